//! Serialises point clouds and poses for the viewers' 3-D panels, the two that both viewers draw
//! without a plug-in.

use nalgebra::Isometry3;

use super::super::header::Header;
use super::super::writer::{WireFormat, Writer};
use super::encode::{time, with_header_at};

/// A coloured point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScenePoint {
    /// in the frame of the message's header (m)
    pub position_m: [f32; 3],
    /// sRGB
    pub rgb: [u8; 3],
}

/// Translation (m) and quaternion, x, y, z, w.
fn parts(pose: &Isometry3<f64>) -> ([f64; 3], [f64; 4]) {
    let (t, q) = (pose.translation.vector, pose.rotation);
    ([t.x, t.y, t.z], [q.i, q.j, q.k, q.w])
}

/// A nested protobuf message of numbers. Zeros are written, too: readers of tables show an absent
/// message as null.
fn proto_numbers(values: &[f64]) -> Vec<u8> {
    Writer::new(WireFormat::Protobuf).f64s(values).finish()
}

/// `foxglove.Pose`
fn proto_pose(pose: &Isometry3<f64>) -> Vec<u8> {
    let (position, orientation) = parts(pose);
    Writer::new(WireFormat::Protobuf)
        .bytes(&proto_numbers(&position))
        .bytes(&proto_numbers(&orientation))
        .finish()
}

/// `PoseStamped`, in the frame of the header.
pub fn pose(wire: WireFormat, header: &Header, pose: &Isometry3<f64>) -> Vec<u8> {
    let message = with_header_at(wire, header, 2);
    match wire {
        WireFormat::Protobuf => message.bytes(&proto_pose(pose)).finish(),
        WireFormat::Cdr | WireFormat::Ros1 => {
            let (position, orientation) = parts(pose);
            message.f64s(&position).f64s(&orientation).finish()
        }
    }
}

/// The pose of the frame `child` in the frame of the header.
pub fn transform(wire: WireFormat, header: &Header, child: &str, pose: &Isometry3<f64>) -> Vec<u8> {
    let (translation, rotation) = parts(pose);
    if wire == WireFormat::Protobuf {
        return with_header_at(wire, header, 2)
            .text(child)
            .bytes(&proto_numbers(&translation))
            .bytes(&proto_numbers(&rotation))
            .finish();
    }
    let (sec, nanosec) = time(header.stamp.unwrap_or_default());
    Writer::new(wire)
        .u32(1)
        .header(sec, nanosec, &header.frame_id)
        .text(child)
        .f64s(&translation)
        .f64s(&rotation)
        .finish()
}

/// `PointCloud2`: x, y, z (m) and a colour, 20 bytes per point. The colour is written twice: as
/// `rgb` for ROS's tools and Foxglove, and as `colors` for rerun. Foxglove's own type has four
/// colour fields, 16 bytes per point, which both viewers read.
pub fn point_cloud(wire: WireFormat, header: &Header, points: &[ScenePoint]) -> Vec<u8> {
    let is_protobuf = wire == WireFormat::Protobuf;
    let step = if is_protobuf { 16 } else { 20 };
    let mut data = Vec::with_capacity(points.len() * step as usize);
    for ScenePoint { position_m, rgb: [r, g, b] } in points {
        position_m.iter().for_each(|v| data.extend(v.to_le_bytes()));
        match is_protobuf {
            true => data.extend([*r, *g, *b, 255]),
            false => data.extend([*b, *g, *r, 0, 255, *b, *g, *r]),
        }
    }
    let message = with_header_at(wire, header, 2);
    if is_protobuf {
        let (float32, uint8) = (7, 1);
        let fields = [
            ("x", 0, float32),
            ("y", 4, float32),
            ("z", 8, float32),
            ("red", 12, uint8),
            ("green", 13, uint8),
            ("blue", 14, uint8),
            ("alpha", 15, uint8),
        ];
        let message = message.bytes(&proto_pose(&Isometry3::identity())).fixed32(step);
        let field = |(name, offset, kind): (&str, u32, u8)| {
            Writer::new(wire).text(name).fixed32(offset).u8(kind).finish()
        };
        let message = fields.into_iter().fold(message, |w, f| w.at(5).bytes(&field(f)));
        return message.at(6).bytes(&data).finish();
    }
    let (float32, uint32) = (7, 6);
    let fields = [
        ("x", 0, float32),
        ("y", 4, float32),
        ("z", 8, float32),
        ("rgb", 12, uint32),
        ("colors", 16, uint32),
    ];
    let message = message.u32(1).u32(points.len() as u32).u32(fields.len() as u32);
    let message = fields
        .into_iter()
        .fold(message, |w, (name, offset, kind)| w.text(name).u32(offset).u8(kind).u32(1));
    message.u8(0).u32(step).u32(data.len() as u32).bytes(&data).u8(1).finish()
}
