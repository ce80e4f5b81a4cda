//! Images for display: downscaled, scaled by one exposure factor, encoded.

use base64::Engine as _;

use crate::image::tone::Tone;
use crate::image::transfer::SrgbTable;
use crate::image::{ImageShape, LinearImage, encode};
use crate::stats::quantile;

/// Display level of the bright end (share of white), and its quantile in the image.
const BRIGHT_LEVEL: f64 = 0.75;
const BRIGHT_QUANTILE: f64 = 0.995;

/// Colours of sheets and posters (sRGB): background, text, secondary text, no data, and bands.
pub const PAPER: [u8; 3] = [250, 250, 248];
pub const INK: [u8; 3] = [28, 33, 38];
pub const SOFT: [u8; 3] = [100, 110, 118];
pub const EMPTY: [u8; 3] = [224, 227, 228];
pub const BANDS: [[u8; 3]; 3] = [[192, 48, 40], [31, 128, 68], [42, 95, 192]];

/// Means over blocks of whole pixels, with the longer side at most `max_side_px`.
pub fn downscale(image: &LinearImage, max_side_px: usize) -> LinearImage {
    let block = image.width.max(image.height).div_ceil(max_side_px.max(1)).max(1);
    if block == 1 {
        return image.clone();
    }
    // Rows and columns that do not fill a block are dropped.
    let (width, height) = ((image.width / block).max(1), (image.height / block).max(1));
    let mut out = LinearImage::new(width, height, image.bands);
    let area = (block * block) as f32;
    for y in 0..height * block {
        let row = &image.pixels[y * image.width * image.bands..][..width * block * image.bands];
        let target = &mut out.pixels[y / block * width * image.bands..][..width * image.bands];
        for (i, value) in row.iter().enumerate() {
            target[i / image.bands / block * image.bands + i % image.bands] += value / area;
        }
    }
    out
}

/// The image resampled to a width (px), each pixel the area-weighted mean of what it covers.
pub fn scaled(image: &LinearImage, width: usize) -> LinearImage {
    let height = (image.height * width).div_ceil(image.width.max(1)).max(1);
    let across = coverage(image.width, width);
    let down = coverage(image.height, height);
    let bands = image.bands;
    let mut out = LinearImage::new(width, height, bands);
    for (target, (first, weights)) in out.pixels.chunks_exact_mut(width * bands).zip(&down) {
        for (row, weight) in weights.iter().enumerate() {
            let source =
                &image.pixels[(first + row) * image.width * bands..][..image.width * bands];
            for (pixel, (left, shares)) in target.chunks_exact_mut(bands).zip(&across) {
                for (column, share) in shares.iter().enumerate() {
                    for (b, value) in pixel.iter_mut().enumerate() {
                        *value += weight * share * source[(left + column) * bands + b];
                    }
                }
            }
        }
    }
    out
}

/// For each of `to` pixels along a side of `from`: the first pixel it covers, and the weight of
/// each.
fn coverage(from: usize, to: usize) -> Vec<(usize, Vec<f32>)> {
    let ratio = from as f64 / to as f64;
    let of = |i: usize| {
        let (start, end) = (i as f64 * ratio, ((i + 1) as f64 * ratio).min(from as f64));
        let first = (start as usize).min(from - 1);
        let last = (end.ceil() as usize).clamp(first + 1, from);
        let share = |k: usize| {
            ((end.min((k + 1) as f64) - start.max(k as f64)).max(0.0) / (end - start)) as f32
        };
        (first, (first..last).map(share).collect())
    };
    (0..to).map(of).collect()
}

/// The factor that scales the bright end of the images to [`BRIGHT_LEVEL`].
pub fn exposure<'i>(images: impl Iterator<Item = &'i LinearImage>) -> f32 {
    let brightest: Vec<f64> = images
        .flat_map(|i| i.pixels.chunks_exact(i.bands))
        .map(|p| f64::from(p.iter().copied().fold(0.0, f32::max)))
        .collect();
    let bright = quantile(&brightest, BRIGHT_QUANTILE) as f32;
    if bright > 0.0 { BRIGHT_LEVEL as f32 / bright } else { 1.0 }
}

/// 8-bit sRGB values of light times a factor, with highlight compression.
pub fn to_srgb(image: &LinearImage, factor: f32) -> Vec<u8> {
    let srgb = SrgbTable::new(Tone::Shoulder { knee: BRIGHT_LEVEL });
    image.pixels.iter().map(|v| srgb.encode(v * factor)).collect()
}

/// 8-bit sRGB values of light whose highlights are already compressed.
pub fn srgb_of_rendered(image: &LinearImage) -> Vec<u8> {
    let srgb = SrgbTable::new(Tone::Shoulder { knee: 1.0 });
    image.pixels.iter().map(|v| srgb.encode(*v)).collect()
}

/// A JPEG as a data URI.
pub fn jpeg_uri(samples: &[u8], shape: ImageShape, quality: u8) -> Result<String, String> {
    let jpeg = encode::jpeg(samples, shape, quality, true)?;
    Ok(format!("data:image/jpeg;base64,{}", base64::engine::general_purpose::STANDARD.encode(jpeg)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn block_means_and_partial_blocks() {
        let mut image = LinearImage::new(5, 4, 3);
        image
            .pixels
            .iter_mut()
            .enumerate()
            .for_each(|(i, v)| *v = (i / 3 % 5) as f32 + (i % 3) as f32 * 10.0);
        let small = downscale(&image, 3);
        assert_eq!((small.width, small.height), (2, 2));
        assert_eq!(small.at(0, 0), &[0.5, 10.5, 20.5]);
        assert_eq!(small.at(1, 1), &[2.5, 12.5, 22.5]);
        assert_eq!(downscale(&image, 5), image);
        let third = scaled(&image, 2);
        assert_eq!((third.width, third.height), (2, 2));
        // 2½ of 5 columns: (0 + 1 + ½ · 2) / 2.5
        assert!(
            (third.at(0, 0)[0] - 0.8).abs() < 1e-6 && (third.at(1, 1)[2] - 23.2).abs() < 1e-5,
            "{:?}",
            third.pixels
        );
        assert_eq!(exposure([LinearImage::new(2, 2, 1)].iter()), 1.0);
    }
}
