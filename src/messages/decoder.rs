//! The decoder of a channel: its wire format, its schema, and its row of [`TYPES`].

use super::layout::{Layout, Primitive, Type};
use super::ros_schema::Dialect;
use super::table::{BY_PATH, DEPTH_IMAGE, Kind, MessageType, TYPES};
use super::value::Value;
use super::{cdr, depth_image, idl_schema, json, known_schemas, protobuf, radiometry, ros_schema};

/// A wire format with the schema needed to read it.
enum Wire {
    Cdr(Layout),
    Ros1(Layout),
    Protobuf(protobuf::Schema),
    Json(Layout),
    /// JSON in the field `data` of a message
    JsonInText(Box<Wire>, Layout),
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
            Self::Cdr(layout)
            | Self::Ros1(layout)
            | Self::Json(layout)
            | Self::JsonInText(_, layout) => layout,
            Self::Protobuf(schema) => &schema.layout,
        }
    }

    /// By the definition known under the schema's name, if it fits a message to its last byte.
    fn of_known_schema(channel: &ChannelSchema<'_>, message: &[u8]) -> Option<Self> {
        let dialect = match channel.message_encoding {
            "cdr" => Dialect::Ros2,
            "ros1" => Dialect::Ros1,
            _ => return None,
        };
        let plain = decompressed(message);
        let message = plain.as_deref().unwrap_or(message);
        let definition = known_schemas::definition(channel.name)?;
        let layout = ros_schema::parse(channel.name, &definition, dialect).ok()?;
        let is_ros1 = dialect == Dialect::Ros1;
        let is_exact = cdr::is_exact(&layout, message, is_ros1);
        is_exact.then_some(if is_ros1 { Self::Ros1(layout) } else { Self::Cdr(layout) })
    }

    fn read<'a>(&self, message: &'a [u8]) -> Result<Value<'a>, String> {
        match self {
            Self::Cdr(layout) => cdr::read(layout, message),
            Self::Ros1(layout) => cdr::read_ros1(layout, message),
            Self::Protobuf(schema) => schema.read(message),
            Self::Json(layout) => json::read(Some(layout), message),
            Self::JsonInText(outer, layout) => {
                let outer = outer.read(message)?;
                let text = outer.text("data").ok_or("the message has no text")?;
                json::read(Some(layout), text.as_bytes()).map(Value::into_owned)
            }
        }
    }
}

/// First bytes of a zstd frame.
const ZSTD: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];
/// A message compressed by itself is no larger than this, whatever it claims (byte) …
const MAX_DECOMPRESSED: u64 = 1 << 30;
/// … nor this many times its compressed size.
const MAX_COMPRESSION: u64 = 1 << 12;

/// A message that its recorder compressed by itself (rosbag2's compression mode `message`). No
/// encoding that is read begins with these bytes.
fn decompressed(message: &[u8]) -> Option<Vec<u8>> {
    use std::io::Read as _;
    if !message.starts_with(&ZSTD) {
        return None;
    }
    let limit = MAX_DECOMPRESSED.min(message.len() as u64 * MAX_COMPRESSION);
    let mut plain = Vec::new();
    let reader = zstd::stream::read::Decoder::new(message).ok()?;
    reader.take(limit).read_to_end(&mut plain).ok()?;
    Some(plain)
}

/// How a channel's messages are encoded, as the log states it.
#[derive(Clone, Copy)]
pub struct ChannelSchema<'c> {
    /// topic of the channel
    pub topic: &'c str,
    /// encoding of its messages
    pub message_encoding: &'c str,
    /// name of the schema; empty without one
    pub name: &'c str,
    /// its encoding
    pub encoding: &'c str,
    /// its text or descriptor
    pub data: &'c [u8],
}

impl ChannelSchema<'_> {
    /// Whether there is no definition: none at all, or nothing but its name.
    fn is_blank(&self) -> bool {
        let text = String::from_utf8_lossy(self.data);
        let text = text.trim().trim_start_matches(['#', ' ']);
        (text.is_empty() || text == self.name) && !self.name.ends_with("/Empty")
    }
}

/// The decoder of a channel.
pub struct Decoder {
    wire: Wire,
    /// its row of [`TYPES`]
    pub message_type: &'static MessageType,
}

impl Decoder {
    /// Seconds in the unit of the exposures that it reads; `None` where no name states it.
    pub fn exposure_unit_s(&self, topic: &str) -> Option<f64> {
        radiometry::exposure_unit_s(self.wire.layout(), topic)
    }

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

    /// The decoder of a channel whose schema does not suffice, by its first message: JSON without
    /// a schema, JSON inside a text, a definition that is missing and known. With it whether a
    /// known definition is used.
    ///
    /// # Errors
    /// The message cannot be read without a definition.
    pub fn for_first_message(
        channel: ChannelSchema<'_>,
        message: &[u8],
    ) -> Result<Option<(Self, bool)>, String> {
        let ChannelSchema { topic, message_encoding, name, encoding, data } = channel;
        if message_encoding == "json" && name.is_empty() {
            return Ok(Self::for_json(topic, message)?.map(|decoder| (decoder, false)));
        }
        let parsed = Wire::parse(message_encoding, name, encoding, data);
        let (wire, is_known) = match parsed {
            Ok(Some(wire)) if !channel.is_blank() => (wire, false),
            _ => match Wire::of_known_schema(&channel, message) {
                Some(wire) => (wire, true),
                None if matches!(message_encoding, "cdr" | "ros1") && channel.is_blank() => {
                    return Err("it carries no message definition (its schema is empty)".into());
                }
                None => return parsed.map(|_| None),
            },
        };
        let is_text = |wire: &Wire| {
            wire.layout().root().len() == 1
                && wire.layout().type_at("data") == Some(&Type::Primitive(Primitive::Text))
        };
        let wire = if is_text(&wire) {
            let text = wire.read(message)?;
            let object = text.text("data").filter(|text| text.trim_start().starts_with('{'));
            let layout = object.and_then(|text| json::layout_of(text.as_bytes()).ok());
            layout.map(|layout| Wire::JsonInText(Box::new(wire), layout))
        } else {
            is_known.then_some(wire)
        };
        let decoder = wire.and_then(|wire| Self::matching(wire, topic));
        Ok(decoder.map(|decoder| (decoder, is_known)))
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
        match decompressed(message) {
            Some(plain) => self.wire.read(&plain).map(Value::into_owned),
            None => self.wire.read(message),
        }
    }
}
