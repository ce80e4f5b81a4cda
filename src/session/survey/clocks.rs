//! Clocks of a log: whose stamps can be compared with the camera's.

use crate::units::Stamp;
use crate::vehicle::RigFile;

/// A channel whose clock differs by more from the camera's keeps another clock (s).
const CLOCK_TOLERANCE_S: f64 = 2.0;

/// The camera's clock, and the corrections of the rig file.
#[derive(Clone, Copy)]
pub struct Clocks<'s> {
    /// median of header time − log time of the camera (s)
    pub camera_offset_s: Option<f64>,
    pub rig_file: &'s RigFile,
}

/// Seconds that the rig file adds to a topic's stamps.
pub fn offset_s(rig_file: &RigFile, topic: &str) -> f64 {
    rig_file.time_offset_s.get(topic).copied().unwrap_or(0.0)
}

impl Clocks<'_> {
    /// Whether a channel of this clock offset keeps the camera's clock.
    pub fn is_cameras(&self, offset_s: Option<f64>) -> bool {
        match (offset_s, self.camera_offset_s) {
            (Some(a), Some(b)) => (a - b).abs() < CLOCK_TOLERANCE_S,
            (Some(a), None) => a.abs() < CLOCK_TOLERANCE_S,
            (None, Some(b)) => b.abs() < CLOCK_TOLERANCE_S,
            (None, None) => true,
        }
    }

    /// A log time on the camera's clock.
    pub fn on_camera_clock(&self, logged: Stamp) -> Stamp {
        logged.plus_seconds(self.camera_offset_s.unwrap_or(0.0))
    }

    /// Seconds that the rig file adds to a topic's stamps.
    pub fn offset_s(&self, topic: &str) -> f64 {
        offset_s(self.rig_file, topic)
    }
}
