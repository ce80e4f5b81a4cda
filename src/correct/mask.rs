//! Validity mask of a corrected image: one byte of flags per pixel (`--mask`).

use crate::vehicle::Camera;

/// Input clipped at full scale, or demosaiced from a clipped pixel.
pub const CLIPPED: u8 = 1;
/// A band's signal is near its noise: its gain is limited, its colour is not measured.
pub const CAPPED: u8 = 2;
/// No seafloor point: black.
pub const OFF_SURFACE: u8 = 4;
/// Beam direction without samples in pass one: the gain is extrapolated.
pub const UNSEEN_BEAM: u8 = 8;
/// Of a rectified image: outside the original image.
pub const OUTSIDE: u8 = 16;

/// Radius of the demosaicing filter (px).
const MOSAIC_REACH: usize = 2;

/// [`CLIPPED`] flags of an image, filled row by row.
pub struct ClippingMask {
    /// `height × width`
    pub bits: Vec<u8>,
    width: usize,
    height: usize,
    reach: usize,
}

impl ClippingMask {
    /// No pixel is marked.
    pub fn new(width: usize, height: usize, is_mosaic: bool) -> Self {
        Self {
            bits: vec![0; width * height],
            width,
            height,
            reach: if is_mosaic { MOSAIC_REACH } else { 0 },
        }
    }

    /// Marks pixels of row `y`, band after band, that reach `level`, and those that are demosaiced
    /// from them.
    pub fn mark_row(&mut self, y: usize, light: &[f32], level: f32) {
        let Self { width, height, reach, .. } = *self;
        let is_clipped = |x: &usize| light.iter().skip(*x).step_by(width).any(|v| *v >= level);
        for x in (0..width).filter(is_clipped) {
            for row in y.saturating_sub(reach)..(y + reach + 1).min(height) {
                self.bits[row * width + x.saturating_sub(reach)
                    ..row * width + (x + reach + 1).min(width)]
                    .fill(CLIPPED);
            }
        }
    }
}

/// The mask of a rectified image: flags of the four pixels that each one is interpolated from.
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
    fn a_clipped_mosaic_pixel_marks_those_demosaiced_from_it() {
        let count = |is_mosaic| {
            let mut clipped = ClippingMask::new(9, 7, is_mosaic);
            for y in 0..7 {
                let light: Vec<f32> =
                    (0..9).map(|x| if (x, y) == (4, 3) { 1.0 } else { 0.0 }).collect();
                clipped.mark_row(y, &light, 0.98);
            }
            clipped.bits.iter().filter(|b| **b == CLIPPED).count()
        };
        assert_eq!((count(false), count(true)), (1, 25));
    }

    #[test]
    fn a_rectified_mask_follows_its_image() {
        let from = Camera::from_field_of_view(40, 30, 60.0);
        let mut mask = vec![0; 40 * 30];
        mask[15 * 40 + 20] = CAPPED;
        let same = rectify(&mask, &from, &from);
        assert_eq!(same[15 * 40 + 20] & CAPPED, CAPPED);
        let wide = Camera { fx: from.fx / 2.0, fy: from.fy / 2.0, ..from };
        assert!(rectify(&mask, &from, &wide).iter().filter(|b| **b == OUTSIDE).count() > 800);
    }
}
