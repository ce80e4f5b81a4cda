//! The bytes of the records that are written: <https://mcap.dev/spec>.

use std::collections::BTreeMap;

use mcap::records::op;

use super::super::read::{Channel, Schema};

/// A record while it is put together: opcode, length, body.
pub struct RecordBytes(Vec<u8>);

impl RecordBytes {
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

    /// Bytes with their length before them. What is longer than the format can say does not come
    /// in: it was read so.
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

    /// The record, of which `more` bytes of the body follow elsewhere.
    pub fn done_before(mut self, more: u64) -> Vec<u8> {
        let length = (self.0.len() - 9) as u64 + more;
        self.0[1..9].copy_from_slice(&length.to_le_bytes());
        self.0
    }

    pub fn done(self) -> Vec<u8> {
        self.done_before(0)
    }
}

pub fn header(profile: &str, library: &str) -> Vec<u8> {
    RecordBytes::new(op::HEADER).text(profile).text(library).done()
}

pub fn schema(id: u16, schema: &Schema) -> Vec<u8> {
    RecordBytes::new(op::SCHEMA)
        .u16(id)
        .text(&schema.name)
        .text(&schema.encoding)
        .sized(&schema.data)
        .done()
}

pub fn channel(id: u16, channel: &Channel) -> Vec<u8> {
    let record = RecordBytes::new(op::CHANNEL)
        .u16(id)
        .u16(channel.schema_id)
        .text(&channel.topic)
        .text(&channel.message_encoding);
    record.pairs(&channel.metadata).done()
}

/// What stands before a message's payload of such a size: the record's head and the message's.
pub fn message_head(
    channel: u16,
    sequence: u32,
    log_time: u64,
    publish_time: u64,
    size: usize,
) -> [u8; 31] {
    let mut head = [op::MESSAGE; 31];
    head[1..9].copy_from_slice(&(22 + size as u64).to_le_bytes());
    head[9..11].copy_from_slice(&channel.to_le_bytes());
    head[11..15].copy_from_slice(&sequence.to_le_bytes());
    head[15..23].copy_from_slice(&log_time.to_le_bytes());
    head[23..31].copy_from_slice(&publish_time.to_le_bytes());
    head
}

/// Messages of one channel in a chunk: log time [ns] and place [byte].
pub fn message_index(channel: u16, messages: &[(u64, u64)]) -> Vec<u8> {
    let record = RecordBytes::new(op::MESSAGE_INDEX).u16(channel).u32(16 * messages.len() as u32);
    messages.iter().fold(record, |record, (time, place)| record.u64(*time).u64(*place)).done()
}

pub fn metadata(name: &str, pairs: &BTreeMap<String, String>) -> Vec<u8> {
    RecordBytes::new(op::METADATA).text(name).pairs(pairs).done()
}
