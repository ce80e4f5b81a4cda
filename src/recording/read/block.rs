//! A block of a log: a chunk, or consecutive messages outside of chunks. Blocks are read,
//! decompressed and verified independently of each other, so that threads share the work.

use std::io::{self, Read as _};
use std::ops::Range;
use std::sync::Arc;

use mcap::records::{Record, op};

use super::super::source::Source;
use super::message::{FrameId, Message};
use super::records::{ChunkHeader, RECORD_HEADER, lengths_fit};
use super::types::{Damage, Window};

/// Position of a block in the file, and its properties known without reading it.
#[derive(Clone, Debug)]
pub struct Block {
    /// number of the block in the log, counted from 0
    pub(super) number: u32,
    /// index of the file it is in
    pub(super) part: usize,
    /// a chunk's body, or message records with their headers (byte)
    range: Range<u64>,
    kind: Kind,
    /// first and last log time (ns); (0, 0) where unknown
    times: (u64, u64),
    /// ids of channels that have messages in it; empty where it has no index
    channels: Vec<u16>,
    /// as claimed by the chunk (byte)
    memory: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Chunk { is_whole: bool, has_checksum: bool },
    Bare,
}

impl Block {
    pub(super) fn chunk(body: Range<u64>, is_whole: bool, header: &ChunkHeader) -> Self {
        let is_compressed = !header.compression.is_empty();
        let unpacked = if is_compressed { header.uncompressed_size } else { 0 };
        Self {
            number: 0,
            part: 0,
            memory: (body.end - body.start).saturating_add(unpacked),
            range: body,
            kind: Kind::Chunk { is_whole, has_checksum: header.crc != 0 },
            times: (header.start, header.end),
            channels: Vec::new(),
        }
    }

    /// A message record outside of chunks.
    pub(super) fn bare(record: Range<u64>, log_time: u64, channel: u16) -> Self {
        Self {
            number: 0,
            part: 0,
            memory: record.end - record.start,
            range: record,
            kind: Kind::Bare,
            times: (log_time, log_time),
            channels: vec![channel],
        }
    }

    /// Adds a message record outside of chunks, if it follows this block and the two together are
    /// no longer than `max` (byte). Returns whether it was added.
    pub(super) fn extend(
        &mut self,
        record: &Range<u64>,
        log_time: u64,
        channel: u16,
        max: u64,
    ) -> bool {
        let size = record.end - self.range.start;
        if self.kind != Kind::Bare || self.range.end != record.start || size > max {
            return false;
        }
        self.range.end = record.end;
        self.memory = size;
        self.times = (self.times.0.min(log_time), self.times.1.max(log_time));
        if !self.channels.contains(&channel) {
            self.channels.push(channel);
        }
        true
    }

    /// Adds a channel of the message index.
    pub(super) fn add_channel(&mut self, id: u16) {
        self.channels.push(id);
    }

    /// Renames the channels of the message index.
    pub(super) fn rename_channels(&mut self, renamed: impl Fn(u16) -> u16) {
        self.channels.iter_mut().for_each(|id| *id = renamed(*id));
    }

    /// First and last log time (ns); `None` where unknown.
    pub fn times(&self) -> Option<(u64, u64)> {
        let (start, end) = self.times;
        (end >= start && end > 0).then_some(self.times)
    }

    /// Whether it is a chunk.
    pub fn is_chunk(&self) -> bool {
        self.kind != Kind::Bare
    }

    /// Whether it is a chunk with a checksum.
    pub fn has_checksum(&self) -> bool {
        matches!(self.kind, Kind::Chunk { has_checksum: true, .. })
    }

    /// Memory needed to read it, packed and unpacked, as claimed by the chunk (byte).
    pub fn memory_bytes(&self) -> usize {
        usize::try_from(self.memory).unwrap_or(usize::MAX)
    }

    /// Ids of the channels that have messages in it; `None` where only reading it reveals them.
    pub fn channels(&self) -> Option<&[u16]> {
        (!self.channels.is_empty()).then_some(&self.channels)
    }

    /// Whether a message may lie in the window.
    pub fn may_overlap(&self, window: Window) -> bool {
        let (start, end) = self.times;
        let is_whole = !matches!(self.kind, Kind::Chunk { is_whole: false, .. });
        let is_known = is_whole && end >= start && end > 0;
        !is_known || window.overlaps(self.times)
    }

    /// Offset of its first record (byte).
    pub(super) fn start(&self) -> u64 {
        match self.kind {
            Kind::Bare => self.range.start,
            Kind::Chunk { .. } => self.range.start - RECORD_HEADER as u64,
        }
    }

    /// Reads, decompresses and verifies the block.
    pub(super) fn read(&self, source: &Source, window: Window) -> io::Result<Contents> {
        let raw = Arc::new(source.bytes(self.start()..self.range.end)?);
        let mut contents = match self.kind {
            Kind::Bare => parse_records(&raw, 0..raw.len(), window).contents,
            Kind::Chunk { is_whole, .. } => {
                parse_chunk(Arc::clone(&raw), self.range.start, is_whole, window)
            }
        };
        contents.raw = raw;
        for entry in &mut contents.entries {
            if let Entry::Message(message) = entry {
                message.id.block = self.number;
            }
        }
        Ok(contents)
    }
}

/// A message, or damage in its place.
pub enum Entry {
    /// in the window
    Message(Message),
    /// part of the block that cannot be read
    Damaged(Damage),
}

/// Contents of a block.
#[derive(Default)]
pub struct Contents {
    /// messages in the window and damage, in the order of the file
    pub entries: Vec<Entry>,
    /// its bytes in the file
    pub(super) raw: Arc<Vec<u8>>,
    /// schemas and channels declared inside
    pub(super) declared: Vec<Record<'static>>,
    /// the chunk as in the file, if it is undamaged, consistent with its header, and entirely
    /// inside the window
    pub chunk: Option<RawChunk>,
}

/// A chunk as in the file.
pub struct RawChunk {
    /// with the record's header
    pub record: Arc<Vec<u8>>,
    /// `zstd`, `lz4`, or empty for none
    pub compression: String,
    /// (byte)
    pub uncompressed_size: u64,
    /// first and last log time (ns); (0, 0) without messages
    pub times: (u64, u64),
    /// channel id, log time (ns) and offset in the uncompressed records (byte) of every message
    pub messages: Vec<(u16, u64, u64)>,
}

/// Parses a chunk record, which may be truncated unless `is_whole`. `offset` is that of its body.
fn parse_chunk(record: Arc<Vec<u8>>, offset: u64, is_whole: bool, window: Window) -> Contents {
    let Some(header) = ChunkHeader::parse(&record[RECORD_HEADER..]) else {
        return Contents::default();
    };
    let ChunkHeader { start, end, uncompressed_size, crc, compression, data } = header;
    let damage = |reason| Entry::Damaged(Damage { offset, start_ns: start, end_ns: end, reason });
    let damaged = |reason| Contents { entries: vec![damage(reason)], ..Contents::default() };
    let data = data.start + RECORD_HEADER..data.end + RECORD_HEADER;
    let has_no_trailer = data.end == record.len();
    // Uncompressed records are used in place.
    let (buffer, range, problem) = if compression.is_empty() {
        (Arc::clone(&record), data, None)
    } else {
        match decompress(&compression, uncompressed_size, &record[data]) {
            Ok((unpacked, problem)) => {
                let range = 0..unpacked.len();
                (Arc::new(unpacked), range, problem)
            }
            Err(reason) => return damaged(reason),
        }
    };
    // A truncated chunk cannot be verified.
    if is_whole && crc != 0 {
        let reason = match &problem {
            Some(problem) => Some(format!("its checksum cannot be verified: {problem}")),
            None if crc32fast::hash(&buffer[range.clone()]) != crc => {
                Some("its checksum is wrong".into())
            }
            None => None,
        };
        if let Some(reason) = reason {
            return damaged(format!("a damaged chunk is left out: {reason}"));
        }
    }
    let size = range.len() as u64;
    let Parsed { mut contents, index, times, is_partial, problem: parse_problem, .. } =
        parse_records(&buffer, range, window);
    // A chunk without messages is not copied: its declarations are repeated anyway.
    if is_whole
        && has_no_trailer
        && problem.is_none()
        && parse_problem.is_none()
        && !is_partial
        && size == uncompressed_size
        && !index.is_empty()
        && times == (start, end)
    {
        contents.chunk =
            Some(RawChunk { record, compression, uncompressed_size, times, messages: index });
    }
    // The truncation of a file is reported once, by its index.
    if is_whole && let Some(reason) = problem.or(parse_problem.map(String::from)) {
        contents.entries.push(damage(reason));
    }
    contents
}

/// Records of a block.
#[derive(Default)]
struct Parsed {
    contents: Contents,
    /// as [`RawChunk::messages`]
    index: Vec<(u16, u64, u64)>,
    times: (u64, u64),
    /// message records so far, in the window or not
    messages: u32,
    /// the contents lack a message outside of the window, or a declaration that cannot be read
    is_partial: bool,
    problem: Option<&'static str>,
}

impl Parsed {
    /// Adds a record: its opcode, its body in the buffer, and its offset among the records.
    fn add(
        &mut self,
        opcode: u8,
        buffer: &Arc<Vec<u8>>,
        body: Range<usize>,
        offset: u64,
        window: Window,
    ) {
        match opcode {
            op::MESSAGE => {
                let id = FrameId { block: 0, entry: self.messages };
                self.messages += 1;
                match Message::parse(id, buffer, body) {
                    Some(message) if window.contains(message.log_time) => {
                        let time = message.log_time;
                        self.index.push((message.channel, time, offset));
                        self.times = (self.times.0.min(time), self.times.1.max(time));
                        self.contents.entries.push(Entry::Message(message));
                    }
                    _ => self.is_partial = true,
                }
            }
            op::SCHEMA | op::CHANNEL => {
                let body = &buffer[body];
                match lengths_fit(opcode, body).then(|| mcap::parse_record(opcode, body)) {
                    Some(Ok(record)) => self.contents.declared.push(record.into_owned()),
                    _ => self.is_partial = true,
                }
            }
            _ => {}
        }
    }
}

fn parse_records(buffer: &Arc<Vec<u8>>, range: Range<usize>, window: Window) -> Parsed {
    let mut parsed = Parsed { times: (u64::MAX, 0), ..Parsed::default() };
    let mut at = range.start;
    while at < range.end {
        let body = at + RECORD_HEADER;
        let header = buffer.get(at..body).filter(|_| body <= range.end);
        let end = header.and_then(|header| {
            let length = u64::from_le_bytes(*header[1..].first_chunk()?);
            body.checked_add(usize::try_from(length).ok()?).filter(|end| *end <= range.end)
        });
        let (Some(header), Some(end)) = (header, end) else {
            parsed.problem = Some("a chunk ends inside a record; the records before it are used");
            break;
        };
        parsed.add(header[0], buffer, body..end, (at - range.start) as u64, window);
        at = end;
    }
    if parsed.index.is_empty() {
        parsed.times = (0, 0);
    }
    parsed
}

/// The records of a chunk. A problem in the middle is returned beside the bytes before it.
fn decompress(
    compression: &str,
    size: u64,
    compressed: &[u8],
) -> std::result::Result<(Vec<u8>, Option<String>), String> {
    let reader: Box<dyn io::Read + '_> = match compression {
        "zstd" => Box::new(
            zstd::Decoder::new(compressed)
                .map_err(|e| format!("a zstd chunk cannot be opened: {e}"))?,
        ),
        "lz4" => Box::new(
            lz4::Decoder::new(compressed)
                .map_err(|e| format!("an lz4 chunk cannot be opened: {e}"))?,
        ),
        other => return Err(format!("chunk compression {other:?} is not supported")),
    };
    // The claimed size limits the reading; it is not trusted for the allocation.
    let mut data = Vec::with_capacity(usize::try_from(size).unwrap_or(0).min(64 << 20));
    let problem = match reader.take(size).read_to_end(&mut data) {
        Ok(_) if (data.len() as u64) < size => {
            Some("a chunk is smaller than its header says".into())
        }
        Ok(_) => None,
        Err(e) => Some(format!("a chunk cannot be decompressed to its end ({e})")),
    };
    Ok((data, problem))
}
