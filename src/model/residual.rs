//! What attenuation and beam pattern leave of the light, where they do not explain it: of lamps of
//! unlike patterns, of a lens, of parts in the light. It moves with the camera, so that it depends
//! on the place in the image and the slant range alone.
//!
//! ```text
//! log c = log r + Eq. 15 + a(x, y) − b(x, y) (ℓ_s − ℓ_0) − n(x, y) log(ℓ_s / ℓ_0)     per band
//! ```

use serde::{Deserialize, Serialize};

use super::image_grid::ImageGrid;
use crate::image::Bands;

/// Factor of the light by region of the image, as its logarithm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ResidualLight {
    /// the regions; cubic between their centres
    #[serde(flatten)]
    pub grid: ImageGrid,
    /// ℓ_0 (m)
    pub reference_m: f64,
    /// slant ranges of the samples; others take the nearest (m)
    pub range_m: [f64; 2],
    /// a per band and region, rows first
    pub log_level: Vec<Vec<f64>>,
    /// b (1/m)
    pub slope_per_m: Vec<Vec<f64>>,
    /// n
    pub exponent: Vec<Vec<f64>>,
}

impl ResidualLight {
    /// Whether it can be evaluated.
    ///
    /// # Errors
    /// A sentence about what is missing.
    pub fn check(&self, bands: usize) -> Result<(), String> {
        let parts = [&self.log_level, &self.slope_per_m, &self.exponent];
        self.grid.check(parts, bands).map_err(|what| format!("residual_light needs {what}"))
    }

    /// Derivatives by a, b and n of a region at a slant range.
    pub fn derivatives(&self, slant_range_m: f64) -> [f64; 3] {
        let range_m = slant_range_m.clamp(self.range_m[0], self.range_m[1]);
        [1.0, self.reference_m - range_m, -(range_m / self.reference_m).ln()]
    }

    /// Log of the factor per band at a point of the image plane; 0 for bands that do not exist.
    pub fn log_light(&self, x: f64, y: f64, slant_range_m: f64) -> Bands {
        let around = self.grid.around(x, y);
        let mean = |values: &[f64]| around.iter().map(|(i, w)| values[*i] * w).sum::<f64>();
        let by = self.derivatives(slant_range_m);
        let parts = [&self.log_level, &self.slope_per_m, &self.exponent];
        let of_band = |b: usize| {
            let part = |(part, by): (&&Vec<Vec<f64>>, f64)| part.get(b).map(|v| by * mean(v));
            parts.iter().zip(by).filter_map(part).sum()
        };
        std::array::from_fn(of_band)
    }
}
