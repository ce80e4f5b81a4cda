//! Log light by region of the image over slant range: the direct light of an empirical model, or
//! what attenuation and beam pattern leave of the light, where they do not explain it (lamps of
//! unlike patterns, a lens, parts in the light). It moves with the camera, so that it depends on
//! the place in the image and the slant range alone.
//!
//! ```text
//! a(x, y) − b(x, y) (ℓ_s − ℓ_0) − n(x, y) log(ℓ_s / ℓ_0)      per band; cubic between regions
//! ```

use serde::{Deserialize, Serialize};

use super::image_grid::ImageGrid;
use crate::image::Bands;

/// Log light on a grid of regions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RegionLight {
    /// the regions
    #[serde(flatten)]
    pub grid: ImageGrid,
    /// ℓ_0 (m)
    pub reference_m: f64,
    /// slant ranges of the samples; others take the nearest (m)
    pub range_m: [f64; 2],
    /// a per band and region, rows first (log of a share of full scale, or of a ratio)
    pub log_level: Vec<Vec<f64>>,
    /// b (1/m)
    pub slope_per_m: Vec<Vec<f64>>,
    /// n; empty where it is 0
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub exponent: Vec<Vec<f64>>,
}

impl RegionLight {
    /// Whether it can be evaluated.
    ///
    /// # Errors
    /// What is needed, in a few words.
    pub fn check(&self, bands: usize) -> Result<(), String> {
        let exponent = (!self.exponent.is_empty()).then_some(&self.exponent);
        let parts = [&self.log_level, &self.slope_per_m].into_iter().chain(exponent);
        self.grid.check(parts, bands)?;
        let Self { reference_m, range_m: [nearest, farthest], .. } = *self;
        let is_range = |v: f64| v > 0.0 && v.is_finite();
        if !is_range(reference_m) || !is_range(nearest) || !is_range(farthest) || farthest < nearest
        {
            return Err("slant ranges above 0 m in reference_m and range_m".into());
        }
        Ok(())
    }

    /// Derivatives by a, b and n of a region at a slant range.
    pub fn derivatives(&self, slant_range_m: f64) -> [f64; 3] {
        let range_m = slant_range_m.clamp(self.range_m[0], self.range_m[1]);
        [1.0, self.reference_m - range_m, -(range_m / self.reference_m).ln()]
    }

    /// Log light per band at a point of the image plane; 0 for bands that do not exist.
    pub fn log_light(&self, x: f64, y: f64, slant_range_m: f64) -> Bands {
        self.at(&self.grid.around(x, y), slant_range_m)
    }

    /// The same of the mean of regions by weight.
    pub fn at(&self, around: &[(usize, f64)], slant_range_m: f64) -> Bands {
        let by = self.derivatives(slant_range_m);
        let parts = [&self.log_level, &self.slope_per_m, &self.exponent];
        let mean = |values: &Vec<f64>| around.iter().map(|(i, w)| values[*i] * w).sum::<f64>();
        let of_band = |b: usize| {
            let part = |(part, by): (&&Vec<Vec<f64>>, f64)| part.get(b).map(|v| by * mean(v));
            parts.iter().zip(by).filter_map(part).sum()
        };
        std::array::from_fn(of_band)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_that_cannot_be_evaluated_is_refused() {
        let sound = RegionLight {
            grid: ImageGrid { x: [-1.0, 1.0], y: [-0.5, 0.5], columns: 2, rows: 2 },
            reference_m: 2.0,
            range_m: [1.0, 3.0],
            log_level: vec![vec![0.0; 4]],
            slope_per_m: vec![vec![0.5; 4]],
            exponent: vec![vec![1.0; 4]],
        };
        assert_eq!(sound.check(1), Ok(()));
        let light = sound.log_light(0.0, 0.0, 9.0)[0];
        assert!((light - (-0.5 - 1.5f64.ln())).abs() < 1e-12, "{light}");
        assert!(sound.check(3).is_err());
        let broken = [
            RegionLight { reference_m: 0.0, ..sound.clone() },
            RegionLight { range_m: [3.0, 1.0], ..sound.clone() },
            RegionLight { range_m: [1.0, f64::NAN], ..sound.clone() },
            RegionLight { exponent: vec![vec![1.0; 3]], ..sound.clone() },
            RegionLight { log_level: vec![vec![f64::INFINITY; 4]], ..sound },
        ];
        assert!(broken.iter().all(|light| light.check(1).is_err()));
    }
}
