//! A block of a log: a chunk, or messages that lie in a row outside of any. It is read whole,
//! decompressed and checked when it is asked for, on whichever core, and forgotten.

use std::io::{self, Read as _};
use std::ops::Range;
use std::sync::Arc;

use mcap::records::{Record, op};

use super::lengths::lengths_fit;
use super::walk::RECORD_HEAD;
use super::{Damage, Entry, Message, Recording, Window};

/// Where messages lie, and what is known of them without reading them.
#[derive(Clone, Debug)]
pub struct Block {
    /// a chunk's body, or bare records with their heads
    place: Range<u64>,
    kind: Kind,
    /// first and last log time [ns]; (0, 0) where not known
    times: (u64, u64),
    /// of which channels there are messages, by its index; none where there is no index
    pub(super) channels: Vec<u16>,
    /// what it takes in memory [byte], by its own word
    weight: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Chunk { whole: bool, checked: bool },
    Bare,
}

impl Block {
    pub(super) fn chunk(body: Range<u64>, whole: bool, head: &ChunkHead) -> Self {
        let checked = head.crc != 0;
        let unpacked = if head.compression.is_empty() { 0 } else { head.uncompressed_size };
        let weight = (body.end - body.start).saturating_add(unpacked);
        Self {
            place: body,
            kind: Kind::Chunk { whole, checked },
            times: (head.start, head.end),
            channels: Vec::new(),
            weight,
        }
    }

    pub(super) fn bare(records: Range<u64>, log_time: u64, channel: u16) -> Self {
        let weight = records.end - records.start;
        Self {
            place: records,
            kind: Kind::Bare,
            times: (log_time, log_time),
            channels: vec![channel],
            weight,
        }
    }

    /// Whether a bare record belongs to this block: it follows it, and the two are not too long
    /// together.
    pub(super) fn takes(&self, record: &Range<u64>, most: u64) -> bool {
        self.kind == Kind::Bare
            && self.place.end == record.start
            && record.end - self.place.start <= most
    }

    pub(super) fn extend(&mut self, end: u64, log_time: u64, channel: u16) {
        self.place.end = end;
        self.weight = end - self.place.start;
        self.times = (self.times.0.min(log_time), self.times.1.max(log_time));
        if !self.channels.contains(&channel) {
            self.channels.push(channel);
        }
    }

    /// Whether it is a chunk.
    pub fn is_chunk(&self) -> bool {
        self.kind != Kind::Bare
    }

    /// Whether it is a chunk with a checksum.
    pub fn is_checked(&self) -> bool {
        matches!(self.kind, Kind::Chunk { checked: true, .. })
    }

    /// What it takes in memory, packed and unpacked, by its own word [byte].
    pub fn weight(&self) -> usize {
        usize::try_from(self.weight).unwrap_or(usize::MAX)
    }

    /// Channels it has messages of; `None` where only reading it tells.
    pub fn channels(&self) -> Option<&[u16]> {
        (!self.channels.is_empty()).then_some(&self.channels)
    }

    /// Whether a message may lie in the window.
    pub fn may_overlap(&self, window: Window) -> bool {
        let (start, end) = self.times;
        let whole = !matches!(self.kind, Kind::Chunk { whole: false, .. });
        let known = whole && end >= start && end > 0;
        !known || !(end < window.start || (start >= window.end && window.end != u64::MAX))
    }
}

/// What a block holds.
#[derive(Default)]
pub struct Contents {
    /// messages in the window, and what could not be read, in the order of the file
    pub entries: Vec<Entry>,
    /// schemas and channels that are declared inside
    pub(super) declared: Vec<Record<'static>>,
    /// the chunk as it lies in the file, where it holds all that its head says, nothing else, and
    /// all of it in the window
    pub chunk: Option<RawChunk>,
}

/// A chunk as it lies in a file.
pub struct RawChunk {
    /// its record, with the record's head
    pub record: Arc<Vec<u8>>,
    /// compression
    pub compression: String,
    /// size of what it holds [byte]
    pub uncompressed_size: u64,
    /// first and last log time [ns]; (0, 0) without messages
    pub times: (u64, u64),
    /// channel, log time [ns] and place of every message in what it holds [byte]
    pub messages: Vec<(u16, u64, u64)>,
}

impl Recording {
    /// Reads a block: messages whose log time lies in the window, and what is wrong with it.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn read(&self, block: &Block, window: Window) -> crate::error::Result<Contents> {
        self.contents(block, window).map_err(|source| self.failed(source))
    }

    pub(super) fn contents(&self, block: &Block, window: Window) -> io::Result<Contents> {
        let Kind::Chunk { whole, .. } = block.kind else {
            let buffer = Arc::new(self.source.bytes(block.place.clone())?);
            return Ok(records(&buffer, 0..buffer.len(), window).contents);
        };
        let body = block.place.clone();
        let record = self.source.bytes(body.start - RECORD_HEAD..body.end)?;
        let Some(head) = chunk_head(&record[RECORD_HEAD as usize..]) else {
            return Ok(Contents::default());
        };
        let ChunkHead { start, end, uncompressed_size: size, crc, compression, data } = head;
        let damage = |reason: String| {
            Entry::Damaged(Damage { offset: body.start, start_ns: start, end_ns: end, reason })
        };
        let data = data.start + RECORD_HEAD as usize..data.end + RECORD_HEAD as usize;
        let ends = data.end == record.len();
        // What lies uncompressed is used where it lies.
        let record = Arc::new(record);
        let (buffer, place, problem) = if compression.is_empty() {
            (Arc::clone(&record), data, None)
        } else {
            match decompressed(&compression, size, &record[data]) {
                Ok((unpacked, problem)) => {
                    let place = 0..unpacked.len();
                    (Arc::new(unpacked), place, problem)
                }
                Err(reason) => {
                    return Ok(Contents { entries: vec![damage(reason)], ..Contents::default() });
                }
            }
        };
        // The tail of a file that was cut short cannot be checked; a whole chunk with a checksum
        // can, and must hold it.
        if whole
            && crc != 0
            && (problem.is_some() || crc32fast::hash(&buffer[place.clone()]) != crc)
        {
            let reason = problem.map_or_else(
                || "its checksum does not hold".into(),
                |p| format!("its checksum cannot hold: {p}"),
            );
            return Ok(Contents {
                entries: vec![damage(format!("a damaged chunk is left out: {reason}"))],
                ..Contents::default()
            });
        }
        let Walked { mut contents, index, times, left_out, broken } =
            records(&buffer, place.clone(), window);
        // Without messages it says nothing that is not declared before it.
        let is_sound = whole
            && !index.is_empty()
            && ends
            && problem.is_none()
            && broken.is_none()
            && !left_out
            && place.len() as u64 == size;
        if is_sound
            && times == (start, end)
            && contents.declared.iter().all(|record| self.declares(record))
        {
            contents.chunk = Some(RawChunk {
                record,
                compression,
                uncompressed_size: size,
                times,
                messages: index,
            });
        }
        // A chunk of a file that was cut short is already listed once; a whole one that breaks is
        // listed here.
        if whole && let Some(reason) = problem.or(broken.map(String::from)) {
            contents.entries.push(damage(reason));
        }
        Ok(contents)
    }
}

/// What a walk over records gives.
#[derive(Default)]
struct Walked {
    contents: Contents,
    /// as in [`RawChunk::messages`]
    index: Vec<(u16, u64, u64)>,
    times: (u64, u64),
    /// something is not in the contents: a message outside of the window, a declaration that cannot
    /// be read
    left_out: bool,
    broken: Option<&'static str>,
}

/// Takes records apart that lie in a buffer.
fn records(buffer: &Arc<Vec<u8>>, place: Range<usize>, window: Window) -> Walked {
    let mut walked = Walked { times: (u64::MAX, 0), ..Walked::default() };
    let head = RECORD_HEAD as usize;
    let mut at = place.start;
    while at < place.end {
        let record = buffer.get(at..at + head).filter(|_| at + head <= place.end);
        let length =
            record.map(|h| u64::from_le_bytes([h[1], h[2], h[3], h[4], h[5], h[6], h[7], h[8]]));
        let stop = length
            .and_then(|l| usize::try_from(l).ok())
            .and_then(|l| (at + head).checked_add(l))
            .filter(|s| *s <= place.end);
        let (Some(record), Some(stop)) = (record, stop) else {
            walked.broken = Some("a chunk ends inside a record; what came before it is used");
            break;
        };
        let body = at + head..stop;
        match record[0] {
            op::MESSAGE => match Message::parse(buffer, body) {
                Some(message) if window.contains(message.log_time) => {
                    walked.index.push((
                        message.channel,
                        message.log_time,
                        (at - place.start) as u64,
                    ));
                    walked.times = (
                        walked.times.0.min(message.log_time),
                        walked.times.1.max(message.log_time),
                    );
                    walked.contents.entries.push(Entry::Message(message));
                }
                _ => walked.left_out = true,
            },
            opcode @ (op::SCHEMA | op::CHANNEL) => {
                let body = &buffer[body];
                match lengths_fit(opcode, body).then(|| mcap::parse_record(opcode, body)) {
                    Some(Ok(record)) => walked.contents.declared.push(record.into_owned()),
                    _ => walked.left_out = true,
                }
            }
            _ => {}
        }
        at = stop;
    }
    if walked.index.is_empty() {
        walked.times = (0, 0);
    }
    walked
}

/// Bytes before the payload of a message's record.
pub const MESSAGE_HEAD: usize = 22;

/// A number in a record's body.
pub fn u64_at(body: &[u8], at: usize) -> Option<u64> {
    Some(u64::from_le_bytes(body.get(at..at.checked_add(8)?)?.try_into().ok()?))
}

fn u32_at(body: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(body.get(at..at.checked_add(4)?)?.try_into().ok()?))
}

/// A text with its length before it, and where it ends.
pub fn sized_text(body: &[u8], at: usize) -> Option<(String, usize)> {
    let end = at.checked_add(4)?.checked_add(u32_at(body, at)? as usize)?;
    Some((std::str::from_utf8(body.get(at + 4..end)?).ok()?.to_string(), end))
}

/// What stands before a message's payload.
pub struct MessageHead {
    pub channel: u16,
    pub sequence: u32,
    pub log_time: u64,
    pub publish_time: u64,
}

/// The head of a message's record body.
pub fn message_head(body: &[u8]) -> Option<MessageHead> {
    Some(MessageHead {
        channel: u16::from_le_bytes(body.get(0..2)?.try_into().ok()?),
        sequence: u32_at(body, 2)?,
        log_time: u64_at(body, 6)?,
        publish_time: u64_at(body, 14)?,
    })
}

/// What stands before a chunk's records.
pub struct ChunkHead {
    pub start: u64,
    pub end: u64,
    pub uncompressed_size: u64,
    pub crc: u32,
    pub compression: String,
    /// where in the body the records lie, as far as the body goes
    pub data: Range<usize>,
}

/// The head of a chunk's record body, of which no more than that need be there.
pub fn chunk_head(body: &[u8]) -> Option<ChunkHead> {
    let (compression, at) = sized_text(body, 28)?;
    let size = usize::try_from(u64_at(body, at)?).unwrap_or(usize::MAX);
    Some(ChunkHead {
        start: u64_at(body, 0)?,
        end: u64_at(body, 8)?,
        uncompressed_size: u64_at(body, 16)?,
        crc: u32_at(body, 24)?,
        compression,
        data: at + 8..(at + 8).saturating_add(size).min(body.len()),
    })
}

/// A chunk's records. What broke, if something did, comes beside as much as could be had.
fn decompressed(
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
        other => return Err(format!("chunk compression {other:?} is not read")),
    };
    // The size is the chunk's own word: it bounds the reading but nothing is reserved on its
    // account alone.
    let mut data = Vec::with_capacity(usize::try_from(size).unwrap_or(0).min(64 << 20));
    let problem = match reader.take(size).read_to_end(&mut data) {
        Ok(_) if (data.len() as u64) < size => Some("a chunk holds less than it says".into()),
        Ok(_) => None,
        Err(e) => Some(format!("a chunk cannot be decompressed to its end ({e})")),
    };
    Ok((data, problem))
}
