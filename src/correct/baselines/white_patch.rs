//! Baseline: white patch, per frame (paper §III-D; Land & McCann 1971, "Lightness and retinex
//! theory"). White is a high quantile of each band, as the maximum is a reflection or noise.

use super::common::{MIN_LIGHT, WHITE_LEVEL};
use crate::image::LinearImage;
use crate::stats::quantile;

/// Quantile of a band that counts as white.
const WHITE_QUANTILE: f64 = 0.99;

/// Scales every band to the same white.
pub fn balance(image: &mut LinearImage) {
    let bands = image.bands;
    for band in 0..bands {
        let of_band = image.pixels.iter().skip(band).step_by(bands);
        let values: Vec<f64> = of_band.map(|v| f64::from(*v)).collect();
        let white = (quantile(&values, WHITE_QUANTILE) as f32).max(MIN_LIGHT);
        image
            .pixels
            .iter_mut()
            .skip(band)
            .step_by(bands)
            .for_each(|v| *v *= WHITE_LEVEL as f32 / white);
    }
}

#[cfg(test)]
mod tests {
    use super::super::common::tests::{assert_close, pattern};

    /// NumPy: `a = ((7*x + 13*y + 29*b) % 97 + 3) / 128` over 31 × 23 × 3;
    /// `a * .9 / np.quantile(a, .99, axis=(0, 1), method='nearest')` at [5, 7].
    #[test]
    fn matches_numpy() {
        let mut image = pattern(31, 23, 3);
        super::balance(&mut image);
        assert_close(image.at(7, 5).iter(), &[0.1836735, 0.4454545, 0.7163265], 1e-6);
    }
}
