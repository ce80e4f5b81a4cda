//! Transfer curves: pixel value ⇄ linear light. sRGB (IEC 61966-2-1), a power law, or linear.

use serde::{Deserialize, Serialize};

use super::tone::Tone;
use super::vectorised;

/// Transfer curve of an image: linear light as a function of the pixel value.
#[derive(Clone, Copy, Debug, PartialEq, Default, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Transfer {
    /// by encoding: JPEG, 8-bit PNG and 8-bit rgb, bgr, mono are sRGB; Bayer and 16 bit are linear
    #[default]
    Auto,
    /// pixel values are proportional to light
    Linear,
    /// IEC 61966-2-1
    Srgb,
    /// light = value^gamma
    Gamma(f64),
}

impl TryFrom<String> for Transfer {
    type Error = String;
    fn try_from(name: String) -> Result<Self, String> {
        name.parse()
    }
}

impl From<Transfer> for String {
    fn from(transfer: Transfer) -> Self {
        match transfer {
            Transfer::Auto => "auto".into(),
            Transfer::Linear => "linear".into(),
            Transfer::Srgb => "srgb".into(),
            Transfer::Gamma(g) => format!("gamma:{g}"),
        }
    }
}

impl std::str::FromStr for Transfer {
    type Err = String;
    fn from_str(name: &str) -> Result<Self, String> {
        let gamma = |g: &str| g.parse().ok().filter(|g| (0.2..=5.0).contains(g)).map(Self::Gamma);
        match name {
            "auto" => Ok(Self::Auto),
            "linear" => Ok(Self::Linear),
            "srgb" => Ok(Self::Srgb),
            _ => name.strip_prefix("gamma:").and_then(gamma).ok_or_else(|| {
                format!("transfer {name:?} is not auto, linear, srgb or gamma:G with G in 0.2 to 5")
            }),
        }
    }
}

impl Transfer {
    /// Linear light of a pixel value in 0 to 1.
    pub fn to_linear(self, value: f64) -> f64 {
        match self {
            Self::Auto | Self::Linear => value,
            Self::Srgb if value <= 0.04045 => value / 12.92,
            Self::Srgb => ((value + 0.055) / 1.055).powf(2.4),
            Self::Gamma(g) => value.max(0.0).powf(g),
        }
    }

    /// Linear light of every 8-bit pixel value.
    pub fn table8(self) -> [f32; 256] {
        std::array::from_fn(|i| self.to_linear(i as f64 / 255.0) as f32)
    }
}

/// sRGB value, 0 to 1, of linear light in 0 to 1.
pub fn srgb_encode(light: f64) -> f64 {
    let light = light.clamp(0.0, 1.0);
    if light <= 0.003_130_8 { light * 12.92 } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 }
}

/// Linear light → 8-bit sRGB value by table. The upper bits of the float are the index: 512 steps
/// per octave, each within 0.1 % of its centre, from black up to twice white. One value costs a
/// shift and a look-up.
pub struct SrgbTable(Box<[u8; Self::STEPS]>);

impl SrgbTable {
    /// 16 octaves, of which 14 are used, so that an index needs no bounds check.
    const STEPS: usize = 1 << 13;
    /// Bits of the float that one step spans.
    const SHIFT: u32 = 14;
    /// Darker light is black.
    const DARKEST: f32 = 1.0 / 8192.0;
    /// Largest float below twice white.
    const BRIGHTEST: f32 = 1.999_999_9;

    /// Tabulates sRGB after a tone curve.
    pub fn new(tone: Tone) -> Self {
        let middle = |i: usize| {
            f32::from_bits(
                Self::DARKEST.to_bits() + ((i as u32) << Self::SHIFT) + (1 << (Self::SHIFT - 1)),
            )
        };
        Self(Box::new(std::array::from_fn(|i| {
            (srgb_encode(tone.shown(f64::from(middle(i)))) * 255.0).round() as u8
        })))
    }

    /// 8-bit sRGB value of `light`; negative light is black.
    pub fn encode(&self, light: f32) -> u8 {
        self.0[Self::index(light) as usize]
    }

    #[inline(always)]
    fn index(light: f32) -> u32 {
        // NaN is black.
        let clamped = if light > Self::DARKEST { light } else { Self::DARKEST };
        let clamped = if clamped < Self::BRIGHTEST { clamped } else { Self::BRIGHTEST };
        ((clamped.to_bits() - Self::DARKEST.to_bits()) >> Self::SHIFT) & (Self::STEPS as u32 - 1)
    }

    /// 8-bit sRGB values of a row: of light band after band, pixel by pixel.
    pub fn encode_row(&self, light: &[f32], bands: usize, out: &mut [u8]) {
        match bands {
            3 => vectorised(
                #[inline(always)]
                || self.encode_bands::<3>(light, out),
            ),
            _ => vectorised(
                #[inline(always)]
                || self.encode_bands::<1>(light, out),
            ),
        }
    }

    #[inline(always)]
    fn encode_bands<const BANDS: usize>(&self, light: &[f32], out: &mut [u8]) {
        // Indices of a whole chunk, which vectorises, then the look-ups, which do not.
        const CHUNK: usize = 64;
        let (table, width) = (&*self.0, light.len() / BANDS);
        let mut indices = [[0u32; CHUNK]; BANDS];
        let pixels = out.as_chunks_mut::<BANDS>().0;
        for (first, pixels) in (0..width).step_by(CHUNK).zip(pixels.chunks_mut(CHUNK)) {
            for (band, indices) in indices.iter_mut().enumerate() {
                let light = &light[band * width + first..];
                match light.first_chunk::<CHUNK>().filter(|_| pixels.len() == CHUNK) {
                    Some(light) => (0..CHUNK).for_each(|k| indices[k] = Self::index(light[k])),
                    None => (0..pixels.len()).for_each(|k| indices[k] = Self::index(light[k])),
                }
            }
            for (x, pixel) in pixels.iter_mut().take(CHUNK).enumerate() {
                for band in 0..BANDS {
                    pixel[band] = table[indices[band][x] as usize & (Self::STEPS - 1)];
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_round_trip_by_table() {
        let (to, back) = (Transfer::Srgb.table8(), SrgbTable::new(Tone::Shoulder { knee: 1.0 }));
        for value in 0..=255u8 {
            assert_eq!(back.encode(to[usize::from(value)]), value);
        }
        assert_eq!((back.encode(1.2), back.encode(1e9), back.encode(-1.0)), (255, 255, 0));
    }
}
