//! Encoded image → linear image; all encodings of `sensor_msgs/image_encodings` are handled here.
//!
//! In: bytes of a message. Out: linear light per band, 1 = full scale, and how the image was
//! encoded. Vignetting and exposure are corrected elsewhere.

use std::io::Cursor;

use image::ImageDecoder;

use super::encoding::SampleLayout;
use super::packed::Packing;
use super::pixel_values::StoredSamples;
pub use super::pixel_values::{CameraResponse, Coding, PixelValues};
use super::{Container, EncodedImage, SensorImage, jpeg_header, jpeg_tables, yuv};

/// Full scale (DN) of 16-bit images whose pixel values, combined by bitwise or, are `bits_used`.
/// Sensors of 10, 12 or 14 bits use the upper bits of the 16 (the lowest are never set) or the
/// lower ones (the highest are never set).
pub fn white_level(bits_used: u16) -> u16 {
    match bits_used.trailing_zeros() {
        0 | 16 => match 16 - bits_used.leading_zeros() {
            1..=10 => 1023,
            11..=12 => 4095,
            13..=14 => 16383,
            _ => 65535,
        },
        unused => 0xffff << unused.min(6),
    }
}

/// A decoded image and how it was encoded.
#[derive(Clone, Debug, PartialEq)]
pub struct DecodedImage {
    /// in linear light
    pub image: SensorImage,
    /// encoding and bit depth
    pub coding: Coding,
}

/// Larger images are taken for damaged (px).
const MAX_PIXELS: usize = 400_000_000;

/// Decodes an image into linear light.
///
/// # Errors
/// See [`read_pixels`].
pub fn decode(
    encoded: &EncodedImage<'_>,
    response: CameraResponse<'_>,
) -> Result<DecodedImage, String> {
    let values = read_pixels(encoded, response)?;
    Ok(DecodedImage { image: values.to_linear(Vec::new()), coding: values.coding })
}

/// Pixel values of an image.
///
/// # Errors
/// An encoding that is not supported, sizes that contradict the data, a damaged file.
pub fn read_pixels<'a>(
    encoded: &EncodedImage<'a>,
    response: CameraResponse<'a>,
) -> Result<PixelValues<'a>, String> {
    read_pixels_with(encoded, response, Vec::new())
}

/// As [`read_pixels`], with a reused buffer; [`PixelValues::into_buffer`] returns it.
///
/// # Errors
/// As [`read_pixels`].
pub fn read_pixels_with<'a>(
    encoded: &EncodedImage<'a>,
    response: CameraResponse<'a>,
    buffer: Vec<u8>,
) -> Result<PixelValues<'a>, String> {
    let samples = match *encoded {
        EncodedImage::Raw { width, height, encoding, big_endian, step, data } => {
            ensure_size(width, height)?;
            let size = (width, height);
            let mismatch = || {
                let bytes = data.len();
                format!(
                    "{width}×{height} {encoding} with step {step} does not fit its {bytes} bytes"
                )
            };
            let (data, step, layout, big_endian) = if yuv::is_yuv(encoding) {
                let rgb = yuv::to_rgb8(encoding, size, step, data);
                let rgb = rgb.ok_or_else(mismatch)?;
                (rgb.into(), 3 * width, SampleLayout::new(3, 1, false), false)
            } else if let Some((packing, layout)) = Packing::from_encoding(encoding)
                .and_then(|p| SampleLayout::from_encoding(&p.unpacked).map(|layout| (p, layout)))
            {
                let unpacked = packing.unpack(size, step, data);
                (unpacked.ok_or_else(mismatch)?.into(), 2 * width, layout, false)
            } else {
                let layout =
                    SampleLayout::from_encoding(encoding).ok_or_else(|| unsupported(encoding))?;
                let row = width * layout.channels * layout.bytes;
                // Some drivers leave it 0.
                let step = if step == 0 && row * height == data.len() { row } else { step };
                let needed = step.checked_mul(height - 1).and_then(|n| n.checked_add(row));
                if step < row || needed.is_none_or(|n| n > data.len()) {
                    return Err(mismatch());
                }
                (data.into(), step, layout, big_endian)
            };
            let container = Container::Raw;
            StoredSamples { data, width, height, step, layout, big_endian, container }
        }
        EncodedImage::Compressed { format, data } => decompress(format, data, buffer)?,
        EncodedImage::Video { codec } => return Err(format!("{codec} video is not supported")),
    };
    Ok(PixelValues::new(samples, response))
}

fn unsupported(encoding: &str) -> String {
    let name = encoding.to_ascii_lowercase();
    let reason = match name.get(..name.len().saturating_sub(2)) {
        Some("8s" | "16s" | "32s") => ": signed pixel values have no defined full scale",
        Some("32f" | "64f") => {
            ": floating-point pixel values have no defined full scale (`32FC1` is supported as a \
             depth image, on a topic of that name)"
        }
        Some("8u" | "16u") => ": two channels are neither grey nor colour",
        _ => "",
    };
    format!("the image encoding {encoding:?} is not supported{reason}")
}

fn cannot_decode(error: image::ImageError) -> String {
    format!("the image cannot be decoded: {error}")
}

/// Width, height and pixel values (DN) of a grey 16-bit PNG: a depth image.
///
/// # Errors
/// Another kind of file, or a damaged one.
pub fn grey16(data: &[u8]) -> Result<(usize, usize, Vec<u16>), String> {
    let decoder = image::codecs::png::PngDecoder::new(Cursor::new(data)).map_err(cannot_decode)?;
    let (width, height) = plausible_size(&decoder, data)?;
    if decoder.color_type() != image::ColorType::L16 {
        return Err("the depth image is not grey with 16 bits".into());
    }
    let mut bytes = vec![0; width * height * 2];
    decoder.read_image(&mut bytes).map_err(cannot_decode)?;
    Ok((width, height, bytes.chunks_exact(2).map(|b| u16::from_ne_bytes([b[0], b[1]])).collect()))
}

/// Width and height (px), where they are known without decoding.
pub fn size(encoded: &EncodedImage<'_>) -> Option<(usize, usize)> {
    match *encoded {
        EncodedImage::Raw { width, height, .. } => Some((width, height)),
        EncodedImage::Compressed { data, .. } => {
            let (w, h) = image::ImageReader::new(Cursor::new(data))
                .with_guessed_format()
                .ok()?
                .into_dimensions()
                .ok()?;
            Some((w as usize, h as usize))
        }
        EncodedImage::Video { .. } => None,
    }
}

/// Encoding and size for tables: `jpeg 1360×1024`.
pub fn describe(encoded: &EncodedImage<'_>) -> String {
    match *encoded {
        EncodedImage::Raw { width, height, encoding, .. } => format!("{encoding} {width}×{height}"),
        EncodedImage::Compressed { data, .. } => {
            let kind = match data {
                [0xff, 0xd8, ..] => "jpeg",
                [0x89, b'P', b'N', b'G', ..] => "png",
                [b'I', b'I', 42, 0, ..] | [b'M', b'M', 0, 42, ..] => "tiff",
                data if is_webp(data) => "webp",
                _ => "unknown",
            };
            size(encoded).map_or_else(|| kind.into(), |(w, h)| format!("{kind} {w}×{h}"))
        }
        EncodedImage::Video { codec } => format!("{codec} video"),
    }
}

fn ensure_size(width: usize, height: usize) -> Result<(), String> {
    match width.checked_mul(height) {
        Some(n) if width >= 3 && height >= 3 && n <= MAX_PIXELS => Ok(()),
        _ => Err(format!("images of {width}×{height} pixels are not supported")),
    }
}

/// No codec compresses further than this. A header that claims more is damaged, and nothing is
/// allocated for it.
const MAX_PIXELS_PER_BYTE: usize = 4096;
/// Images up to this size are accepted whatever their number of bytes (px).
const ALWAYS_PLAUSIBLE_PIXELS: usize = 1 << 20;

/// Size of a compressed image, if it is supported and plausible for the number of bytes.
fn plausible_size(decoder: &impl ImageDecoder, data: &[u8]) -> Result<(usize, usize), String> {
    let (width, height) = decoder.dimensions();
    let (width, height) = (width as usize, height as usize);
    ensure_size(width, height)?;
    if width * height <= ALWAYS_PLAUSIBLE_PIXELS + MAX_PIXELS_PER_BYTE * data.len() {
        return Ok((width, height));
    }
    Err(format!("a file of {} bytes claims {width}×{height} pixels", data.len()))
}

fn is_webp(data: &[u8]) -> bool {
    data.starts_with(b"RIFF") && data.get(8..12) == Some(b"WEBP")
}

/// Lossless WebP counts as PNG, lossy WebP as JPEG with subsampled chroma, which it has.
fn webp_container(data: &[u8]) -> Container {
    let lossless = data.windows(4).take(256).any(|w| w == b"VP8L");
    if lossless { Container::Png } else { Container::Jpeg { subsampled: true } }
}

/// The decoder for a file, by its first bytes.
fn open<'d>(
    format: &str,
    data: &'d [u8],
) -> Result<(Box<dyn ImageDecoder + 'd>, Container), String> {
    use image::codecs::{jpeg::JpegDecoder, png::PngDecoder, tiff::TiffDecoder, webp::WebPDecoder};
    let file = Cursor::new(data);
    Ok(match data {
        [0xff, 0xd8, ..] if !jpeg_header::is_complete(data) => {
            return Err("the image cannot be decoded: truncated JPEG".into());
        }
        [0xff, 0xd8, ..] => {
            let subsampled = jpeg_header::is_subsampled(data);
            (
                Box::new(JpegDecoder::new(file).map_err(cannot_decode)?),
                Container::Jpeg { subsampled },
            )
        }
        [0x89, b'P', b'N', b'G', ..] => {
            (Box::new(PngDecoder::new(file).map_err(cannot_decode)?), Container::Png)
        }
        data if is_webp(data) => {
            (Box::new(WebPDecoder::new(file).map_err(cannot_decode)?), webp_container(data))
        }
        [b'I', b'I', 42, 0, ..] | [b'M', b'M', 0, 42, ..] => {
            (Box::new(TiffDecoder::new(file).map_err(cannot_decode)?), Container::Png)
        }
        _ => {
            return Err(format!(
                "the compressed image is neither JPEG, PNG, TIFF nor WebP (format {format:?})"
            ));
        }
    })
}

fn decompress<'a>(format: &str, data: &[u8], buffer: Vec<u8>) -> Result<StoredSamples<'a>, String> {
    use image::ColorType as C;
    let data = &*jpeg_tables::with_tables(data);
    let (mut decoder, container) = open(format, data)?;
    let mut limits = image::Limits::default();
    limits.max_alloc = Some(4 << 30);
    decoder.set_limits(limits).map_err(cannot_decode)?;
    let (width, height) = plausible_size(&decoder, data)?;
    let (channels, bytes) = match decoder.color_type() {
        C::L8 => (1, 1),
        C::La8 => (2, 1),
        C::Rgb8 => (3, 1),
        C::Rgba8 => (4, 1),
        C::L16 => (1, 2),
        C::La16 => (2, 2),
        C::Rgb16 => (3, 2),
        C::Rgba16 => (4, 2),
        other => return Err(format!("images of type {other:?} are not supported")),
    };
    // Cleared first: where a damaged file leaves pixels out, those of the previous image must not
    // remain.
    let mut pixels = buffer;
    if !jpeg_header::is_one_scan(data) {
        pixels.clear();
    }
    pixels.resize(width * height * channels * bytes, 0);
    decoder.read_image(&mut pixels).map_err(cannot_decode)?;
    // A grey file of a Bayer original whose format names no debayered encoding: the mosaic itself
    // was compressed.
    let (original, tail) = format.split_once(';').unwrap_or((format, "x"));
    let was_debayered = tail.trim_end().ends_with('8') || tail.trim_end().ends_with('6');
    let mut layout = SampleLayout::new(channels, bytes, false);
    if channels == 1 && !was_debayered {
        layout.bayer = SampleLayout::from_encoding(original.trim()).and_then(|l| l.bayer);
    }
    let (step, big_endian) = (width * channels * bytes, cfg!(target_endian = "big"));
    Ok(StoredSamples { data: pixels.into(), width, height, step, layout, big_endian, container })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn raw<'d>(
        encoding: &'d str,
        [width, height, step]: [usize; 3],
        data: &'d [u8],
    ) -> EncodedImage<'d> {
        EncodedImage::Raw { width, height, encoding, big_endian: false, step, data }
    }

    /// Linear light of an image that stores linear pixel values.
    fn linear(image: &EncodedImage<'_>, white_level: u16) -> Result<Vec<f32>, String> {
        let transfer = crate::image::transfer::Transfer::Linear;
        let white_level = Some(white_level);
        let response = CameraResponse { transfer, white_level, ..CameraResponse::default() };
        Ok(decode(image, response)?.image.into_demosaiced().pixels)
    }

    #[test]
    fn white_levels_of_10_to_16_bits_in_lower_and_upper_bits() {
        assert_eq!([0x3ff, 0xfff, 0x3fff, 0xffff].map(white_level), [1023, 4095, 16383, 65535]);
        assert_eq!([0xffc0, 0xfff0, 0xfffc].map(white_level), [0xffc0, 0xfff0, 0xfffc]);
        // A dark image sets no upper bits and is taken for one of fewer bits.
        assert_eq!([0x0001, 0x0155].map(white_level), [1023, 1023]);
    }

    #[test]
    fn bytes_between_rows_are_skipped() {
        let rows: Vec<u8> = (0..3u8).flat_map(|y| [10 * y, 10 * y + 1, 10 * y + 2, 255]).collect();
        let light = linear(&raw("mono8", [3, 3, 4], &rows), 255).expect("an image");
        let expected = [0.0, 1.0, 2.0, 10.0, 11.0, 12.0, 20.0, 21.0, 22.0].map(|v| v / 255.0);
        assert!(light.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{light:?}");
    }

    #[test]
    fn byte_order_and_order_of_bands_are_respected() {
        let values = [1u16, 300, 4095, 2, 5, 600, 7, 800, 9];
        let little: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let big: Vec<u8> = values.iter().flat_map(|v| v.to_be_bytes()).collect();
        let big = EncodedImage::Raw {
            width: 3,
            height: 3,
            encoding: "mono16",
            big_endian: true,
            step: 6,
            data: &big,
        };
        let light = linear(&raw("mono16", [3, 3, 6], &little), 4095).expect("an image");
        assert_eq!(light, linear(&big, 4095).expect("an image"));
        assert!((light[2] - 1.0).abs() < 1e-6 && (light[1] - 300.0 / 4095.0).abs() < 1e-6);

        let bytes: Vec<u8> = (0..27).collect();
        let swapped: Vec<u8> = bytes.chunks_exact(3).flat_map(|p| [p[2], p[1], p[0]]).collect();
        assert_eq!(
            linear(&raw("rgb8", [3, 3, 9], &bytes), 255),
            linear(&raw("bgr8", [3, 3, 9], &swapped), 255)
        );
    }

    #[test]
    fn sizes_that_do_not_fit_are_errors() {
        let data = [0; 27];
        for (size, data) in [
            ([3, 3, 8], &data[..]),                   // rows overlap
            ([3, 3, 9], &data[..26]),                 // a byte is missing
            ([3, 3, usize::MAX], &data[..]),          // overflows
            ([2, 3, 9], &data[..]),                   // too small to demosaic
            ([1 << 20, 1 << 20, 3 << 20], &data[..]), // larger than any camera's
        ] {
            let error = linear(&raw("rgb8", size, data), 255).expect_err("no image");
            assert!(error.contains(&size[0].to_string()), "{size:?}: {error}");
        }
        // A step of 0 is that of rows without a gap, where the data fit exactly.
        let exact = linear(&raw("rgb8", [3, 3, 9], &data), 255);
        assert_eq!(linear(&raw("rgb8", [3, 3, 0], &data), 255), exact);
        assert!(linear(&raw("rgb8", [3, 3, 0], &[0; 28]), 255).is_err());
        // The last row needs no bytes after it.
        assert!(linear(&raw("rgb8", [3, 2 + 1, 9], &data), 255).is_ok());
    }

    #[test]
    fn unsupported_encodings_are_named() {
        for encoding in ["32FC1", "16SC1", "8UC2", "no_such_encoding"] {
            let error = linear(&raw(encoding, [3, 3, 12], &[0; 36]), 255).expect_err("no image");
            assert!(error.contains(encoding), "{error}");
        }
        let video = EncodedImage::Video { codec: "h264" };
        assert!(linear(&video, 255).expect_err("no image").contains("h264"));
    }

    #[test]
    fn a_truncated_file_is_an_error() {
        let shape = crate::image::ImageShape { width: 16, height: 16, bands: 3 };
        let samples: Vec<u8> = (0..16 * 16 * 3).map(|i| (i * 7 % 251) as u8).collect();
        let files = [
            ("jpeg", crate::image::encode::jpeg(&samples, shape, 90, false)),
            ("png", crate::image::encode::png(&samples, shape, 8)),
        ];
        for (format, file) in files {
            let file = file.expect("a file");
            let whole = EncodedImage::Compressed { format, data: &file };
            assert_eq!(size(&whole), Some((16, 16)));
            assert_eq!(linear(&whole, 255).expect("an image").len(), samples.len());
            let cut = EncodedImage::Compressed { format, data: &file[..file.len() / 2] };
            assert!(linear(&cut, 255).is_err(), "half a {format} is read");
        }
    }
}
