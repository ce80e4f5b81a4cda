//! Slant ranges of a frame by its light, in the empirical model: the altimeter of a towed camera
//! often does not measure what the camera sees, and the seafloor is not level.
//!
//! ```text
//! ℓ = ℓ_measured e^(s + t · (x, y))      at a point (x, y) of the image plane
//! ```
//! A plane that is higher, or tilted by a small angle, has ranges of this form.

use serde::{Deserialize, Serialize};

/// Factor of the slant ranges of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RangeFactor {
    /// s
    pub log_factor: f64,
    /// t, by x and y of the image plane
    pub log_tilt: [f64; 2],
    /// no plane explains the light of the frame: a lamp failed
    pub is_unexplained: bool,
}

impl RangeFactor {
    /// The factor at a point of the image plane.
    pub fn at(&self, x: f64, y: f64) -> f64 {
        (self.log_factor + self.log_tilt[0] * x + self.log_tilt[1] * y).exp()
    }

    /// Whether all ranges stay as they are.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }
}
