//! The attitude of the vehicle along the log.

use super::super::log::Log;
use super::clocks::Clocks;
use super::mounts::Mounts;
use crate::config::SeafloorConfig;
use crate::diagnostics::{Diagnostic, MountFact};
use crate::vehicle::AttitudeTrack;

/// Search for the attitude of a log.
pub struct Search<'s> {
    pub log: &'s Log,
    pub mounts: &'s Mounts<'s>,
    pub body_frame: &'s str,
    pub clocks: Clocks<'s>,
}

impl Search<'_> {
    /// Topic and attitudes of the channel with most samples; the mount of its sensor is removed.
    pub fn run(
        &self,
        config: &SeafloorConfig,
        diagnostics: &mut Vec<Diagnostic>,
    ) -> (Option<String>, AttitudeTrack) {
        let Self { log, mounts, body_frame, clocks } = *self;
        let channels = log.index.channels.iter();
        let best = channels
            .filter(|(id, _)| !log.readings.of(**id).attitudes.is_empty())
            .max_by_key(|(id, c)| {
                let without = log.readings.of(**id).without_attitude;
                (c.count.saturating_sub(without), std::cmp::Reverse(**id))
            });
        let Some((id, channel)) = best else {
            diagnostics.push(MountFact::NoAttitude.into());
            return (None, AttitudeTrack::default());
        };
        let topic = log.topic(*id);
        let sensor_from_body = match mounts.pose_below(body_frame, &channel.frame_id) {
            Some(pose) => pose.rotation.inverse(),
            None => {
                if channel.frame_id != body_frame {
                    let frame = channel.frame_id.clone();
                    let fact = MountFact::AttitudeFrameUnknown { frame };
                    diagnostics.push(Diagnostic::on(&topic, fact));
                }
                nalgebra::UnitQuaternion::identity()
            }
        };
        let is_cameras = clocks.is_cameras(channel.clock_offset_s);
        let offset_s = clocks.offset_s(&topic);
        let samples = log.readings.of(*id).attitudes.iter().map(|(stamp, logged, rotation)| {
            let stamp = if is_cameras { *stamp } else { clocks.on_camera_clock(*logged) };
            (stamp.plus_seconds(offset_s), rotation * sensor_from_body)
        });
        (Some(topic), AttitudeTrack::new(samples.collect(), config.max_attitude_gap_s))
    }
}
