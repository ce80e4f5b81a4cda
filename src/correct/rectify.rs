//! Lens distortion removed from a corrected frame (`--rectify`).

use crate::image::LinearImage;
use crate::vehicle::Camera;

/// The image of a camera without distortion: bilinear in linear light, black where the camera did
/// not see.
pub fn rectified(raw: &LinearImage, from: &Camera, to: &Camera) -> LinearImage {
    let mut out = LinearImage::new(to.width, to.height, raw.bands);
    for (y, row) in out.pixels.chunks_exact_mut(to.width * raw.bands).enumerate() {
        for (x, pixel) in row.chunks_exact_mut(raw.bands).enumerate() {
            let Some((px, py)) = to.image_plane(x as f64, y as f64) else { continue };
            let (u, v) = from.pixel(px, py);
            if !(u >= 0.0
                && v >= 0.0
                && u <= (raw.width - 1) as f64
                && v <= (raw.height - 1) as f64)
            {
                continue;
            }
            let (i, j) = ((u as usize).min(raw.width - 2), (v as usize).min(raw.height - 2));
            let (a, b) = ((u - i as f64) as f32, (v - j as f64) as f32);
            for (band, value) in pixel.iter_mut().enumerate() {
                let at = |i: usize, j: usize| raw.at(i, j)[band];
                *value = (1.0 - b) * ((1.0 - a) * at(i, j) + a * at(i + 1, j))
                    + b * ((1.0 - a) * at(i, j + 1) + a * at(i + 1, j + 1));
            }
        }
    }
    out
}
