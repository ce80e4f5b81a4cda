//! Topics of the strobe: its pose, its beam, its beam pattern.

use nalgebra::{Point3, Vector3};

use super::beam_image;
use super::topic::{FrameContext, OutputTopic};
use crate::geometry::{MIN_COS_INCIDENCE, SeafloorPlane};
use crate::messages::output::{self, ScenePoint};

pub const POSE: OutputTopic = OutputTopic {
    rank: 7,
    name: |camera| Some(camera.own_topic("strobe")),
    message_type: |_| output::POSE,
    write: |frame, put| put(&pose(frame)),
};

pub const BEAM: OutputTopic = OutputTopic {
    rank: 8,
    name: |camera| Some(camera.own_topic("strobe/beam")),
    message_type: |_| output::POINT_CLOUD,
    write: |frame, put| frame.output.plane.iter().for_each(|p| put(&beam(frame, p))),
};

pub const BEAM_PATTERN: OutputTopic = OutputTopic {
    rank: 10,
    name: |camera| Some(camera.own_topic("beam_pattern")),
    message_type: |_| output::BEAM_PATTERN,
    write: |frame, put| {
        if frame.is_first {
            put(&beam_pattern(frame));
        }
    },
};

pub const BEAM_PATTERN_IMAGE: OutputTopic = OutputTopic {
    rank: 11,
    name: |camera| Some(camera.own_topic("beam_pattern/picture/compressed")),
    message_type: |_| output::COMPRESSED_IMAGE,
    write: |frame, put| {
        if frame.is_first {
            let png = beam_image::png(&frame.camera.model.prepared.model.beam_pattern);
            let header = &frame.output.header;
            put(&output::compressed_image(frame.camera.wire, header, "png", &png));
        }
    },
};

/// Points along the axis of a beam, less one.
const BEAM_STEPS: u32 = 48;
/// Length of a beam that does not meet the seafloor (m).
const FREE_BEAM_M: f64 = 1.0;
/// sRGB.
const BEAM_COLOR: [u8; 3] = [255, 214, 64];

/// Pose of the strobe, z along its beam, in the camera's optical frame; of several lamps the
/// first.
fn pose(frame: &FrameContext<'_>) -> Vec<u8> {
    let rig = &frame.camera.session.survey.rig;
    let optical_from_strobe = rig.body_from_optical.inverse() * rig.strobe.lamps.body_from_strobe();
    output::pose(frame.camera.wire, &frame.output.header, &optical_from_strobe.isometry())
}

/// The axis of every lamp's beam from the lamp to the seafloor, in the camera's optical frame: not
/// all viewers draw a pose.
fn beam(frame: &FrameContext<'_>, plane: &SeafloorPlane) -> Vec<u8> {
    let rig = &frame.camera.session.survey.rig;
    let optical_from_body = rig.body_from_optical.inverse().isometry();
    let normal = plane.normal.vector();
    let mut points = Vec::new();
    for (pose, _) in rig.strobe.lamps.poses() {
        let (origin, axis) = (pose.translation.vector, pose.rotation * Vector3::z());
        let cosine = normal.dot(&axis);
        let length_m = (plane.distance_m - normal.dot(&origin)) / cosine;
        let meets = cosine > MIN_COS_INCIDENCE && length_m > 0.0;
        let length_m = if meets { length_m } else { FREE_BEAM_M };
        points.extend((0..=BEAM_STEPS).map(|i| {
            let along_m = length_m * f64::from(i) / f64::from(BEAM_STEPS);
            let at = optical_from_body * Point3::from(origin + axis * along_m);
            ScenePoint { position_m: [at.x as f32, at.y as f32, at.z as f32], rgb: BEAM_COLOR }
        }));
    }
    output::point_cloud(frame.camera.wire, &frame.output.header, &points)
}

fn beam_pattern(frame: &FrameContext<'_>) -> Vec<u8> {
    let beam = &frame.camera.model.prepared.model.beam_pattern;
    let nodes = beam.nodes();
    let angles: Vec<f64> = (0..nodes.count).map(|i| nodes.angle(i).to_degrees()).collect();
    let log_gain: Vec<f64> = beam.by_node().into_iter().map(|v| v.unwrap_or(f64::NAN)).collect();
    output::with_header(frame.camera.wire, &frame.output.header)
        .f64_sequence(&angles)
        .f64_sequence(&angles)
        .f64_sequence(&log_gain)
        .finish()
}
