//! What the sensors of a log measured. It grows with the log, so it is dropped once the surveys
//! have taken what they need.

use std::collections::BTreeMap;

use nalgebra::UnitQuaternion;

use crate::messages::{AltitudeCheck, DepthSamples, RadiometrySetting};
use crate::units::Stamp;
use crate::vehicle::Ping;

/// Attitudes nearer in time than this are left out: they add no information, and hours at hundreds
/// a second would fill the memory (s).
const MIN_ATTITUDE_INTERVAL_S: f64 = 0.015;

/// Measurements by channel id.
#[derive(Default)]
pub struct Readings(pub BTreeMap<u16, ChannelReadings>);

/// Measurements of one channel.
#[derive(Default)]
pub struct ChannelReadings {
    /// pings with their log time
    pub pings: Vec<(Ping, Stamp)>,
    /// depth images: the beams of the ping of the same index
    pub depths: Vec<DepthSamples>,
    /// altitudes compared with ranges
    pub altitude_checks: Vec<AltitudeCheck>,
    /// stamp, log time and world_from_sensor
    pub attitudes: Vec<(Stamp, Stamp, UnitQuaternion<f64>)>,
    /// number of messages without an attitude
    pub without_attitude: u64,
    /// settings of camera or strobe, by name
    pub settings: Vec<(Stamp, Vec<RadiometrySetting>)>,
}

impl Readings {
    /// Measurements of a channel; empty where it has none.
    pub fn of(&self, channel: u16) -> &ChannelReadings {
        static NONE: ChannelReadings = ChannelReadings {
            pings: Vec::new(),
            depths: Vec::new(),
            altitude_checks: Vec::new(),
            attitudes: Vec::new(),
            without_attitude: 0,
            settings: Vec::new(),
        };
        self.0.get(&channel).unwrap_or(&NONE)
    }
}

impl ChannelReadings {
    pub(super) fn attitude(
        &mut self,
        stamp: Stamp,
        logged: Stamp,
        rotation: Option<UnitQuaternion<f64>>,
    ) {
        let Some(rotation) = rotation else {
            self.without_attitude += 1;
            return;
        };
        // By both times: stamps may stand still, and messages be logged in bursts.
        let is_near = |from: Stamp, to: Stamp| {
            (0.0..MIN_ATTITUDE_INTERVAL_S).contains(&to.seconds_since(from))
        };
        let last = self.attitudes.last();
        if !last.is_some_and(|(s, l, _)| is_near(*s, stamp) && is_near(*l, logged)) {
            self.attitudes.push((stamp, logged, rotation));
        }
    }
}
