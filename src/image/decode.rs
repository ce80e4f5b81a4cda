//! Encoded picture → linear picture. Every trap of `sensor_msgs/image_encodings` ends here.
//!
//! In: bytes of a message. Out: light per band, 1 = full scale, and how the picture was coded. What the
//! camera's lens or exposure did to the light does not live here.

use std::io::Cursor;

use image::ImageDecoder;

use super::demosaic::Phase;
use super::packed::Packing;
use super::response::Response;
use super::transfer::Transfer;
use super::{Container, EncodedImage, LinearImage, SensorImage, yuv};

/// How codes are to be read.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Light<'r> {
    /// the camera's response
    pub transfer: Transfer,
    /// the response as a table, instead
    pub response: Option<&'r Response>,
    /// code of full scale in 16-bit pictures; 65535 where `None`
    pub white_level: Option<u16>,
}

/// How a picture was coded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coding {
    /// bits per sample, 8 or 16
    pub bits: u8,
    /// the container
    pub container: Container,
    /// the response that was undone where there was no table: never [`Transfer::Auto`]
    pub transfer: Transfer,
    /// all codes or-ed together: which bits the sensor uses
    pub bits_used: u16,
}

/// Full scale of 16-bit pictures whose codes, or-ed together, are `bits_used`: 10, 12 or 14 bits may lie at the top of
/// the 16 (the lowest bits are never set) or at the bottom (the highest are never set).
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

/// A decoded picture and how it was coded.
#[derive(Clone, Debug, PartialEq)]
pub struct Decoded {
    /// light
    pub image: SensorImage,
    /// how it was coded
    pub coding: Coding,
}

/// Pictures larger than this are taken for damage [px].
const MOST_PIXELS: usize = 400_000_000;

/// How the samples of a raw encoding lie.
#[derive(Clone, Copy)]
struct Samples {
    channels: usize,
    bytes: usize,
    /// blue first
    swapped: bool,
    bayer: Option<Phase>,
}

fn samples(encoding: &str) -> Option<Samples> {
    let word = encoding.to_ascii_lowercase();
    let plain = |channels, bytes, swapped| Some(Samples { channels, bytes, swapped, bayer: None });
    let bayer = |phase, bytes| Some(Samples { channels: 1, bytes, swapped: false, bayer: Some(phase) });
    let bayer_word = word.strip_prefix("bayer").map(|w| w.trim_start_matches('_').to_string());
    if let Some(rest) = bayer_word {
        let phase = match rest.trim_end_matches(|c: char| c.is_ascii_digit() || c == 'p') {
            "rggb" | "rg" => Phase::Rggb,
            "bggr" | "bg" => Phase::Bggr,
            "gbrg" | "gb" => Phase::Gbrg,
            "grbg" | "gr" => Phase::Grbg,
            _ => return None,
        };
        return match rest.trim_start_matches(|c: char| c.is_ascii_alphabetic()) {
            "8" => bayer(phase, 1),
            "10" | "12" | "14" | "16" => bayer(phase, 2),
            _ => None,
        };
    }
    match word.as_str() {
        "rgb8" => plain(3, 1, false),
        "bgr8" | "8uc3" => plain(3, 1, true),
        "rgba8" => plain(4, 1, false),
        "bgra8" | "8uc4" => plain(4, 1, true),
        "rgb16" => plain(3, 2, false),
        "bgr16" | "16uc3" => plain(3, 2, true),
        "rgba16" => plain(4, 2, false),
        "bgra16" => plain(4, 2, true),
        "mono8" | "8uc1" => plain(1, 1, false),
        "mono16" | "16uc1" | "mono10" | "mono12" | "mono14" => plain(1, 2, false),
        _ => None,
    }
}

/// Decodes a picture into linear light.
///
/// # Errors
/// A sentence: an encoding that is not read, sizes that contradict the data, a damaged file.
pub fn decode(encoded: &EncodedImage<'_>, light: Light<'_>) -> Result<Decoded, String> {
    match *encoded {
        EncodedImage::Raw { width, height, encoding, step, data, .. } if yuv::is_yuv(encoding) => {
            ensure_size(width, height)?;
            let rgb = yuv::to_rgb8(encoding, (width, height), step, data).ok_or_else(|| misfit(encoded))?;
            let s = Samples { channels: 3, bytes: 1, swapped: false, bayer: None };
            linear(rgb.chunks_exact(3 * width), width, height, s, false, Container::Raw, light)
        }
        EncodedImage::Raw { width, height, encoding, big_endian, step, data } => {
            ensure_size(width, height)?;
            if let Some((packing, s)) = Packing::of(encoding).and_then(|p| samples(&p.unpacked).map(|s| (p, s))) {
                let unpacked = packing.unpack((width, height), step, data).ok_or_else(|| misfit(encoded))?;
                return linear(unpacked.chunks_exact(2 * width), width, height, s, false, Container::Raw, light);
            }
            let s = samples(encoding).ok_or_else(|| not_read(encoding))?;
            let row = width * s.channels * s.bytes;
            let needed = step.checked_mul(height - 1).and_then(|n| n.checked_add(row));
            if step < row || needed.is_none_or(|n| n > data.len()) {
                return Err(misfit(encoded));
            }
            let rows = (0..height).map(|y| &data[y * step..y * step + row]);
            linear(rows, width, height, s, big_endian, Container::Raw, light)
        }
        EncodedImage::Compressed { format, data } => compressed(format, data, light),
        EncodedImage::Video { codec } => Err(format!("{codec} video is not read")),
    }
}

fn not_read(encoding: &str) -> String {
    let word = encoding.to_ascii_lowercase();
    let why = match word.get(..word.len().saturating_sub(2)) {
        Some("8s" | "16s" | "32s") => ": signed numbers have no full scale that would be light",
        Some("32f" | "64f") => ": floats have no full scale; `32FC1` is read as a depth picture on a topic of that name",
        Some("8u" | "16u") => ": two channels are neither grey nor colour",
        _ => "",
    };
    format!("the image encoding {encoding:?} is not read{why}")
}

fn misfit(encoded: &EncodedImage<'_>) -> String {
    match encoded {
        EncodedImage::Raw { width, height, encoding, step, data, .. } => {
            format!("{width}×{height} {encoding} with step {step} does not fit its {} bytes", data.len())
        }
        _ => "the picture does not fit its bytes".into(),
    }
}

/// Width, height and codes of a grey 16-bit PNG: a depth picture.
///
/// # Errors
/// Another kind of file, or a damaged one.
pub fn grey16(data: &[u8]) -> Result<(usize, usize, Vec<u16>), String> {
    let bad = |e: image::ImageError| format!("the picture cannot be decoded: {e}");
    let decoder = image::codecs::png::PngDecoder::new(Cursor::new(data)).map_err(bad)?;
    let (width, height) = decoder.dimensions();
    let (width, height) = (width as usize, height as usize);
    ensure_size(width, height)?;
    ensure_plausible(width, height, data)?;
    if decoder.color_type() != image::ColorType::L16 {
        return Err("a depth picture that is not grey with 16 bits".into());
    }
    let mut bytes = vec![0; width * height * 2];
    decoder.read_image(&mut bytes).map_err(bad)?;
    Ok((width, height, bytes.chunks_exact(2).map(|b| u16::from_ne_bytes([b[0], b[1]])).collect()))
}

/// Width and height, as far as they can be told without decoding.
pub fn size(encoded: &EncodedImage<'_>) -> Option<(usize, usize)> {
    match *encoded {
        EncodedImage::Raw { width, height, .. } => Some((width, height)),
        EncodedImage::Compressed { data, .. } => {
            let (w, h) = image::ImageReader::new(Cursor::new(data)).with_guessed_format().ok()?.into_dimensions().ok()?;
            Some((w as usize, h as usize))
        }
        EncodedImage::Video { .. } => None,
    }
}

/// One line on how a picture is coded, for tables.
pub fn describe(encoded: &EncodedImage<'_>) -> String {
    match *encoded {
        EncodedImage::Raw { width, height, encoding, .. } => format!("{encoding} {width}×{height}"),
        EncodedImage::Compressed { data, .. } => {
            let kind = match data {
                [0xff, 0xd8, ..] => "jpeg",
                [0x89, b'P', b'N', b'G', ..] => "png",
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
        Some(n) if width >= 3 && height >= 3 && n <= MOST_PIXELS => Ok(()),
        _ => Err(format!("a picture of {width}×{height} pixels is not taken")),
    }
}

/// No coder shrinks a picture below this; a header that claims more lies about its size, and nothing is allocated for it.
const MOST_PIXELS_PER_BYTE: usize = 4096;
/// Small pictures are let through whatever their bytes [px].
const FREE_PIXELS: usize = 1 << 20;

fn ensure_plausible(width: usize, height: usize, data: &[u8]) -> Result<(), String> {
    if width * height <= FREE_PIXELS + MOST_PIXELS_PER_BYTE * data.len() {
        return Ok(());
    }
    Err(format!("a file of {} bytes claims {width}×{height} pixels", data.len()))
}

fn is_webp(data: &[u8]) -> bool {
    data.starts_with(b"RIFF") && data.get(8..12) == Some(b"WEBP")
}

/// Lossless WebP is treated like PNG, lossy WebP like a JPEG that halves its colour, which it does.
fn webp_container(data: &[u8]) -> Container {
    let lossless = data.windows(4).take(256).any(|w| w == b"VP8L");
    if lossless { Container::Png } else { Container::Jpeg { subsampled: true } }
}

fn compressed(format: &str, data: &[u8], light: Light<'_>) -> Result<Decoded, String> {
    let bad = |e: image::ImageError| format!("the picture cannot be decoded: {e}");
    let (mut decoder, container): (Box<dyn ImageDecoder + '_>, _) = match data {
        [0xff, 0xd8, ..] if !jpeg_has_end(data) => return Err("the picture cannot be decoded: a JPEG that was cut short".into()),
        [0xff, 0xd8, ..] => {
            let subsampled = jpeg_is_subsampled(data);
            (Box::new(image::codecs::jpeg::JpegDecoder::new(Cursor::new(data)).map_err(bad)?), Container::Jpeg { subsampled })
        }
        [0x89, b'P', b'N', b'G', ..] => (Box::new(image::codecs::png::PngDecoder::new(Cursor::new(data)).map_err(bad)?), Container::Png),
        data if is_webp(data) => (Box::new(image::codecs::webp::WebPDecoder::new(Cursor::new(data)).map_err(bad)?), webp_container(data)),
        _ => return Err(format!("a compressed picture that is neither JPEG, PNG nor WebP (format {format:?})")),
    };
    let mut limits = image::Limits::default();
    limits.max_alloc = Some(4 << 30);
    decoder.set_limits(limits).map_err(bad)?;
    let (width, height) = decoder.dimensions();
    let (width, height) = (width as usize, height as usize);
    ensure_size(width, height)?;
    ensure_plausible(width, height, data)?;
    use image::ColorType as C;
    let (channels, bytes) = match decoder.color_type() {
        C::L8 => (1, 1),
        C::La8 => (2, 1),
        C::Rgb8 => (3, 1),
        C::Rgba8 => (4, 1),
        C::L16 => (1, 2),
        C::La16 => (2, 2),
        C::Rgb16 => (3, 2),
        C::Rgba16 => (4, 2),
        other => return Err(format!("pictures of {other:?} are not read")),
    };
    let mut pixels = vec![0; width * height * channels * bytes];
    decoder.read_image(&mut pixels).map_err(bad)?;
    // A grey file whose original was a mosaic, with nothing said of debayering: the mosaic itself was compressed.
    let (original, tail) = format.split_once(';').unwrap_or((format, "x"));
    let was_debayered = tail.trim_end().ends_with('8') || tail.trim_end().ends_with('6');
    let bayer = if channels == 1 && !was_debayered { samples(original.trim()).and_then(|s| s.bayer) } else { None };
    let s = Samples { channels, bytes, swapped: false, bayer };
    let stride = width * channels * bytes;
    linear(pixels.chunks_exact(stride), width, height, s, cfg!(target_endian = "big"), container, light)
}

fn linear<'a>(
    rows: impl Iterator<Item = &'a [u8]>,
    width: usize,
    height: usize,
    s: Samples,
    big_endian: bool,
    container: Container,
    light: Light<'_>,
) -> Result<Decoded, String> {
    let transfer = match light.transfer {
        Transfer::Auto if s.bytes == 2 || s.bayer.is_some() => Transfer::Linear,
        Transfer::Auto => Transfer::Srgb,
        chosen => chosen,
    };
    let bands = if s.channels >= 3 { 3 } else { 1 };
    let mut pixels = Vec::with_capacity(width * height * bands);
    let mut bits_used = 0u16;
    if s.bytes == 1 {
        let table = match light.response {
            Some(response) => std::array::from_fn(|code| response.to_linear(code as f64 / 255.0) as f32),
            None => transfer.table8(),
        };
        for row in rows {
            for pixel in row.chunks_exact(s.channels) {
                for band in 0..bands {
                    let code = pixel[if s.swapped { bands - 1 - band } else { band }];
                    bits_used |= u16::from(code);
                    pixels.push(table[usize::from(code)]);
                }
            }
        }
    } else {
        let white = f32::from(light.white_level.unwrap_or(u16::MAX));
        let read = if big_endian { u16::from_be_bytes } else { u16::from_le_bytes };
        for row in rows {
            for pixel in row.chunks_exact(2 * s.channels) {
                for band in 0..bands {
                    let at = 2 * if s.swapped { bands - 1 - band } else { band };
                    let code = read([pixel[at], pixel[at + 1]]);
                    bits_used |= code;
                    pixels.push(f32::from(code) / white);
                }
            }
        }
        if let Some(response) = light.response {
            for v in &mut pixels {
                *v = response.to_linear(f64::from(v.min(1.0))) as f32;
            }
        } else if transfer != Transfer::Linear {
            for v in &mut pixels {
                *v = transfer.to_linear(f64::from(v.min(1.0))) as f32;
            }
        }
    }
    let coding = Coding { bits: 8 * s.bytes as u8, container, transfer, bits_used };
    Ok(Decoded { image: SensorImage { light: LinearImage { width, height, bands, pixels }, mosaic: s.bayer }, coding })
}

/// Whether a JPEG's scan comes to an end. The decoder shows grey where it does not, and nobody would know.
fn jpeg_has_end(data: &[u8]) -> bool {
    let last = |marker: [u8; 2]| data.windows(2).rposition(|w| w == marker);
    // A thumbnail's end lies before the scan.
    last([0xff, 0xd9]).zip(last([0xff, 0xda])).is_some_and(|(end, scan)| end > scan)
}

/// Whether a JPEG's frame header gives its first component finer sampling than the others.
fn jpeg_is_subsampled(data: &[u8]) -> bool {
    let mut at = 2;
    while let Some([0xff, marker, hi, lo]) = data.get(at..at + 4) {
        let length = usize::from(u16::from_be_bytes([*hi, *lo]));
        if matches!(marker, 0xc0..=0xcf) && !matches!(marker, 0xc4 | 0xc8 | 0xcc) {
            let components = data.get(at + 9).copied().unwrap_or(1);
            return components >= 3 && data.get(at + 11).is_some_and(|sampling| *sampling != 0x11);
        }
        at += 2 + length.max(2);
    }
    false
}
