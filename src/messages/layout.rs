//! The layout of a message, whatever language its schema is written in: named fields, arrays,
//! messages in messages.
//!
//! A schema is foreign text: types that hold themselves and nesting without end are refused with a
//! sentence.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::value::same_name;

/// A primitive of the interface languages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Primitive {
    /// true or false, one byte
    Bool,
    /// signed integer of so many bytes
    Int(usize),
    /// unsigned integer of so many bytes
    UInt(usize),
    /// float of so many bytes
    Float(usize),
    /// text, also bounded
    Text,
    /// text of 16-bit units, also bounded
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

impl Type {
    /// Bytes as they are: a picture, mostly.
    pub fn bytes() -> Self {
        Self::Array(Box::new(Self::Primitive(Primitive::UInt(1))), None)
    }
}

/// Fields of one message, in the order of its schema.
pub type Fields = Vec<(Arc<str>, Type)>;

/// A message definition and all it depends on.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    /// fields of each message; the last one is the root
    pub records: Vec<Fields>,
}

/// Messages nested deeper than this are no sensor's.
pub const MOST_NESTED: usize = 64;

impl Layout {
    /// The root message's fields.
    pub fn root(&self) -> &[(Arc<str>, Type)] {
        self.records.last().map_or(&[], Vec::as_slice)
    }

    /// Whether a dotted path exists; arrays are passed through (`beams.distance`).
    pub fn has(&self, path: &str) -> bool {
        self.type_at(path).is_some()
    }

    /// Whether all of these paths exist.
    pub fn has_all(&self, paths: &[&str]) -> bool {
        paths.iter().all(|p| self.has(p))
    }

    /// Whether the path exists and is an array.
    pub fn is_array(&self, path: &str) -> bool {
        matches!(self.type_at(path), Some(Type::Array(..)))
    }

    /// Whether the path exists and is one number.
    pub fn is_number(&self, path: &str) -> bool {
        use Primitive::{Float, Int, UInt};
        matches!(self.type_at(path), Some(Type::Primitive(Float(_) | Int(_) | UInt(_))))
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

/// A type as it is written, names not yet resolved.
#[derive(Clone, Debug, PartialEq)]
pub enum Written {
    /// a primitive
    Primitive(Primitive),
    /// a message, by whatever name
    Named(String),
    /// an array of something
    Array(Box<Written>, Option<usize>),
}

/// A field as it is written.
#[derive(Clone, Debug, PartialEq)]
pub struct WrittenField {
    /// its name
    pub name: String,
    /// its type
    pub kind: Written,
}

/// Definitions by full name.
pub type Definitions = BTreeMap<String, Vec<WrittenField>>;

/// Definitions → layout, and the full name of each of its records. `resolve` finds the full name of
/// a name used inside another definition.
///
/// # Errors
/// A sentence: a type that nobody defines or that holds itself.
pub fn build(
    definitions: &Definitions,
    root: &str,
    resolve: &dyn Fn(&str, &str) -> Option<String>,
) -> Result<(Layout, Vec<String>), String> {
    let mut builder = Builder {
        definitions,
        resolve,
        done: BTreeMap::new(),
        open: Vec::new(),
        records: Vec::new(),
        names: Vec::new(),
    };
    builder.record(root)?;
    Ok((Layout { records: builder.records }, builder.names))
}

struct Builder<'d> {
    definitions: &'d Definitions,
    resolve: &'d dyn Fn(&str, &str) -> Option<String>,
    done: BTreeMap<String, usize>,
    open: Vec<String>,
    records: Vec<Fields>,
    names: Vec<String>,
}

impl Builder<'_> {
    fn record(&mut self, name: &str) -> Result<usize, String> {
        if let Some(index) = self.done.get(name) {
            return Ok(*index);
        }
        if self.open.iter().any(|n| n == name) {
            return Err(format!("the schema's type {name} holds itself"));
        }
        if self.open.len() >= MOST_NESTED {
            return Err(format!("the schema nests more than {MOST_NESTED} types"));
        }
        let written = self
            .definitions
            .get(name)
            .ok_or_else(|| format!("the schema does not define its type {name}"))?;
        self.open.push(name.into());
        let fields = written
            .iter()
            .map(|f| Ok((Arc::from(f.name.as_str()), self.kind(&f.kind, name)?)))
            .collect::<Result<_, String>>()?;
        self.open.pop();
        self.records.push(fields);
        self.names.push(name.into());
        self.done.insert(name.into(), self.records.len() - 1);
        Ok(self.records.len() - 1)
    }

    fn kind(&mut self, written: &Written, scope: &str) -> Result<Type, String> {
        Ok(match written {
            Written::Primitive(p) => Type::Primitive(*p),
            Written::Array(element, size) => {
                Type::Array(Box::new(self.kind(element, scope)?), *size)
            }
            Written::Named(name) => {
                let full = (self.resolve)(name, scope)
                    .ok_or_else(|| format!("the schema does not define {name}, used in {scope}"))?;
                Type::Record(self.record(&full)?)
            }
        })
    }
}
