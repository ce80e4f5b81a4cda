//! Baseline: homomorphic filtering with a fitted surface (paper §III-B, Eq. 12; after its reference
//! 17): log I is a polynomial of column and row, fitted to log c by least squares, per band.
//! Smoother than a low-pass, hence no haloes; it cannot represent a beam with a sharp edge.

use nalgebra::{DMatrix, DVector};

use super::common::{MEAN_LEVEL, MIN_LIGHT, log_blocks};
use crate::image::LinearImage;

/// Order of the polynomial; four represents one bright spot off the centre.
const ORDER: i32 = 4;
/// Blocks along the longer side.
const SIDE: usize = 128;

/// Removes the fitted surface of log light.
pub fn flatten(image: &mut LinearImage) {
    let (width, height, bands) = (image.width, image.height, image.bands);
    for band in 0..bands {
        let (logs, (columns, _), block) = log_blocks(image, band, SIDE);
        // Centre of a block; the last one of a row may be smaller.
        let centre =
            |at: usize, end: usize| 0.5 * (at * block + ((at + 1) * block).min(end) - 1) as f64;
        let terms: Vec<[f64; TERMS]> = (0..logs.len())
            .map(|i| terms(centre(i % columns, width), centre(i / columns, height), width, height))
            .collect();
        let design = DMatrix::from_fn(logs.len(), TERMS, |i, k| terms[i][k]);
        let Some(normal) =
            (design.transpose() * &design + DMatrix::identity(TERMS, TERMS) * 1e-9).cholesky()
        else {
            continue;
        };
        let fitted = normal.solve(&(design.transpose() * DVector::from_vec(logs)));
        for (i, pixel) in image.pixels.chunks_exact_mut(bands).enumerate() {
            let here = self::terms((i % width) as f64, (i / width) as f64, width, height);
            let light: f64 = here.iter().zip(fitted.iter()).map(|(t, f)| t * f).sum();
            pixel[band] = (f64::from(pixel[band].max(MIN_LIGHT)) / light.exp() * MEAN_LEVEL) as f32;
        }
    }
}

const TERMS: usize = ((ORDER + 1) * (ORDER + 2) / 2) as usize;

/// x^i y^j with i + j up to the order, x and y from −1 to 1 over the image.
fn terms(x: f64, y: f64, width: usize, height: usize) -> [f64; TERMS] {
    let unit = |at: f64, count: usize| 2.0 * at / (count - 1).max(1) as f64 - 1.0;
    let (x, y) = (unit(x, width), unit(y, height));
    let mut powers = (0..=ORDER).flat_map(|i| (0..=ORDER - i).map(move |j| x.powi(i) * y.powi(j)));
    std::array::from_fn(|_| powers.next().unwrap_or(0.0))
}

#[cfg(test)]
mod tests {
    use super::super::common::tests::{assert_close, pattern};

    /// NumPy: `a = ((7*x + 13*y + 29*b) % 97 + 3) / 128` over 31 × 23 × 3; `u, v = x / 15 - 1, y /
    /// 11 - 1`; `A = np.stack([u**i * v**j for i in range(5) for j in range(5 - i)],
    /// -1).reshape(-1, 15)`; `np.exp(l - A @ np.linalg.lstsq(A, l, rcond=None)[0]) * .25` with `l =
    /// np.log(a).reshape(-1, 3)` at [5, 7] and [22, 30].
    #[test]
    fn matches_numpy() {
        let mut image = pattern(31, 23, 3);
        super::flatten(&mut image);
        assert_close(
            image.at(7, 5).iter().chain(image.at(30, 22)),
            &[0.1128721, 0.3074951, 0.4964193, 0.0742164, 0.3560957, 0.4470186],
            1e-5,
        );
    }
}
