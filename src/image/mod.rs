//! Pictures: encoded as they lie in the log, and linear, proportional to light (paper §II-F, Eq. 8 to 9).
//!
//! The logarithm of Eq. 15 is lawful only on linear values; taking the log of gamma-coded ones is the
//! likeliest silent mistake in this field. So [`EncodedImage`] and [`LinearImage`] are different types and
//! [`decode`](decode::decode) is the only way from one to the other.

pub mod decode;
mod demosaic;
pub mod encode;
pub mod transfer;

/// A picture as a message holds it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EncodedImage<'v> {
    /// pixels, row by row
    Raw {
        /// [px]
        width: usize,
        /// [px]
        height: usize,
        /// a `sensor_msgs/image_encodings` word
        encoding: &'v str,
        /// byte order of 16-bit samples
        big_endian: bool,
        /// bytes from one row to the next; may exceed width × bytes per pixel
        step: usize,
        /// the rows
        data: &'v [u8],
    },
    /// a JPEG or PNG file
    Compressed {
        /// what the writer says it is; only its first word, the pixel format before compression, is believed
        format: &'v str,
        /// the file's bytes
        data: &'v [u8],
    },
}

/// The container a picture came in or goes out in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Container {
    /// JPEG; `subsampled` where the source halves its colour (4:2:0 or 4:2:2)
    Jpeg {
        /// colour at half resolution
        subsampled: bool,
    },
    /// PNG
    Png,
    /// bare pixels
    Raw,
}

/// Light, band by band: values proportional to it, 1 = the sensor's full scale.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearImage {
    /// [px]
    pub width: usize,
    /// [px]
    pub height: usize,
    /// 1 (mono) or 3 (red, green, blue)
    pub bands: usize,
    /// `height × width × bands`, interleaved
    pub pixels: Vec<f32>,
}

impl LinearImage {
    /// A black picture.
    pub fn new(width: usize, height: usize, bands: usize) -> Self {
        Self { width, height, bands, pixels: vec![0.0; width * height * bands] }
    }

    /// One pixel's bands.
    pub fn at(&self, x: usize, y: usize) -> &[f32] {
        let start = (y * self.width + x) * self.bands;
        &self.pixels[start..start + self.bands]
    }
}

/// Bands in the order red, green, blue; a mono picture uses the first `bands` of them.
pub type Bands = [f64; 3];
