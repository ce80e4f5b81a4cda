//! Schemas of the protobuf messages that are written: a `FileDescriptorSet`, the message's file behind the one of
//! `google.protobuf.Timestamp`.

use super::layout::{Primitive, Type};
use super::ros_schema::{Dialect, parse};
use super::writer::{OutputWire, Writer};

/// A message as its makers have numbered it.
#[derive(Debug, PartialEq)]
pub struct ProtoType {
    /// the full name
    pub name: &'static str,
    /// name, number and form of each field
    pub fields: &'static [(&'static str, u32, Form)],
}

/// What a field holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    Time,
    Text,
    Bytes,
    Fixed32,
    UInt32,
    Bool,
    Double,
    Doubles,
    /// Foxglove's level of a log line
    Level,
}

impl Form {
    /// `FieldDescriptorProto`: type, label (1 optional, 3 repeated), and the name of a message or enum.
    fn in_descriptor(self, message: &str) -> (u32, u32, String) {
        match self {
            Self::Time => (11, 1, ".google.protobuf.Timestamp".into()),
            Self::Text => (9, 1, String::new()),
            Self::Bytes => (12, 1, String::new()),
            Self::Fixed32 => (7, 1, String::new()),
            Self::UInt32 => (13, 1, String::new()),
            Self::Bool => (8, 1, String::new()),
            Self::Double => (1, 1, String::new()),
            Self::Doubles => (1, 3, String::new()),
            Self::Level => (14, 1, format!(".{message}.Level")),
        }
    }
}

const LEVELS: [&str; 6] = ["UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL"];

fn empty() -> Writer {
    Writer::new(OutputWire::Protobuf)
}

fn field(name: &str, number: u32, kind: u32, label: u32, type_name: &str) -> Vec<u8> {
    let plain = empty().text(name).at(3).u32(number).at(4).u32(label).at(5).u32(kind);
    if type_name.is_empty() { plain.finish() } else { plain.at(6).text(type_name).finish() }
}

/// `FileDescriptorProto` of one message; proto3.
fn file(full_name: &str, dependency: Option<&str>, fields: &[Vec<u8>], has_levels: bool) -> Vec<u8> {
    let (package, name) = full_name.rsplit_once('.').unwrap_or(("", full_name));
    let message = fields.iter().fold(empty().text(name), |w, f| w.at(2).bytes(f));
    let level = |(number, name): (u32, &&str)| empty().text(name).at(2).u32(number).finish();
    let message = if has_levels {
        let levels = (0..).zip(&LEVELS).map(level).fold(empty().text("Level"), |w, v| w.at(2).bytes(&v));
        message.at(4).bytes(&levels.finish())
    } else {
        message
    };
    let begun = empty().text(&format!("{}.proto", full_name.replace('.', "/").to_ascii_lowercase())).text(package);
    let begun = dependency.into_iter().fold(begun, |w, d| w.at(3).text(d));
    begun.at(4).bytes(&message.finish()).at(12).text("proto3").finish()
}

/// The schema of a message with these fields.
pub fn of(name: &str, fields: &[(&str, u32, Form)]) -> Vec<u8> {
    let timestamp = [field("seconds", 1, 3, 1, ""), field("nanos", 2, 5, 1, "")];
    let timestamp = file("google.protobuf.Timestamp", None, &timestamp, false);
    let described = |(field_name, number, form): &(&str, u32, Form)| {
        let (kind, label, type_name) = form.in_descriptor(name);
        field(field_name, *number, kind, label, &type_name)
    };
    let described: Vec<Vec<u8>> = fields.iter().map(described).collect();
    let has_levels = fields.iter().any(|(_, _, form)| *form == Form::Level);
    let message = file(name, Some("google/protobuf/timestamp.proto"), &described, has_levels);
    empty().bytes(&timestamp).at(1).bytes(&message).finish()
}

/// The schema of a message of ours by its ROS 2 definition: the header's two fields, then the others in their order.
pub fn of_ros2(name: &str, schema: &str) -> Vec<u8> {
    let layout = parse(name, schema, Dialect::Ros2);
    debug_assert!(layout.is_ok(), "{name}: a schema of our own that does not parse");
    let root = layout.as_ref().map_or(&[][..], |l| l.root());
    let form = |kind: &Type| match kind {
        Type::Record(_) => Form::Time,
        Type::Primitive(Primitive::Text | Primitive::WideText) => Form::Text,
        Type::Primitive(Primitive::Bool) => Form::Bool,
        Type::Primitive(Primitive::Float(_)) => Form::Double,
        Type::Primitive(_) => Form::UInt32,
        Type::Array(..) => Form::Doubles,
    };
    let others = root.iter().skip(1).zip(3..).map(|((field, kind), number)| (&**field, number, form(kind)));
    let fields: Vec<(&str, u32, Form)> = [("timestamp", 1, Form::Time), ("frame_id", 2, Form::Text)].into_iter().chain(others).collect();
    of(name, &fields)
}
