//! A smaller picture for the eye: means over blocks, all bands at every pixel.

use super::LinearImage;
use super::decode::PixelValues;

/// The picture with its longer side no longer than `most_px` [px]: as it is where it fits, else
/// means over square blocks. Of a mosaic the means are taken band by band, so nothing is
/// interpolated.
pub fn downscale(codes: &PixelValues<'_>, most_px: usize) -> LinearImage {
    let block = codes.width.max(codes.height).div_ceil(most_px.max(1));
    if block <= 1 {
        return codes.light(Vec::new()).into_demosaiced();
    }
    // A block of a mosaic holds whole cells, so every band is in it.
    let block = if codes.mosaic.is_some() { block.next_multiple_of(2) } else { block };
    let (width, height, bands) =
        ((codes.width / block).max(1), (codes.height / block).max(1), codes.bands());
    let stored = codes.stored_bands();
    let mut small = LinearImage::new(width, height, bands);
    let (mut counts, mut light) = (vec![0u32; width * bands], vec![0.0; codes.width * stored]);
    for (row, sums) in small.pixels.chunks_exact_mut(width * bands).enumerate() {
        counts.fill(0);
        for y in row * block..((row + 1) * block).min(codes.height) {
            codes.light_row(y, &mut light);
            for (x, pixel) in light.chunks_exact(stored).enumerate().take(width * block) {
                for (b, value) in pixel.iter().enumerate() {
                    let at = x / block * bands + codes.mosaic.map_or(b, |phase| phase.band(x, y));
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
        let picture =
            EncodedImage::Raw { width, height, encoding, big_endian: false, step: width, data };
        read_pixels(
            &picture,
            CameraResponse { transfer: Transfer::Linear, ..CameraResponse::default() },
        )
        .expect("a picture")
    }

    #[test]
    fn blocks_of_a_mosaic_keep_the_colour() {
        let (width, height) = (20, 12);
        let data: Vec<u8> = (0..width * height)
            .map(|i| [51, 102, 204][BayerPattern::Grbg.band(i % width, i / width)])
            .collect();
        for most in [7, 10, 20, 40] {
            let small = downscale(&raw("bayer_grbg8", width, height, &data), most);
            assert!(small.width.max(small.height) <= most && small.bands == 3, "{most}");
            assert!(
                small
                    .pixels
                    .chunks_exact(3)
                    .all(|p| (p[0] - 0.2).abs() + (p[1] - 0.4).abs() + (p[2] - 0.8).abs() < 1e-5),
                "{most}"
            );
        }
    }

    #[test]
    fn a_picture_smaller_than_a_block_is_no_reason_to_fail() {
        let small = downscale(&raw("mono8", 100, 3, &[51; 300]), 10);
        assert!((small.width, small.height) == (10, 1) && (small.pixels[9] - 0.2).abs() < 1e-6);
    }
}
