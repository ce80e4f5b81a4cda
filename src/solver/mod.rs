//! Attenuation, beam pattern and the reflectance of every tracked point in one robust solve
//! (Eq. 15).
//!
//! ```text
//! y_o = ρ_t + Σ_n w_n B_n − α_Λ(t) ℓ_o [− p log ℓ_a] [+ δb_Λ S_o / D_o] [+ (1 − s_o) δ log d_Λ]
//! y = log D − spreading − log cos γ
//! ```
//!
//! Each group of unknowns is a term ([`terms`]): α per band (at nodes in time where it changes), B
//! on bilinear nodes shared by the bands, optionally the spreading exponent p, backscatter and
//! daylight, what the camera did to the light ([`camera`]), and to first order the geometry (strobe
//! position, clock, mount, tilts). The log reflectance ρ per track and band is eliminated in closed
//! form (`normal`). Weights are robust (`reweight`), standard deviations come from a jackknife over
//! segments of the log (`covariance`); a few numbers of the geometry are found by Gauss-Newton
//! steps of whole solves (`gauss_newton`).
//!
//! After Bryson et al. (JFR 2016) and SUCRe (3DV 2024) in idea, own in form.

mod answer;
pub mod camera;
mod covariance;
mod equation;
mod gauss_newton;
mod normal;
mod observation;
mod problem;
mod reweight;
mod row;
pub mod terms;
#[cfg(test)]
mod tests;

pub use answer::JointAnswer;
pub use covariance::Independence;
pub use equation::{Equation, MIN_DIRECT_SHARE};
pub use gauss_newton::{Minimum, SETTLED, minimize};
pub use normal::{LinearSystem, Normal};
pub use observation::{Observation, PathFor, Sample, Track, sample_path, thinned};
pub use problem::{Fit, ParameterStep, Problem, Solution};
pub use row::Row;

use crate::config::EstimateConfig;
use crate::geometry::LightPath;
use crate::image::Bands;
use crate::model::{Backscatter, BeamGrid, ScatterIntegral, SpreadingModel};
use crate::vehicle::Lamps;
use camera::CameraUnknowns;
pub use terms::CameraSolution;
use terms::Term;
use terms::attenuation::TimeGrid;
use terms::geometry::{Parameter, strobe_position};

/// S_Λ of an observation.
pub type ScatterOf<'f> = dyn Fn(&Observation) -> ScatterIntegral + Sync + 'f;

/// The light path of an observation over its frame's plane tilted about the camera's x and y axes
/// (rad).
pub type TiltedPath<'f> = dyn Fn(&Observation, [f64; 2], Lamps) -> Option<LightPath> + Sync + 'f;

/// Tilts of planes that are assumed level, which make α less certain.
#[derive(Clone, Copy)]
pub struct FreeTilts<'s> {
    /// the tilted light paths
    pub path: &'s TiltedPath<'s>,
    /// standard deviations of the tilt that all planes share, and of each frame's own (rad)
    pub stds: [f64; 2],
}

impl FreeTilts<'_> {
    /// The tilts of an observation's own frame, about either axis.
    pub fn parameters(&self, lamps: Lamps) -> [Parameter<'_>; 2] {
        std::array::from_fn(|axis| Parameter {
            step: TILT_STEP_RAD,
            path: Box::new(move |o: &Observation, step: f64| {
                let mut tilt = [0.0; 2];
                tilt[axis] = step;
                (self.path)(o, tilt, lamps)
            }),
        })
    }
}

/// Step of the numeric derivatives by a tilt (rad).
const TILT_STEP_RAD: f64 = 0.005;

/// What is solved for, and what is held.
#[derive(Clone, Copy)]
pub struct Setup<'s> {
    /// how far the frames' errors are independent
    pub independence: Independence,
    /// 1 or 3
    pub bands: usize,
    /// the beam pattern's grid
    pub grid: BeamGrid,
    /// p_a and p_s of Eq. 15
    pub spreading: SpreadingModel,
    /// whether p_a is an unknown
    pub fit_exponent: bool,
    /// whether the strobe's position came from the same log, which makes α less certain
    pub free_strobe: bool,
    /// tilts that came from the same log
    pub tilts: Option<FreeTilts<'s>>,
    /// backscatter to begin with and S_Λ of an observation, where backscatter is an unknown
    pub scatter: Option<(&'s Backscatter, &'s ScatterOf<'s>)>,
    /// daylight's share of the light to begin with, where daylight is an unknown
    pub daylight: Option<Bands>,
    /// what of the camera is unknown
    pub camera: Option<CameraUnknowns<'s>>,
    /// nodes of α in time, where it changes
    pub segments: Option<&'s TimeGrid>,
    /// reweightings
    pub rounds: usize,
    /// the settings
    pub config: &'s EstimateConfig,
}

impl<'s> Setup<'s> {
    /// Attenuation and beam pattern as the only unknowns.
    pub fn new(
        independence: Independence,
        bands: usize,
        grid: BeamGrid,
        config: &'s EstimateConfig,
    ) -> Self {
        Self {
            independence,
            bands,
            grid,
            spreading: SpreadingModel::of(config.spreading),
            fit_exponent: false,
            free_strobe: false,
            tilts: None,
            scatter: None,
            daylight: None,
            camera: None,
            segments: None,
            rounds: config.rounds,
            config,
        }
    }
}

impl Setup<'_> {
    /// The same without gains of frames as unknowns.
    #[must_use]
    pub fn without_gains(self) -> Self {
        let camera = self.camera.map(|camera| CameraUnknowns { gains: None, ..camera });
        Self { camera, ..self }
    }
}

/// Solves for all tracks; `None` where too little is observed.
pub fn solve(
    tracks: &[Track],
    setup: &Setup<'_>,
    lamps: Lamps,
    paths: &PathFor<'_>,
) -> Option<JointAnswer> {
    let mut problem = Problem::new(tracks, setup, lamps, paths)?;
    let solution = problem.solve(setup.rounds)?;
    // Position and tilts stay; that they may be others makes the answer less certain.
    let differentiated = |p: &[Parameter<'_>]| problem.differentiate(tracks, p, &solution);
    let position = setup.free_strobe.then(|| differentiated(&strobe_position(lamps, paths)));
    let by_tilt = setup.tilts.map(|t| (differentiated(&t.parameters(lamps)), t.stds));
    let tilt = by_tilt.as_ref().map(|(d, stds)| problem.tilt_term(&solution, (d, &[], *stds)));
    let position = position.iter().map(|term| term as &dyn Term);
    let also_free: Vec<_> = position.chain(tilt.iter().map(|term| term as &dyn Term)).collect();
    problem.answer(&solution, &also_free)
}
