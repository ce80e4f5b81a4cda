//! Camera response: codes ⇄ light. sRGB by IEC 61966-2-1, a pure power law, or none.

use serde::{Deserialize, Serialize};

/// How codes relate to light.
#[derive(Clone, Copy, Debug, PartialEq, Default, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Transfer {
    /// by the kind of picture: JPEG, PNG-8 and 8-bit rgb, bgr, mono are sRGB; bayer and 16 bit are linear
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
            _ => word
                .strip_prefix("gamma:")
                .and_then(gamma)
                .ok_or_else(|| format!("transfer {word:?} is not auto, linear, srgb or gamma:G with G in 0.2 to 5")),
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

/// Light → 8-bit sRGB code by table: 4096 steps of the square root, within half a code of the formula.
pub struct SrgbTable([u8; Self::STEPS + 1]);

impl Default for SrgbTable {
    fn default() -> Self {
        Self::new()
    }
}

impl SrgbTable {
    const STEPS: usize = 4096;

    /// Fills the table.
    pub fn new() -> Self {
        Self(std::array::from_fn(|i| {
            let root = i as f64 / Self::STEPS as f64;
            (srgb_encode(root * root) * 255.0).round() as u8
        }))
    }

    /// The code of `light`; below 0 is black, above 1 is white.
    pub fn code(&self, light: f32) -> u8 {
        self.0[(light.clamp(0.0, 1.0).sqrt() * Self::STEPS as f32 + 0.5) as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_there_and_back_by_table() {
        let (to, back) = (Transfer::Srgb.table8(), SrgbTable::new());
        for code in 0..=255u8 {
            assert_eq!(back.code(to[usize::from(code)]), code);
        }
    }
}
