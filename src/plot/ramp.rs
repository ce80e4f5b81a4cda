//! Colour maps of uniformly increasing lightness, readable in greyscale and with colour blindness.

/// A colour map, from dark to bright.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ramp {
    /// blue to yellow
    Viridis,
    /// violet to yellow, as in the paper's Fig. 9
    Plasma,
}

/// Colours at equal steps (sRGB).
const VIRIDIS: [[u8; 3]; 9] = [
    [68, 1, 84],
    [71, 44, 122],
    [59, 81, 139],
    [44, 113, 142],
    [33, 144, 141],
    [39, 173, 129],
    [92, 200, 99],
    [170, 220, 50],
    [253, 231, 37],
];
const PLASMA: [[u8; 3]; 9] = [
    [13, 8, 135],
    [75, 3, 161],
    [125, 3, 168],
    [168, 34, 150],
    [203, 70, 121],
    [229, 107, 93],
    [248, 148, 65],
    [253, 195, 40],
    [240, 249, 33],
];

impl Ramp {
    /// Colour at a position from 0 to 1; values outside are clamped, NaN counts as 0.
    pub fn at(self, position: f64) -> [u8; 3] {
        let stops = if self == Self::Viridis { VIRIDIS } else { PLASMA };
        let position = if position.is_finite() { position.clamp(0.0, 1.0) } else { 0.0 };
        let position = position * (stops.len() - 1) as f64;
        let first = (position as usize).min(stops.len() - 2);
        let part = position - first as f64;
        std::array::from_fn(|b| {
            (f64::from(stops[first][b]) * (1.0 - part) + f64::from(stops[first + 1][b]) * part)
                .round() as u8
        })
    }
}

/// A colour in CSS notation.
pub fn css(color: [u8; 3]) -> String {
    format!("#{:02x}{:02x}{:02x}", color[0], color[1], color[2])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lightness_increases_monotonically() {
        let lightness = |c: [u8; 3]| {
            0.2126 * f64::from(c[0]) + 0.7152 * f64::from(c[1]) + 0.0722 * f64::from(c[2])
        };
        for ramp in [Ramp::Viridis, Ramp::Plasma] {
            assert!((0..40).all(|i| lightness(ramp.at(f64::from(i) / 40.0))
                < lightness(ramp.at(f64::from(i + 1) / 40.0))));
            assert_eq!(ramp.at(f64::NAN), ramp.at(0.0));
        }
        assert_eq!(css([1, 255, 16]), "#01ff10");
    }
}
