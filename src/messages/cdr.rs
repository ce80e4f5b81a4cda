//! Reads OMG CDR as ROS 2 writes it, in both byte orders, and ROS 1 serialisation, which is the
//! same without encapsulation header, alignment and NUL.
//!
//! Memory is bounded by the message: a sequence that claims more elements than there are bytes left
//! is an error before anything is allocated. Alignment counts from the end of the 4-byte
//! encapsulation header.

use std::borrow::Cow;

use super::layout::{Layout, Primitive, Type};
use super::value::{Budget, Value};

/// Reads one CDR message by its layout.
///
/// # Errors
/// The message ends early or contradicts its schema.
pub fn read<'a>(layout: &Layout, message: &'a [u8]) -> Result<Value<'a>, String> {
    Reader::of_cdr(message)?.root(layout)
}

/// Whether a message, CDR or ROS 1, can be read by this layout to its last byte.
pub fn is_exact(layout: &Layout, message: &[u8], is_ros1: bool) -> bool {
    let reader = if is_ros1 { Ok(Reader::of_ros1(message)) } else { Reader::of_cdr(message) };
    reader.is_ok_and(|mut reader| {
        // CDR may be padded to a multiple of four.
        let padding = if is_ros1 { 0 } else { 3 };
        reader.root(layout).is_ok() && reader.body.len() - reader.at <= padding
    })
}

/// Reads one ROS 1 message by its layout.
///
/// # Errors
/// As [`read`].
pub fn read_ros1<'a>(layout: &Layout, message: &'a [u8]) -> Result<Value<'a>, String> {
    Reader::of_ros1(message).root(layout)
}

struct Reader<'a> {
    body: &'a [u8],
    at: usize,
    little: bool,
    /// true for CDR, false for ROS 1
    aligned: bool,
    budget: Budget,
}

impl<'a> Reader<'a> {
    fn of_cdr(message: &'a [u8]) -> Result<Self, String> {
        let [0, flags, _, _, body @ ..] = message else {
            return Err(format!("no CDR encapsulation header in {} bytes", message.len()));
        };
        if *flags > 1 {
            return Err(format!("CDR representation {flags:#04x} is not plain CDR"));
        }
        let budget = Budget::of(body);
        Ok(Self { body, at: 0, little: *flags == 1, aligned: true, budget })
    }

    fn of_ros1(body: &'a [u8]) -> Self {
        Self { body, at: 0, little: true, aligned: false, budget: Budget::of(body) }
    }

    fn root(&mut self, layout: &Layout) -> Result<Value<'a>, String> {
        self.record(layout, layout.records.len().checked_sub(1).ok_or("the schema is empty")?)
    }

    fn take(&mut self, size: usize) -> Result<&'a [u8], String> {
        let end = self.at.checked_add(size).filter(|e| *e <= self.body.len());
        let end = end.ok_or_else(|| {
            format!("the message ends at byte {} where {size} more are needed", self.body.len())
        })?;
        let bytes = &self.body[self.at..end];
        self.at = end;
        Ok(bytes)
    }

    fn number<const N: usize>(&mut self) -> Result<[u8; N], String> {
        if self.aligned {
            self.at = self.at.next_multiple_of(N);
        }
        let mut bytes = [0; N];
        bytes.copy_from_slice(self.take(N)?);
        if !self.little {
            bytes.reverse();
        }
        Ok(bytes)
    }

    fn unsigned(&mut self, size: usize) -> Result<u64, String> {
        Ok(match size {
            1 => u64::from(self.take(1)?[0]),
            2 => u64::from(u16::from_le_bytes(self.number()?)),
            4 => u64::from(u32::from_le_bytes(self.number()?)),
            _ => u64::from_le_bytes(self.number()?),
        })
    }

    fn length(&mut self) -> Result<usize, String> {
        Ok(self.unsigned(4)? as usize)
    }

    fn float(&mut self, size: usize) -> Result<f64, String> {
        Ok(if size == 4 {
            f64::from(f32::from_le_bytes(self.number()?))
        } else {
            f64::from_le_bytes(self.number()?)
        })
    }

    fn primitive(&mut self, kind: Primitive) -> Result<Value<'a>, String> {
        Ok(match kind {
            Primitive::Bool => Value::Bool(self.take(1)?[0] != 0),
            Primitive::UInt(size) => Value::Int(self.unsigned(size)? as i64),
            Primitive::Int(size) => {
                let shift = 64 - 8 * size as u32;
                Value::Int(((self.unsigned(size)? << shift) as i64) >> shift)
            }
            Primitive::Float(size) => Value::Float(self.float(size)?),
            Primitive::Text => {
                let length = self.length()?;
                let bytes = self.take(length)?;
                Value::Text(String::from_utf8_lossy(bytes.strip_suffix(&[0]).unwrap_or(bytes)))
            }
            Primitive::WideText => {
                let length = self.length()?;
                if length > self.body.len().saturating_sub(self.at) {
                    return Err("a wide string is longer than its message".into());
                }
                let units = (0..length)
                    .map(|_| self.unsigned(2).map(|u| u as u16))
                    .collect::<Result<Vec<_>, _>>()?;
                Value::Text(Cow::Owned(String::from_utf16_lossy(&units)))
            }
        })
    }

    fn value(&mut self, layout: &Layout, kind: &Type) -> Result<Value<'a>, String> {
        match kind {
            Type::Primitive(p) => self.primitive(*p),
            Type::Record(index) => self.record(layout, *index),
            Type::Array(element, fixed) => {
                let count = match fixed {
                    Some(count) => *count,
                    None => self.length()?,
                };
                // Every element has at least one byte (an empty ROS 1 message has none, but
                // counts against the budget): a false length is an error before it allocates.
                if count > self.body.len().saturating_sub(self.at) {
                    return Err(format!(
                        "an array of {count} elements in the remaining {} bytes",
                        self.body.len().saturating_sub(self.at)
                    ));
                }
                match element.as_ref() {
                    Type::Primitive(Primitive::UInt(1)) => {
                        Ok(Value::Bytes(Cow::Borrowed(self.take(count)?)))
                    }
                    Type::Primitive(Primitive::Float(size)) => (0..count)
                        .map(|_| self.float(*size))
                        .collect::<Result<_, _>>()
                        .map(Value::Numbers),
                    Type::Primitive(
                        p @ (Primitive::Bool | Primitive::Int(_) | Primitive::UInt(_)),
                    ) => (0..count)
                        .map(|_| match self.primitive(*p)? {
                            Value::Int(v) => Ok(v as f64),
                            Value::Bool(v) => Ok(f64::from(u8::from(v))),
                            _ => Err(String::from("not a number")),
                        })
                        .collect::<Result<_, _>>()
                        .map(Value::Numbers),
                    other => (0..count)
                        .map(|_| self.value(layout, other))
                        .collect::<Result<_, _>>()
                        .map(Value::List),
                }
            }
        }
    }

    fn record(&mut self, layout: &Layout, index: usize) -> Result<Value<'a>, String> {
        let fields = layout.records.get(index).ok_or("a schema index is out of range")?;
        self.budget.spend(1 + fields.len())?;
        if fields.is_empty() && self.aligned {
            self.take(1)?; // an empty ROS 2 message has one unused byte
        }
        fields
            .iter()
            .map(|(name, kind)| Ok((name.clone(), self.value(layout, kind)?)))
            .collect::<Result<_, String>>()
            .map(Value::Record)
    }
}

#[cfg(test)]
mod tests {
    use super::super::ros_schema::{Dialect, parse};
    use super::super::writer::{WireFormat, Writer};
    use super::*;

    fn layout(text: &str) -> Result<Layout, String> {
        parse("t/T", text, Dialect::Ros2)
    }

    #[test]
    fn written_messages_are_read_back() {
        let layout = layout(
            "std_msgs/Header header\nuint8 a\nfloat64[2] v\nfloat64[] w\nuint8[] data\nstring s\n",
        )
        .expect("layout");
        let bytes = Writer::new(WireFormat::Cdr)
            .header(7, 9, "cam")
            .u8(3)
            .f64_array(&[1.0, -2.0])
            .f64_sequence(&[5.5])
            .bytes(&[1, 2, 3])
            .text("end")
            .finish();
        let value = read(&layout, &bytes).expect("value");
        assert_eq!(
            (value.integer("header.stamp.sec"), value.text("header.frame_id")),
            (Some(7), Some("cam"))
        );
        assert_eq!(
            (value.numbers("v"), value.numbers("w")),
            (Some(vec![1.0, -2.0]), Some(vec![5.5]))
        );
        assert_eq!((value.bytes("data"), value.text("s")), (Some(&[1u8, 2, 3][..]), Some("end")));
        for cut in 0..bytes.len() {
            assert!(read(&layout, &bytes[..cut]).is_err(), "cut at {cut}");
        }
    }

    #[test]
    fn a_false_length_allocates_nothing() {
        let layout = layout("float64[] w\n").expect("layout");
        let bytes = Writer::new(WireFormat::Cdr).u32(u32::MAX).finish();
        assert!(read(&layout, &bytes).expect_err("false length").contains("elements"));
    }
}
