//! Settings that take one of several names; their doc comments are the help of `--help`.

use serde::{Deserialize, Serialize};

/// Estimator of the attenuation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Estimator {
    /// joint where frames overlap, else pairs, else altitude; empirical where it predicts better
    #[default]
    Auto,
    /// attenuation, beam pattern and reflectances in one robust solve
    Joint,
    /// Eq. 16 on points seen in two frames, Eq. 17 for the beam pattern
    Pairs,
    /// slope of log colour against altitude (Fig. 6), Eq. 17 for the beam pattern
    Altitude,
    /// light by regions of the image over slant range; determines no attenuation
    Empirical,
}

impl Estimator {
    /// Whether the joint solve may give the answer.
    pub fn may_be_joint(self) -> bool {
        matches!(self, Self::Auto | Self::Joint)
    }

    /// Its name in files and on the command line.
    pub fn word(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Joint => "joint",
            Self::Pairs => "pairs",
            Self::Altitude => "altitude",
            Self::Empirical => "empirical",
        }
    }
}

/// Model of geometric spreading.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Spreading {
    /// none, as in the paper: the attenuation is then an effective one
    None,
    /// 1/ℓ_a² from the strobe: physical
    #[default]
    Strobe,
    /// 1/(ℓ_a ℓ_s)², as printed in Eq. 15
    Paper,
    /// 1/ℓ_a^p with p estimated: a check of the geometry (p should come out as 2)
    Fit,
}

/// Whether a part of the model is used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Switch {
    /// where it predicts held-out frames better
    #[default]
    Auto,
    /// never
    Off,
    /// always
    On,
}

/// What becomes of faults that the log shows: of the camera's gains, lens and transfer curve, of a
/// given strobe position, of clock and mounts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum SelfCalibration {
    /// found, reported and compensated
    #[default]
    Auto,
    /// found and reported
    Report,
    /// only what other settings ask for
    Off,
}

/// Whether the strobe's position is estimated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum StrobePosition {
    /// estimated where no pose is given; a given pose is checked, and a better one reported
    #[default]
    Auto,
    /// as given, else at the camera; not estimated
    Fixed,
    /// estimated, starting from the given pose
    Refine,
    /// estimated from the images alone, whatever is given
    Find,
}

/// How corrected light is shown in 8 bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Look {
    /// proportional to reflectance below the shoulder
    #[default]
    Measured,
    /// for people: more contrast about the median seafloor, by one invertible curve for the log
    Natural,
}

/// What pass two removes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// attenuation, spreading, incidence and beam pattern (Fig. 10, bottom right)
    #[default]
    Full,
    /// attenuation, spreading and incidence (Fig. 10, top right)
    Attenuation,
    /// beam pattern (Fig. 10, bottom left)
    BeamPattern,
    /// baseline, for comparison: divides by the mean of the frames of pass one (Eq. 14)
    FrameAverage,
    /// baseline, for comparison: divides by the mean of the frames at the same altitude
    RangeAverage,
    /// baseline, for comparison: the mean of each frame is grey
    GreyWorld,
    /// baseline, for comparison: the brightest value of each frame is white
    WhitePatch,
    /// baseline, for comparison: subtracts the low frequencies of each frame's log (Eq. 12)
    Homomorphic,
    /// baseline, for comparison: subtracts a smooth surface fitted to each frame's log
    HomomorphicSurface,
    /// baseline, for comparison: contrast-limited adaptive histogram equalisation of each frame
    Ahe,
}

impl Method {
    /// Whether it is for comparison only: it uses statistics of frames instead of the model.
    pub fn is_baseline(self) -> bool {
        !matches!(self, Self::Full | Self::Attenuation | Self::BeamPattern)
    }

    /// Whether it needs mean frames of the whole log.
    pub fn needs_mean_frames(self) -> bool {
        matches!(self, Self::FrameAverage | Self::RangeAverage)
    }
}

/// Format of corrected images.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum ImageFormat {
    /// PNG where the source is PNG or the depth is 16, else JPEG
    #[default]
    Auto,
    /// JPEG, 8 bit
    Jpeg,
    /// PNG, 8 or 16 bit
    Png,
    /// uncompressed (`sensor_msgs/Image`), 8 or 16 bit
    Raw,
    /// as the source: raw for raw, PNG for PNG, JPEG for JPEG
    Same,
}

/// Quality of corrected images in JPEG.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum JpegQuality {
    /// that of the source where it is JPEG, at most 95; else 95
    #[default]
    Auto,
    /// 1 to 100
    #[serde(untagged)]
    Of(u8),
}

impl JpegQuality {
    /// Without visible artefacts.
    const HIGH: u8 = 95;

    /// The quality for images of a source; `None` where that is no JPEG.
    pub fn for_source(self, source: Option<u8>) -> u8 {
        match self {
            Self::Auto => source.map_or(Self::HIGH, |quality| quality.min(Self::HIGH)),
            Self::Of(quality) => quality,
        }
    }

    /// Whether JPEG knows it.
    pub fn is_valid(self) -> bool {
        !matches!(self, Self::Of(quality) if !(1..=100).contains(&quality))
    }
}

impl std::str::FromStr for JpegQuality {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let quality =
            if text == "auto" { Some(Self::Auto) } else { text.parse().ok().map(Self::Of) };
        quality
            .filter(|quality| quality.is_valid())
            .ok_or_else(|| "auto, or a number from 1 to 100, is expected".into())
    }
}

/// White balance of corrected images, one for the whole log.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum WhiteBalance {
    /// the seafloor's median is grey over the whole log
    #[default]
    GreyWorld,
    /// none: the strobe is assumed white and the camera neutral, as in the paper
    None,
    /// factors for red, green, blue
    #[serde(untagged)]
    Factors([f64; 3]),
}

/// Compression of the output's chunks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Compression {
    /// chunks of the input unchanged; of new ones, none for compressed images (JPEG, PNG, WebP),
    /// zstd for all else
    #[default]
    Auto,
    /// small
    Zstd,
    /// fast to read
    Lz4,
    /// fastest to write
    None,
}

/// Encoding of the added messages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum OutputEncoding {
    /// protobuf where the camera's channel is, else CDR: rerun shows no ROS 1, and of JSON only
    /// bytes
    #[default]
    Auto,
    /// ROS 2: `cdr` with `ros2msg` schemas
    Cdr,
    /// ROS 1: `ros1` with `ros1msg` schemas, for its tools
    Ros1,
    /// protobuf: images, calibration and log in Foxglove's schemas
    Protobuf,
}
