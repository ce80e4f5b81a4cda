//! Every number that is a *choice*, in one place, with its unit, its reason and its default.
//!
//! Said → meant in two steps: words on the command line and a TOML file become a [`Config`], valid
//! and complete. Facts about the vehicle are not here but in the rig. `unwater config` prints
//! [`SETTINGS`] beside the effective values; what it prints can be given back with `--config`.

mod file;
mod settings;

use serde::{Deserialize, Serialize};
pub use settings::{SETTINGS, Setting, with_nearest_key};

use crate::image::transfer::{Shoulder, Transfer};

/// All choices.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// how codes become light
    pub light: LightConfig,
    /// the plane below a frame
    pub seafloor: SeafloorConfig,
    /// keypoints and their matches
    pub matching: MatchingConfig,
    /// pass one
    pub estimate: EstimateConfig,
    /// pass two
    pub render: RenderConfig,
    /// the file that is written
    pub output: OutputConfig,
}

/// How codes become light.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[allow(missing_docs)] // each key is documented in SETTINGS, which `unwater config` prints
pub struct LightConfig {
    pub transfer: Transfer,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub white_level: Option<u16>,
}

/// The plane below a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[allow(missing_docs)]
pub struct SeafloorConfig {
    pub pings_each_side: usize,
    pub ping_window_s: f64,
    pub max_ping_gap_s: f64,
    pub max_attitude_gap_s: f64,
    pub least_altitude_m: f64,
    pub relief: Switch,
}

impl Default for SeafloorConfig {
    fn default() -> Self {
        Self {
            pings_each_side: 8,
            ping_window_s: 1.25,
            max_ping_gap_s: 1.0,
            max_attitude_gap_s: 0.5,
            least_altitude_m: 0.2,
            relief: Switch::Auto,
        }
    }
}

/// Keypoints and their matches.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[allow(missing_docs)]
pub struct MatchingConfig {
    pub detection_side_px: usize,
    pub keypoints_per_frame: usize,
    pub contrast_threshold: f64,
    pub ratio: f64,
    pub neighbours: usize,
    pub inlier_px: f64,
    pub least_inliers: usize,
    pub footprint_px: f64,
}

impl MatchingConfig {
    /// Factor by which a picture is reduced before keypoints are looked for.
    pub fn reduction(&self, width: usize, height: usize) -> usize {
        width.max(height).div_ceil(self.detection_side_px).max(1)
    }
}

impl Default for MatchingConfig {
    fn default() -> Self {
        Self {
            detection_side_px: 800,
            keypoints_per_frame: 600,
            contrast_threshold: 0.02,
            ratio: 0.8,
            neighbours: 4,
            inlier_px: 2.0,
            least_inliers: 12,
            footprint_px: 2.5,
        }
    }
}

/// Which estimator of the attenuation is used.
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Serialize,
    Deserialize,
    clap::ValueEnum,
)]
#[serde(rename_all = "kebab-case")]
pub enum Estimator {
    /// joint where frames overlap, else pairs, else altitude
    #[default]
    Auto,
    /// attenuation, beam pattern and reflectances in one robust solve
    Joint,
    /// Eq. 16 on points seen twice, Eq. 17 for the beam pattern
    Pairs,
    /// slope of log colour against altitude (Fig. 6), Eq. 17 for the beam pattern
    Altitude,
}

impl Estimator {
    /// Its name in files and on the command line.
    pub fn word(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Joint => "joint",
            Self::Pairs => "pairs",
            Self::Altitude => "altitude",
        }
    }
}

/// How light spreads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Spreading {
    /// not at all, as the paper has it: the attenuation is then an effective one
    None,
    /// 1/ℓ_a² from the strobe: physical
    #[default]
    Strobe,
    /// 1/(ℓ_a ℓ_s)², as Eq. 15 prints it
    Paper,
    /// 1/ℓ_a^p with p fitted: a check on the geometry (p should come out as 2)
    Fit,
}

/// Whether a part of the model is used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Switch {
    /// where held-out frames are explained better by it
    #[default]
    Auto,
    /// never
    Off,
    /// always
    On,
}

/// What is done about where the strobe sits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum StrobePosition {
    /// found where no pose is given; a given one is checked, and a better one reported
    #[default]
    Auto,
    /// as given, or at the camera; nothing is searched
    Fixed,
    /// searched from the given pose on
    Refine,
    /// searched from nothing, whatever is given
    Find,
}

/// Pass one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[allow(missing_docs)]
pub struct EstimateConfig {
    pub estimator: Estimator,
    pub spreading: Spreading,
    pub incidence: bool,
    pub strobe_position: StrobePosition,
    pub backscatter: Switch,
    pub drift: Switch,
    pub first_frames: usize,
    pub precision_per_m: f64,
    pub max_frames: usize,
    pub attenuation_floor_per_m: f64,
    pub sweeps: usize,
    pub grid_step_px: usize,
    pub clipped_above: f64,
    pub dark_below: f64,
    pub beam_limit_deg: f64,
    pub beam_nodes: usize,
    pub beam_smoothness: f64,
    pub rounds: usize,
    pub least_pairs: usize,
    pub least_altitude_spread: f64,
}

impl Default for EstimateConfig {
    fn default() -> Self {
        Self {
            estimator: Estimator::Auto,
            spreading: Spreading::Strobe,
            incidence: true,
            strobe_position: StrobePosition::Auto,
            backscatter: Switch::Auto,
            drift: Switch::Auto,
            first_frames: 60,
            precision_per_m: 0.004,
            max_frames: 400,
            attenuation_floor_per_m: 0.0,
            sweeps: 6,
            grid_step_px: 16,
            clipped_above: 0.985,
            dark_below: 0.0015,
            beam_limit_deg: 70.0,
            beam_nodes: 41,
            beam_smoothness: 0.05,
            rounds: 12,
            least_pairs: 200,
            least_altitude_spread: 1.15,
        }
    }
}

/// What pass two removes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// attenuation, spreading, incidence and beam pattern (Fig. 10, bottom right)
    #[default]
    Full,
    /// what the water and the distance took, alone (Fig. 10, top right)
    Attenuation,
    /// the strobe's pattern alone (Fig. 10, bottom left)
    BeamPattern,
    /// baseline, for comparison: divides by the mean of the frames that pass one saw (Eq. 14)
    FrameAverage,
    /// baseline, for comparison: divides by the mean of the frames at the same height
    RangeAverage,
    /// baseline, for comparison: the mean of each frame is grey
    GreyWorld,
    /// baseline, for comparison: the brightest of each frame is white
    WhitePatch,
    /// baseline, for comparison: takes off what is broad in each frame's log (Eq. 12)
    Homomorphic,
    /// baseline, for comparison: takes off a smooth surface fitted to each frame's log
    HomomorphicSurface,
    /// baseline, for comparison: contrast-limited adaptive histogram equalisation of each frame
    Ahe,
}

impl Method {
    /// Whether it is there for comparison alone: it takes statistics of frames, not the water.
    pub fn is_baseline(self) -> bool {
        !matches!(self, Self::Full | Self::Attenuation | Self::BeamPattern)
    }

    /// Whether it needs mean frames of the whole log.
    pub fn needs_mean_frames(self) -> bool {
        matches!(self, Self::FrameAverage | Self::RangeAverage)
    }
}

/// Container of corrected pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum ImageFormat {
    /// PNG where the source is PNG or 16 bit is asked for, JPEG elsewhere
    #[default]
    Auto,
    /// JPEG, 8 bit
    Jpeg,
    /// PNG, 8 or 16 bit
    Png,
    /// bare pixels (`sensor_msgs/Image`), 8 or 16 bit
    Raw,
    /// as the source: raw for raw, PNG for PNG, JPEG for JPEG
    Same,
}

/// Grey balance of corrected pictures, one for the whole log.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum WhiteBalance {
    /// the seafloor's median is grey over the whole log
    #[default]
    GreyWorld,
    /// none: the strobe is taken to be white and the camera even, as the paper does
    None,
    /// factors for red, green, blue
    #[serde(untagged)]
    Factors([f64; 3]),
}

/// Pass two.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[allow(missing_docs)]
pub struct RenderConfig {
    pub method: Method,
    pub white_balance: WhiteBalance,
    pub highlight_quantile: f64,
    pub highlight_level: f64,
    pub shoulder_from: f64,
    pub gain_cap: f64,
    pub least_signal_to_noise: f64,
    pub gain_error: f64,
    pub mask: bool,
    pub rectify: bool,
    pub image_format: ImageFormat,
    pub jpeg_quality: u8,
    pub depth: u8,
}

impl Default for RenderConfig {
    fn default() -> Self {
        Self {
            method: Method::Full,
            white_balance: WhiteBalance::GreyWorld,
            highlight_quantile: 0.995,
            highlight_level: 0.75,
            shoulder_from: 0.75,
            gain_cap: 8.0,
            least_signal_to_noise: 10.0,
            gain_error: 0.001,
            mask: false,
            rectify: false,
            image_format: ImageFormat::Auto,
            jpeg_quality: 95,
            depth: 8,
        }
    }
}

/// Compression of the output's chunks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Compression {
    /// chunks of the input as they are; of those written anew, none for pictures that are files
    /// (JPEG, PNG, WebP), zstd for all else
    #[default]
    Auto,
    /// small
    Zstd,
    /// quick to read
    Lz4,
    /// quickest to write
    None,
}

/// Encoding of the messages that are added.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum OutputEncoding {
    /// protobuf where the camera's channel is, CDR elsewhere: rerun shows no ROS 1, and of JSON no
    /// more than bytes
    #[default]
    Auto,
    /// ROS 2: `cdr` with `ros2msg` schemas
    Cdr,
    /// ROS 1: `ros1` with `ros1msg` schemas, for its tools
    Ros1,
    /// protobuf: pictures, calibration and log as Foxglove has them
    Protobuf,
}

/// The file that is written.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[allow(missing_docs)]
pub struct OutputConfig {
    pub encoding: OutputEncoding,
    pub compression: Compression,
    pub chunk_size_mib: u64,
    pub drop_raw: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub only: Option<String>,
    pub seafloor_points_across: usize,
    pub raw_preview_side_px: usize,
}

impl Default for OutputConfig {
    fn default() -> Self {
        Self {
            encoding: OutputEncoding::Auto,
            compression: Compression::Auto,
            chunk_size_mib: 4,
            drop_raw: false,
            only: None,
            seafloor_points_across: 64,
            raw_preview_side_px: 960,
        }
    }
}

impl RenderConfig {
    /// Corrected light from which on all is shown alike.
    pub fn white(&self) -> f64 {
        if self.depth == 16 { 1.0 } else { Shoulder { knee: self.shoulder_from }.white() }
    }
}
