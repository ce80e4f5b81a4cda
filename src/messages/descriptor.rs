//! Schemas of the protobuf messages that are written: a `FileDescriptorSet`, the message's file
//! behind those of its parts.

use super::layout::{Primitive, Type};
use super::ros_schema::{Dialect, parse};
use super::writer::{WireFormat, Writer};

/// A message as its makers have numbered it.
#[derive(Debug, PartialEq, Eq)]
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
    Int32,
    Int64,
    Bool,
    Double,
    Doubles,
    /// one of a message's own words, numbered from 0
    Choice(&'static str, &'static [&'static str]),
    /// a message of its own
    Part(&'static ProtoType),
    /// several of them
    Parts(&'static ProtoType),
}

impl Form {
    /// `FieldDescriptorProto`: type, label (1 optional, 3 repeated), and the name of a message or
    /// enum.
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
            Self::Choice(choice, _) => (14, 1, format!(".{message}.{choice}")),
            Self::Part(part) => (11, 1, format!(".{}", part.name)),
            Self::Parts(part) => (11, 3, format!(".{}", part.name)),
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

/// `google/protobuf/timestamp.proto` and the like: where a message is declared.
fn path_of(full_name: &str) -> String {
    format!("{}.proto", full_name.replace('.', "/").to_ascii_lowercase())
}

const TIMESTAMP: &str = "google.protobuf.Timestamp";

/// `FileDescriptorProto` of one message; proto3.
fn file(full_name: &str, fields: &[(&str, u32, Form)]) -> Vec<u8> {
    let (package, name) = full_name.rsplit_once('.').unwrap_or(("", full_name));
    let (mut message, mut choices) = (empty().text(name), Vec::new());
    let mut dependencies = Vec::new();
    for (field_name, number, form) in fields {
        let (kind, label, type_name) = form.in_descriptor(full_name);
        message = message.at(2).bytes(&field(field_name, *number, kind, label, &type_name));
        match form {
            Form::Time => dependencies.push(path_of(TIMESTAMP)),
            Form::Part(part) | Form::Parts(part) => dependencies.push(path_of(part.name)),
            Form::Choice(choice, words) => {
                let word =
                    |(number, word): (u32, &&str)| empty().text(word).at(2).u32(number).finish();
                choices.push(
                    (0..)
                        .zip(*words)
                        .map(word)
                        .fold(empty().text(choice), |w, v| w.at(2).bytes(&v))
                        .finish(),
                );
            }
            _ => {}
        }
    }
    dependencies.sort_unstable();
    dependencies.dedup();
    let message = choices.iter().fold(message, |w, choice| w.at(4).bytes(choice));
    let begun = empty().text(&path_of(full_name)).text(package);
    let begun = dependencies.iter().fold(begun, |w, d| w.at(3).text(d));
    begun.at(4).bytes(&message.finish()).at(12).text("proto3").finish()
}

/// A message and all it is made of, parts first, each once.
fn files(
    name: &str,
    fields: &[(&str, u32, Form)],
    seen: &mut Vec<String>,
    found: &mut Vec<Vec<u8>>,
) {
    for (_, _, form) in fields {
        match form {
            Form::Time => files(
                TIMESTAMP,
                &[("seconds", 1, Form::Int64), ("nanos", 2, Form::Int32)],
                seen,
                found,
            ),
            Form::Part(part) | Form::Parts(part) => files(part.name, part.fields, seen, found),
            _ => {}
        }
    }
    if !seen.iter().any(|s| s == name) {
        seen.push(name.into());
        found.push(file(name, fields));
    }
}

/// The schema of a message with these fields.
pub fn of(name: &str, fields: &[(&str, u32, Form)]) -> Vec<u8> {
    let mut found = Vec::new();
    files(name, fields, &mut Vec::new(), &mut found);
    found.iter().fold(empty(), |w, f| w.at(1).bytes(f)).finish()
}

/// The schema of a message of ours by its ROS 2 definition: the header's two fields, then the
/// others in their order.
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
    let others =
        root.iter().skip(1).zip(3..).map(|((field, kind), number)| (&**field, number, form(kind)));
    let fields: Vec<(&str, u32, Form)> =
        [("timestamp", 1, Form::Time), ("frame_id", 2, Form::Text)]
            .into_iter()
            .chain(others)
            .collect();
    of(name, &fields)
}
