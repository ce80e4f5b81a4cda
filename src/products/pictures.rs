//! Pictures made ready to be looked at: smaller, brightened by one factor, coded.

use base64::Engine as _;

use crate::image::transfer::{Shoulder, SrgbTable};
use crate::image::{ImageShape, LinearImage, encode};

/// Light of the brightest that is shown [share of white], and which quantile of the picture that
/// is.
const BRIGHT_LEVEL: f64 = 0.75;
const BRIGHT_QUANTILE: f64 = 0.995;

/// Means over blocks of whole pixels, such that the longer side is no longer [px].
pub fn downscale(image: &LinearImage, longest: usize) -> LinearImage {
    let block = image.width.max(image.height).div_ceil(longest.max(1)).max(1);
    if block == 1 {
        return image.clone();
    }
    // Rows and columns that fill no block are left off.
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

/// The picture at a width [px], each pixel the mean of what it covers.
pub fn scaled(image: &LinearImage, width: usize) -> LinearImage {
    let height = (image.height * width).div_ceil(image.width.max(1)).max(1);
    let across = covers(image.width, width);
    let down = covers(image.height, height);
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

/// Of each of `to` pixels along a side of `from`: the first it covers, and the share of each.
fn covers(from: usize, to: usize) -> Vec<(usize, Vec<f32>)> {
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

/// The factor that brings pictures' bright end to a level that can be looked at.
pub fn exposure<'i>(images: impl Iterator<Item = &'i LinearImage>) -> f32 {
    let mut brightest: Vec<f32> = images
        .flat_map(|i| i.pixels.chunks_exact(i.bands))
        .map(|p| p.iter().copied().fold(0.0, f32::max))
        .filter(|v| v.is_finite())
        .collect();
    if brightest.is_empty() {
        return 1.0;
    }
    let index = ((brightest.len() - 1) as f64 * BRIGHT_QUANTILE).round() as usize;
    let bright = *brightest.select_nth_unstable_by(index, f32::total_cmp).1;
    if bright > 0.0 { BRIGHT_LEVEL as f32 / bright } else { 1.0 }
}

/// 8-bit codes of light times a factor; the upper end is bent, not cut off.
pub fn codes(image: &LinearImage, factor: f32) -> Vec<u8> {
    let srgb = SrgbTable::new(Shoulder { knee: BRIGHT_LEVEL });
    image.pixels.iter().map(|v| srgb.encode(v * factor)).collect()
}

/// 8-bit codes of light that has been through a shoulder already.
pub fn codes_as_shown(image: &LinearImage) -> Vec<u8> {
    let srgb = SrgbTable::new(Shoulder { knee: 1.0 });
    image.pixels.iter().map(|v| srgb.encode(*v)).collect()
}

/// A JPEG inside of a page.
pub fn jpeg_uri(codes: &[u8], shape: ImageShape, quality: u8) -> Result<String, String> {
    let jpeg = encode::jpeg(codes, shape, quality, true)?;
    Ok(format!("data:image/jpeg;base64,{}", base64::engine::general_purpose::STANDARD.encode(jpeg)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_are_means_and_odd_ends_are_left_off() {
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
