//! JSON messages, with a JSON Schema or without any schema; then the first message gives the
//! layout.
//!
//! `data` in base64 (`contentEncoding` in Foxglove's schemas) or as a list of bytes becomes bytes.

use std::borrow::Cow;
use std::sync::Arc;

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use serde_json::Value as Json;

use super::layout::{Fields, Layout, MAX_NESTING, Primitive, Type};
use super::value::Value;

/// Layout of a JSON Schema.
///
/// # Errors
/// The schema is not JSON, has an undefined `$ref`, or a recursive type.
pub fn parse_schema(text: &[u8]) -> Result<Layout, String> {
    let schema: Json = serde_json::from_slice(text)
        .map_err(|e| format!("the JSON schema cannot be parsed: {e}"))?;
    let mut reader =
        SchemaReader { root: &schema, open: Vec::new(), records: Vec::new(), depth: 0 };
    let root = reader.fields(&schema)?;
    reader.records.push(root);
    Ok(Layout { records: reader.records })
}

struct SchemaReader<'s> {
    root: &'s Json,
    /// references being followed
    open: Vec<String>,
    records: Vec<Fields>,
    depth: usize,
}

impl<'s> SchemaReader<'s> {
    fn fields(&mut self, schema: &'s Json) -> Result<Fields, String> {
        let (schema, opened) = self.follow(schema)?;
        let mut fields = Fields::new();
        for (name, property) in schema["properties"].as_object().into_iter().flatten() {
            if let Some(kind) = self.kind(property)? {
                fields.push((Arc::from(name.as_str()), kind));
            }
            if self.records.len() > 4096 {
                return Err("the JSON schema defines more than 4096 objects".into());
            }
        }
        self.open.truncate(self.open.len() - opened);
        Ok(fields)
    }

    /// The target of a chain of `$ref`, and its length.
    fn follow(&mut self, mut schema: &'s Json) -> Result<(&'s Json, usize), String> {
        let mut opened = 0;
        while let Some(target) = schema["$ref"].as_str() {
            if self.open.iter().any(|o| o == target) {
                return Err(format!("the schema's type {target} contains itself"));
            }
            let path = target
                .strip_prefix('#')
                .ok_or_else(|| format!("the JSON schema refers to {target}, which is not in it"))?;
            schema = self
                .root
                .pointer(path)
                .ok_or_else(|| format!("the JSON schema refers to {target}, which is not in it"))?;
            self.open.push(target.into());
            opened += 1;
        }
        Ok((schema, opened))
    }

    /// `None` for types that no decoder reads.
    fn kind(&mut self, schema: &'s Json) -> Result<Option<Type>, String> {
        if self.depth >= MAX_NESTING {
            return Err(format!("the schema nests more than {MAX_NESTING} types"));
        }
        self.depth += 1;
        let (followed, opened) = self.follow(schema)?;
        // ["number", "null"] is an optional number.
        let word = match &followed["type"] {
            Json::Array(words) => words.iter().filter_map(Json::as_str).find(|w| *w != "null"),
            word => word.as_str(),
        };
        let kind = match word {
            Some("boolean") => Some(Type::Primitive(Primitive::Bool)),
            Some("integer") => Some(Type::Primitive(Primitive::Int(8))),
            Some("number") => Some(Type::Primitive(Primitive::Float(8))),
            Some("string") if followed["contentEncoding"] == "base64" => Some(Type::bytes()),
            Some("string") => Some(Type::Primitive(Primitive::Text)),
            Some("array") => {
                self.kind(&followed["items"])?.map(|element| Type::Array(Box::new(element), None))
            }
            _ if followed["properties"].is_object() => {
                let fields = self.fields(followed)?;
                self.records.push(fields);
                Some(Type::Record(self.records.len() - 1))
            }
            _ => None,
        };
        self.open.truncate(self.open.len() - opened);
        self.depth -= 1;
        Ok(kind)
    }
}

/// The layout of a message without a schema.
///
/// # Errors
/// The message is not a JSON object.
pub fn layout_of(message: &[u8]) -> Result<Layout, String> {
    fn kind(value: &Value<'_>, records: &mut Vec<Fields>) -> Type {
        match value {
            Value::Bool(_) => Type::Primitive(Primitive::Bool),
            Value::Int(_) => Type::Primitive(Primitive::Int(8)),
            Value::Float(_) => Type::Primitive(Primitive::Float(8)),
            Value::Text(_) => Type::Primitive(Primitive::Text),
            Value::Bytes(_) => Type::bytes(),
            Value::Numbers(_) => Type::Array(Box::new(Type::Primitive(Primitive::Float(8))), None),
            Value::List(values) => {
                let element =
                    values.first().map_or(Type::Primitive(Primitive::Text), |v| kind(v, records));
                Type::Array(Box::new(element), None)
            }
            Value::Record(fields) => {
                let fields =
                    fields.iter().map(|(name, v)| (name.clone(), kind(v, records))).collect();
                records.push(fields);
                Type::Record(records.len() - 1)
            }
        }
    }
    let value = read(None, message)?;
    let mut records = Vec::new();
    kind(&value, &mut records);
    Ok(Layout { records })
}

/// Reads one message; the layout marks the strings that are base64.
///
/// # Errors
/// The message is not a JSON object.
pub fn read<'a>(layout: Option<&Layout>, message: &'a [u8]) -> Result<Value<'a>, String> {
    // serde_json limits the nesting to 128 levels.
    let json: Json =
        serde_json::from_slice(message).map_err(|e| format!("the message is not JSON: {e}"))?;
    if !json.is_object() {
        return Err("the message is not a JSON object".into());
    }
    let root = layout.and_then(|l| l.records.len().checked_sub(1)).map(Type::Record);
    Ok(value(json, layout.zip(root.as_ref()), "").unwrap_or(Value::Record(Vec::new())))
}

/// `None` for null, which means an absent field.
fn value<'a>(json: Json, kind: Option<(&Layout, &Type)>, name: &str) -> Option<Value<'a>> {
    let element = kind.and_then(|(layout, kind)| {
        if let Type::Array(element, _) = kind { Some((layout, element.as_ref())) } else { None }
    });
    let is_bytes = element.is_some_and(|(_, e)| *e == Type::Primitive(Primitive::UInt(1)))
        || kind.is_none() && name == "data";
    Some(match json {
        Json::Null => return None,
        Json::Bool(v) => Value::Bool(v),
        Json::Number(n) => n.as_i64().map(Value::Int).or_else(|| n.as_f64().map(Value::Float))?,
        Json::String(text) => match is_bytes.then(|| BASE64_STANDARD.decode(&text)) {
            Some(Ok(bytes)) => Value::Bytes(Cow::Owned(bytes)),
            _ => Value::Text(Cow::Owned(text)),
        },
        Json::Array(list) => {
            let byte = |v: &Json| v.as_u64().and_then(|v| u8::try_from(v).ok());
            if (is_bytes || name == "data")
                && let Some(bytes) = list.iter().map(byte).collect::<Option<Vec<u8>>>()
            {
                return Some(Value::Bytes(Cow::Owned(bytes)));
            }
            if list.iter().all(|v| v.is_number() || v.is_null()) {
                // JSON has no NaN; writers use null
                Value::Numbers(list.iter().map(|v| v.as_f64().unwrap_or(f64::NAN)).collect())
            } else {
                Value::List(list.into_iter().filter_map(|v| value(v, element, name)).collect())
            }
        }
        Json::Object(map) => {
            let fields = kind.and_then(|(layout, kind)| {
                if let Type::Record(index) = kind {
                    Some((layout, layout.records.get(*index)?))
                } else {
                    None
                }
            });
            let of_field = |name: &str| {
                fields.and_then(|(layout, f)| {
                    Some((layout, &f.iter().find(|(n, _)| **n == *name)?.1))
                })
            };
            Value::Record(
                map.into_iter()
                    .filter_map(|(name, v)| {
                        Some((Arc::from(name.as_str()), value(v, of_field(&name), &name)?))
                    })
                    .collect(),
            )
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn references_are_followed_and_cycles_rejected() {
        let schema = br##"{"properties": {
            "beams": {"type": "array", "items": {"$ref": "#/$defs/beam"}},
            "data": {"type": "string", "contentEncoding": "base64"}},
            "$defs": {"beam": {"type": "object",
                "properties": {"distance": {"type": ["null", "number"]}}}}}"##;
        let layout = parse_schema(schema).expect("a layout");
        assert!(layout.has("beams.distance") && layout.type_at("data") == Some(&Type::bytes()));
        let value = read(Some(&layout), br#"{"beams": [{"distance": 1.5}], "data": "AQI="}"#)
            .expect("a message");
        assert_eq!(
            (value.bytes("data"), value.list("beams").map(|l| l[0].number("distance"))),
            (Some(&[1u8, 2][..]), Some(Some(1.5)))
        );
        let looped = br##"{"properties": {"a": {"$ref": "#"}},
            "$ref": "#/x", "x": {"properties": {"a": {"$ref": "#/x"}}}}"##;
        assert!(parse_schema(looped).expect_err("cycle").contains("contains itself"));
    }

    #[test]
    fn a_message_without_schema_gives_its_own_layout() {
        let layout = layout_of(
            br#"{"header": {"stamp": {"sec": 1, "nanosec": 2}}, "range": [1, null, 2.5, 3]}"#,
        )
        .expect("a layout");
        assert!(layout.has("header.stamp.sec") && layout.is_array("range"));
    }
}
