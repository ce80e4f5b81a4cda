//! The image formation model, forwards and backwards (paper §II-A, II-C, II-G, IV-A; Eq. 1, 4, 10,
//! 15).
//!
//! ```text
//! log c_Λ = log r_Λ + log BP(θ, φ) − α_Λ (ℓ_a + ℓ_s) − p_a log ℓ_a − p_s log ℓ_s + log cos γ    Eq. 15
//! ```
//!
//! p_a = 2, p_s = 0 (`strobe`): the strobe's light falls with 1/ℓ_a² (Eq. 4). The paper drops
//! spreading (`none`) or prints it on both legs (`paper`); for a surface larger than a pixel the
//! camera's leg has none, as the pixel's footprint grows while the irradiance falls. Without
//! spreading α swallows it: the corrected pictures still look right, so α is called *effective*
//! then and *physical* otherwise.
//!
//! In: light paths [m, rad]. Out: logarithms of relative light. The gain G and the lens L of Eq. 10
//! are constant over a log and end in its one exposure. What the water scatters back (Eq. 5, 6) is
//! taken off before: `backscatter`.

mod backscatter;
mod beam_pattern;
mod drift;
mod file;
mod light_setting;

pub use backscatter::{Backscatter, Frustum, SHAPES, ScatterIntegral, ScatterTable};
pub use beam_pattern::{BeamGrid, BeamPattern};
pub use drift::{AttenuationOverTime, TimeNode};
pub use file::{
    BackscatterFile, BeamPatternFile, EstimatorAnswer, FORMAT, FrameGainFile, ImageAnswer,
    InputFile, LampFile, ModelFile, MountCheckFile, RenderingFile, StrobeFile,
};
pub use light_setting::{LightLaw, LightSettingFile};

use crate::config::Spreading;
use crate::geometry::{LightPath, MIN_COS_INCIDENCE};
use crate::image::Bands;
use crate::units::Stamp;

/// How light falls with distance: the exponents of Eq. 15.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpreadingModel {
    /// p_a, of the strobe's leg
    pub strobe_leg: f64,
    /// p_s, of the camera's leg
    pub camera_leg: f64,
}

impl SpreadingModel {
    /// The exponents a choice stands for; `fit` begins at the physical ones.
    pub fn of(choice: Spreading) -> Self {
        match choice {
            Spreading::None => Self { strobe_leg: 0.0, camera_leg: 0.0 },
            Spreading::Strobe | Spreading::Fit => Self { strobe_leg: 2.0, camera_leg: 0.0 },
            Spreading::Paper => Self { strobe_leg: 2.0, camera_leg: 2.0 },
        }
    }

    /// Its logarithm for a path.
    pub fn log_light(self, path: &LightPath) -> f64 {
        -self.strobe_leg * path.strobe_to_seafloor_m.ln()
            - self.camera_leg * path.seafloor_to_camera_m.ln()
    }
}

/// What pass one finds and pass two divides by.
#[derive(Clone, Debug)]
pub struct ImagingModel {
    /// 1 (mono) or 3
    pub bands: usize,
    /// α [1/m]: red, green, blue; the mean over the log
    pub attenuation_per_m: Bands,
    /// α(t), where the water changes along the log
    pub over_time: AttenuationOverTime,
    /// p_a and p_s
    pub spreading: SpreadingModel,
    /// whether cos γ is modelled
    pub incidence: bool,
    /// BP
    pub beam_pattern: BeamPattern,
    /// what the water scatters back, where the log shows it
    pub backscatter: Option<Backscatter>,
}

impl ImagingModel {
    /// The model as it stands at one time.
    pub fn at(&self, stamp: Stamp) -> Self {
        Self {
            attenuation_per_m: self.over_time.at(stamp).unwrap_or(self.attenuation_per_m),
            ..self.clone()
        }
    }

    /// Logarithm of all that geometry alone decides: spreading and incidence.
    pub fn log_geometry(&self, path: &LightPath) -> f64 {
        log_geometry(self.spreading, self.incidence, path)
    }

    /// Logarithm of what the water took of one band: −α ℓ.                                     Eq.
    /// 1
    pub fn log_water(&self, path: &LightPath, band: usize) -> f64 {
        -self.attenuation_per_m[band] * path.length_m()
    }

    /// Logarithm of the light that a white seafloor would send back in one band.                Eq.
    /// 15
    pub fn log_light(&self, path: &LightPath, band: usize) -> f64 {
        let by = |p: &LightPath| {
            self.beam_pattern.log_gain(p.angles) + self.log_water(p, band) + self.log_geometry(p)
        };
        match path.lamp_paths() {
            [] => by(path),
            legs => log_sum(legs.iter().map(|leg| leg.share.ln() + by(&path.via(leg)))),
        }
    }
}

/// Logarithm of a sum, of logarithms.
pub fn log_sum(logs: impl Iterator<Item = f64> + Clone) -> f64 {
    let most = logs.clone().fold(f64::NEG_INFINITY, f64::max);
    most + logs.map(|l| (l - most).exp()).sum::<f64>().ln()
}

/// Logarithm of spreading and incidence.
pub fn log_geometry(spreading: SpreadingModel, incidence: bool, path: &LightPath) -> f64 {
    // Below 3° of grazing light the plane is no model of the floor any more.
    spreading.log_light(path)
        + if incidence { path.cos_incidence.max(MIN_COS_INCIDENCE).ln() } else { 0.0 }
}
