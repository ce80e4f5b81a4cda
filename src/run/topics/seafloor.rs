//! Topics of the seafloor: plane, its frame, the image as a point cloud on it, plots.

use nalgebra::{Isometry3, Rotation3, UnitQuaternion, Vector3};

use super::super::camera_output::CameraOutput;
use super::super::clouds;
use super::super::corrector::CorrectedFrame;
use super::topic::{FrameContext, OutputTopic};
use crate::coordinates::{Direction, Optical};
use crate::geometry::{SeafloorPlane, View};
use crate::image::transfer::SrgbTable;
use crate::messages::Header;
use crate::messages::output::{self, ScenePoint};

pub const PLANE: OutputTopic = OutputTopic {
    rank: 4,
    name: |camera| Some(camera.own_topic("seafloor")),
    message_type: |_| output::SEAFLOOR,
    write: |frame, put| frame.output.plane.iter().for_each(|p| put(&plane(frame, p))),
};

pub const CLOUD: OutputTopic = OutputTopic {
    rank: 5,
    name: |camera| {
        let is_wanted = camera.clouds.across > 0;
        is_wanted.then(|| camera.own_topic("seafloor/cloud"))
    },
    message_type: |_| output::POINT_CLOUD,
    write: |frame, put| {
        frame.output.result.iter().filter_map(|r| r.cloud.as_deref()).for_each(put);
    },
};

pub const TRANSFORM: OutputTopic = OutputTopic {
    rank: 6,
    name: |camera| Some(camera.own_topic("seafloor/transform")),
    message_type: |_| output::TRANSFORM,
    write: |frame, put| frame.output.plane.iter().for_each(|p| put(&transform(frame, p))),
};

pub const ALTITUDE_PLOT: OutputTopic = OutputTopic {
    rank: 15,
    name: |camera| Some(camera.own_topic("plot/camera_altitude_m")),
    message_type: |_| output::MULTI_ARRAY,
    write: |frame, put| {
        let altitude_m = |p: &SeafloorPlane| p.camera_altitude_m(&frame.camera.session.survey.rig);
        let plot = |m| output::multi_array(frame.camera.wire, "camera_altitude_m", &[m]);
        frame.output.plane.iter().for_each(|p| put(&plot(altitude_m(p))));
    },
};

pub const RESIDUAL_PLOT: OutputTopic = OutputTopic {
    rank: 16,
    name: |camera| Some(camera.own_topic("plot/seafloor_residual_m")),
    message_type: |_| output::MULTI_ARRAY,
    write: |frame, put| {
        let plot = |m| output::multi_array(frame.camera.wire, "seafloor_residual_m", &[m]);
        frame.output.plane.iter().for_each(|p| put(&plot(p.residual_m)));
    },
};

/// The plane's normal in the camera's optical frame.
fn normal_in_optical(camera: &CameraOutput<'_>, plane: &SeafloorPlane) -> Vector3<f64> {
    (camera.session.survey.rig.body_from_optical.inverse() * plane.normal).vector()
}

fn plane(frame: &FrameContext<'_>, plane: &SeafloorPlane) -> Vec<u8> {
    let normal = normal_in_optical(frame.camera, plane);
    let altitude_m = plane.camera_altitude_m(&frame.camera.session.survey.rig);
    let cosine = normal.dot(&Direction::<Optical>::boresight().vector());
    let tilt_deg = cosine.clamp(-1.0, 1.0).acos().to_degrees();
    output::with_header(frame.camera.wire, &frame.output.header)
        .f64s(&[normal.x, normal.y, normal.z, altitude_m, altitude_m, tilt_deg])
        .u32(plane.returns as u32)
        .f64s(&[plane.residual_m, plane.nearest_ping_s])
        .text(plane.support.word())
        .finish()
}

/// The seafloor's frame: on the plane below the camera, z up, x to the right of the images.
fn transform(frame: &FrameContext<'_>, plane: &SeafloorPlane) -> Vec<u8> {
    let normal = normal_in_optical(frame.camera, plane);
    let altitude_m = plane.camera_altitude_m(&frame.camera.session.survey.rig);
    // x as near to the right of the images as lies in the plane.
    let right = if normal.x.abs() < 0.99 { Vector3::x() } else { Vector3::y() };
    let y = (-normal).cross(&right);
    let rotation =
        Rotation3::from_basis_unchecked(&[y.cross(&-normal).normalize(), y.normalize(), -normal]);
    let pose = Isometry3::from_parts(
        (normal * altitude_m).into(),
        UnitQuaternion::from_rotation_matrix(&rotation),
    );
    let name = format!("unwater{}/seafloor", frame.camera.name);
    output::transform(frame.camera.wire, &frame.output.header, &name, &pose)
}

/// The corrected image on the seafloor, in the camera's optical frame.
pub fn cloud(
    camera: &CameraOutput<'_>,
    header: &Header,
    image: &CorrectedFrame,
    view: &View<'_>,
) -> Vec<u8> {
    let (width, height) = (image.shape.width, image.shape.height);
    let (across, down) = clouds::points(camera.clouds.across, (width, height));
    let step = width as f64 / across as f64;
    let optical_from_body = view.rig.body_from_optical.inverse();
    let center = |i: usize| (i as f64 + 0.5) * step - 0.5;
    let points: Vec<ScenePoint> = (0..down * across)
        .filter_map(|i| {
            let (u, v) = (center(i % across), center(i / across));
            let point = (optical_from_body * view.seafloor_point(u, v)?.position).vector();
            let (x, y) = (u.round() as usize, v.round() as usize);
            let rgb = srgb8(image, &camera.corrector.srgb, x.min(width - 1), y.min(height - 1));
            let position_m = [point.x as f32, point.y as f32, point.z as f32];
            Some(ScenePoint { position_m, rgb })
        })
        .collect();
    output::point_cloud(camera.wire, header, &points)
}

/// A pixel of a corrected image in 8-bit sRGB.
fn srgb8(image: &CorrectedFrame, srgb: &SrgbTable, x: usize, y: usize) -> [u8; 3] {
    let bands = image.shape.bands;
    std::array::from_fn(|band| {
        let index = (y * image.shape.width + x) * bands + band.min(bands - 1);
        match image.depth {
            16 => {
                let value = [image.samples[2 * index], image.samples[2 * index + 1]];
                srgb.encode(f32::from(u16::from_ne_bytes(value)) / 65535.0)
            }
            _ => image.samples[index],
        }
    })
}
