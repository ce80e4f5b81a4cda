//! Baseline: the brightest of a frame is taken for white (paper §III-D; Land & McCann 1971,
//! "Lightness and retinex theory"). Not the very brightest pixel, which is a glint or noise, but a
//! high quantile of each band.

use super::{LEAST_LIGHT, WHITE_LEVEL};
use crate::image::LinearImage;

/// The share of pixels that are darker than white.
const WHITE_QUANTILE: f64 = 0.99;

/// Brings every band's bright end to one level.
pub fn balance(image: &mut LinearImage) {
    let bands = image.bands;
    for band in 0..bands {
        let mut values: Vec<f32> = image.pixels.iter().skip(band).step_by(bands).copied().collect();
        let index = ((values.len() - 1) as f64 * WHITE_QUANTILE).round() as usize;
        let white = (*values.select_nth_unstable_by(index, f32::total_cmp).1).max(LEAST_LIGHT);
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
    use super::super::tests::pattern;

    /// NumPy: `a = ((7*x + 13*y + 29*b) % 97 + 3) / 128` over 31 × 23 × 3;
    /// `a * .9 / np.quantile(a, .99, axis=(0, 1), method='nearest')` at [5, 7].
    #[test]
    fn as_numpy_has_it() {
        let mut image = pattern(31, 23, 3);
        super::balance(&mut image);
        for (is, ought) in image.at(7, 5).iter().zip(WHITE_PATCH) {
            assert!((f64::from(*is) - ought).abs() < 1e-6, "{is} {ought}");
        }
    }

    const WHITE_PATCH: [f64; 3] = [0.1836735, 0.4454545, 0.7163265];
}
