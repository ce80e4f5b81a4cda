//! What the lens and the sensor take from an evenly lit picture (Eq. 7): vignetting as a formula,
//! or a picture of an evenly lit surface. Divided out of every frame before anything else.
//!
//! In: the share of light that arrives, per pixel and band, 1 where most does. Mosaics are divided
//! as they are.

use super::demosaic::BayerPattern;
use super::{LinearImage, SensorImage};

/// Pixels darker than this share of the brightest say nothing.
const LEAST_SHARE: f32 = 0.02;
/// The brightest of a picture is this quantile of it: single pixels are not believed.
const BRIGHTEST: f64 = 0.99;

/// Shares of light over a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct FlatField {
    shares: LinearImage,
}

impl FlatField {
    /// From a formula of the pixel's place.
    pub fn from_fn(width: usize, height: usize, share: impl Fn(f64, f64) -> f64) -> Self {
        let mut shares = LinearImage::new(width, height, 1);
        for (y, row) in shares.pixels.chunks_exact_mut(width).enumerate() {
            row.iter_mut()
                .enumerate()
                .for_each(|(x, v)| *v = (share(x as f64, y as f64) as f32).max(LEAST_SHARE));
        }
        Self { shares }
    }

    /// From a picture of an evenly lit surface, each band brought to 1.
    pub fn from_image(mut picture: LinearImage) -> Self {
        for band in 0..picture.bands {
            let mut values: Vec<f32> =
                picture.pixels.iter().skip(band).step_by(picture.bands).copied().collect();
            let at = ((values.len() - 1) as f64 * BRIGHTEST) as usize;
            let brightest = *values.select_nth_unstable_by(at, f32::total_cmp).1;
            picture
                .pixels
                .iter_mut()
                .skip(band)
                .step_by(picture.bands)
                .for_each(|v| *v = (*v / brightest.max(1e-9)).max(LEAST_SHARE));
        }
        Self { shares: picture }
    }

    /// Divides a picture.
    ///
    /// # Errors
    /// The sizes differ.
    pub fn divide(&self, image: &mut SensorImage) -> Result<(), String> {
        let SensorImage { light, mosaic } = image;
        self.check_size(light.width, light.height)?;
        let row = light.width * light.bands;
        light
            .pixels
            .chunks_exact_mut(row)
            .enumerate()
            .for_each(|(y, pixels)| self.divide_row(y, *mosaic, pixels));
        Ok(())
    }

    /// Refuses pictures of another size.
    ///
    /// # Errors
    /// The sizes differ.
    pub fn check_size(&self, width: usize, height: usize) -> Result<(), String> {
        match (self.shares.width, self.shares.height) {
            own if own == (width, height) => Ok(()),
            (w, h) => Err(format!("the flat field is {w}×{h}, the picture {width}×{height}")),
        }
    }

    /// Divides row `y` of a picture of the same size.
    pub fn divide_row(&self, y: usize, mosaic: Option<BayerPattern>, light: &mut [f32]) {
        let LinearImage { width, bands, ref pixels, .. } = self.shares;
        let stored = light.len() / width;
        let shares = pixels[y * width * bands..][..width * bands].chunks_exact(bands);
        for (x, (pixel, share)) in light.chunks_exact_mut(stored).zip(shares).enumerate() {
            for (b, value) in pixel.iter_mut().enumerate() {
                let band = mosaic.map_or(b, |phase| phase.band(x, y));
                *value /= share[band.min(bands - 1)];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_evenly_lit_picture_comes_out_even() {
        let falloff =
            |x: f64, y: f64| 1.0 / (1.0 + ((x - 20.0).powi(2) + (y - 15.0).powi(2)) / 900.0);
        let mut light = LinearImage::new(41, 31, 3);
        for (i, pixel) in light.pixels.chunks_exact_mut(3).enumerate() {
            let lit = falloff((i % 41) as f64, (i / 41) as f64) as f32;
            pixel.copy_from_slice(&[0.5 * lit, 0.25 * lit, 0.75 * lit]);
        }
        for field in [FlatField::from_fn(41, 31, falloff), FlatField::from_image(light.clone())] {
            let mut image = SensorImage { light: light.clone(), mosaic: None };
            field.divide(&mut image).expect("one size");
            let spread = |b: usize| {
                let of_band = image.light.pixels.iter().skip(b).step_by(3);
                of_band.clone().copied().fold(0.0, f32::max)
                    / of_band.copied().fold(f32::INFINITY, f32::min)
            };
            assert!((0..3).all(|b| spread(b) < 1.02), "{} {} {}", spread(0), spread(1), spread(2));
        }
        let mut small = SensorImage { light: LinearImage::new(5, 5, 3), mosaic: None };
        assert!(FlatField::from_fn(41, 31, falloff).divide(&mut small).is_err());
    }
}
