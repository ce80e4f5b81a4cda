//! Tone curves of 8-bit images: how light is shown, the same for the whole log and invertible.
//! 16-bit images are linear.

use serde::{Deserialize, Serialize};

/// Linear light of the 8-bit sRGB value 254.5.
const NEARLY_WHITE: f64 = 0.995_545_250;

/// Light shown as a function of corrected light, both as shares of white.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Tone {
    /// proportional up to a knee k, compressed above instead of clipped:
    ///
    /// ```text
    /// out = light                                      up to k
    /// out = k + (1 − k) (1 − e^(−(light − k)/(1 − k)))  above; slope continuous, white at infinity
    /// ```
    Shoulder {
        /// k; 1 clips
        knee: f64,
    },
    /// more contrast about the median seafloor
    Contrast(ContrastCurve),
}

/// For people: a sigmoid over the logarithm of light.
///
/// ```text
/// out = (1 + c / Wⁿ) lightⁿ / (lightⁿ + c)
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ContrastCurve {
    /// n: contrast in the shadows
    pub exponent: f64,
    /// c
    pub half: f64,
    /// W: light that is shown as white
    pub white: f64,
}

impl ContrastCurve {
    /// Contrast about the median is n times what is left to white: a quarter to a half more than
    /// measured.
    const EXPONENT: f64 = 1.8;
    const MEDIAN_SHOWN: f64 = 0.3;
    const WHITE: f64 = 1.75;
    /// A brighter median would be shown darker than the curve can.
    const MOST_MEDIAN: f64 = 0.6;

    /// The curve that shows the median seafloor at a middle grey.
    pub fn about(median: f64) -> Self {
        let (exponent, white) = (Self::EXPONENT, Self::WHITE);
        let median = if median > 0.0 { median.min(Self::MOST_MEDIAN) } else { Self::MEDIAN_SHOWN };
        let left = Self::MEDIAN_SHOWN - (median / white).powf(exponent);
        Self { exponent, half: median.powf(exponent) * (1.0 - Self::MEDIAN_SHOWN) / left, white }
    }

    /// 1 + c / Wⁿ
    fn scale(self) -> f64 {
        1.0 + self.half / self.white.powf(self.exponent)
    }
}

impl Tone {
    /// Light as it is shown; white is 1.
    pub fn shown(self, light: f64) -> f64 {
        match self {
            Self::Shoulder { knee } if light <= knee || knee >= 1.0 => light.min(1.0),
            Self::Shoulder { knee } => {
                knee - (1.0 - knee) * (-(light - knee) / (1.0 - knee)).exp_m1()
            }
            Self::Contrast(curve) => {
                let power = light.clamp(0.0, curve.white).powf(curve.exponent);
                curve.scale() * power / (power + curve.half)
            }
        }
    }

    /// Inverse of [`Self::shown`].
    pub fn light(self, shown: f64) -> f64 {
        match self {
            Self::Shoulder { knee } if shown <= knee || knee >= 1.0 => shown,
            Self::Shoulder { knee } => {
                knee - (1.0 - knee) * (-(shown - knee) / (1.0 - knee)).ln_1p()
            }
            Self::Contrast(curve) => {
                let shown = shown.clamp(0.0, 1.0);
                (curve.half * shown / (curve.scale() - shown)).powf(1.0 / curve.exponent)
            }
        }
    }

    /// Linear light above which the 8-bit pixel value is 255.
    pub fn white(self) -> f64 {
        match self {
            Self::Shoulder { knee } if knee >= 1.0 => 1.0,
            _ => self.light(NEARLY_WHITE),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::transfer::{SrgbTable, Transfer};
    use super::*;

    /// Highlights stay distinct, values below the knee are unchanged, and compression is
    /// invertible.
    #[test]
    fn the_shoulder_keeps_highlights_distinct_and_is_invertible() {
        let shoulder = Tone::Shoulder { knee: 0.75 };
        let (curve, clipped) =
            (SrgbTable::new(shoulder), SrgbTable::new(Tone::Shoulder { knee: 1.0 }));
        for i in 0..=750 {
            let light = i as f32 / 1000.0;
            assert_eq!(curve.encode(light), clipped.encode(light), "{light}");
        }
        let values = [0.8, 1.0, 1.2, 1.5].map(|light| curve.encode(light));
        assert!(values.windows(2).all(|c| c[0] + 2 < c[1]) && values[3] < 255, "{values:?}");
        for i in 1..150 {
            let light = f64::from(i) / 100.0;
            assert!((shoulder.light(shoulder.shown(light)) - light).abs() < 1e-9);
            let back = shoulder
                .light(Transfer::Srgb.to_linear(f64::from(curve.encode(light as f32)) / 255.0));
            assert!(
                (back / light - 1.0).abs() < if light < 1.2 { 0.05 } else { 0.12 } || light < 0.05,
                "{light} became {back}"
            );
        }
        assert!((NEARLY_WHITE - Transfer::Srgb.to_linear(254.5 / 255.0)).abs() < 1e-8);
        assert!(
            (shoulder.white() - 1.76).abs() < 0.01
                && curve.encode(1.70) < 255
                && curve.encode(1.80) == 255
        );
    }

    /// The median is where it is said to be, and pixel values convert back to light.
    #[test]
    fn the_contrast_curve_shows_the_median_at_a_middle_grey_and_is_invertible() {
        for median in [0.02, 0.1, 0.3, 0.6] {
            let tone = Tone::Contrast(ContrastCurve::about(median));
            assert!((tone.shown(median) - 0.3).abs() < 1e-12, "{median}");
            let contrast = (tone.shown(median * 1.01) / tone.shown(median)).ln() / 1.01f64.ln();
            assert!((1.2..1.5).contains(&contrast), "{contrast}");
            assert!((tone.shown(1.75) - 1.0).abs() < 1e-12 && tone.shown(9.0) == tone.shown(1.75));
            let table = SrgbTable::new(tone);
            for i in 1..170 {
                let light = f64::from(i) / 100.0;
                assert!((tone.light(tone.shown(light)) / light - 1.0).abs() < 1e-9);
                let value = f64::from(table.encode(light as f32));
                // Near white, a step of the pixel value is wide.
                if value < 250.0 {
                    let of = |value: f64| tone.light(Transfer::Srgb.to_linear(value / 255.0));
                    let (off, step) = ((of(value) - light).abs(), of(value + 1.0) - of(value));
                    assert!(off <= step.max(0.02 * light), "{median}: {light} is {value}");
                }
            }
        }
        assert_eq!(Tone::Contrast(ContrastCurve::about(f64::NAN)).shown(0.0), 0.0);
    }
}
