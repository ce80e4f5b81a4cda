//! Light of a dive by regions of the image, without physical constants: for dives whose geometry or
//! overlap does not determine attenuation.
//!
//! ```text
//! c = r e^(a − b (ℓ_s − ℓ_0)) + B      per region and band; bilinear between regions
//! ```
//!
//! a contains beam pattern, vignetting and exposure, b attenuation, spreading and whatever else
//! changes with the slant range ℓ_s. None of them is a property of the water.

use serde::{Deserialize, Serialize};

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
    /// range of x/z in the image plane that the grid covers
    pub x: [f64; 2],
    /// range of y/z
    pub y: [f64; 2],
    /// regions across
    pub columns: usize,
    /// regions down
    pub rows: usize,
    /// ℓ_0 (m)
    pub reference_m: f64,
    /// slant ranges of the samples; others take the nearest (m)
    pub range_m: [f64; 2],
    /// a per band and region, rows first (log of a share of full scale)
    pub log_level: Vec<Vec<f64>>,
    /// b (1/m)
    pub slope_per_m: Vec<Vec<f64>>,
    /// B (share of full scale)
    pub backscatter: Vec<Vec<f64>>,
}

/// Regions around a point, with bilinear weights.
type Corners = [(usize, f64); 4];

impl EmpiricalModel {
    /// Whether the model can be evaluated.
    ///
    /// # Errors
    /// A sentence about what is missing.
    pub fn check(&self, bands: usize) -> Result<(), String> {
        let regions = self.columns * self.rows;
        let is_whole = |values: &Vec<Vec<f64>>| {
            values.len() == bands
                && values.iter().all(|v| v.len() == regions && v.iter().all(|v| v.is_finite()))
        };
        let parts = [&self.log_level, &self.slope_per_m, &self.backscatter];
        if self.columns < 2 || self.rows < 2 || !parts.into_iter().all(is_whole) {
            return Err(format!(
                "empirical needs {bands} bands of {} × {} finite numbers",
                self.columns, self.rows
            ));
        }
        Ok(())
    }

    /// Regions around a point of the image plane; beyond the outermost centres, the edge.
    pub fn corners(&self, x: f64, y: f64) -> Corners {
        let place = |v: f64, [from, to]: [f64; 2], count: usize| {
            let at = (v - from) / (to - from).max(1e-9) * count as f64 - 0.5;
            let at = at.clamp(0.0, (count - 1) as f64);
            let i = (at as usize).min(count - 2);
            (i, at - i as f64)
        };
        let (column, a) = place(x, self.x, self.columns);
        let (row, b) = place(y, self.y, self.rows);
        let index = |r: usize, c: usize| r * self.columns + c;
        [
            (index(row, column), (1.0 - a) * (1.0 - b)),
            (index(row, column + 1), a * (1.0 - b)),
            (index(row + 1, column), (1.0 - a) * b),
            (index(row + 1, column + 1), a * b),
        ]
    }

    /// Log of direct light of a seafloor of reflectance 1, and backscatter, per band.
    pub fn light(&self, x: f64, y: f64, slant_range_m: f64) -> (Bands, Bands) {
        let corners = self.corners(x, y);
        let mean = |values: &[f64]| corners.iter().map(|(i, w)| values[*i] * w).sum::<f64>();
        let range_m = slant_range_m.clamp(self.range_m[0], self.range_m[1]);
        let (mut log_direct, mut scattered) = ([0.0; 3], [0.0; 3]);
        for b in 0..self.log_level.len().min(3) {
            let slope = mean(&self.slope_per_m[b]);
            log_direct[b] = mean(&self.log_level[b]) - slope * (range_m - self.reference_m);
            scattered[b] = mean(&self.backscatter[b]);
        }
        (log_direct, scattered)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_is_bilinear_and_falls_with_range() {
        let model = EmpiricalModel {
            form: EmpiricalForm::Backscatter,
            x: [-1.0, 1.0],
            y: [-0.5, 0.5],
            columns: 4,
            rows: 2,
            reference_m: 2.0,
            range_m: [1.0, 3.0],
            log_level: vec![vec![0.0, 1.0, 2.0, 3.0, 10.0, 11.0, 12.0, 13.0]],
            slope_per_m: vec![vec![0.5; 8]],
            backscatter: vec![vec![0.01; 8]],
        };
        assert_eq!(model.check(1), Ok(()));
        assert!(model.check(3).is_err());
        let (log_direct, scattered) = model.light(0.0, 0.0, 2.5);
        assert!((log_direct[0] - (6.5 - 0.25)).abs() < 1e-12, "{log_direct:?}");
        assert!((scattered[0] - 0.01).abs() < 1e-12);
        assert_eq!(model.light(-5.0, -5.0, 9.0).0[0], -0.5, "the edge, at the farthest range");
    }
}
