//! The range instrument: its pings and its mount.

use std::borrow::Cow;
use std::collections::BTreeMap;

use nalgebra::Isometry3;

use super::super::log::Log;
use super::super::options::Options;
use super::camera::CameraSurvey;
use super::checks;
use super::choose::choose_ranges;
use super::clocks::Clocks;
use super::mounts::Mounts;
use crate::coordinates::{Body, Direction, Dvl, Transform};
use crate::diagnostics::{CameraFact, ClockFact, Diagnostic, MountFact};
use crate::error::{Error, Result};
use crate::units::{SlantRange, Stamp};
use crate::vehicle::{Beam, Ping, RigFile};

/// Pings with their log time.
pub type LoggedPings<'l> = Cow<'l, [(Ping, Stamp)]>;

/// The chosen range instrument.
pub struct RangeSurvey<'l> {
    channel: u16,
    pub topic: String,
    frame_id: String,
    pings: LoggedPings<'l>,
}

impl<'l> RangeSurvey<'l> {
    pub fn new(log: &'l Log, options: &Options, diagnostics: &mut Vec<Diagnostic>) -> Result<Self> {
        let mut pings = all_pings(log, diagnostics);
        let named = options.selection.dvl.as_ref().or(options.rig.dvl.topic.as_ref());
        let channel = choose_ranges(log, &pings, named, &options.rig)?;
        let frame_id = log.index.channels.get(&channel).map(|c| c.frame_id.clone());
        Ok(Self {
            channel,
            topic: log.topic(channel),
            frame_id: frame_id.unwrap_or_default(),
            pings: pings.remove(&channel).unwrap_or_default(),
        })
    }

    /// Checks ranges and clock.
    pub fn check(&self, log: &Log, diagnostics: &mut Vec<Diagnostic>) {
        let Some(channel) = log.index.channels.get(&self.channel) else { return };
        let stamps: Vec<Stamp> = self.pings.iter().map(|(p, _)| p.stamp).collect();
        let ranges = checks::ranges(&self.pings).into_iter();
        diagnostics.extend(ranges.map(|fact| Diagnostic::on(&self.topic, fact)));
        let clock = checks::clock(channel, &stamps).into_iter();
        diagnostics.extend(clock.map(|fact| Diagnostic::on(&self.topic, fact)));
    }

    /// body_from_dvl: by the rig file, else by the TF tree.
    pub fn mount(
        &self,
        mounts: &Mounts<'_>,
        body_frame: &str,
        camera: &CameraSurvey,
        rig_file: &RigFile,
        diagnostics: &mut Vec<Diagnostic>,
    ) -> Result<Transform<Body, Dvl>> {
        if let Some(mount) = &rig_file.dvl.mount {
            return mount.transform().map_err(Error::Rig);
        }
        let pose = self.mount_in_tree(mounts, body_frame, diagnostics);
        let pose = pose.ok_or_else(|| Error::NoMount {
            what: "DVL or altimeter",
            frame: self.frame_id.clone(),
            camera_frame: camera.frame_id.clone(),
            section: "dvl",
        })?;
        Ok(Transform::from_isometry(pose))
    }

    fn mount_in_tree(
        &self,
        mounts: &Mounts<'_>,
        body_frame: &str,
        diagnostics: &mut Vec<Diagnostic>,
    ) -> Option<Isometry3<f64>> {
        if !self.frame_id.is_empty()
            && let Some(pose) = mounts.pose_below(body_frame, &self.frame_id)
        {
            return Some(pose);
        }
        // The frame is not in the tree (`dvl_A50_report_link`, `dvl_altitude`): a frame with the
        // same first word, or with that of the topic, replaces it.
        let word = |name: &str| {
            name.split(['_', '/']).find(|w| !w.is_empty()).unwrap_or("").to_ascii_lowercase()
        };
        let words = [word(&self.frame_id), word(&self.topic)];
        let used = mounts.frames().into_iter().find(|f| {
            words.iter().any(|w| !w.is_empty() && word(f) == *w)
                && mounts.pose_below(body_frame, f).is_some()
        })?;
        let fact = MountFact::FrameReplaced { frame: self.frame_id.clone(), used: used.into() };
        diagnostics.push(Diagnostic::on(&self.topic, fact));
        mounts.pose_below(body_frame, used)
    }

    /// The pings on the camera's clock.
    pub fn pings(
        &self,
        log: &Log,
        clocks: &Clocks<'_>,
        diagnostics: &mut Vec<Diagnostic>,
    ) -> Vec<Ping> {
        let Some(channel) = log.index.channels.get(&self.channel) else { return Vec::new() };
        let altitudes = &log.readings.of(self.channel).altitude_checks;
        let facts = channel.notes.iter().cloned().chain(checks::slant_or_vertical(altitudes));
        diagnostics.extend(facts.map(|fact| Diagnostic::on(&self.topic, fact)));
        let is_cameras = clocks.is_cameras(channel.clock_offset_s);
        if !is_cameras {
            diagnostics.push(Diagnostic::on(&self.topic, ClockFact::NotOnCameraClock));
        }
        let offset_s = clocks.offset_s(&self.topic);
        let on_camera_clock = |(ping, logged): &(Ping, Stamp)| {
            let stamp = if is_cameras { ping.stamp } else { clocks.on_camera_clock(*logged) };
            Ping { stamp: stamp.plus_seconds(offset_s), ..ping.clone() }
        };
        self.pings.iter().map(on_camera_clock).collect()
    }
}

/// Pings of every channel; those of depth images get their beams here, where calibrations are
/// known.
fn all_pings<'l>(
    log: &'l Log,
    diagnostics: &mut Vec<Diagnostic>,
) -> BTreeMap<u16, LoggedPings<'l>> {
    let mut pings = BTreeMap::new();
    for (id, readings) in &log.readings.0 {
        let mut of_channel = Cow::Borrowed(&readings.pings[..]);
        if let Some(first) = readings.depths.first() {
            let (topic, size) = (log.topic(*id), (first.width, first.height));
            let camera = checks::nearest_calibration(log, &topic, Some(size));
            match camera.and_then(|c| c.scaled_to(size.0, size.1)) {
                None => {
                    diagnostics.push(Diagnostic::on(&topic, CameraFact::DepthWithoutCalibration));
                }
                Some(camera) => {
                    let beam = |[u, v, z]: &[f64; 3]| {
                        let (x, y) = camera.image_plane(*u, *v)?;
                        let direction = Direction::from_vector(nalgebra::Vector3::new(x, y, 1.0))?;
                        let range = Some(SlantRange(z * (1.0 + x * x + y * y).sqrt()));
                        Some(Beam { direction, range })
                    };
                    for ((ping, _), depth) in of_channel.to_mut().iter_mut().zip(&readings.depths) {
                        ping.beams = depth.samples.iter().filter_map(beam).collect();
                    }
                }
            }
        }
        pings.insert(*id, of_channel);
    }
    pings
}
