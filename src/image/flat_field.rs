//! Flat-field correction (Eq. 7): black level and relative transmission of lens and sensor, from a
//! vignetting formula or from an image of an evenly lit surface. Divided out of every image before
//! all other steps, and before demosaicing.

use std::borrow::Cow;

use super::demosaic::BayerPattern;
use super::{Bands, LinearImage, SensorImage};

/// Lower bound of the transmission; darker pixels carry no information.
const MIN_TRANSMISSION: f32 = 0.02;
/// Quantile of an image that counts as transmission 1; single pixels may be outliers.
const WHITE_QUANTILE: f64 = 0.99;

/// Transmission per pixel and band; 1 at the brightest pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct FlatField {
    transmission: LinearImage,
    /// whether it is smooth, so that images of another size of the same camera can use it
    is_formula: bool,
    /// black level per band, subtracted before (share of full scale)
    dark: Bands,
}

impl FlatField {
    /// From the transmission at column and row (px), the same for all bands.
    pub fn from_fn(width: usize, height: usize, at: impl Fn(f64, f64) -> f64) -> Self {
        let mut transmission = LinearImage::new(width, height, 1);
        for (y, row) in transmission.pixels.chunks_exact_mut(width).enumerate() {
            row.iter_mut()
                .enumerate()
                .for_each(|(x, v)| *v = (at(x as f64, y as f64) as f32).max(MIN_TRANSMISSION));
        }
        Self { transmission, is_formula: true, dark: [0.0; 3] }
    }

    /// Of transmission 1.
    pub fn even(width: usize, height: usize) -> Self {
        Self::from_fn(width, height, |_, _| 1.0)
    }

    /// The same with a black level per band (share of full scale).
    #[must_use]
    pub fn with_dark(self, dark: Bands) -> Self {
        Self { dark, ..self }
    }

    /// From an image of an evenly lit surface by a camera of this black level; each band is
    /// normalised to 1.
    pub fn from_image(mut image: LinearImage, dark: Bands) -> Self {
        for band in 0..image.bands {
            let of_band = image.pixels.iter_mut().skip(band).step_by(image.bands);
            of_band.for_each(|v| *v -= dark[band] as f32);
            let mut values: Vec<f32> =
                image.pixels.iter().skip(band).step_by(image.bands).copied().collect();
            let rank = ((values.len() - 1) as f64 * WHITE_QUANTILE) as usize;
            let white = *values.select_nth_unstable_by(rank, f32::total_cmp).1;
            image
                .pixels
                .iter_mut()
                .skip(band)
                .step_by(image.bands)
                .for_each(|v| *v = (*v / white.max(1e-9)).max(MIN_TRANSMISSION));
        }
        Self { transmission: image, is_formula: false, dark }
    }

    /// The flat field of images of another size that show the same view. One from an image is of
    /// its own size only.
    ///
    /// # Errors
    /// The sizes differ.
    pub fn for_size(&self, width: usize, height: usize) -> Result<Cow<'_, Self>, String> {
        let image = &self.transmission;
        match self.check_size(width, height) {
            Ok(()) => Ok(Cow::Borrowed(self)),
            Err(e) if !self.is_formula => Err(e),
            Err(_) => {
                let place = |at: f64, from: usize, to: usize| {
                    (((at + 0.5) * from as f64 / to as f64) as usize).min(from - 1)
                };
                let scaled = Self::from_fn(width, height, |x, y| {
                    let (column, row) =
                        (place(x, image.width, width), place(y, image.height, height));
                    f64::from(image.at(column, row)[0])
                });
                Ok(Cow::Owned(scaled.with_dark(self.dark)))
            }
        }
    }

    /// Divides an image.
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

    /// Checks the size of an image.
    ///
    /// # Errors
    /// The sizes differ.
    pub fn check_size(&self, width: usize, height: usize) -> Result<(), String> {
        match (self.transmission.width, self.transmission.height) {
            own if own == (width, height) => Ok(()),
            (w, h) => Err(format!("the flat field is {w}×{h} px, the image {width}×{height} px")),
        }
    }

    /// Divides row `y` of an image of the same size.
    fn divide_row(&self, y: usize, mosaic: Option<BayerPattern>, light: &mut [f32]) {
        let stored = light.len() / self.transmission.width;
        for (x, pixel) in light.chunks_exact_mut(stored).enumerate() {
            for (b, value) in pixel.iter_mut().enumerate() {
                *value = self.divided(*value, (x, y), mosaic.map_or(b, |p| p.band(x, y)));
            }
        }
    }

    /// As [`Self::divide`], of a row whose bands follow one another.
    pub fn divide_bands(&self, y: usize, mosaic: Option<BayerPattern>, light: &mut [f32]) {
        for (b, of_band) in light.chunks_exact_mut(self.transmission.width).enumerate() {
            for (x, value) in of_band.iter_mut().enumerate() {
                *value = self.divided(*value, (x, y), mosaic.map_or(b, |p| p.band(x, y)));
            }
        }
    }

    fn divided(&self, value: f32, (x, y): (usize, usize), band: usize) -> f32 {
        let transmission = self.transmission.at(x, y);
        (value - self.dark[band] as f32) / transmission[band.min(transmission.len() - 1)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_formula_fits_images_of_another_size_and_an_image_does_not() {
        let falloff = |x: f64, y: f64| 1.0 / (1.0 + (x - 20.0).hypot(y - 15.0) / 90.0);
        let field = FlatField::from_fn(40, 30, falloff).with_dark([0.01; 3]);
        let half = field.for_size(20, 15).expect("a formula");
        let mut image = SensorImage { light: LinearImage::new(20, 15, 1), mosaic: None };
        for (i, v) in image.light.pixels.iter_mut().enumerate() {
            let (x, y) = (2.0 * (i % 20) as f64 + 0.5, 2.0 * (i / 20) as f64 + 0.5);
            *v = (0.5 * falloff(x, y) + 0.01) as f32;
        }
        half.divide(&mut image).expect("its size");
        assert!(image.light.pixels.iter().all(|v| (v - 0.5).abs() < 0.01), "{image:?}");
        let flat = FlatField::from_image(LinearImage::new(40, 30, 1), [0.0; 3]);
        assert!(flat.for_size(20, 15).is_err() && flat.for_size(40, 30).is_ok());
    }

    #[test]
    fn an_image_of_an_evenly_lit_surface_becomes_uniform() {
        let falloff =
            |x: f64, y: f64| 1.0 / (1.0 + ((x - 20.0).powi(2) + (y - 15.0).powi(2)) / 900.0);
        let mut light = LinearImage::new(41, 31, 3);
        for (i, pixel) in light.pixels.chunks_exact_mut(3).enumerate() {
            let lit = falloff((i % 41) as f64, (i / 41) as f64) as f32;
            pixel.copy_from_slice(&[0.5 * lit, 0.25 * lit, 0.75 * lit]);
        }
        for field in
            [FlatField::from_fn(41, 31, falloff), FlatField::from_image(light.clone(), [0.0; 3])]
        {
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
