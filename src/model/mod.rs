//! The image formation model, forwards and backwards (paper §II-A, II-C, II-G, IV-A; Eq. 1, 4, 10,
//! 15).
//!
//! ```text
//! log c_Λ = log r_Λ + log BP(θ, φ) − α_Λ (ℓ_a + ℓ_s) − p_a log ℓ_a − p_s log ℓ_s + log cos γ
//! ```
//!
//! p_a = 2, p_s = 0 (`strobe`): the strobe's light falls with 1/ℓ_a² (Eq. 4). The paper drops
//! spreading (`none`) or prints it on both legs (`paper`); for a surface larger than a pixel the
//! camera's leg has none, as the pixel's footprint grows while the irradiance falls. Without
//! spreading α swallows it: the corrected images still look right, so α is called *effective*
//! then and *physical* otherwise.
//!
//! In: light paths (m, rad). Out: logarithms of relative light. The gain G and the lens L of Eq. 10
//! are constant over a log and end in its one exposure. What the water scatters back (Eq. 5, 6) is
//! taken off before: `backscatter`.

mod backscatter;
mod beam_pattern;
mod camera_file;
mod check;
mod daylight;
mod drift;
mod empirical;
mod file;
mod frame_gain;
mod image_grid;
mod light_setting;
pub mod limited;
mod range_factor;
mod region_light;
mod verdict;

pub use backscatter::{
    Backscatter, BackscatterFile, Frustum, SHAPES, ScatterIntegral, ScatterSource, ScatterTable,
};
pub use beam_pattern::{BeamGrid, BeamPattern};
pub use camera_file::{
    CameraFile, GainLawFile, GainsFile, GeometryFile, Metered, ResponseFile, TiltFile, TiltsFile,
    VignettingFile, rounded,
};
pub use daylight::{Daylight, DaylightFile};
pub use drift::{AttenuationOverTime, TimeNode};
pub use empirical::{EmpiricalForm, EmpiricalModel};
pub use file::{
    AttenuationKind, BeamPatternFile, EstimatorAnswer, FORMAT, ImageAnswer, InputFile, LampFile,
    ModelFile, MountCheckFile, RenderingFile, StrobeFile,
};
pub use frame_gain::FrameGainFile;
pub use image_grid::ImageGrid;
pub use light_setting::{LightLaw, LightSettingFile};
pub use range_factor::RangeFactor;
pub use region_light::RegionLight;
pub use verdict::{Verdict, VerdictFigures, VerdictMeasure};

use std::sync::Arc;

use crate::config::{Method, Spreading};
use crate::geometry::{LampPath, LightPath, MIN_COS_INCIDENCE};
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
    /// α (1/m): red, green, blue; the mean over the log
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
    /// daylight on the seafloor, where the log shows it
    pub daylight: Option<Daylight>,
    /// what all of the above leave of the light, where they do not explain it
    pub residual: Option<Arc<RegionLight>>,
    /// light by regions of the image, which full correction uses instead of all of the above
    pub empirical: Option<Arc<EmpiricalModel>>,
}

impl ImagingModel {
    /// The model as it stands at one time.
    pub fn at(&self, stamp: Stamp) -> Self {
        Self {
            attenuation_per_m: self.over_time.at(stamp).unwrap_or(self.attenuation_per_m),
            ..self.clone()
        }
    }

    /// The same under the strobe alone.
    #[must_use]
    pub fn without_daylight(&self) -> Self {
        Self { daylight: None, ..self.clone() }
    }

    /// Log radiance of a white seafloor per band, of the parts that are chosen (Eq. 15); all parts
    /// include daylight (Eq. 3).
    pub fn log_radiance(&self, path: &LightPath, parts: Removal) -> Bands {
        self.log_radiance_in(&self.attenuation_per_m, path, parts)
    }

    /// The same in water of another attenuation (1/m).
    pub fn log_radiance_in(&self, alpha: &Bands, path: &LightPath, parts: Removal) -> Bands {
        let of_lamps = self.log_radiance_of_lamps(alpha, path, parts);
        let Some(daylight) = self.daylight.filter(|_| parts == Removal::FULL) else {
            return of_lamps;
        };
        let daylight = daylight.log_light(alpha, path.seafloor_to_camera_m);
        std::array::from_fn(|b| {
            if b < self.bands { log_sum([of_lamps[b], daylight[b]].into_iter()) } else { 0.0 }
        })
    }

    fn log_radiance_of_lamps(&self, alpha: &Bands, path: &LightPath, parts: Removal) -> Bands {
        let beam = |p: &LightPath| self.beam_pattern.log_gain(p.angles);
        let others = |p: &LightPath, parts: Removal| self.log_beside_beam(alpha, p, parts);
        match path.lamp_paths() {
            legs if legs.is_empty() || !parts.beam => {
                let beam = if parts.beam { beam(path) } else { 0.0 };
                others(path, parts).map(|other| beam + other)
            }
            // The light of several lamps is a sum; what their beams alone contribute is the
            // difference from one lamp that would light a white seafloor as much.
            legs => {
                let of_leg = |leg: &LampPath| {
                    let p = path.via(leg);
                    let common = leg.share.ln() + beam(&p);
                    others(&p, Removal::FULL).map(|other| common + other)
                };
                let of_legs: Vec<Bands> = legs.iter().map(of_leg).collect();
                let kept = others(path, parts.complement());
                std::array::from_fn(|b| log_sum(of_legs.iter().map(|l| l[b])) - kept[b])
            }
        }
    }

    /// All parts but the beam pattern, for one lamp: smooth over the image.
    fn log_beside_beam(&self, alpha: &Bands, path: &LightPath, parts: Removal) -> Bands {
        let spreading = if parts.spreading { self.spreading.log_light(path) } else { 0.0 };
        let incidence = if parts.incidence && self.incidence { log_incidence(path) } else { 0.0 };
        std::array::from_fn(|b| {
            let water = if parts.attenuation { -alpha[b] * path.length_m() } else { 0.0 }; // Eq. 1
            if b < self.bands { water + (spreading + incidence) } else { 0.0 }
        })
    }
}

/// The parts of Eq. 15 that a method divides by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Removal {
    /// BP
    pub beam: bool,
    /// e^(−α ℓ)
    pub attenuation: bool,
    /// ℓ_a^−p_a ℓ_s^−p_s
    pub spreading: bool,
    /// cos γ
    pub incidence: bool,
}

impl Removal {
    /// All of Eq. 15.
    pub const FULL: Self = Self { beam: true, attenuation: true, spreading: true, incidence: true };

    /// What a method of Fig. 10 removes. Baselines divide nothing out: what full correction would
    /// have done is reported.
    pub fn of(method: Method) -> Self {
        match method {
            Method::Attenuation => Self { beam: false, incidence: false, ..Self::FULL },
            Method::BeamPattern => {
                Self { attenuation: false, spreading: false, incidence: false, ..Self::FULL }
            }
            _ => Self::FULL,
        }
    }

    /// Without the beam pattern: smooth over the image.
    pub fn without_beam(self) -> Self {
        Self { beam: false, ..self }
    }

    /// Without attenuation.
    pub fn without_attenuation(self) -> Self {
        Self { attenuation: false, ..self }
    }

    fn complement(self) -> Self {
        Self {
            beam: !self.beam,
            attenuation: !self.attenuation,
            spreading: !self.spreading,
            incidence: !self.incidence,
        }
    }
}

/// Logarithm of a sum, of logarithms.
pub fn log_sum(logs: impl Iterator<Item = f64> + Clone) -> f64 {
    let most = logs.clone().fold(f64::NEG_INFINITY, f64::max);
    most + logs.map(|l| (l - most).exp()).sum::<f64>().ln()
}

/// Logarithm of spreading and incidence: what geometry alone decides.
pub fn log_geometry(spreading: SpreadingModel, incidence: bool, path: &LightPath) -> f64 {
    spreading.log_light(path) + if incidence { log_incidence(path) } else { 0.0 }
}

/// log cos γ. Below 3° of grazing light the plane is no model of the seafloor any more.
fn log_incidence(path: &LightPath) -> f64 {
    path.cos_incidence.max(MIN_COS_INCIDENCE).ln()
}
