//! Names of `sensor_msgs/image_encodings` → layout of the samples.

use super::demosaic::BayerPattern;

/// Layout of the samples of one pixel.
#[derive(Clone, Copy)]
pub struct SampleLayout {
    pub channels: usize,
    /// bytes per sample, 1 or 2
    pub bytes: usize,
    /// channels in the order blue, green, red
    pub is_bgr: bool,
    pub bayer: Option<BayerPattern>,
}

impl SampleLayout {
    /// `None` for an encoding that is not supported.
    pub fn from_encoding(encoding: &str) -> Option<Self> {
        let name = encoding.to_ascii_lowercase();
        let layout = |channels, bytes, is_bgr| Some(Self::new(channels, bytes, is_bgr));
        if let Some(pattern) = name.strip_prefix("bayer") {
            return Self::bayer(pattern.trim_start_matches('_'));
        }
        match name.as_str() {
            "rgb8" => layout(3, 1, false),
            "bgr8" | "8uc3" => layout(3, 1, true),
            "rgba8" => layout(4, 1, false),
            "bgra8" | "8uc4" => layout(4, 1, true),
            "rgb16" => layout(3, 2, false),
            "bgr16" | "16uc3" => layout(3, 2, true),
            "rgba16" => layout(4, 2, false),
            "bgra16" => layout(4, 2, true),
            "mono8" | "8uc1" => layout(1, 1, false),
            "mono16" | "16uc1" | "mono10" | "mono12" | "mono14" => layout(1, 2, false),
            _ => None,
        }
    }

    pub fn new(channels: usize, bytes: usize, is_bgr: bool) -> Self {
        Self { channels, bytes, is_bgr, bayer: None }
    }

    /// From the pattern and the bits per sample: `rggb12`.
    fn bayer(name: &str) -> Option<Self> {
        let pattern = match name.trim_end_matches(|c: char| c.is_ascii_digit() || c == 'p') {
            "rggb" | "rg" => BayerPattern::Rggb,
            "bggr" | "bg" => BayerPattern::Bggr,
            "gbrg" | "gb" => BayerPattern::Gbrg,
            "grbg" | "gr" => BayerPattern::Grbg,
            _ => return None,
        };
        let bytes = match name.trim_start_matches(|c: char| c.is_ascii_alphabetic()) {
            "8" => 1,
            "10" | "12" | "14" | "16" => 2,
            _ => return None,
        };
        Some(Self { bayer: Some(pattern), ..Self::new(1, bytes, false) })
    }
}
