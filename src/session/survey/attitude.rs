//! The attitude of the vehicle along the log.

use std::collections::BTreeMap;

use super::super::log::Log;
use super::clocks::Clocks;
use super::mounts::Mounts;
use crate::config::SeafloorConfig;
use crate::diagnostics::{Diagnostic, MountFact};
use crate::vehicle::{AttitudeTrack, CameraMotion};

/// Search for the attitude of a log.
pub struct Search<'s> {
    pub log: &'s Log,
    pub mounts: &'s Mounts<'s>,
    pub body_frame: &'s str,
    pub clocks: Clocks<'s>,
    pub motion: Option<&'s CameraMotion>,
}

impl Search<'_> {
    /// Topic and attitudes of the channel with most samples; the mount of its sensor is removed.
    pub fn run(
        &self,
        config: &SeafloorConfig,
        diagnostics: &mut Vec<Diagnostic>,
    ) -> (Option<String>, AttitudeTrack) {
        let Self { log, mounts, body_frame, clocks, motion } = *self;
        let mut topics: BTreeMap<String, (u64, Vec<u16>)> = BTreeMap::new();
        for (id, channel) in &log.index.channels {
            let readings = log.readings.of(*id);
            if !readings.attitudes.is_empty() {
                let topic = topics.entry(log.topic(*id)).or_default();
                topic.0 += channel.count.saturating_sub(readings.without_attitude);
                topic.1.push(*id);
            }
        }
        // Of equal ones that of the first channel.
        let best = topics.into_iter().max_by_key(|(_, (n, ids))| (*n, std::cmp::Reverse(ids[0])));
        let Some((topic, (_, ids))) = best else {
            diagnostics.push(MountFact::NoAttitude.into());
            return (None, AttitudeTrack::default());
        };
        let offset_s = clocks.offset_s(&topic);
        let mut samples = Vec::new();
        for (id, channel) in ids.iter().filter_map(|id| Some((id, log.index.channels.get(id)?))) {
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
            // A sensor beside a camera that moves in the vehicle.
            let motion = motion.filter(|_| mounts.turns(&channel.frame_id));
            let is_cameras = clocks.is_cameras(channel.clock_offset_s);
            let of_channel = log.readings.of(*id).attitudes.iter();
            samples.extend(of_channel.map(|(stamp, logged, rotation)| {
                let stamp = if is_cameras { *stamp } else { clocks.on_camera_clock(*logged) };
                let stamp = stamp.plus_seconds(offset_s);
                let world_from_body = rotation * sensor_from_body;
                let body_from_vehicle =
                    motion.map(|m| m.vehicle_from_body(stamp).rotation.inverse());
                (stamp, body_from_vehicle.map_or(world_from_body, |pose| world_from_body * pose))
            }));
        }
        (Some(topic), AttitudeTrack::new(samples, config.max_attitude_gap_s))
    }
}
