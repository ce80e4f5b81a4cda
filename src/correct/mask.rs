//! What not to trust in a corrected picture, pixel by pixel: a picture of bits beside it
//! (`--mask`).

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

/// Marks what is clipped in the input, row by row.
pub struct ClippingMask {
    /// by pixel
    pub bits: Vec<u8>,
    width: usize,
    height: usize,
    reach: usize,
}

impl ClippingMask {
    /// Nothing marked yet.
    pub fn new(width: usize, height: usize, is_mosaic: bool) -> Self {
        Self {
            bits: vec![0; width * height],
            width,
            height,
            reach: if is_mosaic { MOSAIC_REACH } else { 0 },
        }
    }

    /// Marks what reaches `above` in row `y`, and what demosaicing takes colour from there.
    pub fn row(&mut self, y: usize, light: &[f32], above: f32) {
        let Self { width, height, reach, .. } = *self;
        for (x, _) in light
            .chunks_exact(light.len() / width)
            .enumerate()
            .filter(|(_, pixel)| pixel.iter().any(|v| *v >= above))
        {
            for row in y.saturating_sub(reach)..(y + reach + 1).min(height) {
                self.bits[row * width + x.saturating_sub(reach)
                    ..row * width + (x + reach + 1).min(width)]
                    .fill(CLIPPED);
            }
        }
    }
}

/// The mask of a rectified picture: all bits of the pixels that one is made from.
pub fn rectify(mask: &[u8], from: &Camera, to: &Camera) -> Vec<u8> {
    let (width, height) = (from.width, from.height);
    let of = |i: usize| {
        let (px, py) = to.image_plane((i % to.width) as f64, (i / to.width) as f64)?;
        let (u, v) = from.pixel(px, py);
        if !(u >= 0.0 && v >= 0.0 && u <= (width - 1) as f64 && v <= (height - 1) as f64) {
            return None;
        }
        let (x, y) = ((u as usize).min(width - 2), (v as usize).min(height - 2));
        Some(
            mask[y * width + x]
                | mask[y * width + x + 1]
                | mask[(y + 1) * width + x]
                | mask[(y + 1) * width + x + 1],
        )
    };
    (0..to.width * to.height).map(|i| of(i).unwrap_or(OUTSIDE)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clipped_pixel_of_a_mosaic_marks_those_that_take_colour_from_it() {
        let count = |is_mosaic| {
            let mut clipped = ClippingMask::new(9, 7, is_mosaic);
            for y in 0..7 {
                let light: Vec<f32> =
                    (0..9).map(|x| if (x, y) == (4, 3) { 1.0 } else { 0.0 }).collect();
                clipped.row(y, &light, 0.98);
            }
            clipped.bits.iter().filter(|b| **b == CLIPPED).count()
        };
        assert_eq!((count(false), count(true)), (1, 25));
    }

    #[test]
    fn a_rectified_mask_follows_its_picture() {
        let from = Camera::from_field_of_view(40, 30, 60.0);
        let mut mask = vec![0; 40 * 30];
        mask[15 * 40 + 20] = CAPPED;
        let same = rectify(&mask, &from, &from);
        assert_eq!(same[15 * 40 + 20] & CAPPED, CAPPED);
        let wide = Camera { fx: from.fx / 2.0, fy: from.fy / 2.0, ..from };
        assert!(rectify(&mask, &from, &wide).iter().filter(|b| **b == OUTSIDE).count() > 800);
    }
}
