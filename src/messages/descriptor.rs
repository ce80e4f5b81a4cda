//! Schemas of the written protobuf messages: a `FileDescriptorSet`, dependencies first.

use super::layout::{Primitive, Type};
use super::ros_schema::{Dialect, parse};
use super::writer::{WireFormat, Writer};

/// A message type.
#[derive(Debug, PartialEq, Eq)]
pub struct ProtoType {
    /// with the package
    pub name: &'static str,
    pub fields: &'static [Field<'static>],
}

/// Name, number and type of a field.
pub type Field<'n> = (&'n str, u32, FieldType);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FieldType {
    Time,
    Text,
    Bytes,
    Fixed32,
    UInt32,
    Int32,
    Int64,
    Bool,
    Double,
    Doubles,
    /// enum inside the message: name, and the names of its values from 0
    Enum(&'static str, &'static [&'static str]),
    Message(&'static ProtoType),
    /// repeated message
    Messages(&'static ProtoType),
}

impl FieldType {
    /// `FieldDescriptorProto`: type, label (1 optional, 3 repeated), and name of a message or enum.
    fn in_descriptor(self, message: &str) -> (u32, u32, String) {
        match self {
            Self::Time => (11, 1, ".google.protobuf.Timestamp".into()),
            Self::Text => (9, 1, String::new()),
            Self::Bytes => (12, 1, String::new()),
            Self::Fixed32 => (7, 1, String::new()),
            Self::UInt32 => (13, 1, String::new()),
            Self::Int32 => (5, 1, String::new()),
            Self::Int64 => (3, 1, String::new()),
            Self::Bool => (8, 1, String::new()),
            Self::Double => (1, 1, String::new()),
            Self::Doubles => (1, 3, String::new()),
            Self::Enum(name, _) => (14, 1, format!(".{message}.{name}")),
            Self::Message(inner) => (11, 1, format!(".{}", inner.name)),
            Self::Messages(inner) => (11, 3, format!(".{}", inner.name)),
        }
    }
}

fn empty() -> Writer {
    Writer::new(WireFormat::Protobuf)
}

fn field(name: &str, number: u32, kind: u32, label: u32, type_name: &str) -> Vec<u8> {
    let plain = empty().text(name).at(3).u32(number).at(4).u32(label).at(5).u32(kind);
    if type_name.is_empty() { plain.finish() } else { plain.at(6).text(type_name).finish() }
}

/// The file that declares a message: `google/protobuf/timestamp.proto`.
fn path_of(full_name: &str) -> String {
    format!("{}.proto", full_name.replace('.', "/").to_ascii_lowercase())
}

const TIMESTAMP: &str = "google.protobuf.Timestamp";

/// `FileDescriptorProto` of one message; proto3.
fn file(full_name: &str, fields: &[Field<'_>]) -> Vec<u8> {
    let (package, name) = full_name.rsplit_once('.').unwrap_or(("", full_name));
    let (mut message, mut enums) = (empty().text(name), Vec::new());
    let mut dependencies = Vec::new();
    for (field_name, number, field_type) in fields {
        let (kind, label, type_name) = field_type.in_descriptor(full_name);
        message = message.at(2).bytes(&field(field_name, *number, kind, label, &type_name));
        match field_type {
            FieldType::Time => dependencies.push(path_of(TIMESTAMP)),
            FieldType::Message(inner) | FieldType::Messages(inner) => {
                dependencies.push(path_of(inner.name));
            }
            FieldType::Enum(name, values) => {
                let value =
                    |(number, name): (u32, &&str)| empty().text(name).at(2).u32(number).finish();
                let values = (0..).zip(*values).map(value);
                enums.push(values.fold(empty().text(name), |w, v| w.at(2).bytes(&v)).finish());
            }
            _ => {}
        }
    }
    dependencies.sort_unstable();
    dependencies.dedup();
    let message = enums.iter().fold(message, |w, e| w.at(4).bytes(e));
    let head = empty().text(&path_of(full_name)).text(package);
    let head = dependencies.iter().fold(head, |w, d| w.at(3).text(d));
    head.at(4).bytes(&message.finish()).at(12).text("proto3").finish()
}

/// Appends the files of a message and its dependencies, dependencies first, each once.
fn files(name: &str, fields: &[Field<'_>], seen: &mut Vec<String>, found: &mut Vec<Vec<u8>>) {
    for (_, _, field_type) in fields {
        match field_type {
            FieldType::Time => files(
                TIMESTAMP,
                &[("seconds", 1, FieldType::Int64), ("nanos", 2, FieldType::Int32)],
                seen,
                found,
            ),
            FieldType::Message(inner) | FieldType::Messages(inner) => {
                files(inner.name, inner.fields, seen, found);
            }
            _ => {}
        }
    }
    if !seen.iter().any(|s| s == name) {
        seen.push(name.into());
        found.push(file(name, fields));
    }
}

/// The schema of a message type.
pub fn of(name: &str, fields: &[Field<'_>]) -> Vec<u8> {
    let mut found = Vec::new();
    files(name, fields, &mut Vec::new(), &mut found);
    found.iter().fold(empty(), |w, f| w.at(1).bytes(f)).finish()
}

/// The schema of a message by its ROS 2 definition: the two fields of the header, then the others
/// in their order.
pub fn of_ros2(name: &str, schema: &str) -> Vec<u8> {
    let layout = parse(name, schema, Dialect::Ros2);
    debug_assert!(layout.is_ok(), "{name}: invalid built-in schema");
    let root = layout.as_ref().map_or(&[][..], |l| l.root());
    let field_type = |kind: &Type| match kind {
        Type::Record(_) => FieldType::Time,
        Type::Primitive(Primitive::Text | Primitive::WideText) => FieldType::Text,
        Type::Primitive(Primitive::Bool) => FieldType::Bool,
        Type::Primitive(Primitive::Float(_)) => FieldType::Double,
        Type::Primitive(_) => FieldType::UInt32,
        Type::Array(..) => FieldType::Doubles,
    };
    let others = root
        .iter()
        .skip(1)
        .zip(3..)
        .map(|((field, kind), number)| (&**field, number, field_type(kind)));
    let fields: Vec<Field<'_>> =
        [("timestamp", 1, FieldType::Time), ("frame_id", 2, FieldType::Text)]
            .into_iter()
            .chain(others)
            .collect();
    of(name, &fields)
}
