//! The index of a file: one pass over the record headers.

use std::collections::BTreeMap;
use std::io;
use std::ops::Range;

use mcap::records::{Metadata, Record, op};
use sha2::Digest as _;

use super::super::source::Source;
use super::block::Block;
use super::records::{
    ChunkHeader, MAGIC, MESSAGE_HEADER, MessageHeader, RECORD_HEADER, lengths_fit,
};
use super::types::{Damage, Declarations};

/// Size of one read, which holds several headers where records are small (byte).
const READ_SIZE: u64 = 4096;
/// Largest header of a chunk (byte).
const MAX_CHUNK_HEADER: u64 = 1024;
/// Messages outside of chunks are joined to blocks up to this size (byte).
const MAX_BARE_BLOCK: u64 = 1 << 20;
/// Beginning of a record's body that enters the fingerprint of the index (byte): a chunk's times,
/// size and checksum, a message's channel, number and times.
const FINGERPRINTED: u64 = 64;
/// Largest schema or metadata record; a longer one is damaged (byte).
const MAX_RECORD: u64 = 64 << 20;

/// Contents of a file, as far as the record headers show them.
#[derive(Default)]
pub struct Index {
    pub blocks: Vec<Block>,
    /// messages outside of chunks
    pub bare_messages: u64,
    pub has_summary: bool,
    /// whether footer and magic are present
    pub is_complete: bool,
    pub profile: String,
    pub declarations: Declarations,
    pub metadata: Vec<Metadata>,
    /// bodies of the attachment records (byte)
    pub attachments: Vec<Range<u64>>,
    pub damage: Vec<Damage>,
    /// number of chunks per compression
    pub compressions: BTreeMap<String, usize>,
    /// of the places and beginnings of all records
    pub hash: sha2::Sha256,
}

impl Index {
    pub fn read(source: &Source) -> io::Result<Self> {
        let buffer = Buffer { source, start: 0, bytes: Vec::new() };
        let mut indexer = Indexer { buffer, index: Self::default() };
        indexer.run()?;
        Ok(indexer.index)
    }
}

/// The part of the file that was read last.
struct Buffer<'s> {
    source: &'s Source,
    /// offset in the file
    start: u64,
    bytes: Vec<u8>,
}

impl Buffer<'_> {
    /// A short range, as far as the file goes.
    fn peek(&mut self, range: Range<u64>) -> io::Result<&[u8]> {
        let range = range.start..range.end.min(self.source.length());
        if range.is_empty() {
            return Ok(&[]);
        }
        if range.start < self.start || range.end > self.start + self.bytes.len() as u64 {
            let end = range.end.max(range.start + READ_SIZE).min(self.source.length());
            self.bytes = self.source.bytes(range.start..end)?;
            self.start = range.start;
        }
        let first = (range.start - self.start) as usize;
        Ok(&self.bytes[first..first + (range.end - range.start) as usize])
    }

    /// The first `max` bytes of a record's body, or all of it.
    fn peek_body(&mut self, body: &Range<u64>, max: u64) -> io::Result<&[u8]> {
        self.peek(body.start..body.end.min(body.start + max))
    }
}

struct Indexer<'s> {
    buffer: Buffer<'s>,
    index: Index,
}

impl Indexer<'_> {
    fn run(&mut self) -> io::Result<()> {
        let length = self.buffer.source.length();
        self.index.hash.update(length.to_le_bytes());
        let mut at = MAGIC.len() as u64;
        loop {
            let start = at.saturating_add(RECORD_HEADER as u64);
            let &[opcode, ref size @ ..] = self.buffer.peek(at..start)? else { break };
            let Ok(size) = <[u8; 8]>::try_from(size) else { break };
            let end = start.checked_add(u64::from_le_bytes(size)).filter(|e| *e <= length);
            let Some(end) = end else {
                if opcode == op::CHUNK {
                    self.add_chunk(start..length, false)?;
                }
                self.add_damage(at, "the file ends inside a record");
                return Ok(());
            };
            self.add(opcode, start..end)?;
            at = end;
            if opcode == op::FOOTER {
                return self.finish(start, end);
            }
        }
        self.add_damage(at, "the file is truncated: there is no footer");
        Ok(())
    }

    /// Reads the footer's body and the magic after it.
    fn finish(&mut self, start: u64, end: u64) -> io::Result<()> {
        // The footer begins with the offset of the summary, 0 for none.
        self.index.has_summary = self.buffer.peek(start..start + 8)? != [0; 8];
        let source = self.buffer.source;
        let trailer = end..source.length().min(end + 1 + MAGIC.len() as u64);
        self.index.is_complete = source.bytes(trailer)? == MAGIC;
        if !self.index.is_complete {
            self.add_damage(end, "the file does not end with the magic of MCAP");
        }
        Ok(())
    }

    fn add_damage(&mut self, offset: u64, reason: impl Into<String>) {
        self.index.damage.push(Damage::at(offset, reason));
    }

    fn add(&mut self, opcode: u8, body: Range<u64>) -> io::Result<()> {
        let beginning = self.buffer.peek_body(&body, FINGERPRINTED)?;
        self.index.hash.update([opcode]);
        self.index.hash.update(body.start.to_le_bytes());
        self.index.hash.update(beginning);
        match opcode {
            op::CHUNK => self.add_chunk(body, true)?,
            op::MESSAGE_INDEX => {
                let head = self.buffer.peek_body(&body, 6)?;
                if let (Some(chunk), &[a, b, ref size @ ..]) = (self.index.blocks.last_mut(), head)
                    && size != [0; 4]
                {
                    chunk.add_channel(u16::from_le_bytes([a, b]));
                }
            }
            op::MESSAGE => {
                let head = self.buffer.peek_body(&body, MESSAGE_HEADER as u64)?;
                if let Some(header) = MessageHeader::parse(head) {
                    self.add_bare(body, &header);
                }
            }
            op::ATTACHMENT => self.index.attachments.push(body),
            op::HEADER | op::SCHEMA | op::CHANNEL | op::METADATA => {
                self.add_declaration(opcode, body)?;
            }
            _ => {}
        }
        Ok(())
    }

    /// Adds a header, schema, channel or metadata record.
    fn add_declaration(&mut self, opcode: u8, body: Range<u64>) -> io::Result<()> {
        let start = body.start;
        if body.end - start > MAX_RECORD {
            self.add_damage(start, "a record cannot be read: it is too long");
            return Ok(());
        }
        let bytes = self.buffer.peek(body)?;
        if !lengths_fit(opcode, bytes) {
            self.add_damage(start, "a record cannot be read: the lengths inside it exceed it");
            return Ok(());
        }
        match mcap::parse_record(opcode, bytes) {
            Ok(Record::Header(header)) => self.index.profile = header.profile,
            Ok(Record::Metadata(metadata)) => self.index.metadata.push(metadata),
            Ok(record) => self.index.declarations.add(record),
            Err(e) => {
                let reason = format!("a record cannot be read: {e}");
                self.add_damage(start, reason);
            }
        }
        Ok(())
    }

    fn add_chunk(&mut self, body: Range<u64>, is_whole: bool) -> io::Result<()> {
        let Some(header) = ChunkHeader::parse(self.buffer.peek_body(&body, MAX_CHUNK_HEADER)?)
        else {
            self.add_damage(body.start, "a chunk has no valid header");
            return Ok(());
        };
        let name = if header.compression.is_empty() { "none" } else { &header.compression };
        *self.index.compressions.entry(name.into()).or_default() += 1;
        self.index.blocks.push(Block::chunk(body, is_whole, &header));
        Ok(())
    }

    /// Joins neighbouring messages to one block, up to a limit that bounds the memory.
    fn add_bare(&mut self, body: Range<u64>, header: &MessageHeader) {
        self.index.bare_messages += 1;
        let MessageHeader { log_time, channel, .. } = *header;
        let record = body.start - RECORD_HEADER as u64..body.end;
        let last = self.index.blocks.last_mut();
        if !last.is_some_and(|last| last.extend(&record, log_time, channel, MAX_BARE_BLOCK)) {
            self.index.blocks.push(Block::bare(record, log_time, channel));
        }
    }
}
