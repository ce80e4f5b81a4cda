//! One observation as a linear equation in the unknowns.
//!
//! The equation of band Λ is `y = ρ + Σ x · unknown`, where y is the log of the direct light, less
//! what geometry alone decides. Light from several lamps and daylight add up, and backscatter is
//! added to the direct light: both sums are linearised about the previous solution.

use super::{Observation, Setup};
use crate::geometry::LightPath;
use crate::image::Bands;
use crate::model::{Backscatter, ScatterIntegral, SpreadingModel, log_geometry, log_sum};
use crate::solver::camera::ReadingCurve;
use crate::vehicle::MAX_LAMPS;

/// Where less than this share of a band's light is direct, it is no measurement any more.
pub const MIN_DIRECT_SHARE: f64 = 0.05;

/// One observation as numbers of the linear problem.
pub struct Equation {
    /// index of the frame
    pub frame: u32,
    /// index among all observations, in the order of the tracks
    pub source: usize,
    /// index among the equations
    pub index: usize,
    /// what the light path contributes
    pub path: PathTerms,
    /// how direct light becomes the observed light
    pub reading: Reading,
    /// ϱ²: squared image radius, where the camera is solved for
    pub radius_squared: f64,
    /// log of the direct light less geometry, by the previous solution
    pub y: Bands,
}

/// The part of the light path: of several lamps, and with daylight, the linearised sum.
pub struct PathTerms {
    /// nodes of the beam pattern's grid and their weights, `nodes_used` of them
    pub nodes: [(usize, f64); 4 * MAX_LAMPS],
    /// four per lamp
    pub nodes_used: usize,
    /// ℓ (m) of the lamps' light
    pub length_m: f64,
    /// log ℓ_a, ℓ_a in metres
    pub log_strobe_leg: f64,
    /// the lamps' share of the direct light; 1 without daylight
    pub lamp_share: Bands,
    /// spreading and cos γ; of a sum also its remainder, per band
    pub geometry: Bands,
    /// the same of the lamps' light alone
    lamp_geometry: Bands,
    /// ℓ_s (m)
    pub seafloor_to_camera_m: f64,
    /// the lamps, where there are several
    pub legs: Vec<LampTerms>,
}

/// One lamp's part of a light path.
#[derive(Clone, Copy)]
pub struct LampTerms {
    /// nodes of the beam pattern's grid and their weights
    pub nodes: [(usize, f64); 4],
    /// spreading, cos γ and the log of the lamp's share of the light
    pub log_geometry: f64,
    /// ℓ_a (m)
    pub length_m: f64,
}

/// How direct light D becomes the observed light c: with backscatter and black level, through the
/// camera's curve.
pub struct Reading {
    /// log c
    pub log_color: [f32; 3],
    /// S_Λ
    pub scatter: ScatterIntegral,
    /// log c by the previous solution
    pub predicted: Bands,
    /// the light at the sensor over D
    pub light_per_direct: Bands,
    /// the derivative of log c by log D: D / (D + B) for a correct curve
    pub direct_share: Bands,
    /// 1 / D, D by the previous solution. The observed light would carry its own error into the
    /// derivative, and the two together would bias b.
    pub per_direct: Bands,
}

impl Equation {
    /// The equation of an observation; `None` where `is_solved` rejects a node of the beam pattern
    /// that it needs.
    pub fn new(
        setup: &Setup<'_>,
        is_solved: &dyn Fn(usize) -> bool,
        observation: &Observation,
        path: &LightPath,
        source: usize,
    ) -> Option<Self> {
        let path = PathTerms::new(setup, is_solved, path)?;
        let log_color = observation.sample.log_color;
        let (scatter, backscatter) = setup
            .scatter
            .map_or((ScatterIntegral::default(), Backscatter::NONE), |(backscatter, scatter)| {
                (scatter(observation), *backscatter)
            });
        let (mut y, mut reading) = ([0.0; 3], Reading::of(log_color));
        let scattered = backscatter.light(&scatter);
        reading.scatter = scatter;
        for b in 0..setup.bands {
            let observed = f64::from(log_color[b]);
            let (log_light, slope, black_level) = setup.camera.map_or((observed, 1.0, 0.0), |c| {
                let (log_light, slope) = c.start.light(observed);
                (log_light, slope, c.start.black_level[b])
            });
            let all = log_light.exp();
            let direct = (all - scattered[b] - black_level).max(MIN_DIRECT_SHARE * all);
            y[b] = direct.ln() - path.geometry[b];
            reading.set(b, observed, slope, [direct, all]);
        }
        let radius_squared = setup.camera.map_or(0.0, |c| c.radius.squared(&observation.sample));
        let frame = observation.frame;
        Some(Self { frame, source, index: 0, path, reading, radius_squared, y })
    }

    /// An equation whose only content is a residual: for solves that hold the model fixed.
    pub fn of_residual(frame: u32, residual: f64) -> Self {
        let path = PathTerms {
            nodes: [(0, 0.0); 4 * MAX_LAMPS],
            nodes_used: 0,
            length_m: 0.0,
            log_strobe_leg: 0.0,
            lamp_share: [1.0; 3],
            geometry: [0.0; 3],
            lamp_geometry: [0.0; 3],
            seafloor_to_camera_m: 0.0,
            legs: Vec::new(),
        };
        let (reading, y) = (Reading::of([0.0; 3]), [residual, 0.0, 0.0]);
        Self { frame, source: 0, index: 0, path, reading, radius_squared: 0.0, y }
    }

    /// Linearises the sum over several lamps and daylight about a solution (see
    /// `PathTerms::linearize`).
    pub fn linearize_light(&mut self, state: &LightState<'_>) {
        let before = self.path.geometry;
        self.path.linearize(state);
        (0..3).for_each(|b| self.y[b] += before[b] - self.path.geometry[b]);
    }

    /// Linearises the reading about the direct light that a solution predicts.
    pub fn linearize_reading(
        &mut self,
        log_direct: &Bands,
        (backscatter, curve): (&Backscatter, &ReadingCurve),
        bands: usize,
    ) {
        let scattered = backscatter.light(&self.reading.scatter);
        for b in 0..bands {
            let geometry = self.path.geometry[b];
            let added = scattered[b] + curve.black_level[b];
            let direct = (log_direct[b] + geometry).exp().max(MIN_DIRECT_SHARE * added.abs());
            // A negative black level never takes all of the light.
            let all = (direct + added).max(MIN_DIRECT_SHARE * direct);
            let (predicted, slope) = curve.reading(all.ln());
            self.reading.set(b, predicted, slope, [direct, all]);
            let misfit = f64::from(self.reading.log_color[b]) - predicted;
            self.y[b] = direct.ln() - geometry + misfit / self.reading.direct_share[b];
        }
    }
}

impl Reading {
    /// The same light before and after the camera.
    fn of(log_color: [f32; 3]) -> Self {
        Self {
            log_color,
            scatter: ScatterIntegral::default(),
            predicted: log_color.map(f64::from),
            light_per_direct: [1.0; 3],
            direct_share: [1.0; 3],
            per_direct: [0.0; 3],
        }
    }

    /// The state of one band: reading, slope of the curve there, direct light and all light.
    fn set(&mut self, band: usize, predicted: f64, slope: f64, [direct, all]: [f64; 2]) {
        self.predicted[band] = predicted;
        self.light_per_direct[band] = all / direct;
        self.direct_share[band] = direct / all * slope;
        self.per_direct[band] = 1.0 / direct;
    }
}

/// log BP from nodes of the grid and their weights.
pub type LogBeam<'f> = dyn Fn(&[(usize, f64)]) -> f64 + 'f;

/// A solution as the sum over lamps and daylight needs it.
pub struct LightState<'s> {
    /// 1 or 3
    pub bands: usize,
    /// log d_Λ, where there is daylight
    pub log_daylight: Option<Bands>,
    /// α at the observation's frame (1/m)
    pub attenuation_per_m: Bands,
    /// the strobe leg's spreading exponent, where it is an unknown, else 0
    pub exponent: f64,
    /// log BP from nodes and weights
    pub log_beam: &'s LogBeam<'s>,
}

impl PathTerms {
    fn new(setup: &Setup<'_>, is_solved: &dyn Fn(usize) -> bool, path: &LightPath) -> Option<Self> {
        let of_lamp = |p: &LightPath, share: f64| LampTerms {
            nodes: setup.grid.weights(p.angles),
            log_geometry: share.ln()
                + log_geometry(setup.spreading_held(), setup.config.incidence, p),
            length_m: p.strobe_to_seafloor_m,
        };
        let legs: Vec<LampTerms> =
            path.lamp_paths().iter().map(|leg| of_lamp(&path.via(leg), leg.share)).collect();
        let effective = of_lamp(path, 1.0);
        let nodes_used = if legs.is_empty() { 4 } else { 4 * legs.len() };
        let mut nodes = [(0, 0.0); 4 * MAX_LAMPS];
        let all = legs.iter().chain(legs.is_empty().then_some(&effective)).flat_map(|l| l.nodes);
        nodes.iter_mut().zip(all).for_each(|(node, of_lamp)| *node = of_lamp);
        let needed = |(node, weight): &(usize, f64)| is_solved(*node) || *weight <= 1e-9;
        nodes[..nodes_used].iter().all(needed).then(|| Self {
            nodes,
            nodes_used,
            length_m: path.length_m(),
            log_strobe_leg: path.strobe_to_seafloor_m.ln(),
            lamp_share: [1.0; 3],
            geometry: [effective.log_geometry; 3],
            lamp_geometry: [effective.log_geometry; 3],
            seafloor_to_camera_m: path.seafloor_to_camera_m,
            legs,
        })
    }

    /// ℓ (m), of daylight ℓ_s, weighted by their shares: −∂ log D / ∂α.
    pub fn length_in(&self, band: usize) -> f64 {
        let share = self.lamp_share[band];
        share * self.length_m + (1.0 - share) * self.seafloor_to_camera_m
    }

    /// Linearises the sum over lamps, then that of lamps and daylight.
    fn linearize(&mut self, state: &LightState<'_>) {
        if !self.legs.is_empty() {
            self.linearize_lamps(state);
        }
        self.geometry = self.lamp_geometry;
        if let Some(log_daylight) = &state.log_daylight {
            self.linearize_daylight(state, log_daylight);
        }
    }

    /// log(e^u + e^v) = s u + (1 − s) v + H(s), where u is the log of the lamps' light, v =
    /// log d − α ℓ_s that of daylight (Eq. 3), s the lamps' share and H(s) the entropy of the
    /// shares. By band: water takes red daylight on its way down.
    fn linearize_daylight(&mut self, state: &LightState<'_>, log_daylight: &Bands) {
        let log_beam = (state.log_beam)(&self.nodes[..self.nodes_used]);
        for b in 0..state.bands {
            let alpha = state.attenuation_per_m[b];
            let of_lamps = log_beam - alpha * self.length_m - state.exponent * self.log_strobe_leg
                + self.lamp_geometry[b];
            let daylight = log_daylight[b] - alpha * self.seafloor_to_camera_m;
            let share = 1.0 / (1.0 + (daylight - of_lamps).exp());
            self.lamp_share[b] = share;
            self.geometry[b] =
                share * self.lamp_geometry[b] + (1.0 - share) * log_daylight[b] + entropy(share);
        }
    }

    /// log Σ_k e^{u_k} ≈ Σ_k s_k u_k + remainder, where u_k = B_k − α ℓ_k + geometry of lamp k and
    /// s_k is its share of the light.
    fn linearize_lamps(&mut self, state: &LightState<'_>) {
        // Without geometry, as far as it is not an unknown.
        let log_light: Vec<Bands> = self
            .legs
            .iter()
            .map(|l| {
                let log_beam = (state.log_beam)(&l.nodes);
                std::array::from_fn(|b| {
                    log_beam
                        - state.attenuation_per_m[b] * l.length_m
                        - state.exponent * l.length_m.ln()
                })
            })
            .collect();
        let sums: Bands = std::array::from_fn(|b| {
            log_sum(self.legs.iter().zip(&log_light).map(move |(l, u)| l.log_geometry + u[b]))
        });
        // One share for all bands: the remainder makes each band exact at the solution.
        let share = |k: usize| {
            let of_band = |b: usize| (self.legs[k].log_geometry + log_light[k][b] - sums[b]).exp();
            (0..state.bands).map(of_band).sum::<f64>() / state.bands as f64
        };
        let shares: Vec<f64> = (0..self.legs.len()).map(share).collect();
        self.length_m = self.seafloor_to_camera_m;
        self.log_strobe_leg = self.legs.iter().zip(&shares).map(|(l, s)| s * l.length_m.ln()).sum();
        self.lamp_geometry = sums;
        for (k, (leg, share)) in self.legs.iter().zip(&shares).enumerate() {
            for (slot, (node, weight)) in self.nodes[4 * k..4 * k + 4].iter_mut().zip(leg.nodes) {
                *slot = (node, share * weight);
            }
            self.length_m += share * leg.length_m;
            self.lamp_geometry.iter_mut().zip(log_light[k]).for_each(|(g, u)| *g -= share * u);
        }
    }
}

/// −s log s − (1 − s) log(1 − s).
fn entropy(share: f64) -> f64 {
    let of = |s: f64| if s > 0.0 { -s * s.ln() } else { 0.0 };
    of(share) + of(1.0 - share)
}

impl Setup<'_> {
    /// Spreading, except for an exponent that is an unknown.
    pub(super) fn spreading_held(&self) -> SpreadingModel {
        if self.fit_exponent {
            SpreadingModel { strobe_leg: 0.0, ..self.spreading }
        } else {
            self.spreading
        }
    }
}
