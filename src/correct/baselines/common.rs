//! Levels and helpers of several baselines.

use crate::image::LinearImage;

/// Level to which a method scales its mean (share of white).
pub const MEAN_LEVEL: f64 = 0.25;
/// Level to which a method scales its white (share of white).
pub const WHITE_LEVEL: f64 = 0.9;
/// Lower bound before logarithms (share of full scale); about half a DN at 12 bits.
pub const MIN_LIGHT: f32 = 1e-4;

/// Block means of log light of one band, with at most `side` blocks along the longer side; columns
/// and rows of blocks; and the block size (px).
pub fn log_blocks(
    image: &LinearImage,
    band: usize,
    side: usize,
) -> (Vec<f64>, (usize, usize), usize) {
    let block = image.width.max(image.height).div_ceil(side).max(1);
    let (columns, rows) = (image.width.div_ceil(block), image.height.div_ceil(block));
    let mut sums = vec![(0.0, 0u32); columns * rows];
    for (i, pixel) in image.pixels.chunks_exact(image.bands).enumerate() {
        let (sum, count) = &mut sums[i / image.width / block * columns + i % image.width / block];
        *sum += f64::from(pixel[band].max(MIN_LIGHT).ln());
        *count += 1;
    }
    (sums.into_iter().map(|(sum, count)| sum / f64::from(count)).collect(), (columns, rows), block)
}

#[cfg(test)]
pub mod tests {
    use super::*;

    /// Test image that Python reproduces: `((7x + 13y + 29b) % 97 + 3) / 128`, in double precision.
    pub fn pattern(width: usize, height: usize, bands: usize) -> LinearImage {
        let mut image = LinearImage::new(width, height, bands);
        for (i, pixel) in image.pixels.chunks_exact_mut(bands).enumerate() {
            let (x, y) = (i % width, i / width);
            pixel
                .iter_mut()
                .enumerate()
                .for_each(|(b, v)| *v = ((7 * x + 13 * y + 29 * b) % 97 + 3) as f32 / 128.0);
        }
        image
    }

    pub fn assert_close<'v>(
        result: impl Iterator<Item = &'v f32>,
        expected: &[f64],
        tolerance: f64,
    ) {
        let close = |(r, e): (&f32, &f64)| (f64::from(*r) - e).abs() < tolerance;
        assert!(result.zip(expected).all(close), "expected {expected:?}");
    }
}
