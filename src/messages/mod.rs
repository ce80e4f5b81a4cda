//! Bytes of one message type → what the sensor said. The only room that knows wire formats and vendors'
//! ways of saying "no return".
//!
//! A channel is recognised by the *fields of its own schema* ([`TYPES`]), never by its type's name. A new
//! message type costs one file and one row. Each row has a tiny sample log in `sample_logs/messages`, and a
//! test reads them all.

mod altitude;
mod camera_info;
pub mod cdr;
mod dvl_beams;
mod dvl_ranges;
mod imu;
mod odometry;
pub mod output;
mod range;
mod ros_compressed_image;
mod ros_image;
pub mod ros_schema;
mod transforms;
pub mod value;

use nalgebra::{Isometry3, UnitQuaternion};

use crate::image::EncodedImage;
use crate::units::Stamp;
use crate::vehicle::{Camera, DvlFacts, Ping};
use ros_schema::Layout;
use value::Value;

/// Stamp and frame id of a message.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Heading {
    /// the header's own time; `None` where the message has none or it is 0
    pub stamp: Option<Stamp>,
    /// the TF frame it is given in, without a leading slash
    pub frame_id: String,
}

/// A range instrument's report, ready for geometry, or why it is left out.
#[derive(Clone, Debug, PartialEq)]
pub struct PingReading {
    /// `None` where the message holds no bottom range at all (a water-track report)
    pub ping: Option<Ping>,
    /// what had to be mended or assumed, said once per channel
    pub remark: Option<String>,
}

/// One edge of the TF tree: the child's pose in the parent.
#[derive(Clone, Debug, PartialEq)]
pub struct Edge {
    /// the parent's name
    pub parent: String,
    /// the child's name
    pub child: String,
    /// parent_from_child
    pub pose: Isometry3<f64>,
}

/// A picture as it lies in its message.
#[derive(Clone, Debug, PartialEq)]
pub struct PictureReading<'v> {
    /// stamp and frame
    pub heading: Heading,
    /// the picture, still encoded
    pub picture: EncodedImage<'v>,
}

/// What kind of thing a channel carries.
#[derive(Clone, Copy, Debug)]
pub enum Kind {
    /// pictures
    Picture(for<'v> fn(&'v Value<'_>) -> Result<EncodedImage<'v>, String>),
    /// calibration; `None` where the message says it is not calibrated
    CameraInfo(fn(&Value<'_>) -> Result<Option<Camera>, String>),
    /// mounts
    Transforms(fn(&Value<'_>) -> Result<Vec<Edge>, String>),
    /// world_from_sensor; `None` where the message says it has no attitude
    Attitude(fn(&Value<'_>) -> Result<Option<UnitQuaternion<f64>>, String>),
    /// ranges along beams, or an altitude; the rank says which instrument to prefer (lower is better)
    Ping(u8, fn(&Value<'_>, &DvlFacts) -> Result<PingReading, String>),
}

impl Kind {
    /// One word for tables.
    pub fn word(&self) -> &'static str {
        match self {
            Self::Picture(_) => "image",
            Self::CameraInfo(_) => "camera_info",
            Self::Transforms(_) => "transforms",
            Self::Attitude(_) => "attitude",
            Self::Ping(..) => "range",
        }
    }
}

/// One message type the program reads.
pub struct MessageType {
    /// the best known name of the shape
    pub name: &'static str,
    /// whether a schema (and topic) has this shape
    pub matches: fn(&Layout, &str) -> bool,
    /// how it is read
    pub kind: Kind,
}

/// Every message type that is read, first match wins.
#[rustfmt::skip]
pub const TYPES: &[MessageType] = &[
    MessageType { name: "sensor_msgs/Image",           matches: ros_image::matches,            kind: Kind::Picture(ros_image::decode) },
    MessageType { name: "sensor_msgs/CompressedImage", matches: ros_compressed_image::matches, kind: Kind::Picture(ros_compressed_image::decode) },
    MessageType { name: "sensor_msgs/CameraInfo",      matches: camera_info::matches,          kind: Kind::CameraInfo(camera_info::decode) },
    MessageType { name: "tf2_msgs/TFMessage",          matches: transforms::matches,           kind: Kind::Transforms(transforms::decode) },
    MessageType { name: "sensor_msgs/Imu",             matches: imu::matches,                  kind: Kind::Attitude(imu::decode) },
    MessageType { name: "nav_msgs/Odometry",           matches: odometry::matches,             kind: Kind::Attitude(odometry::decode) },
    MessageType { name: "marine_acoustic_msgs/Dvl",    matches: dvl_ranges::matches,           kind: Kind::Ping(0, dvl_ranges::decode) },
    MessageType { name: "dvl_msgs/DVL",                matches: dvl_beams::matches,            kind: Kind::Ping(0, dvl_beams::decode) },
    MessageType { name: "sensor_msgs/Range",           matches: range::matches,                kind: Kind::Ping(1, range::decode) },
    MessageType { name: "std_msgs/Float64 (altitude)", matches: altitude::matches,             kind: Kind::Ping(2, altitude::decode) },
];

/// A channel that can be read.
pub struct Decoder {
    layout: Layout,
    /// its row of [`TYPES`]
    pub message_type: &'static MessageType,
}

impl Decoder {
    /// The decoder for a channel, `None` where its messages are nothing to us.
    ///
    /// # Errors
    /// A sentence where the schema cannot be parsed.
    pub fn for_channel(topic: &str, message_encoding: &str, schema_name: &str, schema_encoding: &str, schema: &[u8]) -> Result<Option<Self>, String> {
        if message_encoding != "cdr" || schema_encoding != "ros2msg" {
            return Ok(None);
        }
        let layout = Layout::parse(schema_name, &String::from_utf8_lossy(schema))?;
        let found = TYPES.iter().find(|t| (t.matches)(&layout, topic));
        Ok(found.map(|message_type| Self { layout, message_type }))
    }

    /// Reads one message into named fields.
    ///
    /// # Errors
    /// A sentence where the bytes contradict the schema.
    pub fn read<'a>(&self, message: &'a [u8]) -> Result<Value<'a>, String> {
        cdr::read(&self.layout, message)
    }
}

/// Stamp and frame of any message with a header.
pub fn heading(value: &Value<'_>) -> Heading {
    let stamp = value.integer("header.stamp.sec").zip(value.integer("header.stamp.nanosec"));
    Heading {
        stamp: stamp.filter(|(s, n)| *s > 0 || *n > 0).map(|(s, n)| Stamp::from_sec_nanos(s, n)),
        frame_id: value.text("header.frame_id").unwrap_or("").trim_start_matches('/').into(),
    }
}

/// The frame whose attitude an attitude message gives: an odometry's child, else the header's.
pub fn attitude_frame(value: &Value<'_>) -> String {
    value.text("child_frame_id").map_or_else(|| heading(value).frame_id, |s| s.trim_start_matches('/').into())
}

fn missing(field: &str) -> String {
    format!("the message has no field {field}")
}

/// A quaternion, `None` where it is all zero or not finite: drivers write that for "no attitude".
fn attitude(xyzw: [f64; 4]) -> Option<UnitQuaternion<f64>> {
    let q = nalgebra::Quaternion::new(xyzw[3], xyzw[0], xyzw[1], xyzw[2]);
    (q.norm().is_finite() && q.norm() > 0.5).then(|| UnitQuaternion::from_quaternion(q))
}
