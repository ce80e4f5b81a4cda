//! The schema of a written message type in each wire format.

use super::super::descriptor::{self, ProtoType};
use super::super::writer::WireFormat;

/// A message type that is written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OutputType {
    /// `pkg/msg/Type`
    pub name: &'static str,
    /// ROS 2 definition with its dependencies
    pub schema: &'static str,
    /// name and definition in ROS 1; `None` where [`in_ros1`] translates the ROS 2 definition
    pub(super) ros1: Option<(&'static str, &'static str)>,
    /// message type in protobuf; `None` for the fields of the ROS 2 definition in their order
    pub(super) protobuf: Option<&'static ProtoType>,
}

/// A schema record of the log.
#[derive(Clone, Debug, PartialEq)]
pub struct OutputSchema {
    /// of the message type
    pub name: String,
    /// `ros2msg`, `ros1msg`, `protobuf`
    pub encoding: &'static str,
    /// the definition
    pub data: Vec<u8>,
    /// `cdr`, `ros1`, `protobuf`
    pub message_encoding: &'static str,
}

impl OutputType {
    pub(super) const fn of_ros2(name: &'static str, schema: &'static str) -> Self {
        Self { name, schema, ros1: None, protobuf: None }
    }

    /// The schema in a wire format.
    pub fn schema_in(&self, wire: WireFormat) -> OutputSchema {
        let (name, encoding, data, message_encoding) = match wire {
            WireFormat::Cdr => (self.name.into(), "ros2msg", self.schema.into(), "cdr"),
            WireFormat::Ros1 => {
                let (name, text) = self.ros1.map_or_else(
                    || (self.name.replace("/msg/", "/"), in_ros1(self.schema)),
                    |(n, t)| (n.into(), t.into()),
                );
                (name, "ros1msg", text.into_bytes(), "ros1")
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
                (name, "protobuf", data, "protobuf")
            }
        };
        OutputSchema { name, encoding, data, message_encoding }
    }
}

/// Translates a ROS 2 definition to ROS 1: `time` is a primitive, and a `Header` has a `seq`.
fn in_ros1(schema: &str) -> String {
    let separator = format!("{}\n", "=".repeat(80));
    let sections: Vec<String> = schema
        .split(&separator)
        .filter(|s| !s.starts_with("MSG: builtin_interfaces/Time"))
        .map(|s| {
            s.replace("builtin_interfaces/Time", "time")
                .replace("MSG: std_msgs/Header\n", "MSG: std_msgs/Header\nuint32 seq\n")
        })
        .collect();
    sections.join(&separator)
}
