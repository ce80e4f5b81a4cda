//! What was found, what was done, what was not and why: `report.json`, and text for people.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::recording::Damage;

/// Why a frame passed through uncorrected.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Reason {
    /// the picture cannot be decoded
    Undecodable(String),
    /// its size does not fit the calibration
    WrongSize,
    /// no ping near enough in time
    NoPing,
    /// pings, but no return
    NoReturn,
    /// a plane through the vehicle
    ImpossiblePlane,
    /// no pixel meets the floor
    OffSurface,
    /// the corrected picture cannot be encoded
    Unencodable(String),
}

impl std::fmt::Display for Reason {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Undecodable(why) => write!(f, "the picture cannot be decoded ({why})"),
            Self::WrongSize => f.write_str("the picture's shape does not fit the calibration"),
            Self::NoPing => f.write_str("no range to the seafloor near enough in time"),
            Self::NoReturn => f.write_str("no sonar beam came back"),
            Self::ImpossiblePlane => f.write_str("the ranges give no plausible seafloor"),
            Self::OffSurface => f.write_str("no pixel looks at the seafloor"),
            Self::Unencodable(why) => write!(f, "the corrected picture cannot be encoded ({why})"),
        }
    }
}

/// The account of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Report {
    /// version of the program
    pub version: String,
    /// input file's name
    pub source: String,
    /// topics used
    pub camera_topic: String,
    /// where corrected frames went
    pub corrected_topic: String,
    /// the range instrument's topic
    pub dvl_topic: String,
    /// method
    pub method: String,
    /// frames of the camera
    pub frames: usize,
    /// of these, corrected
    pub corrected: usize,
    /// of these, not corrected, by reason
    pub uncorrected: BTreeMap<String, usize>,
    /// frames by what held their plane
    pub planes: BTreeMap<String, usize>,
    /// lowest and highest camera altitude of the corrected frames [m]
    pub camera_altitude_m: Option<[f64; 2]>,
    /// mean shares over the corrected frames
    pub mean_shares: BTreeMap<String, f64>,
    /// cameras that were left as they are, and why, where the log has several
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub cameras_left_out: Vec<String>,
    /// what had to be assumed or mended
    pub remarks: Vec<String>,
    /// what may make the result worse
    pub warnings: Vec<String>,
    /// what could not be read
    pub damage: Vec<Damage>,
    /// messages copied and messages added
    pub messages_copied: u64,
    /// see `messages_copied`
    pub messages_added: u64,
}

impl Report {
    /// Whether something was lost on the way: the third state between done and failed.
    pub fn has_losses(&self) -> bool {
        !self.uncorrected.is_empty() || !self.damage.is_empty() || !self.cameras_left_out.is_empty()
    }

    /// As JSON.
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).unwrap_or_default() + "\n"
    }
}
