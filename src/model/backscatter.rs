//! Light that the water scatters back on its way (paper §II-B, Eq. 5, 6), with the lamp where it
//! is.
//!
//! ```text
//! B_Λ = b_Λ S_Λ        S_Λ = ∫₀^ℓ_s BP(θ, φ) / l² · e^(−a_Λ (l + s)) ds
//! ```
//! with l the length from the strobe to the place s along the pixel's ray.
//!
//! Eq. 5 has a field that is even along the ray and so depends on range alone; a strobe's is not,
//! and its scattered light depends on where the strobe is: S is single scattering of the strobe's
//! own beam (Jaffe 1990), of constant phase. Strobe and camera ride on one vehicle, so S is one
//! function of ray and distance for a whole log: it is tabulated once. Directions of the beam that
//! no frame showed (near the camera) carry the shown ones on as a Gaussian falls off, times η:
//! their light is much the same in every frame, however high. The log tells η and ζ.
//!
//! Under daylight, and between many lamps, the field is even: S_Λ = (1 − e^(−a_Λ ℓ_s)) / a_Λ
//! (Eq. 6).
//!
//! In: image-plane coordinates x/z, y/z of the ray and ℓ_s (m). Out: light in the unit of `c / (r ·
//! light)` of Eq. 15.

use nalgebra::{Matrix2, SMatrix, SVector, Vector3};
use serde::{Deserialize, Serialize};

use super::BeamPattern;
use super::beam_pattern::filled;
use crate::coordinates::{Body, Optical, Transform};
use crate::geometry::StrobeAngles;
use crate::image::Bands;
use crate::vehicle::Lamps;

/// Rays per axis of the image plane, and distances along each.
const RAYS: (usize, usize) = (25, 19);
const DISTANCES: usize = 64;
/// Steps of the integral between two distances.
const STEPS: usize = 3;
/// A lamp is no point: nearer than this its light does not rise any more (m).
const LEAST_DISTANCE_M: f64 = 0.1;
/// The unseen part of a beam falls off at least like a Gaussian of this width (rad).
const WIDEST_RAD: f64 = 1.0;

/// What light is scattered back.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ScatterSource {
    /// the strobe's own beam (Eq. 5)
    #[default]
    Strobe,
    /// a field that is the same all along the ray (Eq. 6)
    Uniform,
}

/// Strength and attenuation of what is scattered back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Backscatter {
    /// of what light
    pub source: ScatterSource,
    /// b_Λ: scattered light over a white seafloor's, per metre of lit water (1/m)
    pub strength_per_m: Bands,
    /// a_Λ (1/m)
    pub attenuation_per_m: Bands,
    /// η and ζ
    pub shape: [f64; SHAPES],
}

/// Numbers that shape S: η, light from directions of the beam that no frame showed, over what the
/// Gaussian says; and ζ, how much more the water scatters sideways than backwards, over what Henyey
/// and Greenstein say for g = 0.9.
pub const SHAPES: usize = 2;

/// η and ζ before anything is known of them; ocean water lies between even and Henyey-Greenstein.
const UNKNOWN_SHAPE: [f64; SHAPES] = [1.0, 0.5];
/// What η and ζ may be.
const SHAPE_LIMITS: [(f64, f64); SHAPES] = [(0.0, 4.0), (-0.3, 1.5)];

/// S_Λ of one ray down to the seafloor, in parts.
#[derive(Clone, Copy, Debug, Default)]
pub struct ScatterIntegral {
    /// from directions of the beam that frames showed, scattered evenly
    even: Bands,
    /// times η: from the others; times ζ: what is scattered sideways beyond that
    shaped: [Bands; SHAPES],
}

impl ScatterIntegral {
    /// Of an even field (Eq. 6), without shapes.
    fn uniform(attenuation_per_m: &Bands, seafloor_to_camera_m: f64) -> Self {
        let even = attenuation_per_m.map(|a| {
            let depth = a * seafloor_to_camera_m;
            if depth > 1e-6 { -(-depth).exp_m1() / a } else { seafloor_to_camera_m }
        });
        Self { even, ..Self::default() }
    }

    /// S_Λ.
    pub fn of_band(&self, band: usize, shape: &[f64; SHAPES]) -> f64 {
        self.even[band] + self.shaped.iter().zip(shape).map(|(part, k)| part[band] * k).sum::<f64>()
    }

    /// Its derivatives by η and ζ.
    pub fn by_shape(&self, band: usize) -> [f64; SHAPES] {
        self.shaped.map(|part| part[band])
    }
}

/// Backscatter in `model.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BackscatterFile {
    /// of what light
    #[serde(default)]
    pub source: ScatterSource,
    /// b: scattered light over a white seafloor's, per metre of lit water, in the unit of the log's
    /// light (1/m)
    pub strength_per_m: Vec<f64>,
    /// its standard deviation (1/m)
    pub strength_std_per_m: Vec<f64>,
    /// the attenuation it is subject to (1/m)
    pub attenuation_per_m: Vec<f64>,
    /// η and ζ: light from directions of the beam that no frame showed, and light scattered
    /// sideways (docs/method.md)
    pub shape: [f64; SHAPES],
    /// median share of it in the light of tracked points
    pub median_share: Vec<f64>,
    /// how much better frames that the solve did not see are predicted with it (share of the loss)
    pub held_out_improvement: f64,
}

impl BackscatterFile {
    /// As the model needs it.
    pub fn backscatter(&self) -> Backscatter {
        let bands =
            |values: &[f64]| std::array::from_fn(|b| values.get(b).copied().unwrap_or_default());
        Backscatter {
            source: self.source,
            strength_per_m: bands(&self.strength_per_m),
            attenuation_per_m: bands(&self.attenuation_per_m),
            shape: self.shape,
        }
    }
}

impl Backscatter {
    /// Nothing, and nothing known of the unseen beam.
    pub const NONE: Self = Self {
        source: ScatterSource::Strobe,
        strength_per_m: [0.0; 3],
        attenuation_per_m: [0.0; 3],
        shape: UNKNOWN_SHAPE,
    };

    /// Moves the shape as far as it may.
    pub fn reshape(&mut self, step: [f64; SHAPES]) {
        for ((k, step), (least, most)) in self.shape.iter_mut().zip(step).zip(SHAPE_LIMITS) {
            *k = (*k + step.clamp(-0.5, 0.5)).clamp(least, most);
        }
    }

    /// B_Λ = b_Λ S_Λ.
    pub fn light(&self, scatter: &ScatterIntegral) -> Bands {
        std::array::from_fn(|b| self.strength_per_m[b] * scatter.of_band(b, &self.shape))
    }
}

/// The part of the image and the distances that a table covers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frustum {
    /// least and largest x/z
    pub x: (f64, f64),
    /// least and largest y/z
    pub y: (f64, f64),
    /// farthest seafloor (m)
    pub farthest_m: f64,
}

/// S_Λ over rays and distances.
#[derive(Clone, Debug)]
pub enum ScatterTable {
    /// of the strobe's light
    Strobe {
        /// the rays and distances
        frustum: Frustum,
        /// rays (y major) × distances × (even, shaped)
        values: Vec<[[f32; 3]; 1 + SHAPES]>,
    },
    /// of an even field, in closed form
    Uniform {
        /// a_Λ (1/m)
        attenuation_per_m: Bands,
    },
}

impl Frustum {
    /// The smallest that holds all of these rays (x/z, y/z, distance (m)).
    pub fn around(rays: impl Iterator<Item = (f64, f64, f64)>) -> Self {
        let empty = Self { x: (0.0, 0.0), y: (0.0, 0.0), farthest_m: 0.0 };
        rays.fold(empty, |f, (x, y, s)| Self {
            x: (f.x.0.min(x), f.x.1.max(x)),
            y: (f.y.0.min(y), f.y.1.max(y)),
            farthest_m: f.farthest_m.max(s),
        })
    }
}

impl ScatterTable {
    /// Of the strobe's light: integrates along every ray.
    pub fn of_strobe(
        beam: &BeamPattern,
        body_from_optical: Transform<Body, Optical>,
        lamps: &Lamps,
        attenuation_per_m: &Bands,
        frustum: Frustum,
    ) -> Self {
        let intensity = Intensity::new(beam);
        let of_lamp = |(pose, share): (nalgebra::Isometry3<f64>, f64)| {
            let optical_from_lamp = body_from_optical.inverse().isometry() * pose;
            (optical_from_lamp.translation.vector, optical_from_lamp.rotation.inverse(), share)
        };
        let lamps: Vec<_> = lamps.poses().map(of_lamp).collect();
        let mut values = Vec::with_capacity(RAYS.0 * RAYS.1 * DISTANCES);
        for row in 0..RAYS.1 {
            for column in 0..RAYS.0 {
                let between = |(a, b): (f64, f64), i: usize, n: usize| {
                    a + (b - a) * i as f64 / (n - 1) as f64
                };
                let ray = Vector3::new(
                    between(frustum.x, column, RAYS.0),
                    between(frustum.y, row, RAYS.1),
                    1.0,
                )
                .normalize();
                let mut sums = [[0.0; 3]; 1 + SHAPES];
                values.push([[0.0; 3]; 1 + SHAPES]);
                for k in 1..DISTANCES {
                    let (from, to) = (frustum.distance(k - 1), frustum.distance(k));
                    let step = (to - from) / STEPS as f64;
                    for i in 0..STEPS {
                        let s = from + (i as f64 + 0.5) * step;
                        for (lamp, lamp_from_optical, share) in &lamps {
                            let from_lamp = ray * s - lamp;
                            let (intensity, is_seen) =
                                intensity.towards(&(lamp_from_optical * from_lamp));
                            let l = from_lamp.norm();
                            let lit = share * intensity / l.max(LEAST_DISTANCE_M).powi(2) * step;
                            // Light comes along from_lamp and leaves against the ray.
                            let excess = sideways(-from_lamp.dot(&ray) / l.max(1e-9));
                            for (b, a) in attenuation_per_m.iter().enumerate() {
                                let arriving = lit * (-a * (l + s)).exp();
                                sums[usize::from(!is_seen)][b] += arriving;
                                sums[2][b] += if is_seen { arriving * excess } else { 0.0 };
                            }
                        }
                    }
                    values.push(sums.map(|sum| sum.map(|v| v as f32)));
                }
            }
        }
        Self::Strobe { frustum, values }
    }

    /// S_Λ of a ray down to the seafloor; beyond the table its edge.
    pub fn at(&self, x: f64, y: f64, seafloor_to_camera_m: f64) -> ScatterIntegral {
        let (frustum, values) = match self {
            Self::Strobe { frustum, values } => (frustum, values),
            Self::Uniform { attenuation_per_m } => {
                return ScatterIntegral::uniform(attenuation_per_m, seafloor_to_camera_m);
            }
        };
        let place = |v: f64, (a, b): (f64, f64), n: usize| {
            let at = ((v - a) / (b - a).max(1e-12) * (n - 1) as f64).clamp(0.0, (n - 1) as f64);
            let i = (at as usize).min(n - 2);
            (i, (at - i as f64) as f32)
        };
        let ((column, p), (row, q)) = (place(x, frustum.x, RAYS.0), place(y, frustum.y, RAYS.1));
        let (k, share) = place(
            (seafloor_to_camera_m / frustum.farthest_m.max(1e-12)).max(0.0).sqrt(),
            (0.0, 1.0),
            DISTANCES,
        );
        let mut parts = [[0.0; 3]; 1 + SHAPES];
        for (ray, weight) in [
            ((row, column), (1.0 - p) * (1.0 - q)),
            ((row, column + 1), p * (1.0 - q)),
            ((row + 1, column), (1.0 - p) * q),
            ((row + 1, column + 1), p * q),
        ] {
            let at = (ray.0 * RAYS.0 + ray.1) * DISTANCES + k;
            for (part, (near, far)) in parts.iter_mut().zip(values[at].iter().zip(&values[at + 1]))
            {
                (0..3).for_each(|b| {
                    part[b] += f64::from(weight * (near[b] + (far[b] - near[b]) * share));
                });
            }
        }
        ScatterIntegral { even: parts[0], shaped: [parts[1], parts[2]] }
    }
}

/// Henyey and Greenstein's phase function of g = 0.9 over its value straight back, less 1.
fn sideways(cos_scattering: f64) -> f64 {
    let g: f64 = 0.9;
    ((1.0 + g) * (1.0 + g) / (1.0 + g * g - 2.0 * g * cos_scattering)).powf(1.5) - 1.0
}

impl Frustum {
    /// Distances stand closer near the camera, where the integrand changes most.
    fn distance(&self, k: usize) -> f64 {
        self.farthest_m * (k as f64 / (DISTANCES - 1) as f64).powi(2)
    }
}

/// BP, carried on where it was never seen: from its own edge outwards, falling off as a Gaussian
/// fitted to all of it does.
struct Intensity<'b> {
    beam: &'b BeamPattern,
    /// every node's log BP
    carried_on: Vec<f64>,
    /// log BP ≈ k · (1, θ, φ, θ², θφ, φ²)
    gaussian: SVector<f64, 6>,
}

fn terms(a: &StrobeAngles) -> SVector<f64, 6> {
    let (t, p) = (a.theta_rad, a.phi_rad);
    SVector::from([1.0, t, p, t * t, t * p, p * p])
}

impl<'b> Intensity<'b> {
    fn new(beam: &'b BeamPattern) -> Self {
        let nodes = beam.nodes();
        let angles = |index: usize| StrobeAngles {
            theta_rad: nodes.angle(index / nodes.count),
            phi_rad: nodes.angle(index % nodes.count),
        };
        let by_node = beam.by_node();
        let mut normal = SMatrix::<f64, 6, 6>::identity() * 1e-6;
        let mut right = SVector::<f64, 6>::zeros();
        for (index, value) in by_node.iter().enumerate() {
            let Some(value) = value else { continue };
            let x = terms(&angles(index));
            normal += x * x.transpose();
            right += x * *value;
        }
        let mut gaussian = normal.cholesky().map_or_else(SVector::zeros, |c| c.solve(&right));
        // What was seen of a wide beam may curve upwards; no lamp does so all around.
        let curvature =
            Matrix2::new(2.0 * gaussian[3], gaussian[4], gaussian[4], 2.0 * gaussian[5])
                .symmetric_eigen();
        let held = curvature.eigenvalues.map(|v| v.min(-1.0 / (WIDEST_RAD * WIDEST_RAD)));
        let curvature = curvature.eigenvectors
            * Matrix2::from_diagonal(&held)
            * curvature.eigenvectors.transpose();
        (gaussian[3], gaussian[4], gaussian[5]) =
            (curvature[(0, 0)] / 2.0, curvature[(0, 1)], curvature[(1, 1)] / 2.0);
        let rough: Vec<f64> =
            (0..by_node.len()).map(|index| gaussian.dot(&terms(&angles(index)))).collect();
        let beyond: Vec<Option<f64>> =
            by_node.iter().zip(&rough).map(|(v, rough)| v.map(|v| v - rough)).collect();
        let carried_on = filled(nodes.count, &beyond)
            .iter()
            .zip(&rough)
            .map(|(d, rough)| (d + rough).min(0.0))
            .collect();
        Self { beam, carried_on, gaussian }
    }

    /// Intensity in a direction, and whether a frame showed it.
    fn towards(&self, d: &Vector3<f64>) -> (f64, bool) {
        if d.z <= 0.0 {
            return (0.0, false);
        }
        let angles = StrobeAngles { theta_rad: d.y.atan2(d.z), phi_rad: d.x.atan2(d.z) };
        let nodes = self.beam.nodes();
        let at_edge = self.log_gain(angles);
        let log_gain = if nodes.holds(angles) {
            at_edge
        } else {
            let held = |a: f64| a.clamp(-nodes.limit_rad, nodes.limit_rad);
            let edge =
                StrobeAngles { theta_rad: held(angles.theta_rad), phi_rad: held(angles.phi_rad) };
            at_edge + self.gaussian.dot(&(terms(&angles) - terms(&edge))).min(0.0)
        };
        (log_gain.exp(), self.beam.is_seen(angles))
    }

    fn log_gain(&self, angles: StrobeAngles) -> f64 {
        self.beam
            .nodes()
            .weights(angles)
            .iter()
            .map(|(node, weight)| self.carried_on[*node] * weight)
            .sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::BeamGrid;

    /// Against the integral in closed form: lamp at the camera, even beam, no water: ∫ ds/s² from
    /// where the lamp ends.
    #[test]
    fn the_table_holds_the_integral() {
        let beam = BeamPattern::uniform(BeamGrid::new(41, 70.0));
        let frustum = Frustum { x: (-0.5, 0.5), y: (-0.4, 0.4), farthest_m: 5.0 };
        let table = ScatterTable::of_strobe(
            &beam,
            Transform::identity(),
            &Lamps::one(Transform::identity()),
            &[0.0; 3],
            frustum,
        );
        let expected = |s: f64| 1.0 / LEAST_DISTANCE_M + (1.0 / LEAST_DISTANCE_M - 1.0 / s);
        for s in [0.5, 1.7, 4.3] {
            let is = table.at(0.13, -0.21, s).of_band(0, &[1.0, 0.0]);
            assert!(
                (is / expected(s) - 1.0).abs() < 0.02,
                "{is} instead of {} at {s} m",
                expected(s)
            );
        }
        // A lamp beside the camera lights the near water less, and the far part of the ray as much.
        let beside = ScatterTable::of_strobe(
            &beam,
            Transform::identity(),
            &Lamps::one(Transform::from_parts([0.8, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])),
            &[0.1, 0.1, 0.1],
            frustum,
        );
        let (s, l) = (3.05f64, (3.05f64.powi(2) + 0.64).sqrt());
        let slope = (beside.at(0.0, 0.0, 3.1).of_band(1, &[1.0, 0.0])
            - beside.at(0.0, 0.0, 3.0).of_band(1, &[1.0, 0.0]))
            / 0.1;
        assert!((slope / ((-0.1 * (s + l)).exp() / (l * l)) - 1.0).abs() < 0.03, "{slope}");
    }
}
