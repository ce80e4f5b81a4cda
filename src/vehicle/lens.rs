//! Lens and sensor in a rig file: vignetting and black level (Eq. 7).

use serde::{Deserialize, Serialize};

/// Vignetting model: relative transmission over the image.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Vignetting {
    /// by name
    Named(VignettingName),
    /// a₂, a₄, a₆ of 1 + a₂ r² + a₄ r⁴ + a₆ r⁶, r the tangent of the angle to the optical axis
    Radial([f64; 3]),
}

/// Named vignetting models.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum VignettingName {
    /// fourth power of the cosine of the angle to the optical axis
    Cos4,
}

impl Vignetting {
    /// Relative transmission of a ray with image-plane coordinates x/z, y/z.
    pub fn share(&self, x: f64, y: f64) -> f64 {
        let r2 = x * x + y * y;
        match self {
            Self::Named(VignettingName::Cos4) => (1.0 + r2).powi(-2),
            Self::Radial([a2, a4, a6]) => 1.0 + r2 * (a2 + r2 * (a4 + r2 * a6)),
        }
    }
}

/// What the sensor adds to every pixel value in linear light, as a share of full scale.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum BlackLevel {
    /// the same in all bands
    All(f64),
    /// red, green, blue
    Each([f64; 3]),
}

impl BlackLevel {
    /// Per band.
    pub fn bands(self) -> [f64; 3] {
        match self {
            Self::All(level) => [level; 3],
            Self::Each(levels) => levels,
        }
    }
}
