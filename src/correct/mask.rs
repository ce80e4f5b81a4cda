//! What not to trust in a corrected picture, pixel by pixel: a picture of bits beside it (`--mask`).

use crate::image::{LinearImage, SensorImage};
use crate::vehicle::Camera;

/// The input was at full scale here, or so near that demosaicing takes colour from there.
pub const CLIPPED: u8 = 1;
/// The gain was held at the cap: too dark.
pub const CAPPED: u8 = 2;
/// The ray never meets the floor: black.
pub const OFF_SURFACE: u8 = 4;
/// Lit from a direction of the beam that pass one never saw: the gain is filled in from neighbours.
pub const UNSEEN_BEAM: u8 = 8;
/// Of a rectified picture: the camera did not see this.
pub const OUTSIDE: u8 = 16;

/// How far demosaicing reaches [px].
const MOSAIC_REACH: usize = 2;

/// Marks what is clipped in the input.
pub fn clipped(raw: &SensorImage, above: f32) -> Vec<u8> {
    let LinearImage { width, height, bands, ref pixels } = raw.light;
    let mut mask = vec![0; width * height];
    let reach = if raw.mosaic.is_some() { MOSAIC_REACH } else { 0 };
    for (i, _) in pixels.chunks_exact(bands).enumerate().filter(|(_, pixel)| pixel.iter().any(|v| *v >= above)) {
        let (x, y) = (i % width, i / width);
        for row in y.saturating_sub(reach)..(y + reach + 1).min(height) {
            mask[row * width + x.saturating_sub(reach)..row * width + (x + reach + 1).min(width)].fill(CLIPPED);
        }
    }
    mask
}

/// The mask of a rectified picture: all bits of the pixels that one is made from.
pub fn undistorted(mask: &[u8], from: &Camera, to: &Camera) -> Vec<u8> {
    let (width, height) = (from.width, from.height);
    let of = |i: usize| {
        let (px, py) = to.image_plane((i % to.width) as f64, (i / to.width) as f64)?;
        let (u, v) = from.pixel(px, py);
        if !(u >= 0.0 && v >= 0.0 && u <= (width - 1) as f64 && v <= (height - 1) as f64) {
            return None;
        }
        let (x, y) = ((u as usize).min(width - 2), (v as usize).min(height - 2));
        Some(mask[y * width + x] | mask[y * width + x + 1] | mask[(y + 1) * width + x] | mask[(y + 1) * width + x + 1])
    };
    (0..to.width * to.height).map(|i| of(i).unwrap_or(OUTSIDE)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::demosaic::Phase;

    #[test]
    fn a_clipped_pixel_of_a_mosaic_marks_those_that_take_colour_from_it() {
        let mut light = LinearImage::new(9, 7, 1);
        light.pixels[3 * 9 + 4] = 1.0;
        let count = |mosaic| clipped(&SensorImage { light: light.clone(), mosaic }, 0.98).iter().filter(|b| **b == CLIPPED).count();
        assert_eq!((count(None), count(Some(Phase::Rggb))), (1, 25));
    }

    #[test]
    fn a_rectified_mask_follows_its_picture() {
        let from = Camera::from_field_of_view(40, 30, 60.0);
        let mut mask = vec![0; 40 * 30];
        mask[15 * 40 + 20] = CAPPED;
        let same = undistorted(&mask, &from, &from);
        assert_eq!(same[15 * 40 + 20] & CAPPED, CAPPED);
        let wide = Camera { fx: from.fx / 2.0, fy: from.fy / 2.0, ..from };
        assert!(undistorted(&mask, &from, &wide).iter().filter(|b| **b == OUTSIDE).count() > 800);
    }
}
