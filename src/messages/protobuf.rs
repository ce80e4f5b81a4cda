//! Protocol Buffers: the `FileDescriptorSet` in the schema's data → layout, and messages by it.
//!
//! Small and our own, since a picture's bytes are borrowed and a few wire types are all there is.
//! Fields that a message leaves out get proto3's defaults; members of a `oneof`, `optional` fields
//! and messages stay absent.

use std::borrow::Cow;
use std::collections::BTreeMap;

use super::layout::{
    Definitions, Layout, MOST_NESTED, Primitive, Type, Written, WrittenField, build,
};
use super::value::{Budget, Value};

/// How a field lies on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Coding {
    Varint,
    /// zigzag
    Signed,
    Fixed32,
    Fixed64,
    /// text, bytes, messages
    Sized,
}

/// What the wire needs to know of a field, beyond its layout.
#[derive(Clone, Copy, Debug)]
struct Tag {
    number: u64,
    coding: Coding,
    /// absent on the wire means absent
    optional: bool,
}

/// A message type and all it depends on.
#[derive(Debug)]
pub struct Schema {
    /// names and types
    pub layout: Layout,
    /// beside the layout's fields
    tags: Vec<Vec<Tag>>,
}

/// A field's number and what it holds.
enum Wire<'a> {
    Varint(u64),
    Fixed64(u64),
    Fixed32(u32),
    Sized(&'a [u8]),
}

/// Reads one field off the front.
fn field<'a>(bytes: &mut &'a [u8]) -> Result<(u64, Wire<'a>), String> {
    fn fixed<const N: usize>(bytes: &mut &[u8]) -> Result<[u8; N], String> {
        let (head, tail) =
            bytes.split_first_chunk::<N>().ok_or("the message ends inside a number")?;
        *bytes = tail;
        Ok(*head)
    }
    let key = varint(bytes)?;
    let wire = match key & 7 {
        0 => Wire::Varint(varint(bytes)?),
        1 => Wire::Fixed64(u64::from_le_bytes(fixed(bytes)?)),
        2 => {
            let length = varint(bytes)?;
            let split = usize::try_from(length).ok().and_then(|n| bytes.split_at_checked(n));
            let (head, tail) = split
                .ok_or_else(|| format!("a field of {length} bytes in the {} left", bytes.len()))?;
            *bytes = tail;
            Wire::Sized(head)
        }
        5 => Wire::Fixed32(u32::from_le_bytes(fixed(bytes)?)),
        other => return Err(format!("the protobuf wire type {other} is not read")),
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

/// Definitions of a descriptor set, by full name, with their tags.
#[derive(Default)]
struct Descriptors {
    definitions: Definitions,
    tags: BTreeMap<String, Vec<Tag>>,
}

fn text(wire: &Wire<'_>) -> String {
    if let Wire::Sized(bytes) = wire {
        String::from_utf8_lossy(bytes).into_owned()
    } else {
        String::new()
    }
}

/// The sized fields of this number.
fn parts(mut bytes: &[u8], number: u64) -> Result<Vec<&[u8]>, String> {
    let mut found = Vec::new();
    while !bytes.is_empty() {
        if let (n, Wire::Sized(part)) = field(&mut bytes)?
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
        for file in parts(set, 1)? {
            let package = parts(file, 2)?
                .first()
                .map(|p| String::from_utf8_lossy(p).into_owned())
                .unwrap_or_default();
            for message in parts(file, 4)? {
                all.message(&package, message, 0)?;
            }
        }
        Ok(all)
    }

    /// `DescriptorProto`: name = 1, field = 2, nested_type = 3
    fn message(&mut self, scope: &str, descriptor: &[u8], depth: usize) -> Result<(), String> {
        if depth > MOST_NESTED {
            return Err(format!("the schema nests more than {MOST_NESTED} types"));
        }
        let name = parts(descriptor, 1)?
            .first()
            .map(|p| String::from_utf8_lossy(p).into_owned())
            .unwrap_or_default();
        let full = if scope.is_empty() { name } else { format!("{scope}.{name}") };
        for nested in parts(descriptor, 3)? {
            self.message(&full, nested, depth + 1)?;
        }
        let (mut fields, mut tags) = (Vec::new(), Vec::new());
        for part in parts(descriptor, 2)? {
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
fn field_descriptor(mut bytes: &[u8]) -> Result<(WrittenField, Tag), String> {
    let (mut name, mut type_name, mut number, mut label, mut kind, mut optional) =
        (String::new(), String::new(), 0, 0, 0, false);
    while !bytes.is_empty() {
        match field(&mut bytes)? {
            (1, wire) => name = text(&wire),
            (6, wire) => type_name = text(&wire).trim_start_matches('.').into(),
            (3, Wire::Varint(v)) => number = v,
            (4, Wire::Varint(v)) => label = v,
            (5, Wire::Varint(v)) => kind = v,
            (9, _) => optional = true,
            _ => {}
        }
    }
    let plain = Written::Primitive;
    let (written, coding) = match kind {
        1 => (plain(Primitive::Float(8)), Coding::Fixed64),
        2 => (plain(Primitive::Float(4)), Coding::Fixed32),
        3 => (plain(Primitive::Int(8)), Coding::Varint),
        4 => (plain(Primitive::UInt(8)), Coding::Varint),
        5 | 14 => (plain(Primitive::Int(4)), Coding::Varint),
        6 => (plain(Primitive::UInt(8)), Coding::Fixed64),
        7 => (plain(Primitive::UInt(4)), Coding::Fixed32),
        8 => (plain(Primitive::Bool), Coding::Varint),
        9 => (plain(Primitive::Text), Coding::Sized),
        11 => (Written::Named(type_name), Coding::Sized),
        12 => (Written::Array(Box::new(plain(Primitive::UInt(1))), None), Coding::Sized),
        13 => (plain(Primitive::UInt(4)), Coding::Varint),
        15 => (plain(Primitive::Int(4)), Coding::Fixed32),
        16 => (plain(Primitive::Int(8)), Coding::Fixed64),
        17 => (plain(Primitive::Int(4)), Coding::Signed),
        18 => (plain(Primitive::Int(8)), Coding::Signed),
        other => {
            return Err(format!(
                "the schema's field {name} has the protobuf type {other}, which is not read"
            ));
        }
    };
    let written = if label == 3 { Written::Array(Box::new(written), None) } else { written };
    Ok((WrittenField { name, kind: written }, Tag { number, coding, optional }))
}

impl Schema {
    /// From a `FileDescriptorSet`; `name` is the message's full name.
    ///
    /// # Errors
    /// A sentence: no descriptor set, an unknown type, a type that holds itself.
    pub fn parse(name: &str, set: &[u8]) -> Result<Self, String> {
        let found = Descriptors::read(set)
            .map_err(|e| format!("the schema is no FileDescriptorSet: {e}"))?;
        let resolve =
            |base: &str, _: &str| found.definitions.contains_key(base).then(|| base.to_string());
        let (layout, names) = build(&found.definitions, name.trim_start_matches('.'), &resolve)?;
        let tags = names.iter().map(|n| found.tags.get(n).cloned().unwrap_or_default()).collect();
        Ok(Self { layout, tags })
    }

    /// Reads one message.
    ///
    /// # Errors
    /// A sentence where the bytes contradict the schema.
    pub fn read<'a>(&self, message: &'a [u8]) -> Result<Value<'a>, String> {
        let root = self.layout.records.len().checked_sub(1).ok_or("an empty schema")?;
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
            .ok_or("a schema that points nowhere")?;
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
            let bad = || format!("the field {name} is not on the wire as its schema says");
            match kind {
                Type::Array(element, _)
                    if **element != Type::Primitive(Primitive::UInt(1))
                        || tags[at].coding != Coding::Sized =>
                {
                    let list = values[at].get_or_insert(Value::Numbers(Vec::new()));
                    self.append(list, element, tags[at].coding, wire, budget)?;
                }
                _ => {
                    values[at] =
                        Some(self.single(kind, tags[at].coding, wire, budget)?.ok_or_else(bad)?)
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

    /// An element of a repeated field, or several in one packed block.
    fn append<'a>(
        &self,
        list: &mut Value<'a>,
        element: &Type,
        coding: Coding,
        wire: Wire<'a>,
        budget: &mut Budget,
    ) -> Result<(), String> {
        let bad = || String::from("a repeated field is not on the wire as its schema says");
        match (element, wire) {
            (Type::Primitive(p), Wire::Sized(mut packed)) if coding != Coding::Sized => {
                let Value::Numbers(numbers) = list else { return Err(bad()) };
                while !packed.is_empty() {
                    let wire = match coding {
                        Coding::Fixed32 => Wire::Fixed32(u32::from_le_bytes(
                            *packed.first_chunk().ok_or_else(bad)?,
                        )),
                        Coding::Fixed64 => Wire::Fixed64(u64::from_le_bytes(
                            *packed.first_chunk().ok_or_else(bad)?,
                        )),
                        _ => Wire::Varint(varint(&mut packed)?),
                    };
                    packed = match coding {
                        Coding::Fixed32 => &packed[4..],
                        Coding::Fixed64 => &packed[8..],
                        _ => packed,
                    };
                    numbers.push(scalar(*p, coding, &wire).and_then(number).ok_or_else(bad)?);
                }
            }
            (Type::Primitive(p), wire) if coding != Coding::Sized => {
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
        wire: Wire<'a>,
        budget: &mut Budget,
    ) -> Result<Option<Value<'a>>, String> {
        Ok(match (kind, wire) {
            (Type::Record(index), Wire::Sized(bytes)) => Some(self.record(*index, bytes, budget)?),
            (Type::Array(..), Wire::Sized(bytes)) => Some(Value::Bytes(Cow::Borrowed(bytes))),
            (Type::Primitive(Primitive::Text), Wire::Sized(bytes)) => {
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

fn scalar<'a>(p: Primitive, coding: Coding, wire: &Wire<'_>) -> Option<Value<'a>> {
    Some(match (p, coding, wire) {
        (Primitive::Float(8), _, Wire::Fixed64(v)) => Value::Float(f64::from_bits(*v)),
        (Primitive::Float(_), _, Wire::Fixed32(v)) => Value::Float(f64::from(f32::from_bits(*v))),
        (Primitive::Bool, _, Wire::Varint(v)) => Value::Bool(*v != 0),
        (_, Coding::Signed, Wire::Varint(v)) => Value::Int((v >> 1) as i64 ^ -((v & 1) as i64)),
        // Negative int32 and enums come as ten bytes, sign-extended.
        (_, Coding::Varint, Wire::Varint(v)) => Value::Int(*v as i64),
        (Primitive::Int(_), Coding::Fixed32, Wire::Fixed32(v)) => Value::Int(i64::from(*v as i32)),
        (_, Coding::Fixed32, Wire::Fixed32(v)) => Value::Int(i64::from(*v)),
        (_, Coding::Fixed64, Wire::Fixed64(v)) => Value::Int(*v as i64),
        _ => return None,
    })
}

/// proto3: what is not on the wire is zero; a message is absent.
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
    fn packed_or_not_zigzag_or_not() {
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
    fn a_type_that_holds_itself_is_refused() {
        let error = Schema::parse("p.T", &set(&[descriptor("again", 1, 1, 11, ".p.T")]))
            .expect_err("recursion");
        assert!(error.contains("holds itself"), "{error}");
    }
}
