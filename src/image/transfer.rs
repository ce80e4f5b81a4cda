//! Camera response: codes ⇄ light. sRGB by IEC 61966-2-1, a pure power law, or none.

use serde::{Deserialize, Serialize};

/// How codes relate to light.
#[derive(Clone, Copy, Debug, PartialEq, Default, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Transfer {
    /// by the kind of picture: JPEG, PNG-8 and 8-bit rgb, bgr, mono are sRGB; bayer and 16 bit are
    /// linear
    #[default]
    Auto,
    /// codes are proportional to light
    Linear,
    /// codes are sRGB
    Srgb,
    /// light = code^gamma
    Gamma(f64),
}

impl TryFrom<String> for Transfer {
    type Error = String;
    fn try_from(word: String) -> Result<Self, String> {
        word.parse()
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
    fn from_str(word: &str) -> Result<Self, String> {
        let gamma = |g: &str| g.parse().ok().filter(|g| (0.2..=5.0).contains(g)).map(Self::Gamma);
        match word {
            "auto" => Ok(Self::Auto),
            "linear" => Ok(Self::Linear),
            "srgb" => Ok(Self::Srgb),
            _ => word.strip_prefix("gamma:").and_then(gamma).ok_or_else(|| {
                format!("transfer {word:?} is not auto, linear, srgb or gamma:G with G in 0.2 to 5")
            }),
        }
    }
}

impl Transfer {
    /// Light of a code in 0 to 1.
    pub fn to_linear(self, code: f64) -> f64 {
        match self {
            Self::Auto | Self::Linear => code,
            Self::Srgb if code <= 0.04045 => code / 12.92,
            Self::Srgb => ((code + 0.055) / 1.055).powf(2.4),
            Self::Gamma(g) => code.max(0.0).powf(g),
        }
    }

    /// Light of every 8-bit code.
    pub fn table8(self) -> [f32; 256] {
        std::array::from_fn(|i| self.to_linear(i as f64 / 255.0) as f32)
    }
}

/// sRGB code in 0 to 1 of light in 0 to 1.
pub fn srgb_encode(light: f64) -> f64 {
    let light = light.clamp(0.0, 1.0);
    if light <= 0.003_130_8 { light * 12.92 } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 }
}

/// The upper end of 8-bit pictures: light above a level is squeezed in below white instead of being
/// cut off there.
///
/// ```text
/// shown = light                                      up to k
/// shown = k + (1 − k) (1 − e^(−(light − k)/(1 − k)))  above: one slope at k, white at infinity
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shoulder {
    /// k [share of white]; 1 cuts off
    pub knee: f64,
}

impl Shoulder {
    /// What light is shown as.
    pub fn compress(self, light: f64) -> f64 {
        let (k, room) = (self.knee, 1.0 - self.knee);
        if light <= k || room <= 0.0 {
            light.min(1.0)
        } else {
            k - room * (-(light - k) / room).exp_m1()
        }
    }

    /// The light that is shown so: the way back.
    pub fn expand(self, shown: f64) -> f64 {
        let (k, room) = (self.knee, 1.0 - self.knee);
        if shown <= k || room <= 0.0 { shown } else { k - room * (-(shown - k) / room).ln_1p() }
    }

    /// Light from which on all is shown by the highest of 8-bit codes.
    pub fn white(self) -> f64 {
        if self.knee >= 1.0 { 1.0 } else { self.expand(Transfer::Srgb.to_linear(254.5 / 255.0)) }
    }
}

/// Light → 8-bit sRGB code by table. A float's upper bits are its place: 512 steps per octave, each
/// within 0.1 % of its middle, from what is still black up to twice white. So a code costs a shift
/// and a look-up.
pub struct SrgbTable(Box<[u8; Self::STEPS]>);

impl SrgbTable {
    /// 16 octaves, of which 14 are used: a place needs no check.
    const STEPS: usize = 1 << 13;
    /// Bits of a float that one step spans.
    const SHIFT: u32 = 14;
    /// Light below is black.
    const LEAST: f32 = 1.0 / 8192.0;
    /// The last light below twice white.
    const BRIGHTEST: f32 = 1.999_999_9;

    /// Fills the table.
    pub fn new(shoulder: Shoulder) -> Self {
        let middle = |i: usize| {
            f32::from_bits(
                Self::LEAST.to_bits() + ((i as u32) << Self::SHIFT) + (1 << (Self::SHIFT - 1)),
            )
        };
        Self(Box::new(std::array::from_fn(|i| {
            (srgb_encode(shoulder.compress(f64::from(middle(i)))) * 255.0).round() as u8
        })))
    }

    /// The code of `light`; below 0 is black.
    pub fn encode(&self, light: f32) -> u8 {
        self.0[Self::place(light) as usize]
    }

    fn place(light: f32) -> u32 {
        // NaN is black.
        let held = if light > Self::LEAST { light } else { Self::LEAST };
        let held = if held < Self::BRIGHTEST { held } else { Self::BRIGHTEST };
        ((held.to_bits() - Self::LEAST.to_bits()) >> Self::SHIFT) & (Self::STEPS as u32 - 1)
    }

    /// The codes of a row.
    pub fn encode_row(&self, light: &[f32], out: &mut Vec<u8>) {
        // Places many at a time, which vectorises; then the look-ups, which cannot.
        const MANY: usize = 256;
        let table = &*self.0;
        let (mut places, mut codes) = ([0u32; MANY], [0u8; MANY]);
        for light in light.chunks(MANY) {
            places.iter_mut().zip(light).for_each(|(place, v)| *place = Self::place(*v));
            for (codes, places) in
                codes.chunks_exact_mut(8).zip(places.chunks_exact(8)).take(light.len().div_ceil(8))
            {
                codes
                    .iter_mut()
                    .zip(places)
                    .for_each(|(code, place)| *code = table[*place as usize & (Self::STEPS - 1)]);
            }
            out.extend_from_slice(&codes[..light.len()]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_there_and_back_by_table() {
        let (to, back) = (Transfer::Srgb.table8(), SrgbTable::new(Shoulder { knee: 1.0 }));
        for code in 0..=255u8 {
            assert_eq!(back.encode(to[usize::from(code)]), code);
        }
        assert_eq!((back.encode(1.2), back.encode(1e9), back.encode(-1.0)), (255, 255, 0));
    }

    /// Highlights stay apart, nothing below the shoulder moves, and codes lead back to light.
    #[test]
    fn the_shoulder_keeps_highlights_apart_and_can_be_undone() {
        let shoulder = Shoulder { knee: 0.75 };
        let (bent, cut) = (SrgbTable::new(shoulder), SrgbTable::new(Shoulder { knee: 1.0 }));
        for i in 0..=750 {
            let light = i as f32 / 1000.0;
            assert_eq!(bent.encode(light), cut.encode(light), "{light}");
        }
        let codes = [0.8, 1.0, 1.2, 1.5].map(|light| bent.encode(light));
        assert!(codes.windows(2).all(|c| c[0] + 2 < c[1]) && codes[3] < 255, "{codes:?}");
        for i in 1..150 {
            let light = f64::from(i) / 100.0;
            assert!((shoulder.expand(shoulder.compress(light)) - light).abs() < 1e-9);
            let back = shoulder
                .expand(Transfer::Srgb.to_linear(f64::from(bent.encode(light as f32)) / 255.0));
            assert!(
                (back / light - 1.0).abs() < if light < 1.2 { 0.05 } else { 0.12 } || light < 0.05,
                "{light} came back as {back}"
            );
        }
        assert!(
            (shoulder.white() - 1.76).abs() < 0.01
                && bent.encode(1.70) < 255
                && bent.encode(1.80) == 255
        );
    }
}
