//! `ros2msg` schema text → the layout of a message on the wire.
//!
//! The text of a channel's own schema decides how its bytes are read, never the type's name: one name
//! (`ds_sensor_msgs/Dvl`) has two incompatible definitions in the field, and one shape has eight names.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::value::same_name;

/// A primitive of the ROS interface language.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Primitive {
    /// `bool`
    Bool,
    /// signed integer of so many bytes
    Int(usize),
    /// unsigned integer of so many bytes
    UInt(usize),
    /// float of so many bytes
    Float(usize),
    /// `string`, also bounded
    Text,
    /// `wstring`, also bounded
    WideText,
}

/// The type of a field.
#[derive(Clone, Debug, PartialEq)]
pub enum Type {
    /// a primitive
    Primitive(Primitive),
    /// a message: index into [`Layout::records`]
    Record(usize),
    /// an array: fixed length, or a length on the wire
    Array(Box<Type>, Option<usize>),
}

/// A message definition and all it depends on.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    /// fields of each message; the last one is the root
    pub records: Vec<Vec<(Arc<str>, Type)>>,
}

/// A line of a definition, types not yet resolved.
struct Line {
    base: String,
    array: Option<Option<usize>>,
    name: String,
}

impl Layout {
    /// Parses a definition with its dependencies behind `===` lines and `MSG: pkg/Type`.
    ///
    /// # Errors
    /// A sentence: an unknown type, a type that holds itself, a line that is no field.
    pub fn parse(name: &str, text: &str) -> Result<Self, String> {
        let mut sections: BTreeMap<String, Vec<Line>> = BTreeMap::new();
        let root = short(name);
        let mut current = Some(root.clone());
        for line in text.lines() {
            let line = line.trim();
            if line.len() >= 3 && line.bytes().all(|b| b == b'=') {
                current = None;
            } else if let Some(dependency) = line.strip_prefix("MSG:") {
                current = Some(short(dependency.trim()));
                sections.entry(short(dependency.trim())).or_default();
            } else if let Some(section) = &current
                && let Some(field) = field(line)?
            {
                sections.entry(section.clone()).or_default().push(field);
            }
        }
        sections.entry(root.clone()).or_default();
        for (known, fields) in [
            ("builtin_interfaces/Time", ["int32 sec", "uint32 nanosec"]),
            ("builtin_interfaces/Duration", ["int32 sec", "uint32 nanosec"]),
            ("std_msgs/Header", ["builtin_interfaces/Time stamp", "string frame_id"]),
        ] {
            if !sections.contains_key(known) {
                let fields = fields.iter().filter_map(|l| field(l).transpose()).collect::<Result<_, _>>()?;
                sections.insert(known.into(), fields);
            }
        }
        let mut builder = Builder { sections: &sections, done: BTreeMap::new(), open: Vec::new(), records: Vec::new() };
        builder.record(&root)?;
        Ok(Self { records: builder.records })
    }

    /// The root message's fields.
    pub fn root(&self) -> &[(Arc<str>, Type)] {
        self.records.last().map_or(&[], Vec::as_slice)
    }

    /// Whether a dotted path exists; arrays are passed through (`beams.distance`).
    pub fn has(&self, path: &str) -> bool {
        self.type_at(path).is_some()
    }

    /// The type at a dotted path; arrays are passed through.
    pub fn type_at(&self, path: &str) -> Option<&Type> {
        let mut fields = self.root();
        let mut names = path.split('.').peekable();
        while let Some(name) = names.next() {
            let (_, kind) = fields.iter().find(|(n, _)| same_name(n, name))?;
            if names.peek().is_none() {
                return Some(kind);
            }
            let mut inner = kind;
            while let Type::Array(element, _) = inner {
                inner = element;
            }
            let Type::Record(index) = inner else { return None };
            fields = self.records.get(*index)?;
        }
        None
    }
}

struct Builder<'t> {
    sections: &'t BTreeMap<String, Vec<Line>>,
    done: BTreeMap<String, usize>,
    open: Vec<String>,
    records: Vec<Vec<(Arc<str>, Type)>>,
}

impl Builder<'_> {
    fn record(&mut self, name: &str) -> Result<usize, String> {
        if let Some(index) = self.done.get(name) {
            return Ok(*index);
        }
        if self.open.iter().any(|n| n == name) {
            return Err(format!("the schema's type {name} holds itself"));
        }
        let lines = self.sections.get(name).ok_or_else(|| format!("the schema does not define its type {name}"))?;
        self.open.push(name.into());
        let mut fields = Vec::with_capacity(lines.len());
        for line in lines {
            let element = match primitive(&line.base) {
                Some(p) => Type::Primitive(p),
                None => Type::Record(self.record(&self.resolve(&line.base, name)?)?),
            };
            let kind = match line.array {
                Some(size) => Type::Array(Box::new(element), size),
                None => element,
            };
            fields.push((Arc::from(line.name.as_str()), kind));
        }
        self.open.pop();
        self.records.push(fields);
        self.done.insert(name.into(), self.records.len() - 1);
        Ok(self.records.len() - 1)
    }

    /// `Header` and types of the same package may come without one.
    fn resolve(&self, base: &str, scope: &str) -> Result<String, String> {
        let base = short(base);
        let package = scope.split('/').next().unwrap_or("");
        let candidates = [base.clone(), format!("{package}/{base}"), format!("std_msgs/{base}"), format!("builtin_interfaces/{base}")];
        candidates
            .into_iter()
            .find(|c| self.sections.contains_key(c))
            .or_else(|| self.sections.keys().find(|k| k.rsplit('/').next() == Some(&base)).cloned())
            .ok_or_else(|| format!("the schema does not define {base}, used in {scope}"))
    }
}

/// `pkg/msg/Type` and `pkg/srv/Type` → `pkg/Type`.
fn short(name: &str) -> String {
    let parts: Vec<&str> = name.split('/').filter(|p| !p.is_empty()).collect();
    match parts.as_slice() {
        [package, _, rest] => format!("{package}/{rest}"),
        _ => parts.join("/"),
    }
}

/// One line of a definition: `None` for blanks, comments and constants.
fn field(line: &str) -> Result<Option<Line>, String> {
    let line = line.split('#').next().unwrap_or("").trim();
    let Some((kind, rest)) = line.split_once(char::is_whitespace) else {
        return if line.is_empty() { Ok(None) } else { Err(format!("the schema line {line:?} is no field")) };
    };
    let rest = rest.trim();
    let name: String = rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
    if name.is_empty() {
        return Err(format!("the schema line {line:?} is no field"));
    }
    if rest[name.len()..].trim_start().starts_with('=') {
        return Ok(None);
    }
    let (base, array) = match kind.split_once('[') {
        None => (kind, None),
        Some((base, size)) => {
            let size = size.trim_end_matches(']');
            let fixed = if size.is_empty() || size.starts_with("<=") {
                None
            } else {
                Some(size.parse().map_err(|_ignored| format!("the array size in {line:?} is no number"))?)
            };
            (base, Some(fixed))
        }
    };
    let base = base.split("<=").next().unwrap_or(base);
    Ok(Some(Line { base: base.into(), array, name }))
}

fn primitive(name: &str) -> Option<Primitive> {
    Some(match name {
        "bool" => Primitive::Bool,
        "int8" => Primitive::Int(1),
        "int16" => Primitive::Int(2),
        "int32" => Primitive::Int(4),
        "int64" => Primitive::Int(8),
        "byte" | "char" | "uint8" => Primitive::UInt(1),
        "uint16" => Primitive::UInt(2),
        "uint32" => Primitive::UInt(4),
        "uint64" => Primitive::UInt(8),
        "float32" => Primitive::Float(4),
        "float64" => Primitive::Float(8),
        "string" => Primitive::Text,
        "wstring" => Primitive::WideText,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_constants_and_relative_names() {
        let text =
            "uint8 MODE=1\nHeader header\nBeam[] beams # four\nfloat64[3] v\nstring<=10 form \"a\"\n===\nMSG: p/Beam\nfloat64 distance\nbool valid\n";
        let layout = Layout::parse("p/msg/Dvl", text).expect("a layout");
        assert!(layout.has("header.stamp.nanosec") && layout.has("beams.distance") && !layout.has("mode"));
        assert_eq!(layout.type_at("v"), Some(&Type::Array(Box::new(Type::Primitive(Primitive::Float(8))), Some(3))));
    }

    #[test]
    fn a_type_that_holds_itself_is_refused() {
        let error = Layout::parse("p/A", "B b\n===\nMSG: p/B\nA a\n").expect_err("recursion");
        assert!(error.contains("holds itself"), "{error}");
    }
}
