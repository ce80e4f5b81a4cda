//! The bytes of written records: <https://mcap.dev/spec>.

use std::collections::BTreeMap;

use mcap::records::op;

use super::super::read::{Channel, Schema};
pub use super::super::read::{MessageHeader, RECORD_HEADER};

/// Builder of a record: opcode, length, body.
pub struct RecordBuilder(Vec<u8>);

impl RecordBuilder {
    pub fn new(opcode: u8) -> Self {
        Self(vec![opcode, 0, 0, 0, 0, 0, 0, 0, 0])
    }

    pub fn bytes(mut self, bytes: &[u8]) -> Self {
        self.0.extend_from_slice(bytes);
        self
    }

    pub fn u16(self, n: u16) -> Self {
        self.bytes(&n.to_le_bytes())
    }

    pub fn u32(self, n: u32) -> Self {
        self.bytes(&n.to_le_bytes())
    }

    pub fn u64(self, n: u64) -> Self {
        self.bytes(&n.to_le_bytes())
    }

    /// Length-prefixed bytes. They came from a record, so the length fits.
    pub fn sized(self, bytes: &[u8]) -> Self {
        self.u32(bytes.len() as u32).bytes(bytes)
    }

    pub fn text(self, text: &str) -> Self {
        self.sized(text.as_bytes())
    }

    pub fn pairs(self, pairs: &BTreeMap<String, String>) -> Self {
        let length: usize = pairs.iter().map(|(k, v)| 8 + k.len() + v.len()).sum();
        pairs.iter().fold(self.u32(length as u32), |record, (k, v)| record.text(k).text(v))
    }

    /// The record without the last `rest` bytes of its body, which are written separately.
    pub fn finish_before(mut self, rest: u64) -> Vec<u8> {
        let length = (self.0.len() - RECORD_HEADER) as u64 + rest;
        self.0[1..RECORD_HEADER].copy_from_slice(&length.to_le_bytes());
        self.0
    }

    pub fn finish(self) -> Vec<u8> {
        self.finish_before(0)
    }
}

pub fn header(profile: &str, library: &str) -> Vec<u8> {
    RecordBuilder::new(op::HEADER).text(profile).text(library).finish()
}

pub fn schema(id: u16, schema: &Schema) -> Vec<u8> {
    RecordBuilder::new(op::SCHEMA)
        .u16(id)
        .text(&schema.name)
        .text(&schema.encoding)
        .sized(&schema.data)
        .finish()
}

pub fn channel(id: u16, channel: &Channel) -> Vec<u8> {
    let record = RecordBuilder::new(op::CHANNEL)
        .u16(id)
        .u16(channel.schema_id)
        .text(&channel.topic)
        .text(&channel.message_encoding);
    record.pairs(&channel.metadata).finish()
}

/// A message record without its payload of `size` bytes.
pub fn message(header: &MessageHeader, size: usize) -> Vec<u8> {
    RecordBuilder::new(op::MESSAGE)
        .u16(header.channel)
        .u32(header.sequence)
        .u64(header.log_time)
        .u64(header.publish_time)
        .finish_before(size as u64)
}

/// Index of a channel's messages in a chunk: log time (ns) and offset (byte).
pub fn message_index(channel: u16, messages: &[(u64, u64)]) -> Vec<u8> {
    let record = RecordBuilder::new(op::MESSAGE_INDEX).u16(channel).u32(16 * messages.len() as u32);
    messages.iter().fold(record, |record, (time, offset)| record.u64(*time).u64(*offset)).finish()
}

pub fn metadata(name: &str, pairs: &BTreeMap<String, String>) -> Vec<u8> {
    RecordBuilder::new(op::METADATA).text(name).pairs(pairs).finish()
}
