//! A message of a log.

use std::ops::Range;
use std::sync::Arc;

use crate::units::Stamp;

use super::block::{MESSAGE_HEAD, message_head};

/// A message; its bytes belong to the block they were read with.
#[derive(Clone)]
pub struct Message {
    /// id
    pub channel: u16,
    /// number
    pub sequence: u32,
    /// when it was recorded [ns]
    pub log_time: u64,
    /// when it was published [ns]
    pub publish_time: u64,
    buffer: Arc<Vec<u8>>,
    range: Range<usize>,
}

impl Message {
    /// A message from the body of its record, which lies so in the buffer.
    pub(super) fn parse(buffer: &Arc<Vec<u8>>, body: Range<usize>) -> Option<Self> {
        let head = message_head(buffer.get(body.clone())?)?;
        let range = body.start + MESSAGE_HEAD..body.end;
        Some(Self {
            channel: head.channel,
            sequence: head.sequence,
            log_time: head.log_time,
            publish_time: head.publish_time,
            buffer: Arc::clone(buffer),
            range,
        })
    }

    /// The payload.
    pub fn data(&self) -> &[u8] {
        self.buffer.get(self.range.clone()).unwrap_or_default()
    }

    /// The log time as a stamp.
    pub fn log_stamp(&self) -> Stamp {
        Stamp(i64::try_from(self.log_time).unwrap_or(i64::MAX))
    }

    /// The same without its payload, so that the block it was read with can go.
    #[must_use]
    pub fn without_data(self) -> Self {
        Self { buffer: Arc::default(), range: 0..0, ..self }
    }
}
