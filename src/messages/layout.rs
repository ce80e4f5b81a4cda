//! The layout of a message, independent of its schema language: named fields, arrays, nested
//! messages.
//!
//! Schemas are untrusted input: recursive types and excessive nesting are errors.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::value::same_name;

/// A primitive of the interface languages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Primitive {
    /// one byte
    Bool,
    /// signed integer; size (byte)
    Int(usize),
    /// unsigned integer; size (byte)
    UInt(usize),
    /// IEEE float; size (byte)
    Float(usize),
    /// string, also bounded
    Text,
    /// string of 16-bit units, also bounded
    WideText,
}

/// The type of a field.
#[derive(Clone, Debug, PartialEq)]
pub enum Type {
    /// number, bool or string
    Primitive(Primitive),
    /// message: index into [`Layout::records`]
    Record(usize),
    /// array: fixed length, or `None` for a length on the wire
    Array(Box<Type>, Option<usize>),
}

impl Type {
    /// `uint8[]`, mostly image data.
    pub fn bytes() -> Self {
        Self::Array(Box::new(Self::Primitive(Primitive::UInt(1))), None)
    }
}

/// Fields of one message, in the order of its schema.
pub type Fields = Vec<(Arc<str>, Type)>;

/// A message definition with its dependencies.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    /// fields of each message; the last one is the root
    pub records: Vec<Fields>,
}

/// Deepest nesting of messages that is accepted.
pub const MAX_NESTING: usize = 64;

impl Layout {
    /// The root message's fields.
    pub fn root(&self) -> &[(Arc<str>, Type)] {
        self.records.last().map_or(&[], Vec::as_slice)
    }

    /// Whether a dotted path exists; a path may lead through arrays (`beams.distance`).
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

    /// The type at a dotted path, which may lead through arrays.
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

/// A type of a schema, names not yet resolved.
#[derive(Clone, Debug, PartialEq)]
pub enum UnresolvedType {
    /// number, bool or string
    Primitive(Primitive),
    /// message, by its name as written
    Named(String),
    /// array: fixed length, or `None` for a length on the wire
    Array(Box<UnresolvedType>, Option<usize>),
}

/// A field of a schema.
#[derive(Clone, Debug, PartialEq)]
pub struct UnresolvedField {
    /// as written in the schema
    pub name: String,
    /// of the field
    pub kind: UnresolvedType,
}

/// Definitions by full name.
pub type Definitions = BTreeMap<String, Vec<UnresolvedField>>;

/// The layout of a set of definitions, and the full name of each of its records. `resolve` maps a
/// name and the definition that uses it to a full name.
///
/// # Errors
/// A type is undefined or recursive.
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
            return Err(format!("the schema's type {name} contains itself"));
        }
        if self.open.len() >= MAX_NESTING {
            return Err(format!("the schema nests more than {MAX_NESTING} types"));
        }
        let unresolved = self
            .definitions
            .get(name)
            .ok_or_else(|| format!("the schema does not define its type {name}"))?;
        self.open.push(name.into());
        let fields = unresolved
            .iter()
            .map(|f| Ok((Arc::from(f.name.as_str()), self.kind(&f.kind, name)?)))
            .collect::<Result<_, String>>()?;
        self.open.pop();
        self.records.push(fields);
        self.names.push(name.into());
        self.done.insert(name.into(), self.records.len() - 1);
        Ok(self.records.len() - 1)
    }

    fn kind(&mut self, unresolved: &UnresolvedType, scope: &str) -> Result<Type, String> {
        Ok(match unresolved {
            UnresolvedType::Primitive(p) => Type::Primitive(*p),
            UnresolvedType::Array(element, size) => {
                Type::Array(Box::new(self.kind(element, scope)?), *size)
            }
            UnresolvedType::Named(name) => {
                let full = (self.resolve)(name, scope)
                    .ok_or_else(|| format!("the schema does not define {name}, used in {scope}"))?;
                Type::Record(self.record(&full)?)
            }
        })
    }
}
