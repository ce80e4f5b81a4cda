//! Protocol Buffers: parses the `FileDescriptorSet` of a schema, and reads messages by it.
//!
//! Not a library, because image data is borrowed and only a few wire types are needed. Fields that
//! are not on the wire get proto3's defaults; members of a `oneof`, `optional` fields and messages
//! stay absent.

use std::borrow::Cow;
use std::collections::BTreeMap;

use super::layout::{
    Definitions, Layout, MAX_NESTING, Primitive, Type, UnresolvedField, UnresolvedType, build,
};
use super::value::{Budget, Value};

/// Wire encoding of a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Coding {
    Varint,
    /// varint in zigzag encoding
    Zigzag,
    Fixed32,
    Fixed64,
    /// strings, bytes, messages
    LengthDelimited,
}

/// Number and wire encoding of a field, beside its layout.
#[derive(Clone, Copy, Debug)]
struct Tag {
    number: u64,
    coding: Coding,
    /// has no default value
    optional: bool,
}

/// A message type with its dependencies.
#[derive(Debug)]
pub struct Schema {
    pub layout: Layout,
    /// one per record and field of the layout
    tags: Vec<Vec<Tag>>,
}

/// Content of a field on the wire.
enum WireValue<'a> {
    Varint(u64),
    Fixed64(u64),
    Fixed32(u32),
    LengthDelimited(&'a [u8]),
}

/// Takes one field off the front: its number and content.
fn field<'a>(bytes: &mut &'a [u8]) -> Result<(u64, WireValue<'a>), String> {
    fn fixed<const N: usize>(bytes: &mut &[u8]) -> Result<[u8; N], String> {
        let (head, tail) =
            bytes.split_first_chunk::<N>().ok_or("the message ends inside a number")?;
        *bytes = tail;
        Ok(*head)
    }
    let key = varint(bytes)?;
    let wire = match key & 7 {
        0 => WireValue::Varint(varint(bytes)?),
        1 => WireValue::Fixed64(u64::from_le_bytes(fixed(bytes)?)),
        2 => {
            let length = varint(bytes)?;
            let split = usize::try_from(length).ok().and_then(|n| bytes.split_at_checked(n));
            let (head, tail) = split.ok_or_else(|| {
                format!("a field of {length} bytes in the remaining {}", bytes.len())
            })?;
            *bytes = tail;
            WireValue::LengthDelimited(head)
        }
        5 => WireValue::Fixed32(u32::from_le_bytes(fixed(bytes)?)),
        other => return Err(format!("the protobuf wire type {other} is not supported")),
    };
    Ok((key >> 3, wire))
}

fn varint(bytes: &mut &[u8]) -> Result<u64, String> {
    let mut value = 0;
    for shift in (0..70).step_by(7) {
        let (byte, rest) = bytes.split_first().ok_or("the message ends inside a number")?;
        *bytes = rest;
        value |= u64::from(byte & 0x7f).checked_shl(shift).unwrap_or(0);
        if byte & 0x80 == 0 {
            return Ok(value);
        }
    }
    Err("a number of more than ten bytes".into())
}

/// Definitions of a descriptor set and their tags, by full name.
#[derive(Default)]
struct Descriptors {
    definitions: Definitions,
    tags: BTreeMap<String, Vec<Tag>>,
}

fn text(wire: &WireValue<'_>) -> String {
    if let WireValue::LengthDelimited(bytes) = wire {
        String::from_utf8_lossy(bytes).into_owned()
    } else {
        String::new()
    }
}

/// The length-delimited fields of one number.
fn fields_numbered(mut bytes: &[u8], number: u64) -> Result<Vec<&[u8]>, String> {
    let mut found = Vec::new();
    while !bytes.is_empty() {
        if let (n, WireValue::LengthDelimited(part)) = field(&mut bytes)?
            && n == number
        {
            found.push(part);
        }
    }
    Ok(found)
}

impl Descriptors {
    /// `FileDescriptorSet.file` → `package`, `message_type`
    fn read(set: &[u8]) -> Result<Self, String> {
        let mut all = Self::default();
        for file in fields_numbered(set, 1)? {
            let package = fields_numbered(file, 2)?
                .first()
                .map(|p| String::from_utf8_lossy(p).into_owned())
                .unwrap_or_default();
            for message in fields_numbered(file, 4)? {
                all.message(&package, message, 0)?;
            }
        }
        Ok(all)
    }

    /// `DescriptorProto`: name = 1, field = 2, nested_type = 3
    fn message(&mut self, scope: &str, descriptor: &[u8], depth: usize) -> Result<(), String> {
        if depth > MAX_NESTING {
            return Err(format!("the schema nests more than {MAX_NESTING} types"));
        }
        let name = fields_numbered(descriptor, 1)?
            .first()
            .map(|p| String::from_utf8_lossy(p).into_owned())
            .unwrap_or_default();
        let full = if scope.is_empty() { name } else { format!("{scope}.{name}") };
        for nested in fields_numbered(descriptor, 3)? {
            self.message(&full, nested, depth + 1)?;
        }
        let (mut fields, mut tags) = (Vec::new(), Vec::new());
        for part in fields_numbered(descriptor, 2)? {
            let (field, tag) = field_descriptor(part)?;
            fields.push(field);
            tags.push(tag);
        }
        self.definitions.insert(full.clone(), fields);
        self.tags.insert(full, tags);
        Ok(())
    }
}

/// `FieldDescriptorProto`: name = 1, number = 3, label = 4, type = 5, type_name = 6, oneof_index =
/// 9
fn field_descriptor(mut bytes: &[u8]) -> Result<(UnresolvedField, Tag), String> {
    let (mut name, mut type_name, mut number, mut label, mut kind, mut optional) =
        (String::new(), String::new(), 0, 0, 0, false);
    while !bytes.is_empty() {
        match field(&mut bytes)? {
            (1, wire) => name = text(&wire),
            (6, wire) => type_name = text(&wire).trim_start_matches('.').into(),
            (3, WireValue::Varint(v)) => number = v,
            (4, WireValue::Varint(v)) => label = v,
            (5, WireValue::Varint(v)) => kind = v,
            (9, _) => optional = true,
            _ => {}
        }
    }
    let primitive = UnresolvedType::Primitive;
    let (element, coding) = match kind {
        1 => (primitive(Primitive::Float(8)), Coding::Fixed64),
        2 => (primitive(Primitive::Float(4)), Coding::Fixed32),
        3 => (primitive(Primitive::Int(8)), Coding::Varint),
        4 => (primitive(Primitive::UInt(8)), Coding::Varint),
        5 | 14 => (primitive(Primitive::Int(4)), Coding::Varint),
        6 => (primitive(Primitive::UInt(8)), Coding::Fixed64),
        7 => (primitive(Primitive::UInt(4)), Coding::Fixed32),
        8 => (primitive(Primitive::Bool), Coding::Varint),
        9 => (primitive(Primitive::Text), Coding::LengthDelimited),
        11 => (UnresolvedType::Named(type_name), Coding::LengthDelimited),
        12 => (
            UnresolvedType::Array(Box::new(primitive(Primitive::UInt(1))), None),
            Coding::LengthDelimited,
        ),
        13 => (primitive(Primitive::UInt(4)), Coding::Varint),
        15 => (primitive(Primitive::Int(4)), Coding::Fixed32),
        16 => (primitive(Primitive::Int(8)), Coding::Fixed64),
        17 => (primitive(Primitive::Int(4)), Coding::Zigzag),
        18 => (primitive(Primitive::Int(8)), Coding::Zigzag),
        other => {
            return Err(format!(
                "the schema's field {name} has the unsupported protobuf type {other}"
            ));
        }
    };
    let kind = if label == 3 { UnresolvedType::Array(Box::new(element), None) } else { element };
    Ok((UnresolvedField { name, kind }, Tag { number, coding, optional }))
}

impl Schema {
    /// From a `FileDescriptorSet`; `name` is the message's full name.
    ///
    /// # Errors
    /// The schema is not a descriptor set, or a type is unknown or recursive.
    pub fn parse(name: &str, set: &[u8]) -> Result<Self, String> {
        let found = Descriptors::read(set)
            .map_err(|e| format!("the schema is not a FileDescriptorSet: {e}"))?;
        let resolve =
            |base: &str, _: &str| found.definitions.contains_key(base).then(|| base.to_string());
        let (layout, names) = build(&found.definitions, name.trim_start_matches('.'), &resolve)?;
        let tags = names.iter().map(|n| found.tags.get(n).cloned().unwrap_or_default()).collect();
        Ok(Self { layout, tags })
    }

    /// Reads one message.
    ///
    /// # Errors
    /// The bytes contradict the schema.
    pub fn read<'a>(&self, message: &'a [u8]) -> Result<Value<'a>, String> {
        let root = self.layout.records.len().checked_sub(1).ok_or("the schema is empty")?;
        self.record(root, message, &mut Budget::of(message))
    }

    fn record<'a>(
        &self,
        index: usize,
        mut bytes: &'a [u8],
        budget: &mut Budget,
    ) -> Result<Value<'a>, String> {
        let (fields, tags) = self
            .layout
            .records
            .get(index)
            .zip(self.tags.get(index))
            .ok_or("a schema index is out of range")?;
        budget.spend(1 + fields.len())?;
        let mut values: Vec<Option<Value<'a>>> = fields
            .iter()
            .zip(tags)
            .map(|((_, kind), tag)| if tag.optional { None } else { default(kind) })
            .collect();
        while !bytes.is_empty() {
            let (number, wire) = field(&mut bytes)?;
            let Some(at) = tags.iter().position(|t| t.number == number) else { continue };
            let (name, kind) = &fields[at];
            let bad = || format!("the field {name} does not match its schema");
            match kind {
                Type::Array(element, _)
                    if **element != Type::Primitive(Primitive::UInt(1))
                        || tags[at].coding != Coding::LengthDelimited =>
                {
                    let list = values[at].get_or_insert(Value::Numbers(Vec::new()));
                    self.append(list, element, tags[at].coding, wire, budget)?;
                }
                _ => {
                    values[at] =
                        Some(self.single(kind, tags[at].coding, wire, budget)?.ok_or_else(bad)?);
                }
            }
        }
        Ok(Value::Record(
            fields
                .iter()
                .zip(values)
                .filter_map(|((name, _), value)| Some((name.clone(), value?)))
                .collect(),
        ))
    }

    /// Appends an element of a repeated field, or the elements of a packed block.
    fn append<'a>(
        &self,
        list: &mut Value<'a>,
        element: &Type,
        coding: Coding,
        wire: WireValue<'a>,
        budget: &mut Budget,
    ) -> Result<(), String> {
        let bad = || String::from("a repeated field does not match its schema");
        match (element, wire) {
            (Type::Primitive(p), WireValue::LengthDelimited(mut packed))
                if coding != Coding::LengthDelimited =>
            {
                let Value::Numbers(numbers) = list else { return Err(bad()) };
                while !packed.is_empty() {
                    let wire = match coding {
                        Coding::Fixed32 => WireValue::Fixed32(u32::from_le_bytes(
                            *packed.first_chunk().ok_or_else(bad)?,
                        )),
                        Coding::Fixed64 => WireValue::Fixed64(u64::from_le_bytes(
                            *packed.first_chunk().ok_or_else(bad)?,
                        )),
                        _ => WireValue::Varint(varint(&mut packed)?),
                    };
                    packed = match coding {
                        Coding::Fixed32 => &packed[4..],
                        Coding::Fixed64 => &packed[8..],
                        _ => packed,
                    };
                    numbers.push(scalar(*p, coding, &wire).and_then(number).ok_or_else(bad)?);
                }
            }
            (Type::Primitive(p), wire) if coding != Coding::LengthDelimited => {
                let Value::Numbers(numbers) = list else { return Err(bad()) };
                numbers.push(scalar(*p, coding, &wire).and_then(number).ok_or_else(bad)?);
            }
            (element, wire) => {
                budget.spend(1)?;
                let value = self.single(element, coding, wire, budget)?.ok_or_else(bad)?;
                if let Value::List(values) = list {
                    values.push(value);
                } else {
                    *list = Value::List(vec![value]);
                }
            }
        }
        Ok(())
    }

    fn single<'a>(
        &self,
        kind: &Type,
        coding: Coding,
        wire: WireValue<'a>,
        budget: &mut Budget,
    ) -> Result<Option<Value<'a>>, String> {
        Ok(match (kind, wire) {
            (Type::Record(index), WireValue::LengthDelimited(bytes)) => {
                Some(self.record(*index, bytes, budget)?)
            }
            (Type::Array(..), WireValue::LengthDelimited(bytes)) => {
                Some(Value::Bytes(Cow::Borrowed(bytes)))
            }
            (Type::Primitive(Primitive::Text), WireValue::LengthDelimited(bytes)) => {
                Some(Value::Text(String::from_utf8_lossy(bytes)))
            }
            (Type::Primitive(p), wire) => scalar(*p, coding, &wire),
            _ => None,
        })
    }
}

fn number(value: Value<'_>) -> Option<f64> {
    match value {
        Value::Float(v) => Some(v),
        Value::Int(v) => Some(v as f64),
        Value::Bool(v) => Some(f64::from(u8::from(v))),
        _ => None,
    }
}

fn scalar<'a>(p: Primitive, coding: Coding, wire: &WireValue<'_>) -> Option<Value<'a>> {
    Some(match (p, coding, wire) {
        (Primitive::Float(8), _, WireValue::Fixed64(v)) => Value::Float(f64::from_bits(*v)),
        (Primitive::Float(_), _, WireValue::Fixed32(v)) => {
            Value::Float(f64::from(f32::from_bits(*v)))
        }
        (Primitive::Bool, _, WireValue::Varint(v)) => Value::Bool(*v != 0),
        (_, Coding::Zigzag, WireValue::Varint(v)) => {
            Value::Int((v >> 1) as i64 ^ -((v & 1) as i64))
        }
        // Negative int32 and enums are ten bytes, sign-extended.
        (_, Coding::Varint, WireValue::Varint(v)) => Value::Int(*v as i64),
        (Primitive::Int(_), Coding::Fixed32, WireValue::Fixed32(v)) => {
            Value::Int(i64::from(*v as i32))
        }
        (_, Coding::Fixed32, WireValue::Fixed32(v)) => Value::Int(i64::from(*v)),
        (_, Coding::Fixed64, WireValue::Fixed64(v)) => Value::Int(*v as i64),
        _ => return None,
    })
}

/// proto3's value of a field that is not on the wire: zero; `None` for a message.
fn default<'a>(kind: &Type) -> Option<Value<'a>> {
    Some(match kind {
        Type::Primitive(Primitive::Bool) => Value::Bool(false),
        Type::Primitive(Primitive::Int(_) | Primitive::UInt(_)) => Value::Int(0),
        Type::Primitive(Primitive::Float(_)) => Value::Float(0.0),
        Type::Primitive(Primitive::Text | Primitive::WideText) => Value::Text(Cow::Borrowed("")),
        Type::Array(element, _) => match element.as_ref() {
            Type::Primitive(Primitive::UInt(1)) => Value::Bytes(Cow::Borrowed(&[])),
            Type::Primitive(Primitive::Text | Primitive::WideText)
            | Type::Record(_)
            | Type::Array(..) => Value::List(Vec::new()),
            Type::Primitive(_) => Value::Numbers(Vec::new()),
        },
        Type::Record(_) => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A length-delimited field.
    fn sized(number: u8, body: &[u8]) -> Vec<u8> {
        [&[number << 3 | 2, body.len() as u8], body].concat()
    }

    fn descriptor(name: &str, number: u8, label: u8, kind: u8, type_name: &str) -> Vec<u8> {
        let body = [
            sized(1, name.as_bytes()),
            vec![3 << 3, number, 4 << 3, label, 5 << 3, kind],
            sized(6, type_name.as_bytes()),
        ]
        .concat();
        sized(2, &body)
    }

    fn set(fields: &[Vec<u8>]) -> Vec<u8> {
        let message = [vec![sized(1, b"T")], fields.to_vec()].concat().concat();
        sized(1, &[sized(2, b"p"), sized(4, &message)].concat())
    }

    #[test]
    fn packed_and_zigzag_fields_are_read() {
        let set = set(&[
            descriptor("ranges", 1, 3, 2, ""),
            descriptor("depth", 2, 1, 17, ""),
            descriptor("valid", 3, 1, 8, ""),
        ]);
        let schema = Schema::parse("p.T", &set).expect("a schema");
        let one = 1.5f32.to_le_bytes();
        let packed = [sized(1, &[one, one].concat()), vec![2 << 3, 3]].concat();
        let value = schema.read(&packed).expect("a message");
        assert_eq!(
            (value.numbers("ranges"), value.integer("depth"), value.flag("valid")),
            (Some(vec![1.5, 1.5]), Some(-2), Some(false))
        );
        let loose = [&[1 << 3 | 5][..], &one, &[1 << 3 | 5], &one].concat();
        assert_eq!(schema.read(&loose).expect("a message").numbers("ranges"), Some(vec![1.5, 1.5]));
        assert!(schema.read(&packed[..5]).is_err());
    }

    #[test]
    fn a_recursive_type_is_rejected() {
        let error = Schema::parse("p.T", &set(&[descriptor("again", 1, 1, 11, ".p.T")]))
            .expect_err("recursion");
        assert!(error.contains("contains itself"), "{error}");
    }
}
