//! Baseline: homomorphic filtering (paper §III-B, Eq. 12; Singh, Roman, Pizarro, Eustice & Can
//! 2007, its reference 16).
//!
//! ```text
//! log c = log I + log r,   log I ≈ low-pass of log c       a Gaussian, band by band
//! ```
//!
//! Low spatial frequencies of the seafloor are removed with the illumination, and sharp edges get
//! haloes. The Gaussian is applied to block means, since it is much wider than the blocks.

use super::common::{MEAN_LEVEL, MIN_LIGHT, log_blocks};
use crate::image::LinearImage;

/// Standard deviation of the low-pass (share of the longer side); about the size of a strobe's
/// cone.
const SIGMA_SHARE: f64 = 0.125;
/// Blocks along the longer side.
const SIDE: usize = 128;
/// Truncation of the Gaussian (standard deviations), SciPy's default.
const REACH: f64 = 4.0;

/// Removes the low-pass of log light.
pub fn flatten(image: &mut LinearImage) {
    for band in 0..image.bands {
        let (logs, (columns, rows), block) = log_blocks(image, band, SIDE);
        let smooth = blurred(&logs, columns, rows, SIGMA_SHARE * columns.max(rows) as f64);
        let (width, bands) = (image.width, image.bands);
        for (i, pixel) in image.pixels.chunks_exact_mut(bands).enumerate() {
            // Bilinear between block centres.
            let neighbours = |at: usize, count: usize| {
                let position =
                    ((at as f64 + 0.5) / block as f64 - 0.5).clamp(0.0, (count - 1) as f64);
                let first = (position as usize).min(count.saturating_sub(2));
                (first, (first + 1).min(count - 1), position - first as f64)
            };
            let ((x0, x1, a), (y0, y1, b)) =
                (neighbours(i % width, columns), neighbours(i / width, rows));
            let row =
                |y: usize| smooth[y * columns + x0] * (1.0 - a) + smooth[y * columns + x1] * a;
            let light = row(y0) * (1.0 - b) + row(y1) * b;
            pixel[band] = (f64::from(pixel[band].max(MIN_LIGHT)) / light.exp() * MEAN_LEVEL) as f32;
        }
    }
}

/// Separable Gaussian, the image mirrored at its edges.
fn blurred(values: &[f64], columns: usize, rows: usize, sigma: f64) -> Vec<f64> {
    let reach = (REACH * sigma + 0.5) as i64;
    let weights: Vec<f64> =
        (-reach..=reach).map(|k| (-0.5 * (k as f64 / sigma).powi(2)).exp()).collect();
    let sum: f64 = weights.iter().sum();
    let mirrored = |at: i64, count: usize| {
        let folded = at.rem_euclid(2 * count as i64) as usize;
        if folded < count { folded } else { 2 * count - 1 - folded }
    };
    let along = |count: usize, of: &dyn Fn(usize) -> f64, at: usize| {
        let taps = weights
            .iter()
            .enumerate()
            .map(|(k, w)| w * of(mirrored(at as i64 + k as i64 - reach, count)));
        taps.sum::<f64>() / sum
    };
    let cells = 0..columns * rows;
    let across: Vec<f64> = cells
        .clone()
        .map(|i| along(columns, &|x| values[i / columns * columns + x], i % columns))
        .collect();
    cells.map(|i| along(rows, &|y| across[y * columns + i % columns], i / columns)).collect()
}

#[cfg(test)]
mod tests {
    use super::super::common::tests::{assert_close, pattern};

    /// SciPy: `a = ((7*x + 13*y + 29*b) % 97 + 3) / 128` over 31 × 23 × 3; `np.exp(np.log(a) -
    /// scipy.ndimage.gaussian_filter(np.log(a), (31 / 8, 31 / 8, 0))) * .25` at [5, 7] and [22,
    /// 30].
    #[test]
    fn matches_scipy() {
        let mut image = pattern(31, 23, 3);
        super::flatten(&mut image);
        assert_close(
            image.at(7, 5).iter().chain(image.at(30, 22)),
            &[0.1217440, 0.3089676, 0.4886810, 0.0743780, 0.3063410, 0.4788395],
            1e-5,
        );
    }
}
