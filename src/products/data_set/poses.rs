//! Calibration and poses of the camera, from the trajectory that the log has.

use std::collections::BTreeMap;

use nalgebra::Isometry3;

use super::super::dive::{CameraLog, CorrectedLog, Images};
use super::super::places::{Places, placed};
use crate::session::Options;
use crate::vehicle::Camera;

/// Calibration and poses of a camera.
pub struct CameraPoses {
    /// for the size of the images
    pub camera: Camera,
    /// what the poses are from, as text; empty without poses
    pub source: String,
    /// by index of the frame's record: world_from_optical of the longest segment; x east, y north,
    /// z up
    pub poses: BTreeMap<usize, Isometry3<f64>>,
}

/// Calibration and poses of a camera; `None` where the log lacks what was used for the correction.
pub fn camera_poses(
    log: &CorrectedLog,
    camera: &CameraLog,
    places: &Places,
) -> Option<CameraPoses> {
    let options = Options { window: Some(log.window), ..Options::default() };
    let source = log.source(camera, Images::Corrected, &options).ok()?;
    let session = &source.bench.session;
    let (width, height) = session.survey.image_size;
    let rig = &session.survey.rig;
    let mut calibration = rig.camera.scaled_to(width, height)?;
    if log.config.render.rectify {
        calibration = calibration.rectified();
    }
    let of_frame = |frame: &crate::session::FrameRef| {
        let record = *source.records.get(&frame.id)?;
        Some((record, (frame.stamp, session.seafloor(frame.stamp).ok()?)))
    };
    let (records, frames): (Vec<usize>, Vec<_>) =
        session.survey.frames.iter().filter_map(of_frame).unzip();
    let Some(found) = placed(session, places, &frames) else {
        return Some(CameraPoses {
            camera: calibration,
            source: String::new(),
            poses: BTreeMap::new(),
        });
    };
    let mut segments: BTreeMap<u32, usize> = BTreeMap::new();
    found.poses.iter().flatten().for_each(|(s, _)| *segments.entry(*s).or_default() += 1);
    let longest = segments.iter().max_by_key(|(s, frames)| (**frames, std::cmp::Reverse(**s)));
    let longest = longest.map(|(segment, _)| *segment);
    let body_from_optical = rig.body_from_optical.isometry();
    let pose = |(record, pose): (usize, Option<(u32, Isometry3<f64>)>)| {
        let (_, world_from_body) = pose.filter(|(segment, _)| Some(*segment) == longest)?;
        Some((record, world_from_body * body_from_optical))
    };
    let poses = records.into_iter().zip(found.poses).filter_map(pose).collect();
    Some(CameraPoses { camera: calibration, source: found.source, poses })
}
