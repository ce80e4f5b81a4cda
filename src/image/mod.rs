//! Images: encoded, as stored in the log, and linear, proportional to radiance (paper §II-F, Eq. 8
//! to 9).
//!
//! Eq. 15 holds for the logarithm of linear values only; the logarithm of gamma-encoded values is a
//! silent mistake. [`EncodedImage`] and [`LinearImage`] are therefore different types, and
//! [`decode`](decode::decode) is the only conversion.

pub mod decode;
pub mod demosaic;
pub mod encode;
mod encoding;
pub mod exif;
pub mod flat_field;
pub mod jpeg_header;
mod jpeg_tables;
pub mod noise;
mod packed;
mod pixel_values;
pub mod reduce;
pub mod response;
pub mod tone;
pub mod transfer;
mod vectorised;
mod yuv;

use serde::{Deserialize, Serialize};

pub use vectorised::vectorised;

/// Values of a row whose bands follow one another, pixel by pixel.
pub fn interleaved(row: &[f32], bands: usize) -> impl Iterator<Item = f32> + '_ {
    let width = row.len() / bands;
    (0..width).flat_map(move |x| (0..bands).map(move |band| row[band * width + x]))
}

/// An image as stored in a message.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EncodedImage<'v> {
    /// uncompressed pixels, row-major
    Raw {
        /// (px)
        width: usize,
        /// (px)
        height: usize,
        /// a name of `sensor_msgs/image_encodings`
        encoding: &'v str,
        /// byte order of 16-bit samples
        big_endian: bool,
        /// bytes from one row to the next; may exceed width × bytes per pixel
        step: usize,
        /// `height × step` bytes
        data: &'v [u8],
    },
    /// a JPEG, PNG, TIFF or WebP file
    Compressed {
        /// as in `sensor_msgs/CompressedImage`; only the part before `;`, the encoding before
        /// compression, is used
        format: &'v str,
        /// contents of the file
        data: &'v [u8],
    },
    /// a packet of a video stream; not decodable on its own
    Video {
        /// `h264`, …
        codec: &'v str,
    },
}

/// File format of an image, read or written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Container {
    /// JPEG
    Jpeg {
        /// chroma at half resolution (4:2:0 or 4:2:2)
        subsampled: bool,
    },
    /// PNG
    Png,
    /// uncompressed pixels
    Raw,
}

/// A decoded image in linear light, before demosaicing.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorImage {
    /// one band for a Bayer mosaic
    pub light: LinearImage,
    /// `None` where every pixel has all bands
    pub mosaic: Option<demosaic::BayerPattern>,
}

impl SensorImage {
    /// Number of bands after demosaicing.
    pub fn bands(&self) -> usize {
        if self.mosaic.is_some() { 3 } else { self.light.bands }
    }

    /// Demosaics; all bands at every pixel.
    pub fn into_demosaiced(self) -> LinearImage {
        let LinearImage { width, height, ref pixels, .. } = self.light;
        match self.mosaic {
            Some(phase) => LinearImage {
                width,
                height,
                bands: 3,
                pixels: demosaic::demosaic(pixels, width, height, phase),
            },
            None => self.light,
        }
    }
}

/// Pixels proportional to radiance; 1 is the sensor's full scale.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearImage {
    /// (px)
    pub width: usize,
    /// (px)
    pub height: usize,
    /// 1 (monochrome) or 3 (red, green, blue)
    pub bands: usize,
    /// `height × width × bands`, row-major, bands interleaved
    pub pixels: Vec<f32>,
}

/// Size of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImageShape {
    /// (px)
    pub width: usize,
    /// (px)
    pub height: usize,
    /// 1 (monochrome) or 3 (red, green, blue)
    pub bands: usize,
}

impl LinearImage {
    /// A black image.
    pub fn new(width: usize, height: usize, bands: usize) -> Self {
        Self { width, height, bands, pixels: vec![0.0; width * height * bands] }
    }

    /// Width, height and bands.
    pub fn shape(&self) -> ImageShape {
        ImageShape { width: self.width, height: self.height, bands: self.bands }
    }

    /// Bands of the pixel in column `x` and row `y`.
    pub fn at(&self, x: usize, y: usize) -> &[f32] {
        let start = (y * self.width + x) * self.bands;
        &self.pixels[start..start + self.bands]
    }
}

/// One value per band: red, green, blue; a monochrome image uses the first only.
pub type Bands = [f64; 3];
