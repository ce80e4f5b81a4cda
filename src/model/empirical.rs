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

    /// Regions around a point of the image plane with their weights.
    fn around(&self, x: f64, y: f64) -> Vec<(usize, f64)> {
        let (columns, rows) = (taps(x, self.x, self.columns), taps(y, self.y, self.rows));
        let of_row = |(row, b): (usize, f64)| columns.map(|(c, a)| (row * self.columns + c, a * b));
        rows.into_iter().flat_map(of_row).collect()
    }

    /// Log of direct light of a seafloor of reflectance 1, and backscatter, per band.
    pub fn light(&self, x: f64, y: f64, slant_range_m: f64) -> (Bands, Bands) {
        let around = self.around(x, y);
        let mean = |values: &[f64]| around.iter().map(|(i, w)| values[*i] * w).sum::<f64>();
        let range_m = slant_range_m.clamp(self.range_m[0], self.range_m[1]);
        let (mut log_direct, mut scattered) = ([0.0; 3], [0.0; 3]);
        for b in 0..self.log_level.len().min(3) {
            let slope = mean(&self.slope_per_m[b]);
            log_direct[b] = mean(&self.log_level[b]) - slope * (range_m - self.reference_m);
            scattered[b] = mean(&self.backscatter[b]).max(0.0);
        }
        (log_direct, scattered)
    }
}

/// Four regions along an axis and their weights: cubic (Catmull and Rom) between the centres, as
/// light has no edges where a grid has nodes; straight on beyond the outermost ones, up to a
/// region.
fn taps(v: f64, [from, to]: [f64; 2], count: usize) -> [(usize, f64); 4] {
    let last = count - 1;
    let at = (v - from) / (to - from).max(1e-9) * count as f64 - 0.5;
    let at = at.clamp(-1.0, last as f64 + 1.0);
    let i = (at.max(0.0) as usize).min(last - 1);
    let t = at - i as f64;
    if !(0.0..=1.0).contains(&t) {
        return [(i, 1.0 - t), (i + 1, t), (i, 0.0), (i, 0.0)];
    }
    let cubic = [
        t * (-0.5 + t * (1.0 - 0.5 * t)),
        1.0 + t * t * (1.5 * t - 2.5),
        t * (0.5 + t * (2.0 - 1.5 * t)),
        t * t * (0.5 * t - 0.5),
    ];
    let [mut before, mut near, mut next, mut after] = cubic;
    // Before the first centre and after the last, the line goes straight on.
    if i == 0 {
        (near, next) = (near + 2.0 * before, next - before);
        before = 0.0;
    }
    if i + 1 == last {
        (next, near) = (next + 2.0 * after, near - after);
        after = 0.0;
    }
    [(i.saturating_sub(1), before), (i, near), (i + 1, next), ((i + 2).min(last), after)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_is_smooth_over_the_image_and_falls_with_range() {
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
        // Beyond the outermost centres it goes straight on, and no farther than a region.
        let (corner, far) = (model.light(-1.0, -0.5, 9.0).0[0], model.light(-9.0, -9.0, 9.0).0[0]);
        assert!((corner - (-5.5 - 0.5)).abs() < 1e-12, "{corner}");
        assert!((far - (-11.0 - 0.5)).abs() < 1e-12, "{far}");
    }

    #[test]
    fn between_regions_a_parabola_has_no_kinks() {
        let count = 9;
        let value = |at: f64| 0.3 * at * at - at;
        let interpolated = |at: f64| {
            let v = (at + 0.5) / count as f64;
            taps(v, [0.0, 1.0], count).iter().map(|(i, w)| w * value(*i as f64)).sum::<f64>()
        };
        for k in 10..70 {
            let at = 0.1 * f64::from(k);
            assert!((interpolated(at) - value(at)).abs() < 1e-9, "{at}");
        }
    }
}
