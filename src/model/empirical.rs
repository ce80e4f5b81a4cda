//! Light of a dive by regions of the image, without physical constants: for dives whose geometry or
//! overlap does not determine attenuation.
//!
//! ```text
//! c = r e^(a − b (ℓ_s − ℓ_0)) + B      per region and band; cubic between regions
//! ```
//!
//! a contains beam pattern, vignetting and exposure, b attenuation, spreading and whatever else
//! changes with the slant range ℓ_s. None of them is a property of the water.

use serde::{Deserialize, Serialize};

use super::region_light::RegionLight;
use crate::image::Bands;

/// Form of an empirical model, the simplest last.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EmpiricalForm {
    /// as `Backscatter`, and slant ranges of single frames corrected by their own light
    Ranges,
    /// direct light that falls with slant range, and backscatter
    Backscatter,
    /// direct light that falls with slant range
    Range,
    /// mean of the log by region
    FrameAverage,
    /// one factor per band
    WhiteBalance,
}

impl EmpiricalForm {
    /// All forms, the simplest last.
    pub const ALL: [Self; 5] =
        [Self::Ranges, Self::Backscatter, Self::Range, Self::FrameAverage, Self::WhiteBalance];

    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ranges => "ranges",
            Self::Backscatter => "backscatter",
            Self::Range => "range",
            Self::FrameAverage => "frame-average",
            Self::WhiteBalance => "white-balance",
        }
    }

    /// Its name in texts.
    pub fn word(self) -> &'static str {
        match self {
            Self::Ranges => "light over slant range, backscatter, refined ranges",
            Self::Backscatter => "light over slant range, backscatter",
            Self::Range => "light over slant range",
            Self::FrameAverage => "mean of all frames",
            Self::WhiteBalance => "white balance",
        }
    }
}

/// Direct light and backscatter on a grid of regions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EmpiricalModel {
    /// the form that was chosen
    pub form: EmpiricalForm,
    /// direct light: a is the log of a share of full scale, n is 0
    #[serde(flatten)]
    pub direct: RegionLight,
    /// B (share of full scale)
    pub backscatter: Vec<Vec<f64>>,
}

impl EmpiricalModel {
    /// Whether the model can be evaluated.
    ///
    /// # Errors
    /// A sentence about what is missing.
    pub fn check(&self, bands: usize) -> Result<(), String> {
        let backscatter = || self.direct.grid.check([&self.backscatter], bands);
        let checked = self.direct.check(bands).and_then(|()| backscatter());
        checked.map_err(|what| format!("empirical needs {what}"))
    }

    /// Log of direct light of a seafloor of reflectance 1, and backscatter, per band.
    pub fn light(&self, x: f64, y: f64, slant_range_m: f64) -> (Bands, Bands) {
        let around = self.direct.grid.around(x, y);
        let mean = |values: &Vec<f64>| around.iter().map(|(i, w)| values[*i] * w).sum::<f64>();
        let scattered =
            std::array::from_fn(|b| self.backscatter.get(b).map_or(0.0, |v| mean(v).max(0.0)));
        (self.direct.at(&around, slant_range_m), scattered)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::ImageGrid;

    #[test]
    fn light_is_smooth_over_the_image_and_falls_with_range() {
        let model = EmpiricalModel {
            form: EmpiricalForm::Backscatter,
            direct: RegionLight {
                grid: ImageGrid { x: [-1.0, 1.0], y: [-0.5, 0.5], columns: 4, rows: 2 },
                reference_m: 2.0,
                range_m: [1.0, 3.0],
                log_level: vec![vec![0.0, 1.0, 2.0, 3.0, 10.0, 11.0, 12.0, 13.0]],
                slope_per_m: vec![vec![0.5; 8]],
                exponent: Vec::new(),
            },
            backscatter: vec![vec![0.01; 8]],
        };
        assert_eq!(model.check(1), Ok(()));
        assert!(model.check(3).is_err());
        let (log_direct, scattered) = model.light(0.0, 0.0, 2.5);
        assert!((log_direct[0] - (6.5 - 0.25)).abs() < 1e-12, "{log_direct:?}");
        assert!((scattered[0] - 0.01).abs() < 1e-12);
        // Beyond the outermost centres it goes straight on, and no farther than a region.
        let (corner, far) = (model.light(-1.0, -0.5, 9.0).0[0], model.light(-9.0, -9.0, 9.0).0[0]);
        assert!((corner - (-5.5 - 0.5)).abs() < 1e-12, "{corner}");
        assert!((far - (-11.0 - 0.5)).abs() < 1e-12, "{far}");
    }
}
