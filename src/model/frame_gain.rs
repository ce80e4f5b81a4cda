//! Frames that got another amount of light, in `model.json`.

use serde::{Deserialize, Serialize};

use super::RangeFactor;
use crate::recording::FrameId;

/// A frame that got another amount of light than others.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameGainFile {
    /// its place in its log; absent in files of earlier versions
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frame: Option<FrameId>,
    /// its log, an index of `inputs`
    #[serde(default)]
    pub input: usize,
    /// its time (ns)
    pub stamp_ns: i64,
    /// its light over its neighbours', the mean over the bands
    pub gain: f64,
    /// each band's own gain over that, where the bands differ
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub balance: Option<[f64; 3]>,
    /// factor of its slant ranges by its light, in the empirical model; 1 where absent
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub range_factor: f64,
    /// change of its logarithm by x and y of the image plane; none where absent
    #[serde(default, skip_serializing_if = "is_level")]
    pub range_tilt: [f64; 2],
    /// no plane explains its light, in the empirical model
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_unexplained: bool,
}

impl FrameGainFile {
    /// The factor of its slant ranges.
    pub fn ranges(&self) -> RangeFactor {
        RangeFactor {
            log_factor: self.range_factor.ln(),
            log_tilt: self.range_tilt,
            is_unexplained: self.is_unexplained,
        }
    }
}

pub(super) fn one() -> f64 {
    1.0
}

#[allow(clippy::trivially_copy_pass_by_ref)] // serde passes a reference
pub(super) fn is_one(factor: &f64) -> bool {
    *factor == 1.0
}

fn is_level(tilt: &[f64; 2]) -> bool {
    *tilt == [0.0; 2]
}
