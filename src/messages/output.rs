//! The messages unwater writes: flat numeric fields, units in the names, NaN for unknown. CDR with
//! self-contained `ros2msg` schemas by default, as it is the family that rerun and Foxglove both
//! show best; protobuf with Foxglove's schemas or ROS 1 by choice.

use super::Header;
use super::descriptor::{self, FieldType, ProtoType};
use super::writer::{WireFormat, Writer};
use crate::diagnostics::{Diagnostic, Severity};
use crate::units::Stamp;
use crate::vehicle::Camera;

/// A message type that is written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OutputType {
    /// `pkg/msg/Type`
    pub name: &'static str,
    /// the definition with its dependencies, as ROS 2 has it
    pub schema: &'static str,
    /// name and definition in ROS 1, where they are not those of ROS 2 in its older words
    ros1: Option<(&'static str, &'static str)>,
    /// the message in protobuf; where `None`, the definition's fields in their order
    protobuf: Option<&'static ProtoType>,
}

/// A schema as the log holds it.
#[derive(Clone, Debug, PartialEq)]
pub struct OutputSchema {
    /// the type's name
    pub name: String,
    /// `ros2msg`, `ros1msg`, `protobuf`
    pub encoding: &'static str,
    /// the definition
    pub data: Vec<u8>,
    /// the encoding of its messages
    pub message_encoding: &'static str,
}

impl OutputType {
    const fn of_ros2(name: &'static str, schema: &'static str) -> Self {
        Self { name, schema, ros1: None, protobuf: None }
    }

    /// The type's schema in an encoding.
    pub fn schema_in(&self, wire: WireFormat) -> OutputSchema {
        match wire {
            WireFormat::Cdr => OutputSchema {
                name: self.name.into(),
                encoding: "ros2msg",
                data: self.schema.into(),
                message_encoding: "cdr",
            },
            WireFormat::Ros1 => {
                let (name, text) = self.ros1.map_or_else(
                    || (self.name.replace("/msg/", "/"), in_ros1(self.schema)),
                    |(n, t)| (n.into(), t.into()),
                );
                OutputSchema {
                    name,
                    encoding: "ros1msg",
                    data: text.into_bytes(),
                    message_encoding: "ros1",
                }
            }
            WireFormat::Protobuf => {
                let (name, data) = match self.protobuf {
                    Some(known) => (known.name.into(), descriptor::of(known.name, known.fields)),
                    None => {
                        let name = self.name.replace("/msg/", ".");
                        let data = descriptor::of_ros2(&name, self.schema);
                        (name, data)
                    }
                };
                OutputSchema { name, encoding: "protobuf", data, message_encoding: "protobuf" }
            }
        }
    }
}

/// A ROS 2 definition in the words of ROS 1: `time` is a primitive, and a header has a number.
fn in_ros1(schema: &str) -> String {
    let sections = schema.split(
        "================================================================================\n",
    );
    let kept: Vec<String> = sections
        .filter(|s| !s.starts_with("MSG: builtin_interfaces/Time"))
        .map(|s| {
            s.replace("builtin_interfaces/Time", "time")
                .replace("MSG: std_msgs/Header\n", "MSG: std_msgs/Header\nuint32 seq\n")
        })
        .collect();
    kept.join("================================================================================\n")
}

macro_rules! with_header {
    ($fields:literal) => {
        concat!(
            "std_msgs/Header header\n",
            $fields,
            "================================================================================\nMSG: \
             std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n",
            "================================================================================\nMSG: \
             builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
        )
    };
}

mod scene;
pub use scene::{POINT_CLOUD, POSE, ScenePoint, TRANSFORM, point_cloud, pose, transform};

/// A corrected picture as JPEG or PNG.
pub const COMPRESSED_IMAGE: OutputType = OutputType {
    name: "sensor_msgs/msg/CompressedImage",
    schema: with_header!("string format\nuint8[] data\n"),
    ros1: None,
    protobuf: Some(&ProtoType {
        name: "foxglove.CompressedImage",
        fields: &[
            ("timestamp", 1, FieldType::Time),
            ("frame_id", 4, FieldType::Text),
            ("data", 2, FieldType::Bytes),
            ("format", 3, FieldType::Text),
        ],
    }),
};

/// A corrected picture as bare pixels.
pub const IMAGE: OutputType = OutputType {
    name: "sensor_msgs/msg/Image",
    schema: with_header!(
        "uint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\nuint8[] \
         data\n"
    ),
    ros1: None,
    protobuf: Some(&ProtoType {
        name: "foxglove.RawImage",
        fields: &[
            ("timestamp", 1, FieldType::Time),
            ("frame_id", 7, FieldType::Text),
            ("width", 2, FieldType::Fixed32),
            ("height", 3, FieldType::Fixed32),
            ("encoding", 4, FieldType::Text),
            ("step", 5, FieldType::Fixed32),
            ("data", 6, FieldType::Bytes),
        ],
    }),
};

/// Calibration of a rectified picture.
pub const CAMERA_INFO: OutputType = OutputType {
    name: "sensor_msgs/msg/CameraInfo",
    schema: concat!(
        with_header!(
            "uint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\nfloat64[9] \
             k\nfloat64[9] r\nfloat64[12] p\nuint32 binning_x\nuint32 \
             binning_y\nsensor_msgs/RegionOfInterest roi\n"
        ),
        "================================================================================\nMSG: \
         sensor_msgs/RegionOfInterest\nuint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 \
         width\nbool do_rectify\n"
    ),
    ros1: Some(("sensor_msgs/CameraInfo", ROS1_CAMERA_INFO)),
    protobuf: Some(&ProtoType {
        name: "foxglove.CameraCalibration",
        fields: &[
            ("timestamp", 1, FieldType::Time),
            ("frame_id", 9, FieldType::Text),
            ("width", 2, FieldType::Fixed32),
            ("height", 3, FieldType::Fixed32),
            ("distortion_model", 4, FieldType::Text),
            ("D", 5, FieldType::Doubles),
            ("K", 6, FieldType::Doubles),
            ("R", 7, FieldType::Doubles),
            ("P", 8, FieldType::Doubles),
        ],
    }),
};

/// α of a frame.
pub const ATTENUATION: OutputType = OutputType::of_ros2(
    "unwater_msgs/msg/Attenuation",
    with_header!(
        "# red, green, blue; NaN where there is no such band\nfloat64[3] \
         attenuation_per_m\nfloat64[3] attenuation_std_per_m\n# true: spreading is modelled; \
         false: an effective value that holds spreading too\nbool physical\nbool identified\n"
    ),
);

/// The plane below a frame.
pub const SEAFLOOR: OutputType = OutputType::of_ros2(
    "unwater_msgs/msg/Seafloor",
    with_header!(
        "# the plane n.x = d in the camera's optical frame, n pointing into the floor\nfloat64 \
         normal_x\nfloat64 normal_y\nfloat64 normal_z\nfloat64 distance_m\nfloat64 \
         camera_altitude_m\nfloat64 tilt_to_camera_deg\n# hits of sonar beams, their spread over \
         the plane, and the time to the nearest ping\nuint32 hits\nfloat64 residual_m\nfloat64 \
         nearest_ping_s\n# least squares, exact, assumed level\nstring support\n"
    ),
);

/// Facts of a frame.
pub const FRAME: OutputType = OutputType::of_ros2(
    "unwater_msgs/msg/Frame",
    with_header!(
        "bool corrected\n# why not, if not\nstring reason\nfloat64 camera_altitude_m\nfloat64 \
         path_length_min_m\nfloat64 path_length_mean_m\nfloat64 path_length_max_m\n# shares of \
         the picture's pixels\nfloat64 clipped_input_share\nfloat64 clipped_output_share\nfloat64 \
         gain_capped_share\nfloat64 off_surface_share\nfloat64 unseen_beam_share\nfloat64 \
         mean_gain\n# of the picture: light too near its own noise\nfloat64 low_signal_share\n"
    ),
);

/// The strobe's pattern.
pub const BEAM_PATTERN: OutputType = OutputType::of_ros2(
    "unwater_msgs/msg/BeamPattern",
    with_header!(
        "# angles in the strobe's frame: theta = atan2(y, z), phi = atan2(x, z)\nfloat64[] \
         theta_deg\nfloat64[] phi_deg\n# natural log of the gain, peak 0, NaN where never seen; \
         one row per theta\nfloat64[] log_gain\n"
    ),
);

/// Numbers that rerun plots by itself.
pub const MULTI_ARRAY: OutputType = OutputType {
    name: "std_msgs/msg/Float64MultiArray",
    schema: concat!(
        "std_msgs/MultiArrayLayout layout\nfloat64[] data\n",
        "================================================================================\nMSG: \
         std_msgs/MultiArrayLayout\nstd_msgs/MultiArrayDimension[] dim\nuint32 data_offset\n",
        "================================================================================\nMSG: \
         std_msgs/MultiArrayDimension\nstring label\nuint32 size\nuint32 stride\n"
    ),
    ros1: None,
    protobuf: Some(&ProtoType {
        name: "unwater_msgs.Numbers",
        fields: &[("label", 1, FieldType::Text), ("data", 2, FieldType::Doubles)],
    }),
};

/// A line for the viewers' log panels.
pub const LOG: OutputType = OutputType {
    name: "rcl_interfaces/msg/Log",
    schema: concat!(
        "byte DEBUG=10\nbyte INFO=20\nbyte WARN=30\nbyte ERROR=40\nbyte \
         FATAL=50\nbuiltin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring \
         file\nstring function\nuint32 line\n",
        "================================================================================\nMSG: \
         builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
    ),
    ros1: Some(("rosgraph_msgs/Log", ROS1_LOG)),
    protobuf: Some(&ProtoType {
        name: "foxglove.Log",
        fields: &[
            ("timestamp", 1, FieldType::Time),
            (
                "level",
                2,
                FieldType::Enum(
                    "Level",
                    &["UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL"],
                ),
            ),
            ("message", 3, FieldType::Text),
            ("name", 4, FieldType::Text),
            ("file", 5, FieldType::Text),
            ("line", 6, FieldType::Fixed32),
        ],
    }),
};

/// ROS 1 has capitals here, and its readers insist on them.
const ROS1_CAMERA_INFO: &str = concat!(
    "std_msgs/Header header\nuint32 height\nuint32 width\nstring distortion_model\nfloat64[] \
     D\nfloat64[9] K\nfloat64[9] R\nfloat64[12] P\nuint32 binning_x\nuint32 \
     binning_y\nsensor_msgs/RegionOfInterest roi\n",
    "================================================================================\nMSG: \
     std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n",
    "================================================================================\nMSG: \
     sensor_msgs/RegionOfInterest\nuint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 \
     width\nbool do_rectify\n"
);

/// ROS 1's line of a log, whose levels are other numbers.
const ROS1_LOG: &str = concat!(
    "byte DEBUG=1\nbyte INFO=2\nbyte WARN=4\nbyte ERROR=8\nbyte FATAL=16\nstd_msgs/Header \
     header\nbyte level\nstring name\nstring msg\nstring file\nstring function\nuint32 \
     line\nstring[] topics\n",
    "================================================================================\nMSG: \
     std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"
);

/// A line of `/unwater/log`.
pub struct LogLine {
    severity: Severity,
    /// `unwater`, for a diagnostic with its code: `unwater.no-ping`
    name: String,
    text: String,
}

impl LogLine {
    /// A line that is no diagnostic.
    pub fn info(text: String) -> Self {
        Self { severity: Severity::Info, name: "unwater".into(), text }
    }

    /// A diagnostic with its remedy.
    pub fn of(diagnostic: &Diagnostic) -> Self {
        let name = format!("unwater.{}", diagnostic.code());
        Self { severity: diagnostic.severity(), name, text: diagnostic.with_remedy() }
    }
}

fn time(stamp: Stamp) -> (i32, u32) {
    (stamp.0.div_euclid(1_000_000_000) as i32, stamp.0.rem_euclid(1_000_000_000) as u32)
}

/// A message begun with the header of the frame it speaks of, copied as it is.
pub fn with_header(wire: WireFormat, header: &Header) -> Writer {
    let (sec, nanosec) = time(header.stamp.unwrap_or_default());
    Writer::new(wire).header(sec, nanosec, &header.frame_id)
}

/// The header where protobuf has the frame's name at this number.
fn begun(wire: WireFormat, header: &Header, frame_id: u32) -> Writer {
    let (sec, nanosec) = time(header.stamp.unwrap_or_default());
    match wire {
        WireFormat::Protobuf => {
            Writer::new(wire).time(sec, nanosec).at(frame_id).text(&header.frame_id)
        }
        WireFormat::Cdr | WireFormat::Ros1 => with_header(wire, header),
    }
}

/// `CompressedImage`; `format` is `jpeg` or `png`.
pub fn compressed_image(wire: WireFormat, header: &Header, format: &str, data: &[u8]) -> Vec<u8> {
    begun(wire, header, 4).at(3).text(format).at(2).bytes(data).finish()
}

/// `Image`, little-endian.
pub fn image(
    wire: WireFormat,
    header: &Header,
    width: usize,
    height: usize,
    encoding: &str,
    step: usize,
    data: &[u8],
) -> Vec<u8> {
    let sized = begun(wire, header, 7)
        .at(3)
        .fixed32(height as u32)
        .at(2)
        .fixed32(width as u32)
        .at(4)
        .text(encoding);
    // Foxglove's has no byte order: it is little-endian.
    let ordered = if wire == WireFormat::Protobuf { sized } else { sized.u8(0) };
    ordered.at(5).fixed32(step as u32).bytes(data).finish()
}

/// `CameraInfo` of a camera.
pub fn camera_info(wire: WireFormat, header: &Header, camera: &Camera) -> Vec<u8> {
    let Camera { fx, fy, cx, cy, .. } = *camera;
    let sized = begun(wire, header, 9)
        .at(3)
        .fixed32(camera.height as u32)
        .at(2)
        .fixed32(camera.width as u32);
    let calibrated = sized
        .at(4)
        .text(camera.distortion.name())
        .f64_sequence(&camera.distortion.coefficients())
        .f64_array(&[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0])
        .f64_array(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
        .f64_array(&[fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]);
    match wire {
        WireFormat::Protobuf => calibrated.finish(),
        // binning, region of interest: none
        WireFormat::Cdr | WireFormat::Ros1 => {
            (0..6).fold(calibrated, |w, _| w.u32(0)).u8(0).finish()
        }
    }
}

/// `Float64MultiArray` with one labelled dimension; label and numbers in protobuf.
pub fn multi_array(wire: WireFormat, label: &str, values: &[f64]) -> Vec<u8> {
    let n = values.len() as u32;
    let labelled = match wire {
        WireFormat::Protobuf => Writer::new(wire).text(label),
        WireFormat::Cdr | WireFormat::Ros1 => {
            Writer::new(wire).u32(1).text(label).u32(n).u32(n).u32(0)
        }
    };
    labelled.f64_sequence(values).finish()
}

/// A line of a log.
pub fn log(wire: WireFormat, stamp: Stamp, line: &LogLine) -> Vec<u8> {
    let (sec, nanosec) = time(stamp);
    let LogLine { severity, name, text } = line;
    let level = match (wire, severity) {
        (WireFormat::Cdr, Severity::Info) => 20,
        (WireFormat::Cdr, _) => 30,
        (WireFormat::Ros1 | WireFormat::Protobuf, Severity::Info) => 2,
        (WireFormat::Ros1, _) => 4,
        (WireFormat::Protobuf, _) => 3,
    };
    let begun = Writer::new(wire);
    match wire {
        WireFormat::Cdr => begun
            .time(sec, nanosec)
            .u8(level)
            .text(name)
            .text(text)
            .text("")
            .text("")
            .u32(0)
            .finish(),
        WireFormat::Ros1 => begun
            .header(sec, nanosec, "")
            .u8(level)
            .text(name)
            .text(text)
            .text("")
            .text("")
            .u32(0)
            .u32(0)
            .finish(),
        WireFormat::Protobuf => {
            begun.time(sec, nanosec).u8(level).text(text).text(name).text("").fixed32(0).finish()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnostics::MountFact;
    use crate::messages::Decoder;

    const WIRES: [WireFormat; 3] = [WireFormat::Cdr, WireFormat::Ros1, WireFormat::Protobuf];

    #[test]
    fn what_is_written_reads_by_its_own_schema() {
        let header =
            Header { stamp: Some(Stamp(1_700_000_000_500_000_000)), frame_id: "cam".into() };
        let camera = Camera::from_field_of_view(640, 480, 60.0);
        let no_attitude = Diagnostic::from(MountFact::NoAttitude);
        for wire in WIRES {
            let frame = with_header(wire, &header).u8(1).text("why").f64s(&[0.5; 11]).finish();
            let cases = [
                (COMPRESSED_IMAGE, compressed_image(wire, &header, "jpeg", &[1, 2, 3])),
                (IMAGE, image(wire, &header, 2, 1, "rgb8", 6, &[0; 6])),
                (CAMERA_INFO, camera_info(wire, &header, &camera)),
                (MULTI_ARRAY, multi_array(wire, "attenuation_per_m", &[1.0, 2.0])),
                (LOG, log(wire, Stamp(5_000_000_001), &LogLine::of(&no_attitude))),
                (FRAME, frame),
                (POSE, pose(wire, &header, &nalgebra::Isometry3::translation(1.0, 2.0, 3.0))),
                (
                    TRANSFORM,
                    transform(
                        wire,
                        &header,
                        "floor",
                        &nalgebra::Isometry3::translation(1.0, 2.0, 3.0),
                    ),
                ),
                (
                    POINT_CLOUD,
                    point_cloud(
                        wire,
                        &header,
                        &[ScenePoint { at: [1.0, 2.0, 3.0], rgb: [255, 128, 0] }; 5],
                    ),
                ),
            ];
            for (kind, bytes) in cases {
                let schema = kind.schema_in(wire);
                let decoder = Decoder::by_path(
                    schema.message_encoding,
                    &schema.name,
                    schema.encoding,
                    &schema.data,
                )
                .expect(kind.name);
                let value = decoder.read(&bytes).expect(kind.name);
                let said = crate::messages::header(&value);
                match kind.name {
                    "sensor_msgs/msg/CameraInfo" => {
                        assert_eq!(value.numbers("k").map(|k| k[0]), Some(camera.fx))
                    }
                    "std_msgs/msg/Float64MultiArray" => {
                        assert_eq!(value.numbers("data"), Some(vec![1.0, 2.0]))
                    }
                    "rcl_interfaces/msg/Log" => {
                        assert_eq!(
                            value.text("msg").or(value.text("message")),
                            Some(no_attitude.to_string().as_str()),
                            "{wire:?}"
                        );
                        assert_eq!(
                            (value.text("name"), said.stamp),
                            (Some("unwater.attitude-missing"), Some(Stamp(5_000_000_001))),
                            "{wire:?}"
                        );
                    }
                    "geometry_msgs/msg/PoseStamped" => {
                        assert_eq!(
                            (value.number("pose.position.y"), value.number("pose.orientation.w")),
                            (Some(2.0), Some(1.0)),
                            "{wire:?}"
                        );
                    }
                    "tf2_msgs/msg/TFMessage" => assert!(
                        value.text("child_frame_id") == Some("floor")
                            && value.number("translation.z") == Some(3.0)
                            || value.list("transforms").is_some_and(|t| t.len() == 1),
                        "{wire:?}"
                    ),
                    "unwater_msgs/msg/Frame" => {
                        assert_eq!(
                            (
                                value.flag("corrected"),
                                value.number("mean_gain"),
                                value.text("reason")
                            ),
                            (Some(true), Some(0.5), Some("why"))
                        );
                    }
                    _ => assert_eq!(
                        (said.frame_id.as_str(), said.stamp),
                        ("cam", header.stamp),
                        "{wire:?} {}",
                        kind.name
                    ),
                }
            }
        }
    }
}
