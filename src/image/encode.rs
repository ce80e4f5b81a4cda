//! Pixel values → JPEG and PNG files.

use image::ImageEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use libjpeg_turbo_rs::{PixelFormat, Subsampling};

use super::ImageShape;

/// Encodes 8-bit samples (row-major, 1 or 3 bands) as JPEG.
///
/// # Errors
/// The encoder's message; images over 65535 pixels a side.
pub fn jpeg(
    samples: &[u8],
    shape: ImageShape,
    quality: u8,
    subsampled: bool,
) -> Result<Vec<u8>, String> {
    let ImageShape { width, height, bands } = shape;
    if width.max(height) > 65535 {
        return Err(format!("a JPEG cannot hold {width}×{height} pixels; use --image-format png"));
    }
    let format = if bands == 1 { PixelFormat::Grayscale } else { PixelFormat::Rgb };
    let sampling = match (bands, subsampled) {
        (3, true) => Subsampling::S420,
        _ => Subsampling::S444,
    };
    libjpeg_turbo_rs::compress(samples, width, height, format, quality, sampling)
        .map_err(|e| format!("the JPEG encoder failed: {e}"))
}

/// Encodes 8-bit samples (row-major, 1 or 3 bands), or 16-bit ones given as native-endian bytes, as
/// PNG.
///
/// # Errors
/// The encoder's message.
pub fn png(samples: &[u8], shape: ImageShape, bits: u8) -> Result<Vec<u8>, String> {
    use image::ExtendedColorType as C;
    let color = match (shape.bands, bits) {
        (1, 8) => C::L8,
        (1, _) => C::L16,
        (_, 8) => C::Rgb8,
        _ => C::Rgb16,
    };
    let mut out = Vec::with_capacity(samples.len());
    PngEncoder::new_with_quality(&mut out, CompressionType::Fast, FilterType::Adaptive)
        .write_image(samples, shape.width as u32, shape.height as u32, color)
        .map_err(|e| format!("the PNG encoder failed: {e}"))?;
    Ok(out)
}
