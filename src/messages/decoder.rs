//! The decoder of a channel: its wire format, its schema, and its row of [`TYPES`].

use super::layout::Layout;
use super::ros_schema::Dialect;
use super::table::{BY_PATH, DEPTH_IMAGE, Kind, MessageType, TYPES};
use super::value::Value;
use super::{cdr, depth_image, idl_schema, json, protobuf, ros_schema};

/// A wire format with the schema needed to read it.
enum Wire {
    Cdr(Layout),
    Ros1(Layout),
    Protobuf(protobuf::Schema),
    Json(Layout),
}

impl Wire {
    /// `None` for encodings that are not supported.
    fn parse(
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

/// The decoder of a channel.
pub struct Decoder {
    wire: Wire,
    /// its row of [`TYPES`]
    pub message_type: &'static MessageType,
}

impl Decoder {
    /// The decoder of a channel, `None` where no row of [`TYPES`] matches.
    ///
    /// # Errors
    /// The schema cannot be parsed.
    pub fn for_channel(
        topic: &str,
        message_encoding: &str,
        schema_name: &str,
        schema_encoding: &str,
        schema: &[u8],
    ) -> Result<Option<Self>, String> {
        Ok(Wire::parse(message_encoding, schema_name, schema_encoding, schema)?
            .and_then(|wire| Self::matching(wire, topic)))
    }

    /// The decoder of a JSON channel without a schema, by its first message.
    ///
    /// # Errors
    /// The message is not a JSON object.
    pub fn for_json(topic: &str, message: &[u8]) -> Result<Option<Self>, String> {
        Ok(Self::matching(Wire::Json(json::layout_of(message)?), topic))
    }

    /// The decoder of the channel named by `dvl.topic` and `dvl.path` in the rig file.
    ///
    /// # Errors
    /// The encoding is not supported, or the schema cannot be parsed.
    pub fn by_path(
        message_encoding: &str,
        schema_name: &str,
        schema_encoding: &str,
        schema: &[u8],
    ) -> Result<Self, String> {
        let wire = match Wire::parse(message_encoding, schema_name, schema_encoding, schema)? {
            None if message_encoding == "json" => Wire::Json(Layout { records: Vec::new() }),
            wire => wire.ok_or_else(|| {
                format!(
                    "rig file: dvl.path does not support messages of encoding {message_encoding:?}"
                )
            })?,
        };
        Ok(Self { wire, message_type: &BY_PATH })
    }

    fn matching(wire: Wire, topic: &str) -> Option<Self> {
        let found = TYPES.iter().find(|t| (t.matches)(wire.layout(), topic));
        found.map(|message_type| Self { wire, message_type })
    }

    /// Separates depth images from camera images by the channel's first message: their schemas are
    /// equal.
    pub fn refine(&mut self, topic: &str, first: &[u8]) {
        let is_depth = matches!(self.message_type.kind, Kind::Image(_))
            && self.read(first).is_ok_and(|v| depth_image::is_depth(&v, topic));
        if is_depth && let Some(depth) = TYPES.iter().find(|t| t.name == DEPTH_IMAGE) {
            self.message_type = depth;
        }
    }

    /// Reads one message into named fields.
    ///
    /// # Errors
    /// The bytes contradict the schema.
    pub fn read<'a>(&self, message: &'a [u8]) -> Result<Value<'a>, String> {
        match &self.wire {
            Wire::Cdr(layout) => cdr::read(layout, message),
            Wire::Ros1(layout) => cdr::read_ros1(layout, message),
            Wire::Protobuf(schema) => schema.read(message),
            Wire::Json(layout) => json::read(Some(layout), message),
        }
    }
}
