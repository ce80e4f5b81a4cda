//! Encoded picture → linear picture. Every trap of `sensor_msgs/image_encodings` ends here.
//!
//! In: bytes of a message. Out: light per band, 1 = full scale, and how the picture was coded. What
//! the camera's lens or exposure did to the light does not live here.

use std::borrow::Cow;
use std::io::Cursor;

use image::ImageDecoder;

use super::demosaic::BayerPattern;
use super::packed::Packing;
use super::response::ResponseTable;
use super::transfer::Transfer;
use super::{Container, EncodedImage, LinearImage, SensorImage, yuv};

/// How codes are to be read.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CameraResponse<'r> {
    /// the camera's response
    pub transfer: Transfer,
    /// the response as a table, instead
    pub response: Option<&'r ResponseTable>,
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

/// Full scale of 16-bit pictures whose codes, or-ed together, are `bits_used`: 10, 12 or 14 bits
/// may lie at the top of the 16 (the lowest bits are never set) or at the bottom (the highest are
/// never set).
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
pub struct DecodedImage {
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
    bayer: Option<BayerPattern>,
}

fn samples(encoding: &str) -> Option<Samples> {
    let word = encoding.to_ascii_lowercase();
    let plain = |channels, bytes, swapped| Some(Samples { channels, bytes, swapped, bayer: None });
    let bayer =
        |phase, bytes| Some(Samples { channels: 1, bytes, swapped: false, bayer: Some(phase) });
    let bayer_word = word.strip_prefix("bayer").map(|w| w.trim_start_matches('_').to_string());
    if let Some(rest) = bayer_word {
        let phase = match rest.trim_end_matches(|c: char| c.is_ascii_digit() || c == 'p') {
            "rggb" | "rg" => BayerPattern::Rggb,
            "bggr" | "bg" => BayerPattern::Bggr,
            "gbrg" | "gb" => BayerPattern::Gbrg,
            "grbg" | "gr" => BayerPattern::Grbg,
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
/// See [`read_pixels`].
pub fn decode(
    encoded: &EncodedImage<'_>,
    light: CameraResponse<'_>,
) -> Result<DecodedImage, String> {
    decode_with(encoded, light, &mut Buffers::default())
}

/// The memory of a picture before, for the next one: fresh memory for every frame costs as much as
/// a tenth of decoding.
#[derive(Default)]
pub struct Buffers {
    codes: Vec<u8>,
    light: Vec<f32>,
}

impl Buffers {
    /// Takes back a picture that is no longer needed.
    pub fn recycle(&mut self, image: SensorImage) {
        self.light = image.light.pixels;
    }
}

/// As [`decode`], with the memory of a picture before.
///
/// # Errors
/// See [`read_pixels`].
pub fn decode_with(
    encoded: &EncodedImage<'_>,
    light: CameraResponse<'_>,
    room: &mut Buffers,
) -> Result<DecodedImage, String> {
    let codes = read_pixels_with(encoded, light, std::mem::take(&mut room.codes))?;
    let decoded =
        DecodedImage { image: codes.light(std::mem::take(&mut room.light)), coding: codes.coding };
    room.codes = codes.into_buffer();
    Ok(decoded)
}

/// A picture out of its container, before its codes are light: rows become light one at a time,
/// where they are used.
pub struct PixelValues<'a> {
    /// [px]
    pub width: usize,
    /// [px]
    pub height: usize,
    /// the mosaic's phase
    pub mosaic: Option<BayerPattern>,
    /// how it was coded
    pub coding: Coding,
    samples: Samples,
    data: Cow<'a, [u8]>,
    /// bytes from one row to the next
    step: usize,
    law: Law<'a>,
}

/// PixelValues → light.
enum Law<'a> {
    /// 8 bits
    Table(Box<[f32; 256]>),
    /// 16 bits
    Wide { big_endian: bool, white: f32, transfer: Transfer, response: Option<&'a ResponseTable> },
}

impl PixelValues<'_> {
    /// What a picture took of memory, for the next one; none where it lies in its message.
    pub fn into_buffer(self) -> Vec<u8> {
        match self.data {
            Cow::Owned(memory) => memory,
            Cow::Borrowed(_) => Vec::new(),
        }
    }

    /// Values per pixel as it is stored: 1 for a mosaic.
    pub fn stored_bands(&self) -> usize {
        if self.samples.channels >= 3 { 3 } else { 1 }
    }

    /// Bands once it is demosaiced.
    pub fn bands(&self) -> usize {
        if self.mosaic.is_some() { 3 } else { self.stored_bands() }
    }

    /// Light of all rows, in the memory of a picture before.
    pub fn light(&self, memory: Vec<f32>) -> SensorImage {
        let (width, height, bands) = (self.width, self.height, self.stored_bands());
        let mut pixels = memory;
        pixels.resize(width * height * bands, 0.0);
        for (y, row) in pixels.chunks_exact_mut(width * bands).enumerate() {
            self.light_row(y, row);
        }
        SensorImage { light: LinearImage { width, height, bands, pixels }, mosaic: self.mosaic }
    }

    /// Whether light of row `y` may reach a level. Of 8 bits the brightest code tells, many at a
    /// time.
    pub fn may_reach(&self, y: usize, level: f32) -> bool {
        match &self.law {
            Law::Table(table) => {
                let row = &self.data[y * self.step..][..self.width * self.samples.channels];
                let brightest = row.iter().fold(0, |most, code| most.max(*code));
                table[..=usize::from(brightest)].iter().any(|light| *light >= level)
            }
            Law::Wide { .. } => true,
        }
    }

    /// Light of a row, `width × stored_bands` values.
    pub fn light_row(&self, y: usize, out: &mut [f32]) {
        let Samples { channels, bytes, swapped, .. } = self.samples;
        let row = &self.data[y * self.step..][..self.width * channels * bytes];
        let bands = self.stored_bands();
        let place = |band: usize| if swapped { bands - 1 - band } else { band };
        match &self.law {
            Law::Table(table) if channels == bands && !swapped => {
                let (blocks, rest) = row.as_chunks::<8>();
                let (out, last) = out.as_chunks_mut::<8>();
                let look_up = |out: &mut [f32], row: &[u8]| {
                    out.iter_mut().zip(row).for_each(|(v, code)| *v = table[usize::from(*code)])
                };
                out.iter_mut().zip(blocks).for_each(|(out, block)| look_up(out, block));
                look_up(last, rest);
            }
            Law::Table(table) => {
                for (pixel, codes) in out.chunks_exact_mut(bands).zip(row.chunks_exact(channels)) {
                    pixel
                        .iter_mut()
                        .enumerate()
                        .for_each(|(band, v)| *v = table[usize::from(codes[place(band)])]);
                }
            }
            Law::Wide { big_endian, white, transfer, response } => {
                let read = |at: &[u8]| {
                    if *big_endian {
                        u16::from_be_bytes([at[0], at[1]])
                    } else {
                        u16::from_le_bytes([at[0], at[1]])
                    }
                };
                if channels == bands && !swapped {
                    out.iter_mut()
                        .zip(row.chunks_exact(2))
                        .for_each(|(v, code)| *v = f32::from(read(code)) / white);
                } else {
                    for (pixel, codes) in
                        out.chunks_exact_mut(bands).zip(row.chunks_exact(2 * channels))
                    {
                        pixel.iter_mut().enumerate().for_each(|(band, v)| {
                            *v = f32::from(read(&codes[2 * place(band)..])) / white
                        });
                    }
                }
                match response {
                    Some(response) => out
                        .iter_mut()
                        .for_each(|v| *v = response.to_linear(f64::from(v.min(1.0))) as f32),
                    None if *transfer != Transfer::Linear => out
                        .iter_mut()
                        .for_each(|v| *v = transfer.to_linear(f64::from(v.min(1.0))) as f32),
                    None => {}
                }
            }
        }
    }
}

/// Takes a picture out of its container.
///
/// # Errors
/// A sentence: an encoding that is not read, sizes that contradict the data, a damaged file.
pub fn read_pixels<'a>(
    encoded: &EncodedImage<'a>,
    light: CameraResponse<'a>,
) -> Result<PixelValues<'a>, String> {
    read_pixels_with(encoded, light, Vec::new())
}

/// The same, with the memory of a picture before; [`PixelValues::into_buffer`] gives it back.
///
/// # Errors
/// As [`read_pixels`].
pub fn read_pixels_with<'a>(
    encoded: &EncodedImage<'a>,
    light: CameraResponse<'a>,
    memory: Vec<u8>,
) -> Result<PixelValues<'a>, String> {
    match *encoded {
        EncodedImage::Raw { width, height, encoding, step, data, .. } if yuv::is_yuv(encoding) => {
            ensure_size(width, height)?;
            let rgb = yuv::to_rgb8(encoding, (width, height), step, data)
                .ok_or_else(|| misfit(encoded))?;
            let s = Samples { channels: 3, bytes: 1, swapped: false, bayer: None };
            Ok(of_samples(rgb.into(), (width, height, 3 * width), s, false, Container::Raw, light))
        }
        EncodedImage::Raw { width, height, encoding, big_endian, step, data } => {
            ensure_size(width, height)?;
            if let Some((packing, s)) =
                Packing::of(encoding).and_then(|p| samples(&p.unpacked).map(|s| (p, s)))
            {
                let unpacked =
                    packing.unpack((width, height), step, data).ok_or_else(|| misfit(encoded))?;
                return Ok(of_samples(
                    unpacked.into(),
                    (width, height, 2 * width),
                    s,
                    false,
                    Container::Raw,
                    light,
                ));
            }
            let s = samples(encoding).ok_or_else(|| not_read(encoding))?;
            let row = width * s.channels * s.bytes;
            let needed = step.checked_mul(height - 1).and_then(|n| n.checked_add(row));
            if step < row || needed.is_none_or(|n| n > data.len()) {
                return Err(misfit(encoded));
            }
            Ok(of_samples(data.into(), (width, height, step), s, big_endian, Container::Raw, light))
        }
        EncodedImage::Compressed { format, data } => compressed(format, data, light, memory),
        EncodedImage::Video { codec } => Err(format!("{codec} video is not read")),
    }
}

fn not_read(encoding: &str) -> String {
    let word = encoding.to_ascii_lowercase();
    let why = match word.get(..word.len().saturating_sub(2)) {
        Some("8s" | "16s" | "32s") => ": signed numbers have no full scale that would be light",
        Some("32f" | "64f") => {
            ": floats have no full scale; `32FC1` is read as a depth picture on a topic of that \
             name"
        }
        Some("8u" | "16u") => ": two channels are neither grey nor colour",
        _ => "",
    };
    format!("the image encoding {encoding:?} is not read{why}")
}

fn misfit(encoded: &EncodedImage<'_>) -> String {
    match encoded {
        EncodedImage::Raw { width, height, encoding, step, data, .. } => {
            format!(
                "{width}×{height} {encoding} with step {step} does not fit its {} bytes",
                data.len()
            )
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

/// No coder shrinks a picture below this; a header that claims more lies about its size, and
/// nothing is allocated for it.
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

fn compressed<'a>(
    format: &str,
    data: &[u8],
    light: CameraResponse<'a>,
    memory: Vec<u8>,
) -> Result<PixelValues<'a>, String> {
    let bad = |e: image::ImageError| format!("the picture cannot be decoded: {e}");
    let (mut decoder, container): (Box<dyn ImageDecoder + '_>, _) = match data {
        [0xff, 0xd8, ..] if !jpeg_has_end(data) => {
            return Err("the picture cannot be decoded: a JPEG that was cut short".into());
        }
        [0xff, 0xd8, ..] => {
            let subsampled = jpeg_is_subsampled(data);
            (
                Box::new(image::codecs::jpeg::JpegDecoder::new(Cursor::new(data)).map_err(bad)?),
                Container::Jpeg { subsampled },
            )
        }
        [0x89, b'P', b'N', b'G', ..] => (
            Box::new(image::codecs::png::PngDecoder::new(Cursor::new(data)).map_err(bad)?),
            Container::Png,
        ),
        data if is_webp(data) => (
            Box::new(image::codecs::webp::WebPDecoder::new(Cursor::new(data)).map_err(bad)?),
            webp_container(data),
        ),
        _ => {
            return Err(format!(
                "a compressed picture that is neither JPEG, PNG nor WebP (format {format:?})"
            ));
        }
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
    // Empty before it is used: where a damaged file leaves pixels out, those of another picture
    // must not stand.
    let mut pixels = memory;
    pixels.clear();
    pixels.resize(width * height * channels * bytes, 0);
    decoder.read_image(&mut pixels).map_err(bad)?;
    // A grey file whose original was a mosaic, with nothing said of debayering: the mosaic itself
    // was compressed.
    let (original, tail) = format.split_once(';').unwrap_or((format, "x"));
    let was_debayered = tail.trim_end().ends_with('8') || tail.trim_end().ends_with('6');
    let bayer = if channels == 1 && !was_debayered {
        samples(original.trim()).and_then(|s| s.bayer)
    } else {
        None
    };
    let s = Samples { channels, bytes, swapped: false, bayer };
    let stride = width * channels * bytes;
    Ok(of_samples(
        pixels.into(),
        (width, height, stride),
        s,
        cfg!(target_endian = "big"),
        container,
        light,
    ))
}

fn of_samples<'a>(
    data: Cow<'a, [u8]>,
    (width, height, step): (usize, usize, usize),
    samples: Samples,
    big_endian: bool,
    container: Container,
    light: CameraResponse<'a>,
) -> PixelValues<'a> {
    let transfer = match light.transfer {
        Transfer::Auto if samples.bytes == 2 || samples.bayer.is_some() => Transfer::Linear,
        Transfer::Auto => Transfer::Srgb,
        chosen => chosen,
    };
    let (law, bits_used) = if samples.bytes == 1 {
        let table = match light.response {
            Some(response) => {
                std::array::from_fn(|code| response.to_linear(code as f64 / 255.0) as f32)
            }
            None => transfer.table8(),
        };
        (Law::Table(Box::new(table)), 0xff)
    } else {
        let row = width * samples.channels * 2;
        let of_row = |y: usize| {
            data[y * step..][..row]
                .chunks_exact(2)
                .fold(0, |bits, code| bits | u16::from_le_bytes([code[0], code[1]]))
        };
        let bits = (0..height).fold(0, |bits, y| bits | of_row(y));
        let white = f32::from(light.white_level.unwrap_or(u16::MAX));
        (
            Law::Wide { big_endian, white, transfer, response: light.response },
            if big_endian { bits.swap_bytes() } else { bits },
        )
    };
    let coding = Coding { bits: 8 * samples.bytes as u8, container, transfer, bits_used };
    PixelValues { width, height, mosaic: samples.bayer, coding, samples, data, step, law }
}

/// Shows the segments before a JPEG's first scan; where that begins.
fn jpeg_segments(data: &[u8], mut see: impl FnMut(u8, &[u8])) -> Option<usize> {
    let mut at = 2;
    loop {
        let &[0xff, marker, hi, lo] = data.get(at..at + 4)? else { return None };
        if marker == 0xff {
            at += 1; // a filling byte
            continue;
        }
        let length = usize::from(u16::from_be_bytes([hi, lo])).max(2);
        if marker == 0xda {
            return Some(at);
        }
        see(marker, data.get(at + 4..at + 2 + length)?);
        at += 2 + length;
    }
}

/// Whether a JPEG's scan comes to an end. The decoder shows grey where it does not, and nobody
/// would know. A thumbnail's end lies before the scan.
fn jpeg_has_end(data: &[u8]) -> bool {
    let last = |marker: [u8; 2]| data.windows(2).rposition(|w| w == marker);
    let scan = || jpeg_segments(data, |_, _| {}).or_else(|| last([0xff, 0xda]));
    last([0xff, 0xd9]).is_some_and(|end| scan().is_some_and(|scan| end > scan))
}

/// Whether a JPEG's frame header gives its first component finer sampling than the others.
fn jpeg_is_subsampled(data: &[u8]) -> bool {
    let mut subsampled = false;
    jpeg_segments(data, |marker, body| {
        if matches!(marker, 0xc0..=0xcf) && !matches!(marker, 0xc4 | 0xc8 | 0xcc) {
            let components = body.get(5).copied().unwrap_or(1);
            subsampled = components >= 3 && body.get(7).is_some_and(|sampling| *sampling != 0x11);
        }
    });
    subsampled
}
