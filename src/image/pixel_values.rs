//! Pixel values (DN) in memory → linear light, row by row (paper §II-F, Eq. 8 to 9).

use std::borrow::Cow;
use std::sync::OnceLock;

use super::demosaic::BayerPattern;
use super::encoding::SampleLayout;
use super::response::ResponseTable;
use super::transfer::Transfer;
use super::{Bands, Container, LinearImage, SensorImage};

/// Blocks of 2 × 2 pixels, so far apart, are enough for a mean (px).
const MEAN_STEP: usize = 8;

/// How pixel values relate to light.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CameraResponse<'r> {
    /// used where there is no table
    pub transfer: Transfer,
    /// measured response; replaces `transfer`
    pub response: Option<&'r ResponseTable>,
    /// pixel value of full scale in 16-bit images (DN); 65535 where `None`
    pub white_level: Option<u16>,
}

/// How an image was encoded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coding {
    /// bits per sample, 8 or 16
    pub bits: u8,
    /// file format
    pub container: Container,
    /// transfer curve that was inverted where there was no table; never [`Transfer::Auto`]
    pub transfer: Transfer,
    /// bitwise or of all pixel values: the bits that the sensor uses
    pub bits_used: u16,
}

impl Coding {
    /// Number of steps of the pixel values up to full scale: 255 for 8 bits, 4095 for a sensor of
    /// 12 bits that uses the upper bits of 16.
    pub fn max_value(&self, white_level: Option<u16>) -> u16 {
        if self.bits <= 8 {
            return 255;
        }
        let unused = self.bits_used.trailing_zeros().min(8);
        (white_level.unwrap_or(u16::MAX) >> unused).max(1)
    }
}

/// Samples in memory, as decompressed or as stored in the message.
pub struct StoredSamples<'a> {
    pub data: Cow<'a, [u8]>,
    pub width: usize,
    pub height: usize,
    /// bytes from one row to the next
    pub step: usize,
    pub layout: SampleLayout,
    pub big_endian: bool,
    pub container: Container,
}

/// Pixel values of an image (DN). Rows are converted to linear light one at a time, where they are
/// used.
pub struct PixelValues<'a> {
    /// (px)
    pub width: usize,
    /// (px)
    pub height: usize,
    /// `None` where every pixel has all bands
    pub mosaic: Option<BayerPattern>,
    /// how the image was encoded
    pub coding: Coding,
    layout: SampleLayout,
    data: Cow<'a, [u8]>,
    /// bytes from one row to the next
    step: usize,
    linearisation: Linearisation<'a>,
    /// computed when it is needed first
    mean_light: OnceLock<Bands>,
}

/// Pixel value → linear light.
enum Linearisation<'a> {
    /// 8 bits
    Table(Box<[f32; 256]>),
    /// 16 bits
    Wide { big_endian: bool, white: f32, transfer: Transfer, response: Option<&'a ResponseTable> },
}

impl<'a> PixelValues<'a> {
    /// Chooses the linearisation.
    pub fn new(samples: StoredSamples<'a>, response: CameraResponse<'a>) -> Self {
        let StoredSamples { data, width, height, step, layout, big_endian, container } = samples;
        let transfer = match response.transfer {
            Transfer::Auto if layout.bytes == 2 || layout.bayer.is_some() => Transfer::Linear,
            Transfer::Auto => Transfer::Srgb,
            chosen => chosen,
        };
        let (linearisation, bits_used) = if layout.bytes == 1 {
            let table = match response.response {
                Some(table) => {
                    std::array::from_fn(|value| table.to_linear(value as f64 / 255.0) as f32)
                }
                None => transfer.table8(),
            };
            (Linearisation::Table(Box::new(table)), 0xff)
        } else {
            let row = width * layout.channels * 2;
            let bits_of_row = |y: usize| {
                data[y * step..][..row]
                    .chunks_exact(2)
                    .fold(0, |bits, value| bits | u16::from_le_bytes([value[0], value[1]]))
            };
            let bits = (0..height).fold(0, |bits, y| bits | bits_of_row(y));
            let white = f32::from(response.white_level.unwrap_or(u16::MAX));
            (
                Linearisation::Wide { big_endian, white, transfer, response: response.response },
                if big_endian { bits.swap_bytes() } else { bits },
            )
        };
        let coding = Coding { bits: 8 * layout.bytes as u8, container, transfer, bits_used };
        let (mosaic, mean_light) = (layout.bayer, OnceLock::new());
        Self { width, height, mosaic, coding, layout, data, step, linearisation, mean_light }
    }

    /// Returns the buffer for the next image; empty where the samples are borrowed from a message.
    pub fn into_buffer(mut self) -> Vec<u8> {
        self.take_buffer()
    }

    /// As [`Self::into_buffer`]; what is left has no pixels any more.
    pub fn take_buffer(&mut self) -> Vec<u8> {
        match std::mem::take(&mut self.data) {
            Cow::Owned(buffer) => buffer,
            Cow::Borrowed(_) => Vec::new(),
        }
    }

    /// Bands per stored pixel; 1 for a mosaic.
    pub fn stored_bands(&self) -> usize {
        if self.layout.channels >= 3 { 3 } else { 1 }
    }

    /// Number of bands after demosaicing.
    pub fn bands(&self) -> usize {
        if self.mosaic.is_some() { 3 } else { self.stored_bands() }
    }

    /// All rows in linear light, written to `buffer`.
    pub fn to_linear(&self, buffer: Vec<f32>) -> SensorImage {
        let (width, height, bands) = (self.width, self.height, self.stored_bands());
        let mut pixels = buffer;
        pixels.resize(width * height * bands, 0.0);
        for (y, row) in pixels.chunks_exact_mut(width * bands).enumerate() {
            self.linear_row(y, row);
        }
        SensorImage { light: LinearImage { width, height, bands, pixels }, mosaic: self.mosaic }
    }

    /// Mean linear light per band, from a sixteenth of the pixels.
    pub fn mean_light(&self) -> Bands {
        *self.mean_light.get_or_init(|| self.mean_of_blocks())
    }

    /// Mean of that over the bands.
    pub fn brightness(&self) -> f64 {
        let bands = self.bands();
        self.mean_light()[..bands].iter().sum::<f64>() / bands as f64
    }

    fn mean_of_blocks(&self) -> Bands {
        match self.stored_bands() {
            3 => self.mean_of::<3>(),
            _ => self.mean_of::<1>(),
        }
    }

    fn mean_of<const STORED: usize>(&self) -> Bands {
        // Even and odd rows and columns of a mosaic hold different bands.
        let (mut sums, mut counts) = ([[[0.0; STORED]; 2]; 2], [[0usize; 2]; 2]);
        for y in (0..self.height).filter(|y| y % MEAN_STEP < 2) {
            let (sums, counts) = (&mut sums[y % 2], &mut counts[y % 2]);
            for column in 0..2 {
                for x in (column..self.width).step_by(MEAN_STEP) {
                    for b in 0..STORED {
                        sums[column][b] += f64::from(self.linear_at(x, y, b));
                    }
                    counts[column] += 1;
                }
            }
        }
        let (mut light, mut pixels) = ([0.0; 3], [0usize; 3]);
        for (row, column) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            for b in 0..STORED {
                let band = self.mosaic.map_or(b, |pattern| pattern.band(column, row));
                light[band] += sums[row][column][b];
                pixels[band] += counts[row][column];
            }
        }
        std::array::from_fn(|b| light[b] / pixels[b].max(1) as f64)
    }

    /// Linear light of one stored value.
    #[inline(always)]
    fn linear_at(&self, x: usize, y: usize, band: usize) -> f32 {
        let SampleLayout { channels, bytes, is_bgr, .. } = self.layout;
        let channel = if is_bgr { self.stored_bands() - 1 - band } else { band };
        let at = y * self.step + (x * channels + channel) * bytes;
        match &self.linearisation {
            Linearisation::Table(table) => table[usize::from(self.data[at])],
            Linearisation::Wide { big_endian, white, transfer, response } => {
                let mut value = [f32::from(wide(*big_endian, &self.data[at..])) / white];
                invert_response(&mut value, *transfer, *response);
                value[0]
            }
        }
    }

    /// Whether linear light in row `y` may reach `level`. Of 8-bit images the largest pixel value
    /// is looked up; 16-bit images are not examined.
    pub fn may_reach(&self, y: usize, level: f32) -> bool {
        match &self.linearisation {
            Linearisation::Table(table) => {
                let row = &self.data[y * self.step..][..self.width * self.layout.channels];
                let largest = row.iter().fold(0, |max, value| max.max(*value));
                table[..=usize::from(largest)].iter().any(|light| *light >= level)
            }
            Linearisation::Wide { .. } => true,
        }
    }

    /// Linear light of row `y`: `width × stored_bands` values.
    pub fn linear_row(&self, y: usize, out: &mut [f32]) {
        let SampleLayout { channels, bytes, is_bgr, .. } = self.layout;
        let row = &self.data[y * self.step..][..self.width * channels * bytes];
        let bands = self.stored_bands();
        let is_packed = channels == bands && !is_bgr;
        let channel = |band: usize| if is_bgr { bands - 1 - band } else { band };
        match &self.linearisation {
            Linearisation::Table(table) if is_packed => {
                let (blocks, rest) = row.as_chunks::<8>();
                let (out, last) = out.as_chunks_mut::<8>();
                let look_up = |out: &mut [f32], row: &[u8]| {
                    out.iter_mut().zip(row).for_each(|(v, value)| *v = table[usize::from(*value)]);
                };
                out.iter_mut().zip(blocks).for_each(|(out, block)| look_up(out, block));
                look_up(last, rest);
            }
            Linearisation::Table(table) => {
                for (pixel, values) in out.chunks_exact_mut(bands).zip(row.chunks_exact(channels)) {
                    pixel
                        .iter_mut()
                        .enumerate()
                        .for_each(|(band, v)| *v = table[usize::from(values[channel(band)])]);
                }
            }
            Linearisation::Wide { big_endian, white, transfer, response } => {
                let read = |at: &[u8]| wide(*big_endian, at);
                if is_packed {
                    out.iter_mut()
                        .zip(row.chunks_exact(2))
                        .for_each(|(v, value)| *v = f32::from(read(value)) / white);
                } else {
                    for (pixel, values) in
                        out.chunks_exact_mut(bands).zip(row.chunks_exact(2 * channels))
                    {
                        pixel.iter_mut().enumerate().for_each(|(band, v)| {
                            *v = f32::from(read(&values[2 * channel(band)..])) / white;
                        });
                    }
                }
                invert_response(out, *transfer, *response);
            }
        }
    }

    /// Linear light of row `y`, band after band: `stored_bands × width` values.
    pub fn linear_bands(&self, y: usize, out: &mut [f32]) {
        let SampleLayout { channels, bytes, is_bgr, .. } = self.layout;
        if self.stored_bands() == 1 {
            return self.linear_row(y, out);
        }
        let row = &self.data[y * self.step..][..self.width * channels * bytes];
        match &self.linearisation {
            Linearisation::Table(table) => {
                let light = |value: &u8| table[usize::from(*value)];
                match channels {
                    3 => split_bands(row.as_chunks::<3>().0, is_bgr, light, out),
                    _ => split_bands(row.as_chunks::<4>().0, is_bgr, light, out),
                }
            }
            Linearisation::Wide { big_endian, white, transfer, response } => {
                let light = |value: &[u8; 2]| f32::from(wide(*big_endian, value)) / white;
                let values = row.as_chunks::<2>().0;
                match channels {
                    3 => split_bands(values.as_chunks::<3>().0, is_bgr, light, out),
                    _ => split_bands(values.as_chunks::<4>().0, is_bgr, light, out),
                }
                invert_response(out, *transfer, *response);
            }
        }
    }
}

/// A 16-bit pixel value.
fn wide(big_endian: bool, at: &[u8]) -> u16 {
    let bytes = [at[0], at[1]];
    if big_endian { u16::from_be_bytes(bytes) } else { u16::from_le_bytes(bytes) }
}

/// Linear light of the first three channels of pixels, band after band.
fn split_bands<T, const CHANNELS: usize>(
    pixels: &[[T; CHANNELS]],
    is_bgr: bool,
    light: impl Fn(&T) -> f32,
    out: &mut [f32],
) {
    let (red, rest) = out.split_at_mut(pixels.len());
    let (green, blue) = rest.split_at_mut(pixels.len());
    let (first, third) = if is_bgr { (blue, red) } else { (red, blue) };
    for (((pixel, first), second), third) in pixels.iter().zip(first).zip(green).zip(third) {
        (*first, *second, *third) = (light(&pixel[0]), light(&pixel[1]), light(&pixel[2]));
    }
}

/// Applies the inverse camera response to a row of pixel values (share of full scale).
fn invert_response(row: &mut [f32], transfer: Transfer, response: Option<&ResponseTable>) {
    match response {
        Some(response) => {
            row.iter_mut().for_each(|v| *v = response.to_linear(f64::from(v.min(1.0))) as f32);
        }
        None if transfer != Transfer::Linear => {
            row.iter_mut().for_each(|v| *v = transfer.to_linear(f64::from(v.min(1.0))) as f32);
        }
        None => {}
    }
}
