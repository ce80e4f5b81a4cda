//! A decoded message of any wire format: a tree of named fields that borrows the message's bytes.
//!
//! Fields are accessed by path (`"header.stamp.sec"`). Names are compared without case and
//! underscores: ROS 1 has `K` where ROS 2 has `k`, and drivers rename at will.

use std::borrow::Cow;
use std::sync::Arc;

/// One decoded value.
#[derive(Clone, Debug, PartialEq)]
pub enum Value<'a> {
    /// boolean
    Bool(bool),
    /// integer of any size
    Int(i64),
    /// 32- or 64-bit float
    Float(f64),
    /// string
    Text(Cow<'a, str>),
    /// `uint8[]`; borrowed, so an image is not copied
    Bytes(Cow<'a, [u8]>),
    /// array of any other numeric type
    Numbers(Vec<f64>),
    /// array of messages or strings
    List(Vec<Value<'a>>),
    /// message: fields in the order of the schema
    Record(Vec<(Arc<str>, Value<'a>)>),
}

fn plain(name: &str) -> impl Iterator<Item = char> {
    name.chars().filter(|c| *c != '_').map(|c| c.to_ascii_lowercase())
}

/// A name without case and underscores.
pub fn plain_name(name: &str) -> String {
    plain(name).collect()
}

/// Whether two names are equal without case and underscores.
pub fn same_name(a: &str, b: &str) -> bool {
    a == b || plain(a).eq(plain(b))
}

impl<'a> Value<'a> {
    /// The value with bytes and strings of its own.
    pub fn into_owned(self) -> Value<'static> {
        match self {
            Self::Bool(v) => Value::Bool(v),
            Self::Int(v) => Value::Int(v),
            Self::Float(v) => Value::Float(v),
            Self::Text(v) => Value::Text(v.into_owned().into()),
            Self::Bytes(v) => Value::Bytes(v.into_owned().into()),
            Self::Numbers(v) => Value::Numbers(v),
            Self::List(v) => Value::List(v.into_iter().map(Self::into_owned).collect()),
            Self::Record(fields) => {
                Value::Record(fields.into_iter().map(|(n, v)| (n, v.into_owned())).collect())
            }
        }
    }

    /// The value at a dotted path.
    pub fn get(&self, path: &str) -> Option<&Self> {
        path.split('.').try_fold(self, |value, name| match value {
            Self::Record(fields) => fields
                .iter()
                .find(|(n, _)| **n == *name)
                .or_else(|| fields.iter().find(|(n, _)| same_name(n, name)))
                .map(|(_, v)| v),
            _ => None,
        })
    }

    /// A number (or a bool as 0 and 1) at a path.
    pub fn number(&self, path: &str) -> Option<f64> {
        match self.get(path)? {
            Self::Float(v) => Some(*v),
            Self::Int(v) => Some(*v as f64),
            Self::Bool(v) => Some(f64::from(u8::from(*v))),
            // protobuf's JSON writes 64-bit integers as text
            Self::Text(v) => v.parse().ok(),
            _ => None,
        }
    }

    /// An integer at a path.
    pub fn integer(&self, path: &str) -> Option<i64> {
        match self.get(path)? {
            Self::Int(v) => Some(*v),
            Self::Bool(v) => Some(i64::from(*v)),
            Self::Float(v) if v.fract() == 0.0 => Some(*v as i64),
            Self::Text(v) => v.parse().ok(),
            _ => None,
        }
    }

    /// A size or count at a path; `None` where it is negative.
    pub fn size(&self, path: &str) -> Option<usize> {
        self.integer(path).and_then(|v| usize::try_from(v).ok())
    }

    /// A bool at a path; numbers other than 0 are true.
    pub fn flag(&self, path: &str) -> Option<bool> {
        self.number(path).map(|v| v != 0.0)
    }

    /// A string at a path.
    pub fn text(&self, path: &str) -> Option<&str> {
        match self.get(path)? {
            Self::Text(v) => Some(v),
            _ => None,
        }
    }

    /// Raw bytes at a path.
    pub fn bytes(&self, path: &str) -> Option<&[u8]> {
        match self.get(path)? {
            Self::Bytes(v) => Some(v),
            _ => None,
        }
    }

    /// An array of numbers at a path.
    pub fn numbers(&self, path: &str) -> Option<Vec<f64>> {
        match self.get(path)? {
            Self::Numbers(v) => Some(v.clone()),
            Self::Bytes(v) => Some(v.iter().map(|b| f64::from(*b)).collect()),
            _ => None,
        }
    }

    /// An array of messages at a path.
    pub fn list(&self, path: &str) -> Option<&[Self]> {
        match self.get(path)? {
            Self::List(v) => Some(v),
            _ => None,
        }
    }

    /// x, y, z of a vector at a path.
    pub fn xyz(&self, path: &str) -> Option<[f64; 3]> {
        let v = self.get(path)?;
        Some([v.number("x")?, v.number("y")?, v.number("z")?])
    }

    /// x, y, z, w of a quaternion at a path.
    pub fn xyzw(&self, path: &str) -> Option<[f64; 4]> {
        let v = self.get(path)?;
        Some([v.number("x")?, v.number("y")?, v.number("z")?, v.number("w")?])
    }
}

/// Limit on the number of values decoded from one message: in proportion to its size, whatever
/// lengths it claims.
pub struct Budget(usize);

impl Budget {
    /// The budget of a message.
    pub fn of(message: &[u8]) -> Self {
        Self(4096 + 16 * message.len())
    }

    /// Counts `values` more values.
    ///
    /// # Errors
    /// The budget is exceeded.
    pub fn spend(&mut self, values: usize) -> Result<(), String> {
        self.0 = self
            .0
            .checked_sub(values)
            .ok_or("the message claims more values than its size can hold")?;
        Ok(())
    }
}
