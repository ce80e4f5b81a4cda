//! Bytes of one message type → what the sensor said. The only room that knows wire formats and
//! vendors' ways of saying "no return".
//!
//! A channel is recognised by the *fields of its own schema* ([`TYPES`]), never by its type's name.
//! A new message type costs one file and one row. Each row has a tiny sample log in
//! `sample_logs/messages`, and a test reads them all.

mod altitude;
mod camera_info;
pub mod cdr;
mod depth_image;
mod descriptor;
mod dvl;
mod dvl_arrays;
mod dvl_beams;
mod dvl_by_path;
mod dvl_numbered;
mod dvl_points;
mod dvl_ranges;
mod foxglove_transforms;
mod header;
mod idl_schema;
mod imu;
mod json;
pub mod layout;
mod mavlink_distance;
mod odometry;
pub mod output;
mod ping1d;
mod point_cloud;
mod protobuf;
mod radiometry;
mod range;
mod ros_compressed_image;
mod ros_image;
pub mod ros_schema;
mod table;
mod transforms;
pub mod value;
mod video;
pub mod writer;

use nalgebra::{Isometry3, UnitQuaternion};

use crate::image::EncodedImage;
use crate::vehicle::{Calibration, DvlFacts, Ping, RangeKind};
pub use header::{Header, attitude_frame, header};
use layout::Layout;
use ros_schema::Dialect;
use table::DEPTH;
pub use table::{MessageType, TYPES};
use value::Value;

/// A range instrument's report, ready for geometry, or why it is left out.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PingReading {
    /// `None` where the message holds no bottom range at all (a water-track report)
    pub ping: Option<Ping>,
    /// what had to be mended or assumed, said once per channel
    pub warning: Option<String>,
    /// the message's own altitude held against its ranges
    pub altitude_check: Option<AltitudeCheck>,
    /// places of a depth picture: beams once the camera's calibration is known
    pub depth: Option<DepthSamples>,
}

/// Some places of a depth picture.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DepthSamples {
    /// size of the picture [px]
    pub width: usize,
    /// see `width`
    pub height: usize,
    /// column, row [px] and depth along the optical axis [m]
    pub samples: Vec<[f64; 3]>,
}

/// What a message's own altitude says of its ranges: whether they are slant or vertical.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AltitudeCheck {
    /// altitude over the mean of the ranges, all beams good: about `cosine` where they are slant, 1
    /// where they are vertical
    pub ratio: f64,
    /// mean cosine of the beams' angles off their axis
    pub cosine: f64,
    /// what the ranges were taken for
    pub kind: RangeKind,
}

/// One edge of the TF tree: the child's pose in the parent.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameTransform {
    /// the parent's name
    pub parent: String,
    /// the child's name
    pub child: String,
    /// parent_from_child
    pub pose: Isometry3<f64>,
}

/// A number and what it is called.
pub type RadiometrySetting = (&'static str, f64);

/// What kind of thing a channel carries.
#[derive(Clone, Copy, Debug)]
pub enum Kind {
    /// pictures
    Image(for<'v> fn(&'v Value<'_>) -> Result<EncodedImage<'v>, String>),
    /// calibration; `None` where the message says it is not calibrated
    CameraInfo(fn(&Value<'_>) -> Result<Option<Calibration>, String>),
    /// mounts
    Transforms(fn(&Value<'_>) -> Result<Vec<FrameTransform>, String>),
    /// world_from_sensor; `None` where the message says it has no attitude
    Attitude(fn(&Value<'_>) -> Result<Option<UnitQuaternion<f64>>, String>),
    /// ranges along beams, or an altitude; the rank says which instrument to prefer (lower is
    /// better)
    Ping(u8, fn(&Value<'_>, &DvlFacts) -> Result<PingReading, String>),
    /// exposure, gain or strobe power, by name, in the sender's unit
    Radiometry(fn(&Value<'_>) -> Result<Vec<RadiometrySetting>, String>),
}

impl Kind {
    /// One word for tables.
    pub fn label(&self) -> &'static str {
        match self {
            Self::Image(_) => "image",
            Self::CameraInfo(_) => "camera_info",
            Self::Transforms(_) => "transforms",
            Self::Attitude(_) => "attitude",
            Self::Ping(..) => "range",
            Self::Radiometry(_) => "radiometry",
        }
    }
}

/// Beside the table: what `dvl.path` in the rig file points to.
static BY_PATH: MessageType = MessageType {
    name: "dvl.path in the rig file",
    about: "what the rig file points to",
    matches: |_, _| false,
    kind: Kind::Ping(0, dvl_by_path::decode),
};

/// How a channel's bytes become values.
enum Wire {
    Cdr(Layout),
    Ros1(Layout),
    Protobuf(protobuf::Schema),
    Json(Layout),
}

impl Wire {
    /// From a schema; `None` for encodings that are not read.
    fn of(
        message_encoding: &str,
        schema_name: &str,
        schema_encoding: &str,
        schema: &[u8],
    ) -> Result<Option<Self>, String> {
        let text = || String::from_utf8_lossy(schema);
        Ok(match (message_encoding, schema_encoding) {
            ("cdr", "ros2msg") => {
                Some(Self::Cdr(ros_schema::parse(schema_name, &text(), Dialect::Ros2)?))
            }
            ("cdr", "ros2idl" | "omgidl") => {
                Some(Self::Cdr(idl_schema::parse(schema_name, &text())?))
            }
            ("ros1", "ros1msg") => {
                Some(Self::Ros1(ros_schema::parse(schema_name, &text(), Dialect::Ros1)?))
            }
            ("protobuf", "protobuf") => {
                Some(Self::Protobuf(protobuf::Schema::parse(schema_name, schema)?))
            }
            ("json", "jsonschema") => Some(Self::Json(json::parse_schema(schema)?)),
            _ => None,
        })
    }

    fn layout(&self) -> &Layout {
        match self {
            Self::Cdr(layout) | Self::Ros1(layout) | Self::Json(layout) => layout,
            Self::Protobuf(schema) => &schema.layout,
        }
    }
}

/// A channel that can be read.
pub struct Decoder {
    wire: Wire,
    /// its row of [`TYPES`]
    pub message_type: &'static MessageType,
}

impl Decoder {
    /// The decoder for a channel, `None` where its messages are nothing to us.
    ///
    /// # Errors
    /// A sentence where the schema cannot be parsed.
    pub fn for_channel(
        topic: &str,
        message_encoding: &str,
        schema_name: &str,
        schema_encoding: &str,
        schema: &[u8],
    ) -> Result<Option<Self>, String> {
        Ok(Wire::of(message_encoding, schema_name, schema_encoding, schema)?
            .and_then(|wire| Self::matching(wire, topic)))
    }

    /// The decoder for a JSON channel without a schema, by its first message.
    ///
    /// # Errors
    /// A sentence where that is no JSON object.
    pub fn for_json(topic: &str, message: &[u8]) -> Result<Option<Self>, String> {
        Ok(Self::matching(Wire::Json(json::layout_of(message)?), topic))
    }

    /// The decoder for the channel whose ranges the rig file points to (`dvl.topic`, `dvl.path`),
    /// whatever its shape.
    ///
    /// # Errors
    /// A sentence where the encoding is not read or the schema cannot be parsed.
    pub fn by_path(
        message_encoding: &str,
        schema_name: &str,
        schema_encoding: &str,
        schema: &[u8],
    ) -> Result<Self, String> {
        let wire = match Wire::of(message_encoding, schema_name, schema_encoding, schema)? {
            None if message_encoding == "json" => Wire::Json(Layout { records: Vec::new() }),
            wire => wire.ok_or_else(|| {
                format!(
                    "rig file: dvl.path in a message of encoding {message_encoding:?} is not read"
                )
            })?,
        };
        Ok(Self { wire, message_type: &BY_PATH })
    }

    fn matching(wire: Wire, topic: &str) -> Option<Self> {
        let found = TYPES.iter().find(|t| (t.matches)(wire.layout(), topic));
        found.map(|message_type| Self { wire, message_type })
    }

    /// Looks at the channel's first message: a depth picture has the shape of any other.
    pub fn refine(&mut self, topic: &str, first: &[u8]) {
        let is_depth = matches!(self.message_type.kind, Kind::Image(_))
            && self.read(first).is_ok_and(|v| depth_image::is_depth(&v, topic));
        if is_depth && let Some(depth) = TYPES.iter().find(|t| t.name == DEPTH) {
            self.message_type = depth;
        }
    }

    /// Reads one message into named fields.
    ///
    /// # Errors
    /// A sentence where the bytes contradict the schema.
    pub fn read<'a>(&self, message: &'a [u8]) -> Result<Value<'a>, String> {
        match &self.wire {
            Wire::Cdr(layout) => cdr::read(layout, message),
            Wire::Ros1(layout) => cdr::read_ros1(layout, message),
            Wire::Protobuf(schema) => schema.read(message),
            Wire::Json(layout) => json::read(Some(layout), message),
        }
    }
}

fn missing(field: &str) -> String {
    format!("the message has no field {field}")
}

/// A quaternion, `None` where it is all zero or not finite: drivers write that for "no attitude".
fn attitude(xyzw: [f64; 4]) -> Option<UnitQuaternion<f64>> {
    let q = nalgebra::Quaternion::new(xyzw[3], xyzw[0], xyzw[1], xyzw[2]);
    (q.norm().is_finite() && q.norm() > 0.5).then(|| UnitQuaternion::from_quaternion(q))
}
