//! The range instrument: its pings and its mount.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::Isometry3;

use super::super::index::ChannelIndex;
use super::super::log::Log;
use super::super::options::Options;
use super::super::readings::ChannelReadings;
use super::calibration::{Images, calibration_in_log};
use super::camera::CameraSurvey;
use super::checks;
use super::choose::choose_ranges;
use super::clocks::Clocks;
use super::mounts::Mounts;
use super::{ping_faults, range_unit};
use crate::coordinates::{Body, Direction, Dvl, Transform};
use crate::diagnostics::{CameraFact, ClockFact, Diagnostic, MountFact, RangeFact};
use crate::error::{Error, MissingMount, Result};
use crate::messages::AltitudeCheck;
use crate::units::{SlantRange, Stamp};
use crate::vehicle::{Beam, Ping, RigFile};

/// Pings with their log time.
pub type LoggedPings<'l> = Cow<'l, [(Ping, Stamp)]>;

/// The chosen range instrument.
pub struct RangeSurvey<'l> {
    pub topic: String,
    frame_id: String,
    /// pings of each channel of the topic; after a merge there may be several
    channels: Vec<(&'l ChannelIndex, &'l ChannelReadings, LoggedPings<'l>)>,
}

impl<'l> RangeSurvey<'l> {
    pub fn new(log: &'l Log, options: &Options, diagnostics: &mut Vec<Diagnostic>) -> Result<Self> {
        let pings = all_pings(log, diagnostics);
        let named = options.selection.dvl.as_ref().or(options.rig.dvl.topic.as_ref());
        let channel = choose_ranges(log, &pings, named, &options.rig)?;
        let topic = log.topic(channel);
        let of_topic = pings
            .into_iter()
            .filter(|(id, pings)| log.topic(*id) == topic && (*id == channel || !pings.is_empty()));
        let of_channel = |(id, pings): (u16, LoggedPings<'l>)| {
            Some((log.index.channels.get(&id)?, log.readings.of(id), pings))
        };
        let channels: Vec<_> = of_topic.filter_map(of_channel).collect();
        let frame_id = channels.iter().map(|c| &c.0.frame_id).find(|f| !f.is_empty()).cloned();
        Ok(Self { topic, frame_id: frame_id.unwrap_or_default(), channels })
    }

    /// Frame id of its messages.
    pub fn frame_id(&self) -> &str {
        &self.frame_id
    }

    /// Checks ranges and clock.
    pub fn check(&self, diagnostics: &mut Vec<Diagnostic>) {
        for (channel, _, pings) in &self.channels {
            let stamps: Vec<Stamp> = pings.iter().map(|(p, _)| p.stamp).collect();
            let ranges = checks::ranges(pings).into_iter();
            diagnostics.extend(ranges.map(|fact| Diagnostic::on(&self.topic, fact)));
            let clock = checks::clock(channel, &stamps).into_iter();
            diagnostics.extend(clock.map(|fact| Diagnostic::on(&self.topic, fact)));
        }
    }

    /// body_from_dvl: by the rig file, else by the TF tree.
    pub fn mount(
        &self,
        (mounts, body_frame): (&Mounts<'_>, &str),
        camera: &CameraSurvey,
        (rig_file, file): (&RigFile, &Path),
        diagnostics: &mut Vec<Diagnostic>,
    ) -> Result<Transform<Body, Dvl>> {
        if let Some(mount) = &rig_file.dvl.mount {
            return mount.transform().map_err(Error::Rig);
        }
        let is_near = rig_file.camera.mount.is_some() || !mounts.is_far(&camera.frame_id);
        let pose = self.mount_in_tree(mounts, body_frame, diagnostics).filter(|_| is_near);
        let pose = pose.ok_or_else(|| {
            Error::NoMount(Box::new(MissingMount {
                what: "range instrument",
                topic: self.topic.clone(),
                frame: self.frame_id.clone(),
                camera_frame: camera.frame_id.clone(),
                gap: mounts.gap(&self.frame_id, &camera.frame_id),
                section: "dvl",
                file: file.into(),
            }))
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

    /// The pings on the camera's clock, in the order of time, without those that are no
    /// measurements.
    ///
    /// # Errors
    /// They cannot be in metres, and nothing says in what else.
    pub fn pings(
        &self,
        log: &Log,
        clocks: &Clocks<'_>,
        diagnostics: &mut Vec<Diagnostic>,
    ) -> Result<Vec<Ping>> {
        let mut add = |fact: Diagnostic| diagnostics.push(fact);
        let offset_s = clocks.offset_s(&self.topic);
        let mut pings = Vec::new();
        for (channel, _, of_channel) in &self.channels {
            let notes = channel.notes.iter().cloned();
            notes.for_each(|fact| add(Diagnostic::on(&self.topic, fact)));
            let is_cameras = clocks.is_cameras(channel.clock_offset_s);
            if !is_cameras {
                add(Diagnostic::on(&self.topic, ClockFact::NotOnCameraClock));
            }
            pings.extend(of_channel.iter().map(|(ping, logged)| {
                let stamp = if is_cameras { ping.stamp } else { clocks.on_camera_clock(*logged) };
                Ping { stamp: stamp.plus_seconds(offset_s), ..ping.clone() }
            }));
        }
        pings.sort_by_key(|ping| ping.stamp);
        let checks: Vec<AltitudeCheck> =
            self.channels.iter().flat_map(|c| c.1.altitude_checks.iter().copied()).collect();
        let unit = self.convert_units(log, clocks.rig_file, &mut pings, &checks)?;
        let equal = ping_faults::take_equal_beams(&mut pings, &checks);
        let slant = checks::slant_or_vertical(&checks).filter(|_| equal.is_none());
        let frozen = ping_faults::drop_repeated(&mut pings);
        let facts = [unit, equal, slant, frozen].into_iter().flatten();
        facts.for_each(|fact| add(Diagnostic::on(&self.topic, fact)));
        Ok(pings)
    }

    /// Converts ranges that cannot be metres, where the rig file gives no unit.
    fn convert_units(
        &self,
        log: &Log,
        rig_file: &RigFile,
        pings: &mut [Ping],
        checks: &[AltitudeCheck],
    ) -> Result<Option<RangeFact>> {
        if rig_file.dvl.unit_m.is_some() {
            return Ok(None);
        }
        let others = log.readings.0.iter().filter(|(id, _)| log.topic(**id) != self.topic);
        let of_others: Vec<Vec<f64>> = others
            .map(|(_, readings)| {
                let pings: Vec<Ping> = readings.pings.iter().map(|(p, _)| p.clone()).collect();
                range_unit::ranges(&pings)
            })
            .collect();
        range_unit::convert_implausible(pings, checks, &of_others).map_err(|typical| {
            Error::Data(format!(
                "the ranges of {} are typically {typical:.0}: no camera sees the seafloor from as \
                 many metres; write their unit under [dvl] in a rig file, as unit_m = 0.001 for \
                 millimetres (1.0 if they are metres)",
                self.topic
            ))
        })
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
            let frame = log.index.channels.get(id).map_or("", |c| c.frame_id.as_str());
            let images = Images { topic: &topic, frame, size: Some(size), named_info: None };
            let camera = calibration_in_log(log, images).camera;
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
