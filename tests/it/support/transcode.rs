//! A log of ROS 2 (CDR, ros2msg) rewritten in another encoding, by writers that share nothing
//! with the readers under test.

use std::collections::BTreeMap;
use std::path::Path;

use base64::Engine as _;
use serde_json::{Value as Json, json};
use unwater::messages::layout::{Layout, Primitive, Type};
use unwater::messages::ros_schema::{Dialect, parse};
use unwater::messages::{cdr, value::Value};
use unwater::recording::{Entry, Recording, Window};

/// To what.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Encoding {
    Ros1,
    Protobuf,
    Json,
}

/// The same log with other bytes in its raw images, whose last `bytes` are pixels.
pub fn with_pixels(path: &Path, topic: &str, bytes: usize, change: impl Fn(&mut [u8])) {
    let recording = Recording::open(path).unwrap();
    let mut out = Vec::new();
    let mut writer =
        mcap::WriteOptions::new().profile("ros2").create(std::io::Cursor::new(&mut out)).unwrap();
    for (id, schema) in &recording.schemas {
        writer.add_schema_with_id(*id, &schema.name, &schema.encoding, &schema.data).unwrap();
    }
    for (id, c) in &recording.channels {
        writer
            .add_channel_with_id(*id, c.schema_id, &c.topic, &c.message_encoding, &c.metadata)
            .unwrap();
    }
    for entry in recording.messages(Window::ALL) {
        let Entry::Message(m) = entry else { continue };
        let mut data = m.data().to_vec();
        if recording.channels[&m.channel].topic == topic {
            let start = data.len() - bytes;
            change(&mut data[start..]);
        }
        let header = mcap::records::MessageHeader {
            channel_id: m.channel,
            sequence: m.sequence,
            log_time: m.log_time,
            publish_time: m.publish_time,
        };
        writer.write_to_known_channel(&header, &data).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    drop(recording);
    std::fs::write(path, out).unwrap();
}

/// Every channel of `source`, in the other encoding.
pub fn transcode(source: &Path, target: &Path, encoding: Encoding) {
    let recording = Recording::open(source).unwrap();
    let file = std::io::BufWriter::new(std::fs::File::create(target).unwrap());
    let profile = if encoding == Encoding::Ros1 { "ros1" } else { "" };
    let mut writer = mcap::WriteOptions::new().profile(profile).create(file).unwrap();
    let mut layouts = BTreeMap::new();
    for (id, schema) in &recording.schemas {
        let layout =
            parse(&schema.name, std::str::from_utf8(&schema.data).unwrap(), Dialect::Ros2).unwrap();
        let (schema_encoding, name, data) = match encoding {
            Encoding::Ros1 => ("ros1msg", "t/Root", ros1_schema(&layout).into_bytes()),
            Encoding::Protobuf => ("protobuf", "t.Root", descriptor_set(&layout)),
            Encoding::Json => (
                "jsonschema",
                "t.Root",
                json_schema(&layout, &Type::Record(layout.records.len() - 1))
                    .to_string()
                    .into_bytes(),
            ),
        };
        writer.add_schema_with_id(*id, name, schema_encoding, &data).unwrap();
        layouts.insert(*id, layout);
    }
    for (id, c) in &recording.channels {
        let word = match encoding {
            Encoding::Ros1 => "ros1",
            Encoding::Protobuf => "protobuf",
            Encoding::Json => "json",
        };
        writer.add_channel_with_id(*id, c.schema_id, &c.topic, word, &c.metadata).unwrap();
    }
    for entry in recording.messages(Window::ALL) {
        if let Entry::Message(m) = entry {
            let layout = &layouts[&recording.channels[&m.channel].schema_id];
            let root = Type::Record(layout.records.len() - 1);
            let value = cdr::read(layout, m.data()).unwrap();
            let mut data = Vec::new();
            match encoding {
                Encoding::Ros1 => ros1(layout, &root, &value, &mut data),
                Encoding::Protobuf => protobuf(layout, layout.records.len() - 1, &value, &mut data),
                Encoding::Json => data = json_message(&value).to_string().into_bytes(),
            }
            let header = mcap::records::MessageHeader {
                channel_id: m.channel,
                sequence: m.sequence,
                log_time: m.log_time,
                publish_time: m.publish_time,
            };
            writer.write_to_known_channel(&header, &data).unwrap();
        }
    }
    writer.finish().unwrap();
}

fn float(value: &Value<'_>) -> f64 {
    match value {
        Value::Float(v) => *v,
        Value::Int(v) => *v as f64,
        Value::Bool(v) => f64::from(u8::from(*v)),
        other => panic!("{other:?} is no number"),
    }
}

fn int(value: &Value<'_>) -> i64 {
    match value {
        Value::Int(v) => *v,
        other => float(other) as i64,
    }
}

/// The elements of an array, whatever form the reader gave it.
fn elements<'v>(value: &'v Value<'_>) -> Vec<Value<'v>> {
    match value {
        Value::Numbers(v) => v.iter().map(|n| Value::Float(*n)).collect(),
        Value::Bytes(v) => v.iter().map(|b| Value::Int(i64::from(*b))).collect(),
        Value::List(v) => v.clone(),
        other => panic!("{other:?} is no array"),
    }
}

fn text<'v>(value: &'v Value<'_>) -> &'v str {
    if let Value::Text(t) = value { t } else { panic!("{value:?} is no text") }
}

fn fields<'v>(value: &'v Value<'_>) -> impl Iterator<Item = &'v Value<'v>> {
    let Value::Record(fields) = value else { panic!("{value:?} is no message") };
    fields.iter().map(|(_, v)| v)
}

// ---- ROS 1

fn ros1_name(kind: &Type) -> String {
    match kind {
        Type::Primitive(p) => match p {
            Primitive::Bool => "bool".into(),
            Primitive::Int(n) => format!("int{}", 8 * n),
            Primitive::UInt(n) => format!("uint{}", 8 * n),
            Primitive::Float(n) => format!("float{}", 8 * n),
            Primitive::Text | Primitive::WideText => "string".into(),
        },
        Type::Record(index) => format!("t/R{index}"),
        Type::Array(element, size) => {
            format!("{}[{}]", ros1_name(element), size.map(|n| n.to_string()).unwrap_or_default())
        }
    }
}

fn ros1_schema(layout: &Layout) -> String {
    let section = |fields: &Vec<(std::sync::Arc<str>, Type)>| {
        fields
            .iter()
            .map(|(name, kind)| format!("{} {name}\n", ros1_name(kind)))
            .collect::<String>()
    };
    let (root, others) = layout.records.split_last().unwrap();
    others.iter().enumerate().fold(section(root), |text, (i, r)| {
        text + &format!("{}\nMSG: t/R{i}\n{}", "=".repeat(80), section(r))
    })
}

fn ros1(layout: &Layout, kind: &Type, value: &Value<'_>, out: &mut Vec<u8>) {
    match kind {
        Type::Record(index) => {
            for ((_, kind), value) in layout.records[*index].iter().zip(fields(value)) {
                ros1(layout, kind, value, out);
            }
        }
        Type::Array(element, size) => {
            if let Value::Bytes(bytes) = value {
                out.extend_from_slice(
                    &(bytes.len() as u32).to_le_bytes()[..if size.is_some() { 0 } else { 4 }],
                );
                out.extend_from_slice(bytes);
                return;
            }
            let list = elements(value);
            if size.is_none() {
                out.extend_from_slice(&(list.len() as u32).to_le_bytes());
            }
            list.iter().for_each(|v| ros1(layout, element, v, out));
        }
        Type::Primitive(p) => match p {
            Primitive::Bool => out.push(int(value) as u8),
            Primitive::Int(n) | Primitive::UInt(n) => {
                out.extend_from_slice(&int(value).to_le_bytes()[..*n]);
            }
            Primitive::Float(4) => out.extend_from_slice(&(float(value) as f32).to_le_bytes()),
            Primitive::Float(_) => out.extend_from_slice(&float(value).to_le_bytes()),
            Primitive::Text | Primitive::WideText => {
                out.extend_from_slice(&(text(value).len() as u32).to_le_bytes());
                out.extend_from_slice(text(value).as_bytes());
            }
        },
    }
}

// ---- protobuf

fn varint(mut v: u64, out: &mut Vec<u8>) {
    while v >= 0x80 {
        out.push(v as u8 | 0x80);
        v >>= 7;
    }
    out.push(v as u8);
}

fn sized(number: u64, body: &[u8], out: &mut Vec<u8>) {
    varint(number << 3 | 2, out);
    varint(body.len() as u64, out);
    out.extend_from_slice(body);
}

/// FieldDescriptorProto.type: double 1, float 2, int64 3, string 9, message 11, bytes 12.
fn proto_type(kind: &Type) -> u64 {
    match kind {
        Type::Primitive(Primitive::Float(4)) => 2,
        Type::Primitive(Primitive::Float(_)) => 1,
        Type::Primitive(Primitive::Text | Primitive::WideText) => 9,
        Type::Primitive(_) => 3,
        Type::Record(_) => 11,
        Type::Array(element, _) if **element == Type::Primitive(Primitive::UInt(1)) => 12,
        Type::Array(element, _) => proto_type(element),
    }
}

fn descriptor_set(layout: &Layout) -> Vec<u8> {
    let mut file = Vec::new();
    sized(1, b"t.proto", &mut file);
    sized(2, b"t", &mut file);
    for (i, record) in layout.records.iter().enumerate() {
        let mut message = Vec::new();
        let name = if i + 1 == layout.records.len() { "Root".into() } else { format!("R{i}") };
        sized(1, name.as_bytes(), &mut message);
        for (number, (name, kind)) in record.iter().enumerate() {
            let mut field = Vec::new();
            sized(1, name.as_bytes(), &mut field);
            let is_list = matches!(kind, Type::Array(..)) && proto_type(kind) != 12;
            for (key, v) in
                [(3, number as u64 + 1), (4, if is_list { 3 } else { 1 }), (5, proto_type(kind))]
            {
                varint(key << 3, &mut field);
                varint(v, &mut field);
            }
            let inner = if let Type::Array(element, _) = kind { element } else { kind };
            if let Type::Record(index) = inner {
                sized(6, format!(".t.R{index}").as_bytes(), &mut field);
            }
            sized(2, &field, &mut message);
        }
        sized(4, &message, &mut file);
    }
    let mut set = Vec::new();
    sized(1, &file, &mut set);
    set
}

fn protobuf(layout: &Layout, index: usize, value: &Value<'_>, out: &mut Vec<u8>) {
    for (number, ((_, kind), value)) in layout.records[index].iter().zip(fields(value)).enumerate()
    {
        let number = number as u64 + 1;
        match (kind, value) {
            (_, Value::Bytes(bytes)) if proto_type(kind) == 12 => sized(number, bytes, out),
            (Type::Array(element, _), _) => match element.as_ref() {
                Type::Record(inner) => {
                    for v in elements(value) {
                        let mut body = Vec::new();
                        protobuf(layout, *inner, &v, &mut body);
                        sized(number, &body, out);
                    }
                }
                Type::Primitive(p) => {
                    let mut packed = Vec::new();
                    for v in elements(value) {
                        match p {
                            Primitive::Float(4) => {
                                packed.extend_from_slice(&(float(&v) as f32).to_le_bytes());
                            }
                            Primitive::Float(_) => {
                                packed.extend_from_slice(&float(&v).to_le_bytes());
                            }
                            _ => varint(int(&v) as u64, &mut packed),
                        }
                    }
                    sized(number, &packed, out);
                }
                Type::Array(..) => panic!("arrays of arrays"),
            },
            (Type::Record(inner), _) => {
                let mut body = Vec::new();
                protobuf(layout, *inner, value, &mut body);
                sized(number, &body, out);
            }
            (Type::Primitive(p), _) => match p {
                Primitive::Text | Primitive::WideText => sized(number, text(value).as_bytes(), out),
                // proto3 leaves zeros out.
                _ if float(value) == 0.0 => {}
                Primitive::Float(4) => {
                    varint(number << 3 | 5, out);
                    out.extend_from_slice(&(float(value) as f32).to_le_bytes());
                }
                Primitive::Float(_) => {
                    varint(number << 3 | 1, out);
                    out.extend_from_slice(&float(value).to_le_bytes());
                }
                _ => {
                    varint(number << 3, out);
                    varint(int(value) as u64, out);
                }
            },
        }
    }
}

// ---- JSON

fn json_schema(layout: &Layout, kind: &Type) -> Json {
    match kind {
        Type::Primitive(Primitive::Bool) => json!({"type": "boolean"}),
        Type::Primitive(Primitive::Int(_) | Primitive::UInt(_)) => json!({"type": "integer"}),
        Type::Primitive(Primitive::Float(_)) => json!({"type": "number"}),
        Type::Primitive(_) => json!({"type": "string"}),
        Type::Array(element, _) if **element == Type::Primitive(Primitive::UInt(1)) => {
            json!({"type": "string", "contentEncoding": "base64"})
        }
        Type::Array(element, _) => json!({"type": "array", "items": json_schema(layout, element)}),
        Type::Record(index) => {
            let properties = layout.records[*index]
                .iter()
                .map(|(name, kind)| (name.to_string(), json_schema(layout, kind)));
            json!({"type": "object", "properties": properties.collect::<serde_json::Map<_, _>>()})
        }
    }
}

fn json_message(value: &Value<'_>) -> Json {
    match value {
        Value::Bool(v) => json!(v),
        Value::Int(v) => json!(v),
        Value::Float(v) => json!(v),
        Value::Text(v) => json!(v),
        Value::Bytes(v) => json!(base64::prelude::BASE64_STANDARD.encode(v)),
        Value::Numbers(v) => json!(v),
        Value::List(v) => Json::Array(v.iter().map(json_message).collect()),
        Value::Record(fields) => Json::Object(
            fields.iter().map(|(name, v)| (name.to_string(), json_message(v))).collect(),
        ),
    }
}
