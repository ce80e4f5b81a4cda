//! Pictures: encoded as they lie in the log, and linear, proportional to light (paper §II-F, Eq. 8
//! to 9).
//!
//! The logarithm of Eq. 15 is lawful only on linear values; taking the log of gamma-coded ones is
//! the likeliest silent mistake in this field. So [`EncodedImage`] and [`LinearImage`] are
//! different types and [`decode`](decode::decode) is the only way from one to the other.

pub mod decode;
pub mod demosaic;
pub mod encode;
pub mod flat_field;
pub mod noise;
mod packed;
pub mod reduce;
pub mod response;
pub mod transfer;
mod yuv;

/// The largest of many values, none of which counts below 0: eight at a time, in a loop that
/// vectorises.
pub fn max_value(values: &[f32]) -> f32 {
    let (blocks, rest) = values.as_chunks::<8>();
    let most = blocks.iter().fold([0f32; 8], |most, block| {
        std::array::from_fn(|k| if block[k] > most[k] { block[k] } else { most[k] })
    });
    most.iter().chain(rest).copied().fold(0.0, f32::max)
}

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
    /// a JPEG, PNG or WebP file
    Compressed {
        /// what the writer says it is; only its first word, the pixel format before compression, is
        /// believed
        format: &'v str,
        /// the file's bytes
        data: &'v [u8],
    },
    /// a packet of a video stream: no picture by itself
    Video {
        /// `h264`, …
        codec: &'v str,
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

/// A decoded picture: light, still one band per pixel where the sensor has a mosaic.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorImage {
    /// light as measured: `bands` is 1 for a mosaic
    pub light: LinearImage,
    /// the mosaic's phase
    pub mosaic: Option<demosaic::BayerPattern>,
}

impl SensorImage {
    /// Bands of the picture once it is demosaiced.
    pub fn bands(&self) -> usize {
        if self.mosaic.is_some() { 3 } else { self.light.bands }
    }

    /// All bands at every pixel.
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
