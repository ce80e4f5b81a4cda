//! Linear picture → bytes of a corrected message: sRGB-coded 8 bit, or linear 16 bit.

use image::ImageEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};

/// Encodes 8-bit samples (1 or 3 bands) as JPEG.
///
/// # Errors
/// The encoder's own words; pictures over 65535 pixels a side.
pub fn jpeg(samples: &[u8], width: usize, height: usize, bands: usize, quality: u8, subsampled: bool) -> Result<Vec<u8>, String> {
    let (Ok(w), Ok(h)) = (u16::try_from(width), u16::try_from(height)) else {
        return Err(format!("a JPEG cannot hold {width}×{height} pixels; use --image-format png"));
    };
    let mut out = Vec::with_capacity(samples.len() / 4);
    let mut encoder = jpeg_encoder::Encoder::new(&mut out, quality);
    encoder.set_sampling_factor(if subsampled { jpeg_encoder::SamplingFactor::F_2_2 } else { jpeg_encoder::SamplingFactor::F_1_1 });
    let color = if bands == 1 { jpeg_encoder::ColorType::Luma } else { jpeg_encoder::ColorType::Rgb };
    encoder.encode(samples, w, h, color).map_err(|e| format!("the JPEG encoder failed: {e}"))?;
    Ok(out)
}

/// Encodes 8-bit samples (1 or 3 bands) as PNG, or 16-bit ones given as native-endian bytes.
///
/// # Errors
/// The encoder's own words.
pub fn png(samples: &[u8], width: usize, height: usize, bands: usize, bits: u8) -> Result<Vec<u8>, String> {
    use image::ExtendedColorType as C;
    let color = match (bands, bits) {
        (1, 8) => C::L8,
        (1, _) => C::L16,
        (_, 8) => C::Rgb8,
        _ => C::Rgb16,
    };
    let mut out = Vec::with_capacity(samples.len());
    PngEncoder::new_with_quality(&mut out, CompressionType::Fast, FilterType::Adaptive)
        .write_image(samples, width as u32, height as u32, color)
        .map_err(|e| format!("the PNG encoder failed: {e}"))?;
    Ok(out)
}
