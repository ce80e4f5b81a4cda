//! A message of a log.

use std::ops::Range;
use std::sync::Arc;

use super::records::{MESSAGE_HEADER, MessageHeader};
use crate::units::Stamp;

/// A message. Its payload is shared with the block it was read with.
#[derive(Clone)]
pub struct Message {
    /// channel id
    pub channel: u16,
    /// 0 where the recorder does not number messages
    pub sequence: u32,
    /// when it was recorded [ns]
    pub log_time: u64,
    /// when it was published [ns]
    pub publish_time: u64,
    buffer: Arc<Vec<u8>>,
    payload: Range<usize>,
}

impl Message {
    /// From a message record, whose body is this range of the buffer.
    pub(super) fn parse(buffer: &Arc<Vec<u8>>, body: Range<usize>) -> Option<Self> {
        let header = MessageHeader::parse(buffer.get(body.clone())?)?;
        Some(Self {
            channel: header.channel,
            sequence: header.sequence,
            log_time: header.log_time,
            publish_time: header.publish_time,
            buffer: Arc::clone(buffer),
            payload: body.start + MESSAGE_HEADER..body.end,
        })
    }

    /// The payload.
    pub fn data(&self) -> &[u8] {
        self.buffer.get(self.payload.clone()).unwrap_or_default()
    }

    /// The log time as a stamp.
    pub fn log_stamp(&self) -> Stamp {
        Stamp(i64::try_from(self.log_time).unwrap_or(i64::MAX))
    }

    /// The same message without its payload; this releases the block.
    #[must_use]
    pub fn without_data(self) -> Self {
        Self { buffer: Arc::default(), payload: 0..0, ..self }
    }
}
