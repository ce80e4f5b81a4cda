//! Daylight that reaches the seafloor and the camera (paper §II-A, Eq. 3).
//!
//! ```text
//! c_Λ = r_Λ (strobe's light + d_Λ e^(−α_Λ ℓ_s))
//! ```
//!
//! The sea and the sky are far away: d is the same all over the seafloor, as long as its depth is.

use serde::{Deserialize, Serialize};

use crate::image::Bands;

/// d_Λ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Daylight {
    /// log d_Λ: light of white seafloor under daylight over that under the strobe at 1 m in the
    /// peak of its beam, without water in between; −∞ without daylight
    pub log_strength: Bands,
}

impl Daylight {
    /// Log of the light that reaches the camera, at ℓ_s (m) in water of α (1/m).
    pub fn log_light(&self, alpha: &Bands, seafloor_to_camera_m: f64) -> Bands {
        std::array::from_fn(|b| self.log_strength[b] - alpha[b] * seafloor_to_camera_m)
    }

    /// The same with the level of the beam pattern changed.
    #[must_use]
    pub fn shifted(&self, by: f64) -> Self {
        Self { log_strength: self.log_strength.map(|d| d + by) }
    }
}

/// Daylight in `model.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DaylightFile {
    /// d: light of the seafloor under daylight over that under the strobe at 1 m in the peak of its
    /// beam, both without water in between
    pub strength: Vec<f64>,
    /// its standard deviation
    pub strength_std: Vec<f64>,
    /// median share of it in the light of tracked points
    pub median_share: Vec<f64>,
    /// how much better frames that the solve did not see are predicted with it (share of the loss)
    pub held_out_improvement: f64,
}

impl DaylightFile {
    /// As the model needs it.
    pub fn daylight(&self) -> Daylight {
        let log = |b: usize| self.strength.get(b).copied().unwrap_or_default().max(0.0).ln();
        Daylight { log_strength: std::array::from_fn(log) }
    }
}
