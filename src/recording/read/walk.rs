//! The walk over the heads of a file's records, by which its blocks are known.

use std::io;
use std::ops::Range;

use mcap::records::{Record, op};

use super::super::source::Source;
use super::block::{Block, MESSAGE_HEAD, chunk_head, message_head};
use super::lengths::lengths_fit;
use super::{Damage, Recording};

pub const MAGIC: &[u8] = &[0x89, b'M', b'C', b'A', b'P', 0x30, b'\r', b'\n'];
pub const RECORD_HEAD: u64 = 9;

/// Read at once; several heads lie in it where records are small [byte].
const STEP: u64 = 4096;
/// Most that the head of a chunk takes [byte].
const CHUNK_HEAD: u64 = 1024;
/// Messages outside of chunks are read together up to here [byte].
const STRETCH: u64 = 1 << 20;
/// Longer than any schema or metadata record: a length that says so is damaged [byte].
const LONGEST: u64 = 64 << 20;

/// A buffer that goes along with the walk.
struct Reader<'s> {
    source: &'s Source,
    at: u64,
    buffer: Vec<u8>,
}

impl Reader<'_> {
    /// A short stretch, as far as the file goes.
    fn peek(&mut self, place: Range<u64>) -> io::Result<&[u8]> {
        let place = place.start..place.end.min(self.source.length());
        if place.is_empty() {
            return Ok(&[]);
        }
        if place.start < self.at || place.end > self.at + self.buffer.len() as u64 {
            let end = place.end.max(place.start + STEP).min(self.source.length());
            self.buffer = self.source.bytes(place.start..end)?;
            self.at = place.start;
        }
        let first = (place.start - self.at) as usize;
        Ok(&self.buffer[first..first + (place.end - place.start) as usize])
    }
}

impl Recording {
    /// Walks the file from head to head.
    pub(super) fn index(&mut self) -> io::Result<()> {
        let source = std::sync::Arc::clone(&self.source);
        let mut reader = Reader { source: &source, at: 0, buffer: Vec::new() };
        let length = source.length();
        let mut at = MAGIC.len() as u64;
        loop {
            let start = at.saturating_add(RECORD_HEAD);
            let &[opcode, ref size @ ..] = reader.peek(at..start)? else { break };
            let Ok(size) = <[u8; 8]>::try_from(size) else { break };
            let end = start.checked_add(u64::from_le_bytes(size)).filter(|e| *e <= length);
            let Some(end) = end else {
                if opcode == op::CHUNK {
                    self.add_chunk(reader.peek(start..start + CHUNK_HEAD)?, start..length, false);
                }
                self.cut(at, "the file ends inside a record");
                return Ok(());
            };
            self.record(&mut reader, opcode, start..end)?;
            at = end;
            if opcode == op::FOOTER {
                // The footer's first number says where the summary begins.
                self.has_summary = reader.peek(start..start + 8)? != [0; 8];
                self.is_complete =
                    source.bytes(at..length.min(at + 1 + MAGIC.len() as u64))? == MAGIC;
                if !self.is_complete {
                    self.cut(at, "the file does not end as an MCAP should");
                }
                return Ok(());
            }
        }
        self.cut(at, "the file was cut short: there is no footer");
        Ok(())
    }

    fn cut(&mut self, at: u64, reason: &str) {
        self.damage.push(Damage { offset: at, start_ns: 0, end_ns: 0, reason: reason.into() });
    }

    fn record(&mut self, reader: &mut Reader<'_>, opcode: u8, body: Range<u64>) -> io::Result<()> {
        match opcode {
            op::CHUNK => {
                let head = reader.peek(body.start..body.end.min(body.start + CHUNK_HEAD))?;
                self.add_chunk(head, body, true);
            }
            op::MESSAGE_INDEX => {
                let head = reader.peek(body.start..body.end.min(body.start + 6))?;
                if let (Some(chunk), &[a, b, ref size @ ..]) = (self.blocks.last_mut(), head)
                    && size != [0; 4]
                {
                    chunk.channels.push(u16::from_le_bytes([a, b]));
                }
            }
            op::MESSAGE => {
                let head =
                    reader.peek(body.start..body.end.min(body.start + MESSAGE_HEAD as u64))?;
                if let Some(head) = message_head(head) {
                    self.add_bare(body, head.log_time, head.channel);
                }
            }
            op::ATTACHMENT => self.attachments.push(body),
            op::HEADER | op::SCHEMA | op::CHANNEL | op::METADATA
                if body.end - body.start > LONGEST =>
            {
                self.cut(body.start, "a record cannot be read: it is too long to be what it says");
            }
            op::HEADER | op::SCHEMA | op::CHANNEL | op::METADATA => {
                let bytes = reader.peek(body.clone())?;
                if !lengths_fit(opcode, bytes) {
                    self.cut(
                        body.start,
                        "a record cannot be read: the lengths inside it do not add up",
                    );
                    return Ok(());
                }
                match mcap::parse_record(opcode, bytes) {
                    Ok(Record::Header(header)) => self.profile = header.profile,
                    Ok(Record::Metadata(metadata)) => self.metadata.push(metadata),
                    Ok(record) => self.declare(record),
                    Err(e) => self.cut(body.start, &format!("a record cannot be read: {e}")),
                }
            }
            _ => {}
        }
        Ok(())
    }

    fn add_chunk(&mut self, head: &[u8], body: Range<u64>, whole: bool) {
        let Some(head) = chunk_head(head) else {
            return self.cut(body.start, "a chunk without a head");
        };
        *self
            .compressions
            .entry(if head.compression.is_empty() {
                "none".into()
            } else {
                head.compression.clone()
            })
            .or_default() += 1;
        self.blocks.push(Block::chunk(body, whole, &head));
    }

    /// Neighbours are read together; what they cost in memory does not grow with their number.
    fn add_bare(&mut self, body: Range<u64>, log_time: u64, channel: u16) {
        self.bare_messages += 1;
        let record = body.start - RECORD_HEAD..body.end;
        match self.blocks.last_mut() {
            Some(last) if last.takes(&record, STRETCH) => {
                last.extend(record.end, log_time, channel)
            }
            _ => self.blocks.push(Block::bare(record, log_time, channel)),
        }
    }
}
