//! A message of a log.

use std::ops::Range;
use std::sync::Arc;

use super::records::{MESSAGE_HEADER, MessageHeader};
use crate::units::Stamp;

/// Identity of a frame, and of any message: its place in the log. It depends neither on the window
/// that is read nor on any clock.
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    serde::Serialize,
    serde::Deserialize,
)]
pub struct FrameId {
    /// block of the log, counted from 0
    pub block: u32,
    /// message of the block, counted from 0
    pub entry: u32,
}

/// A message. Its payload is shared with the block it was read with.
#[derive(Clone)]
pub struct Message {
    /// its place in the log
    pub id: FrameId,
    /// channel id
    pub channel: u16,
    /// 0 where the recorder does not number messages
    pub sequence: u32,
    /// when it was recorded (ns)
    pub log_time: u64,
    /// when it was published (ns)
    pub publish_time: u64,
    buffer: Arc<Vec<u8>>,
    payload: Range<usize>,
}

impl Message {
    /// From a message record, whose body is this range of the buffer.
    pub(super) fn parse(id: FrameId, buffer: &Arc<Vec<u8>>, body: Range<usize>) -> Option<Self> {
        let header = MessageHeader::parse(buffer.get(body.clone())?)?;
        Some(Self {
            id,
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
