//! Schemas, channels, damage and time windows.

use std::collections::BTreeMap;

use mcap::records::Record;

/// A schema of the log.
#[derive(Clone, Debug, PartialEq)]
pub struct Schema {
    /// of the message type
    pub name: String,
    /// `ros2msg`, …
    pub encoding: String,
    /// the definition
    pub data: Vec<u8>,
}

/// A channel of the log.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// 0 for none
    pub schema_id: u16,
    /// of the messages
    pub topic: String,
    /// `cdr`, …
    pub message_encoding: String,
    /// from the recorder (QoS)
    pub metadata: BTreeMap<String, String>,
}

/// A part of the file that cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
pub struct Damage {
    /// in the file (byte)
    pub offset: u64,
    /// first log time affected (ns); 0 where unknown
    pub start_ns: u64,
    /// last log time affected (ns); 0 where unknown
    pub end_ns: u64,
    /// cause
    pub reason: String,
}

impl Damage {
    /// Damage of unknown log time.
    pub(super) fn at(offset: u64, reason: impl Into<String>) -> Self {
        Self { offset, start_ns: 0, end_ns: 0, reason: reason.into() }
    }
}

/// A range of log time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// inclusive (ns)
    pub start: u64,
    /// exclusive (ns); `u64::MAX` for no limit
    pub end: u64,
}

impl Window {
    /// All log times.
    pub const ALL: Self = Self { start: 0, end: u64::MAX };

    /// Whether a log time lies inside.
    pub fn contains(&self, log_time: u64) -> bool {
        log_time >= self.start && self.is_before_end(log_time)
    }

    /// Whether any log time from `first` to `last` lies inside.
    pub fn overlaps(&self, (first, last): (u64, u64)) -> bool {
        last >= self.start && self.is_before_end(first)
    }

    fn is_before_end(&self, log_time: u64) -> bool {
        log_time < self.end || self.end == u64::MAX
    }
}

/// Schemas and channels by id. The first declaration of an id is valid.
#[derive(Default)]
pub struct Declarations {
    /// by id
    pub schemas: BTreeMap<u16, Schema>,
    /// by id
    pub channels: BTreeMap<u16, Channel>,
}

impl Declarations {
    pub(super) fn add(&mut self, record: Record<'_>) {
        match record {
            Record::Schema { header, data } if header.id != 0 => {
                let schema = Schema {
                    name: header.name,
                    encoding: header.encoding,
                    data: data.into_owned(),
                };
                self.schemas.entry(header.id).or_insert(schema);
            }
            Record::Channel(c) => {
                let channel = Channel {
                    schema_id: c.schema_id,
                    topic: c.topic,
                    message_encoding: c.message_encoding,
                    metadata: c.metadata,
                };
                self.channels.entry(c.id).or_insert(channel);
            }
            _ => {}
        }
    }
}

/// An unused id: after the last one, else in a gap. 0 means no schema.
pub fn free_id<T>(used: &BTreeMap<u16, T>) -> Option<u16> {
    let next = used.last_key_value().map_or(Some(1), |(last, _)| last.checked_add(1));
    next.or_else(|| (1..=u16::MAX).find(|id| !used.contains_key(id)))
}
