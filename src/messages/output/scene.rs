//! What stands in the viewers' 3-D panels: a cloud of points and a pose. Both viewers draw these
//! two by themselves; boxes and planes only one of them.

use nalgebra::Isometry3;

use super::super::descriptor::{FieldType, ProtoType};
use super::super::writer::{WireFormat, Writer};
use super::{Header, OutputType, begun};

/// A point as the viewers draw it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScenePoint {
    /// in the frame of the message's header [m]
    pub at: [f32; 3],
    /// its colour, sRGB-coded
    pub rgb: [u8; 3],
}

/// A cloud of coloured points.
pub const POINT_CLOUD: OutputType = OutputType {
    name: "sensor_msgs/msg/PointCloud2",
    schema: concat!(
        with_header!(
            "uint32 height\nuint32 width\nsensor_msgs/PointField[] fields\nbool \
             is_bigendian\nuint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense\n"
        ),
        "================================================================================\nMSG: \
         sensor_msgs/PointField\nstring name\nuint32 offset\nuint8 datatype\nuint32 count\n"
    ),
    ros1: None,
    protobuf: Some(&ProtoType {
        name: "foxglove.PointCloud",
        fields: &[
            ("timestamp", 1, FieldType::Time),
            ("frame_id", 2, FieldType::Text),
            ("pose", 3, FieldType::Message(&PROTO_POSE)),
            ("point_stride", 4, FieldType::Fixed32),
            ("fields", 5, FieldType::Messages(&PACKED_FIELD)),
            ("data", 6, FieldType::Bytes),
        ],
    }),
};

/// A place and a turn in the frame of its header.
pub const POSE: OutputType = OutputType {
    name: "geometry_msgs/msg/PoseStamped",
    schema: concat!(
        with_header!("geometry_msgs/Pose pose\n"),
        "================================================================================\nMSG: \
         geometry_msgs/Pose\ngeometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
        "================================================================================\nMSG: \
         geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n",
        "================================================================================\nMSG: \
         geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"
    ),
    ros1: None,
    protobuf: Some(&ProtoType {
        name: "foxglove.PoseInFrame",
        fields: &[
            ("timestamp", 1, FieldType::Time),
            ("frame_id", 2, FieldType::Text),
            ("pose", 3, FieldType::Message(&PROTO_POSE)),
        ],
    }),
};

/// Where a frame lies in another.
pub const TRANSFORM: OutputType = OutputType {
    name: "tf2_msgs/msg/TFMessage",
    schema: concat!(
        "geometry_msgs/TransformStamped[] transforms\n",
        "================================================================================\nMSG: \
         geometry_msgs/TransformStamped\nstd_msgs/Header header\nstring \
         child_frame_id\ngeometry_msgs/Transform transform\n",
        "================================================================================\nMSG: \
         std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n",
        "================================================================================\nMSG: \
         builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n",
        "================================================================================\nMSG: \
         geometry_msgs/Transform\ngeometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion \
         rotation\n",
        "================================================================================\nMSG: \
         geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n",
        "================================================================================\nMSG: \
         geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"
    ),
    ros1: None,
    protobuf: Some(&ProtoType {
        name: "foxglove.FrameTransform",
        fields: &[
            ("timestamp", 1, FieldType::Time),
            ("parent_frame_id", 2, FieldType::Text),
            ("child_frame_id", 3, FieldType::Text),
            ("translation", 4, FieldType::Message(&VECTOR3)),
            ("rotation", 5, FieldType::Message(&QUATERNION)),
        ],
    }),
};

static PROTO_POSE: ProtoType = ProtoType {
    name: "foxglove.Pose",
    fields: &[
        ("position", 1, FieldType::Message(&VECTOR3)),
        ("orientation", 2, FieldType::Message(&QUATERNION)),
    ],
};
static VECTOR3: ProtoType = ProtoType {
    name: "foxglove.Vector3",
    fields: &[
        ("x", 1, FieldType::Double),
        ("y", 2, FieldType::Double),
        ("z", 3, FieldType::Double),
    ],
};
static QUATERNION: ProtoType = ProtoType {
    name: "foxglove.Quaternion",
    fields: &[
        ("x", 1, FieldType::Double),
        ("y", 2, FieldType::Double),
        ("z", 3, FieldType::Double),
        ("w", 4, FieldType::Double),
    ],
};
static PACKED_FIELD: ProtoType = ProtoType {
    name: "foxglove.PackedElementField",
    fields: &[
        ("name", 1, FieldType::Text),
        ("offset", 2, FieldType::Fixed32),
        ("type", 3, FieldType::Enum("NumericType", &NUMERIC_TYPES)),
    ],
};
static NUMERIC_TYPES: [&str; 9] =
    ["UNKNOWN", "UINT8", "INT8", "UINT16", "INT16", "UINT32", "INT32", "FLOAT32", "FLOAT64"];

/// Place and turn, as protobuf's part of a message.
fn proto_pose(pose: &Isometry3<f64>) -> Vec<u8> {
    let part = || Writer::new(WireFormat::Protobuf);
    let (t, q) = (pose.translation.vector, pose.rotation);
    // All set, also where they are 0: an absent part is a null to a reader of tables.
    part()
        .bytes(&part().f64s(&[t.x, t.y, t.z]).finish())
        .bytes(&part().f64s(&[q.i, q.j, q.k, q.w]).finish())
        .finish()
}

/// `PoseStamped`, in the space of the header's frame.
pub fn pose(wire: WireFormat, header: &Header, pose: &Isometry3<f64>) -> Vec<u8> {
    let (t, q) = (pose.translation.vector, pose.rotation);
    let headed = begun(wire, header, 2);
    match wire {
        WireFormat::Protobuf => headed.bytes(&proto_pose(pose)).finish(),
        WireFormat::Cdr | WireFormat::Ros1 => {
            headed.f64s(&[t.x, t.y, t.z, q.i, q.j, q.k, q.w]).finish()
        }
    }
}

/// A transform from the frame `child` to the header's: where the child lies in it.
pub fn transform(wire: WireFormat, header: &Header, child: &str, pose: &Isometry3<f64>) -> Vec<u8> {
    let (t, q) = (pose.translation.vector, pose.rotation);
    let (place, turn) = ([t.x, t.y, t.z], [q.i, q.j, q.k, q.w]);
    if wire == WireFormat::Protobuf {
        let part = |values: &[f64]| Writer::new(wire).f64s(values).finish();
        return begun(wire, header, 2)
            .text(child)
            .bytes(&part(&place))
            .bytes(&part(&turn))
            .finish();
    }
    let (sec, nanosec) = super::time(header.stamp.unwrap_or_default());
    Writer::new(wire)
        .u32(1)
        .header(sec, nanosec, &header.frame_id)
        .text(child)
        .f64s(&place)
        .f64s(&turn)
        .finish()
}

/// `PointCloud2`: x, y, z [m] and a colour, 20 bytes a point. The colour stands twice: as `rgb`,
/// where ROS's tools and Foxglove look for it, and as `colors`, where rerun does. In Foxglove's own
/// type it is four fields of 16 bytes in all, which both read.
pub fn point_cloud(wire: WireFormat, header: &Header, points: &[ScenePoint]) -> Vec<u8> {
    let is_protobuf = wire == WireFormat::Protobuf;
    let step = if is_protobuf { 16 } else { 20 };
    let mut data = Vec::with_capacity(points.len() * step as usize);
    for ScenePoint { at, rgb: [r, g, b] } in points {
        at.iter().for_each(|v| data.extend(v.to_le_bytes()));
        match is_protobuf {
            true => data.extend([*r, *g, *b, 255]),
            false => data.extend([*b, *g, *r, 0, 255, *b, *g, *r]),
        }
    }
    let headed = begun(wire, header, 2);
    if is_protobuf {
        let fields = [
            ("x", 0, 7),
            ("y", 4, 7),
            ("z", 8, 7),
            ("red", 12, 1),
            ("green", 13, 1),
            ("blue", 14, 1),
            ("alpha", 15, 1),
        ];
        let sized = headed.bytes(&proto_pose(&Isometry3::identity())).fixed32(step);
        let field = |(name, offset, kind): (&str, u32, u8)| {
            Writer::new(wire).text(name).fixed32(offset).u8(kind).finish()
        };
        return fields
            .into_iter()
            .fold(sized, |w, f| w.at(5).bytes(&field(f)))
            .at(6)
            .bytes(&data)
            .finish();
    }
    let (float32, uint32) = (7, 6);
    let fields = [
        ("x", 0, float32),
        ("y", 4, float32),
        ("z", 8, float32),
        ("rgb", 12, uint32),
        ("colors", 16, uint32),
    ];
    let sized = headed.u32(1).u32(points.len() as u32).u32(fields.len() as u32);
    let described = fields
        .into_iter()
        .fold(sized, |w, (name, offset, kind)| w.text(name).u32(offset).u8(kind).u32(1));
    described.u8(0).u32(step).u32(data.len() as u32).bytes(&data).u8(1).finish()
}
