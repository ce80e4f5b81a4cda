//! Exposure times of the camera.

use super::super::dive::{CameraLog, CorrectedLog};
use crate::units::Stamp;
use crate::vehicle::SettingSeries;

/// Exposure times that the images follow, in a unit that the log states.
pub struct Exposures {
    series: SettingSeries,
    unit_s: f64,
}

impl Exposures {
    /// `None` where the log has none, the images do not follow them, or no name states their unit.
    pub fn of(log: &CorrectedLog, camera: &CameraLog) -> Option<Self> {
        let recording = &log.scanned.recording;
        let unit_s = |topic: &str| {
            let ids = recording.channels.iter().filter(|(_, c)| c.topic == topic).map(|(id, _)| id);
            let mut decoders = ids.filter_map(|id| log.scanned.index.decoders.get(id));
            decoders.find_map(|decoder| decoder.exposure_unit_s(topic))
        };
        let followed = camera.model.light_settings.iter();
        let mut exposures = followed.filter(|s| matches!(s.name.as_str(), "exposure" | "value"));
        let (followed, unit_s) = exposures.find_map(|s| Some((s, unit_s(&s.topic)?)))?;
        let is_it = |s: &SettingSeries| (&s.topic, &s.name) == (&followed.topic, &followed.name);
        Some(Self { series: log.scanned.settings().into_iter().find(is_it)?, unit_s })
    }

    /// Of the frame at this time (s).
    pub fn at(&self, stamp: Stamp) -> Option<f64> {
        self.series.at(stamp).map(|value| value * self.unit_s).filter(|seconds| *seconds > 0.0)
    }
}
