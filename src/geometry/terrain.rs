//! Terrain: height of the seafloor over a frame's plane, from all returns along the track.
//!
//! ```text
//! h_i = d − n · x_i                   height of return x_i over the frame's plane n·x = d
//! h(x) = Σ_i a_i k(|x − x_i|),  (K + σ²) a = h    Gaussian process of zero mean
//! ```
//!
//! Away from returns the terrain falls back to the plane. Returns of the seconds before and after a
//! frame are placed by the trajectory, so that terrain ahead is known. An instrument with many
//! beams (a depth image, a point cloud) needs no trajectory: one ping is a surface.
//!
//! In: returns over a plane. Out: heights (m) on a grid in the plane.

use nalgebra::{DMatrix, DVector, Isometry3, Vector3};

use super::plane::SeafloorPlane;
use crate::coordinates::{Body, Point};
use crate::stats::median;
use crate::vehicle::Rig;

/// Half the side of the grid, and the distance up to which returns are used (altitudes).
const REACH: f64 = 2.0;
/// Length scale of the kernel (altitudes).
const LENGTH: f64 = 0.3;
/// Range noise (share of the altitude), its lower bound (m), and the growth of a height's standard
/// deviation by trajectory drift (m/s).
const NOISE_SHARE: f64 = 0.006;
const MIN_NOISE_M: f64 = 0.005;
const DRIFT_M_PER_S: f64 = 0.003;
/// Returns used per frame; more cost time and do not improve the terrain.
const MAX_RETURNS: usize = 140;
/// Fewer returns are no terrain; a single ping with as many is a surface by itself.
pub const MIN_RETURNS: usize = 9;
/// Grid nodes per side.
const NODES: usize = 33;
/// Returns are predicted from those at least this far away in time (s).
const SEPARATION_S: f64 = 0.6;
/// Iterations of the ray intersection; slopes are gentle.
const ITERATIONS: usize = 4;

/// A return over the plane.
#[derive(Clone, Copy, Debug)]
pub struct TerrainSample {
    pub ping: usize,
    pub beam: usize,
    /// position in the plane (m)
    pub u: f64,
    pub v: f64,
    /// over the plane, towards the vehicle (m)
    pub height_m: f64,
    /// time of the ping minus time of the frame (s)
    pub offset_s: f64,
}

/// Axes in a plane; the origin is below the camera.
#[derive(Clone, Copy, Debug)]
pub struct PlaneAxes {
    plane: SeafloorPlane,
    origin: Vector3<f64>,
    u: Vector3<f64>,
    v: Vector3<f64>,
    altitude_m: f64,
}

impl PlaneAxes {
    pub fn new(plane: &SeafloorPlane, rig: &Rig) -> Self {
        let (normal, camera) = (plane.normal.vector(), rig.body_from_optical.origin().vector());
        let altitude_m = plane.camera_altitude_m(rig);
        let u = normal
            .cross(&if normal.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() })
            .normalize();
        let origin = camera + normal * altitude_m;
        Self { plane: *plane, origin, u, v: normal.cross(&u), altitude_m }
    }

    fn coordinates(&self, at: &Vector3<f64>) -> (f64, f64) {
        let from = at - self.origin;
        (self.u.dot(&from), self.v.dot(&from))
    }

    /// (u, v, height) of a return (m); `None` where it is out of reach or implausibly high.
    pub fn project(&self, at: &Vector3<f64>) -> Option<(f64, f64, f64)> {
        let (u, v) = self.coordinates(at);
        let height_m = self.plane.distance_m - self.plane.normal.vector().dot(at);
        (u.hypot(v) < REACH * self.altitude_m && height_m.abs() < self.altitude_m / 2.0)
            .then_some((u, v, height_m))
    }
}

/// Every n-th return, such that at most [`MAX_RETURNS`] are left, evenly over the beams.
fn thinned(samples: Vec<TerrainSample>) -> Vec<TerrainSample> {
    let every = samples.len().div_ceil(MAX_RETURNS).max(1);
    samples.into_iter().filter(|s| (s.ping + s.beam) % every == 0).collect()
}

struct GaussianProcess {
    samples: Vec<TerrainSample>,
    weights: DVector<f64>,
    length_m: f64,
}

impl GaussianProcess {
    fn new(samples: Vec<TerrainSample>, altitude_m: f64) -> Option<Self> {
        let n = samples.len();
        let variance =
            samples.iter().map(|s| s.height_m * s.height_m).sum::<f64>() / n.max(1) as f64;
        let noise = |s: &TerrainSample| {
            (NOISE_SHARE * altitude_m + MIN_NOISE_M).powi(2) + (DRIFT_M_PER_S * s.offset_s).powi(2)
        };
        let length_m = LENGTH * altitude_m;
        let kernel = |a: &TerrainSample, b: &TerrainSample| {
            variance
                * (-((a.u - b.u).powi(2) + (a.v - b.v).powi(2)) / (2.0 * length_m * length_m)).exp()
        };
        let matrix = DMatrix::from_fn(n, n, |i, j| {
            kernel(&samples[i], &samples[j]) + if i == j { noise(&samples[i]) } else { 0.0 }
        });
        let heights = DVector::from_iterator(n, samples.iter().map(|s| s.height_m));
        let weights = matrix.cholesky()?.solve(&heights) * variance;
        Some(Self { samples, weights, length_m })
    }

    /// Height (m) and its slopes along u and v.
    fn at(&self, u: f64, v: f64) -> [f64; 3] {
        let per_square = 1.0 / (self.length_m * self.length_m);
        self.samples.iter().zip(self.weights.iter()).fold([0.0; 3], |[h, du, dv], (sample, w)| {
            let (x, y) = (u - sample.u, v - sample.v);
            let k = w * (-(x * x + y * y) * per_square / 2.0).exp();
            [h + k, du - k * x * per_square, dv - k * y * per_square]
        })
    }
}

/// Heights over a frame's plane.
#[derive(Clone, Debug)]
pub struct Terrain {
    axes: PlaneAxes,
    /// `NODES × NODES`, v-major: height (m) and its slopes along u and v
    nodes: Vec<[f64; 3]>,
    half_side_m: f64,
}

impl Terrain {
    /// `None` where there are too few returns.
    pub fn new(samples: Vec<TerrainSample>, axes: PlaneAxes) -> Option<Self> {
        if samples.len() < MIN_RETURNS {
            return None;
        }
        let process = GaussianProcess::new(thinned(samples), axes.altitude_m)?;
        let half_side_m = REACH * axes.altitude_m;
        let node = |i: usize| (2.0 * i as f64 / (NODES - 1) as f64 - 1.0) * half_side_m;
        let nodes =
            (0..NODES * NODES).map(|i| process.at(node(i % NODES), node(i / NODES))).collect();
        Some(Self { axes, nodes, half_side_m })
    }

    /// The terrain in other coordinates, given the pose of those in the terrain's own.
    #[must_use]
    pub fn seen_from(self, pose: &Isometry3<f64>) -> Self {
        let PlaneAxes { plane, origin, u, v, altitude_m } = self.axes;
        let turn = pose.rotation.inverse();
        let axes = PlaneAxes {
            plane: plane.seen_from(pose),
            origin: turn * (origin - pose.translation.vector),
            u: turn * u,
            v: turn * v,
            altitude_m,
        };
        Self { axes, ..self }
    }

    /// Height (m) and slopes at a point projected onto the plane; 0 beyond the grid.
    fn at(&self, at: &Vector3<f64>) -> [f64; 3] {
        let (u, v) = self.axes.coordinates(at);
        let [x, y] = [u, v].map(|p| (p / self.half_side_m + 1.0) / 2.0 * (NODES - 1) as f64);
        let inside = |p: f64| p >= 0.0 && p < (NODES - 1) as f64;
        if !inside(x) || !inside(y) {
            return [0.0; 3];
        }
        let (i, j) = (x as usize, y as usize);
        let (a, b) = (x - i as f64, y - j as f64);
        let node = |i: usize, j: usize| &self.nodes[j * NODES + i];
        std::array::from_fn(|k| {
            (1.0 - b) * ((1.0 - a) * node(i, j)[k] + a * node(i + 1, j)[k])
                + b * ((1.0 - a) * node(i, j + 1)[k] + a * node(i + 1, j + 1)[k])
        })
    }

    /// Intersection of a ray (unit vector) from `camera` with the terrain: point, distance (m), and
    /// the surface normal (not of unit length).
    pub fn intersect(
        &self,
        camera: &Vector3<f64>,
        ray: &Vector3<f64>,
    ) -> Option<(Point<Body>, f64, Vector3<f64>)> {
        let normal = self.axes.plane.normal.vector();
        let cos = normal.dot(ray);
        let depth = self.axes.plane.distance_m - normal.dot(camera);
        let mut distance = depth / cos;
        let mut here = [0.0; 3];
        for _ in 0..ITERATIONS {
            here = self.at(&(camera + ray * distance));
            distance = (depth - here[0]) / cos;
        }
        let surface = normal + self.axes.u * here[1] + self.axes.v * here[2];
        (distance > 0.0 && surface.dot(ray) > 0.0)
            .then(|| (Point::from_vector(camera + ray * distance), distance, surface))
    }
}

/// Cross-validation over some frames, given as samples and altitude (m): median error of left-out
/// returns against the terrain predicted from the others, divided by that against the plane. 1
/// means that the terrain explains nothing. `None` where there are too few returns.
pub fn prediction_ratio(frames: impl Iterator<Item = (Vec<TerrainSample>, f64)>) -> Option<f64> {
    let (mut by_plane, mut by_terrain) = (Vec::new(), Vec::new());
    for (samples, altitude_m) in frames {
        // Returns close in time are close in space: whole seconds are left out, with a margin.
        for second in [-4.0, -2.0, 0.0, 2.0, 4.0] {
            let others: Vec<TerrainSample> = samples
                .iter()
                .filter(|s| (s.offset_s - second).abs() > 0.5 + SEPARATION_S)
                .copied()
                .collect();
            if others.len() < MIN_RETURNS {
                continue;
            }
            let Some(process) = GaussianProcess::new(thinned(others), altitude_m) else { continue };
            let left_out: Vec<TerrainSample> =
                samples.iter().filter(|s| (s.offset_s - second).abs() <= 0.5).copied().collect();
            // Relative to the mean of each ping: a drift of the trajectory shifts all beams of a
            // ping and is not terrain.
            for of_ping in left_out.chunk_by(|a, b| a.ping == b.ping).filter(|p| p.len() >= 2) {
                let residuals: Vec<f64> =
                    of_ping.iter().map(|s| s.height_m - process.at(s.u, s.v)[0]).collect();
                let mean = |values: &mut dyn Iterator<Item = f64>| {
                    values.sum::<f64>() / of_ping.len() as f64
                };
                let (plane, terrain) = (
                    mean(&mut of_ping.iter().map(|s| s.height_m)),
                    mean(&mut residuals.iter().copied()),
                );
                by_plane.extend(of_ping.iter().map(|s| (s.height_m - plane).abs()));
                by_terrain.extend(residuals.iter().map(|e| (e - terrain).abs()));
            }
        }
    }
    (by_plane.len() >= 50).then(|| median(&by_terrain) / median(&by_plane).max(1e-9))
}

#[cfg(test)]
mod tests {
    use super::super::plane::Support;
    use super::*;
    use crate::coordinates::{Direction, Transform};
    use crate::vehicle::{Camera, Lamps, StrobeMount};

    const ALTITUDE_M: f64 = 2.0;

    /// Level seafloor below a camera at the body's origin, as are all instruments.
    fn axes() -> PlaneAxes {
        let normal = Direction::from_vector(Vector3::z()).expect("a direction");
        let plane = SeafloorPlane {
            normal,
            distance_m: ALTITUDE_M,
            support: Support::LeastSquares,
            returns: 4,
            residual_m: 0.0,
            nearest_ping_s: 0.0,
        };
        let rig = Rig {
            camera: Camera::from_field_of_view(64, 48, 60.0),
            body_from_optical: Transform::identity(),
            body_from_dvl: Transform::identity(),
            strobe: StrobeMount { lamps: Lamps::one(Transform::identity()), source: None },
            camera_motion: None,
        };
        PlaneAxes::new(&plane, &rig)
    }

    /// Pings of four beams every 0.2 s, over heights that are a function of u and v.
    fn samples(height_m: impl Fn(f64, f64) -> f64) -> Vec<TerrainSample> {
        let sample = |i: usize| {
            let (ping, beam) = (i / 4, i % 4);
            let offset_s = 0.2 * ping as f64 - 6.0;
            let (u, v) = (0.3 * offset_s, 0.8 * (beam as f64 - 1.5));
            TerrainSample { ping, beam, u, v, height_m: height_m(u, v), offset_s }
        };
        (0..240).map(sample).collect()
    }

    fn bump(u: f64, v: f64) -> f64 {
        0.2 * (-(u * u + v * v) / 0.5).exp()
    }

    #[test]
    fn process_predicts_heights_and_their_slopes_and_decays_to_the_plane() {
        let grid = (-8..=8).flat_map(|i| (-8..=8).map(move |j| (0.15 * f64::from(i), j)));
        let sample = |(k, (u, j)): (usize, (f64, i32))| {
            let v = 0.15 * f64::from(j);
            TerrainSample { ping: k, beam: 0, u, v, height_m: bump(u, v), offset_s: 0.0 }
        };
        let process =
            GaussianProcess::new(grid.enumerate().map(sample).collect(), ALTITUDE_M).expect("one");
        for (u, v) in [(0.0, 0.0), (0.2, -0.1), (-0.5, 0.3)] {
            let [height, du, dv] = process.at(u, v);
            assert!((height - bump(u, v)).abs() < 0.01, "{height} at {u}, {v}");
            let step = 1e-5;
            let numeric = |a: [f64; 3], b: [f64; 3]| (a[0] - b[0]) / (2.0 * step);
            let by_u = numeric(process.at(u + step, v), process.at(u - step, v));
            let by_v = numeric(process.at(u, v + step), process.at(u, v - step));
            assert!((du - by_u).abs() < 1e-6 && (dv - by_v).abs() < 1e-6, "{du} {dv}");
        }
        assert!(process.at(6.0, 0.0)[0].abs() < 1e-6);
    }

    #[test]
    fn rays_meet_the_terrain_above_the_plane() {
        let terrain = Terrain::new(samples(|_, _| 0.1), axes()).expect("terrain");
        let ray = Vector3::new(0.1, 0.05, 1.0).normalize();
        let (point, distance, _) = terrain.intersect(&Vector3::zeros(), &ray).expect("a point");
        let depth = point.vector().z;
        assert!((depth - (ALTITUDE_M - 0.1)).abs() < 0.01, "{depth}");
        assert!((distance * ray.z - depth).abs() < 1e-9);
        // Beyond the grid it is the plane.
        let ray = Vector3::new(3.0, 0.0, 1.0).normalize();
        let (point, ..) = terrain.intersect(&Vector3::zeros(), &ray).expect("a point");
        assert!((point.vector().z - ALTITUDE_M).abs() < 1e-9);
    }

    #[test]
    fn normals_follow_the_slope() {
        let axes = axes();
        let terrain = Terrain::new(samples(|u, _| 0.2 * u), axes).expect("terrain");
        let (_, _, normal) = terrain.intersect(&Vector3::zeros(), &Vector3::z()).expect("a point");
        let (along, across) = (normal.dot(&axes.u), normal.dot(&axes.v));
        assert!((along - 0.2).abs() < 0.05 && across.abs() < 0.05, "{along} {across}");
    }

    #[test]
    fn few_returns_are_no_terrain() {
        let few = samples(bump).into_iter().take(MIN_RETURNS - 1).collect();
        assert!(Terrain::new(few, axes()).is_none());
        let none = std::iter::once((samples(bump).into_iter().take(40).collect(), ALTITUDE_M));
        assert!(prediction_ratio(none).is_none());
    }

    #[test]
    fn ridges_are_predicted_and_range_noise_is_not() {
        let ratio = |height_m: &dyn Fn(f64, f64) -> f64| {
            prediction_ratio(std::iter::once((samples(height_m), ALTITUDE_M))).expect("a ratio")
        };
        let ridges = ratio(&|u, v| 0.15 * (1.2 * u + 2.0 * v).sin());
        // Differs from return to return without any pattern in the plane.
        let noise = ratio(&|u, v| 0.02 * (1e4 * u + 3e3 * v).sin());
        assert!(ridges < 0.4, "{ridges}");
        assert!(noise > 0.9, "{noise}");
    }

    #[test]
    fn thinning_keeps_every_beam() {
        let kept = thinned(samples(bump));
        assert!(kept.len() <= MAX_RETURNS);
        let of_beam = |beam| kept.iter().filter(|s| s.beam == beam).count();
        assert!((0..4).all(|beam| of_beam(beam) == kept.len() / 4));
    }
}
