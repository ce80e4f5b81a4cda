//! Downscaling of raw images for display: block means, all bands at every pixel.

use super::LinearImage;
use super::pixel_values::PixelValues;

/// The image with its longer side at most `max_side_px`: means over square blocks, per band, so
/// that a mosaic is not interpolated; demosaiced only where it fits unscaled.
pub fn downscale(values: &PixelValues<'_>, max_side_px: usize) -> LinearImage {
    let block = values.width.max(values.height).div_ceil(max_side_px.max(1));
    if block <= 1 {
        return values.to_linear(Vec::new()).into_demosaiced();
    }
    // A block of a mosaic holds whole 2×2 cells, so that it has every band.
    let block = if values.mosaic.is_some() { block.next_multiple_of(2) } else { block };
    let (width, height, bands) =
        ((values.width / block).max(1), (values.height / block).max(1), values.bands());
    let stored = values.stored_bands();
    let mut small = LinearImage::new(width, height, bands);
    let (mut counts, mut light) = (vec![0u32; width * bands], vec![0.0; values.width * stored]);
    for (row, sums) in small.pixels.chunks_exact_mut(width * bands).enumerate() {
        counts.fill(0);
        for y in row * block..((row + 1) * block).min(values.height) {
            values.linear_row(y, &mut light);
            for (x, pixel) in light.chunks_exact(stored).enumerate().take(width * block) {
                for (b, value) in pixel.iter().enumerate() {
                    let at =
                        x / block * bands + values.mosaic.map_or(b, |pattern| pattern.band(x, y));
                    sums[at] += value;
                    counts[at] += 1;
                }
            }
        }
        sums.iter_mut().zip(&counts).for_each(|(sum, count)| *sum /= (*count).max(1) as f32);
    }
    small
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::EncodedImage;
    use crate::image::decode::{CameraResponse, read_pixels};
    use crate::image::demosaic::BayerPattern;
    use crate::image::transfer::Transfer;

    fn raw<'a>(encoding: &'a str, width: usize, height: usize, data: &'a [u8]) -> PixelValues<'a> {
        let image =
            EncodedImage::Raw { width, height, encoding, big_endian: false, step: width, data };
        read_pixels(
            &image,
            CameraResponse { transfer: Transfer::Linear, ..CameraResponse::default() },
        )
        .expect("valid")
    }

    #[test]
    fn block_means_of_a_mosaic_keep_the_colour() {
        let (width, height) = (20, 12);
        let data: Vec<u8> = (0..width * height)
            .map(|i| [51, 102, 204][BayerPattern::Grbg.band(i % width, i / width)])
            .collect();
        for max_side_px in [7, 10, 20, 40] {
            let small = downscale(&raw("bayer_grbg8", width, height, &data), max_side_px);
            assert!(
                small.width.max(small.height) <= max_side_px && small.bands == 3,
                "{max_side_px}"
            );
            assert!(
                small
                    .pixels
                    .chunks_exact(3)
                    .all(|p| (p[0] - 0.2).abs() + (p[1] - 0.4).abs() + (p[2] - 0.8).abs() < 1e-5),
                "{max_side_px}"
            );
        }
    }

    #[test]
    fn an_image_smaller_than_a_block_is_downscaled() {
        let small = downscale(&raw("mono8", 100, 3, &[51; 300]), 10);
        assert!((small.width, small.height) == (10, 1) && (small.pixels[9] - 0.2).abs() < 1e-6);
    }
}
