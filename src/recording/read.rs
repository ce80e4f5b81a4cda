//! Reading: a memory map and an index of its blocks, made by walking the record headers once.
//!
//! No summary is needed, so a log that was cut short reads like any other, up to the last whole record of its
//! last chunk. A chunk is decompressed when it is asked for, checked against its checksum, and forgotten.
//! Memory scales with the chunk, not with the log. A chunk that lies about its size is read as far as its data goes.

mod lengths;
mod notes;

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read as _;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use mcap::records::{Record, op};

use crate::error::{Error, Result};
use crate::units::Stamp;
use lengths::lengths_fit;

/// A schema of the log.
#[derive(Clone, Debug, PartialEq)]
pub struct Schema {
    /// name
    pub name: String,
    /// `ros2msg`, …
    pub encoding: String,
    /// the definition
    pub data: Vec<u8>,
}

/// A channel of the log.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// 0 where it has none
    pub schema_id: u16,
    /// topic
    pub topic: String,
    /// `cdr`, …
    pub message_encoding: String,
    /// what the recorder wrote with it (QoS)
    pub metadata: BTreeMap<String, String>,
}

/// A message; its bytes belong to the map or to its chunk.
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
    buffer: Buffer,
    range: Range<usize>,
}

impl Message {
    /// The payload.
    pub fn data(&self) -> &[u8] {
        &self.buffer.bytes()[self.range.clone()]
    }

    /// The log time as a stamp.
    pub fn logged(&self) -> Stamp {
        Stamp(i64::try_from(self.log_time).unwrap_or(i64::MAX))
    }
}

#[derive(Clone)]
enum Buffer {
    Map(Arc<memmap2::Mmap>),
    Chunk(Arc<Vec<u8>>),
}

impl Buffer {
    fn bytes(&self) -> &[u8] {
        match self {
            Self::Map(map) => map,
            Self::Chunk(chunk) => chunk,
        }
    }
}

/// Something that could not be read.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
pub struct Damage {
    /// where in the file [byte]
    pub offset: u64,
    /// first log time it may have held [ns]; 0 where unknown
    pub start_ns: u64,
    /// last
    pub end_ns: u64,
    /// what is wrong
    pub reason: String,
}

/// A stretch of log time; start inclusive, end exclusive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// [ns]
    pub start: u64,
    /// [ns]
    pub end: u64,
}

impl Window {
    /// Everything.
    pub const ALL: Self = Self { start: 0, end: u64::MAX };

    /// Whether a log time lies inside.
    pub fn holds(&self, log_time: u64) -> bool {
        log_time >= self.start && (log_time < self.end || self.end == u64::MAX)
    }
}

/// Where messages lie.
#[derive(Clone, Debug)]
enum Block {
    /// a chunk's body; the record was cut short where `whole` is false
    Chunk { body: Range<usize>, whole: bool, start: u64, end: u64 },
    /// one message outside any chunk
    Message { body: Range<usize> },
}

/// An opened log.
pub struct Recording {
    path: PathBuf,
    map: Arc<memmap2::Mmap>,
    blocks: Vec<Block>,
    /// header: profile
    pub profile: String,
    /// schemas by id
    pub schemas: BTreeMap<u16, Schema>,
    /// channels by id
    pub channels: BTreeMap<u16, Channel>,
    /// metadata records in order
    pub metadata: Vec<mcap::records::Metadata>,
    attachments: Vec<Range<usize>>,
    /// what the walk met
    pub damage: Vec<Damage>,
    /// chunks, and their compressions by count
    pub compressions: BTreeMap<String, usize>,
    /// whether the file ends as it should
    pub is_complete: bool,
}

const MAGIC: &[u8] = &[0x89, b'M', b'C', b'A', b'P', 0x30, b'\r', b'\n'];
const RECORD_HEAD: usize = 9;

impl Recording {
    /// Maps a log and indexes its blocks.
    ///
    /// # Errors
    /// The file cannot be read, or is not MCAP.
    pub fn open(path: &Path) -> Result<Self> {
        let read = |source| Error::Read { path: path.into(), source };
        let file = File::open(path).map_err(read)?;
        if file.metadata().map_err(read)?.is_dir() {
            let source = std::io::Error::new(std::io::ErrorKind::IsADirectory, "it is a folder; give the .mcap file inside it");
            return Err(read(source));
        }
        // The one unsafe line of the program: the log must not be cut short by others while it is read.
        #[expect(unsafe_code)]
        let map = unsafe { memmap2::Mmap::map(&file) }.map_err(read)?;
        if !map.starts_with(MAGIC) {
            let hint = match &map[..] {
                [] => " (it is empty)",
                [b'#', b'R', b'O', b'S', b'B', b'A', b'G', ..] => " but a ROS 1 bag; convert it first: `mcap convert in.bag out.mcap`",
                [b'S', b'Q', b'L', b'i', b't', b'e', ..] => " but a ROS 2 SQLite bag; convert it first: `ros2 bag convert`",
                [0x28, 0xb5, 0x2f, 0xfd, ..] => " but a zstd file; decompress it first: `zstd -d`",
                _ => "",
            };
            return Err(Error::NotMcap { path: path.into(), hint });
        }
        let mut recording = Self {
            path: path.into(),
            map: Arc::new(map),
            blocks: Vec::new(),
            profile: String::new(),
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            metadata: Vec::new(),
            attachments: Vec::new(),
            damage: Vec::new(),
            compressions: BTreeMap::new(),
            is_complete: false,
        };
        recording.index();
        // Without a summary, or with one that repeats no channels, they stand only inside chunks.
        if !recording.is_complete || recording.channels.is_empty() {
            let inside: Vec<Record<'static>> = recording.blocks.iter().flat_map(|b| recording.entries(b, Window::ALL).1).collect();
            inside.into_iter().for_each(|r| recording.declare(r));
        }
        Ok(recording)
    }

    /// Where it came from.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The whole file.
    pub fn bytes(&self) -> &[u8] {
        &self.map
    }

    /// Chunks of the file.
    pub fn chunk_count(&self) -> usize {
        self.blocks.iter().filter(|b| matches!(b, Block::Chunk { .. })).count()
    }

    fn index(&mut self) {
        let map = Arc::clone(&self.map);
        let mut at = MAGIC.len();
        while let Some(head) = map.get(at..at + RECORD_HEAD) {
            let opcode = head[0];
            let length = u64::from_le_bytes([head[1], head[2], head[3], head[4], head[5], head[6], head[7], head[8]]);
            let start = at + RECORD_HEAD;
            let end = usize::try_from(length).ok().and_then(|l| start.checked_add(l)).filter(|e| *e <= map.len());
            let Some(end) = end else {
                if opcode == op::CHUNK {
                    self.add_chunk(start..map.len(), false);
                }
                self.cut(at, "the file ends inside a record");
                return;
            };
            self.record(opcode, start..end);
            at = end;
            if opcode == op::FOOTER {
                self.is_complete = map.get(at..) == Some(MAGIC);
                if !self.is_complete {
                    self.cut(at, "the file does not end as an MCAP should");
                }
                return;
            }
        }
        self.cut(at, "the file was cut short: there is no footer");
    }

    fn cut(&mut self, at: usize, reason: &str) {
        self.damage.push(Damage { offset: at as u64, start_ns: 0, end_ns: 0, reason: reason.into() });
    }

    fn record(&mut self, opcode: u8, body: Range<usize>) {
        let map = Arc::clone(&self.map);
        let bytes = &map[body.clone()];
        match opcode {
            op::CHUNK => self.add_chunk(body, true),
            op::MESSAGE => self.blocks.push(Block::Message { body }),
            op::ATTACHMENT => self.attachments.push(body),
            op::HEADER | op::SCHEMA | op::CHANNEL | op::METADATA if !lengths_fit(opcode, bytes) => {
                self.cut(body.start, "a record cannot be read: the lengths inside it do not add up");
            }
            op::HEADER | op::SCHEMA | op::CHANNEL | op::METADATA => match mcap::parse_record(opcode, bytes) {
                Ok(Record::Header(header)) => self.profile = header.profile,
                Ok(Record::Metadata(metadata)) => self.metadata.push(metadata),
                Ok(record) => self.declare(record),
                Err(e) => self.cut(body.start, &format!("a record cannot be read: {e}")),
            },
            _ => {}
        }
    }

    fn declare(&mut self, record: Record<'_>) {
        match record {
            Record::Schema { header, data } if header.id != 0 => {
                let schema = Schema { name: header.name, encoding: header.encoding, data: data.into_owned() };
                self.schemas.entry(header.id).or_insert(schema);
            }
            Record::Channel(c) => {
                let channel = Channel { schema_id: c.schema_id, topic: c.topic, message_encoding: c.message_encoding, metadata: c.metadata };
                self.channels.entry(c.id).or_insert(channel);
            }
            _ => {}
        }
    }

    fn add_chunk(&mut self, body: Range<usize>, whole: bool) {
        let map = Arc::clone(&self.map);
        let Some(head) = chunk_head(&map[body.clone()]) else {
            return self.cut(body.start, "a chunk without a head");
        };
        *self.compressions.entry(if head.compression.is_empty() { "none".into() } else { head.compression.into() }).or_default() += 1;
        self.blocks.push(Block::Chunk { body, whole, start: head.start, end: head.end });
    }

    /// Messages whose log time lies in the window, in the order of the file, with what could not be read.
    pub fn messages(&self, window: Window) -> impl Iterator<Item = Entry> + '_ {
        self.blocks.iter().flat_map(move |block| self.entries(block, window).0)
    }

    /// What a block holds: messages and damage, and the schemas and channels that stand inside it.
    fn entries(&self, block: &Block, window: Window) -> (Vec<Entry>, Vec<Record<'static>>) {
        match block {
            Block::Message { body } => {
                let message = message(Buffer::Map(Arc::clone(&self.map)), body.clone());
                (message.into_iter().filter(|m| window.holds(m.log_time)).map(Entry::Message).collect(), Vec::new())
            }
            Block::Chunk { body, whole, start, end } => {
                let outside = *whole && *end >= *start && *end > 0 && (*end < window.start || (*start >= window.end && window.end != u64::MAX));
                if outside {
                    return Default::default();
                }
                self.chunk_entries(body, *whole, window)
            }
        }
    }

    fn chunk_entries(&self, body: &Range<usize>, whole: bool, window: Window) -> (Vec<Entry>, Vec<Record<'static>>) {
        let bytes = &self.map[body.clone()];
        let Some(head) = chunk_head(bytes) else { return Default::default() };
        let damage = |reason: String| Entry::Damaged(Damage { offset: body.start as u64, start_ns: head.start, end_ns: head.end, reason });
        let (buffer, first, end, problem) = match decompressed(&head, bytes) {
            Ok((None, problem)) => (Buffer::Map(Arc::clone(&self.map)), body.start + head.data.start, body.start + head.data.end, problem),
            Ok((Some(data), problem)) => {
                let end = data.len();
                (Buffer::Chunk(Arc::new(data)), 0, end, problem)
            }
            Err(reason) => return (vec![damage(reason)], Vec::new()),
        };
        let data = &buffer.bytes()[first..end];
        // The tail of a file that was cut short cannot be checked; a whole chunk with a checksum can, and must hold it.
        if whole && head.crc != 0 && (problem.is_some() || crc32fast::hash(data) != head.crc) {
            let reason = problem.map_or_else(|| "its checksum does not hold".into(), |p| format!("its checksum cannot hold: {p}"));
            return (vec![damage(format!("a damaged chunk is left out: {reason}"))], Vec::new());
        }
        let (mut entries, mut declared) = (Vec::new(), Vec::new());
        let mut at = first;
        let mut cut = None;
        while at < end {
            let record = buffer.bytes().get(at..at + RECORD_HEAD).filter(|_| at + RECORD_HEAD <= end);
            let length = record.map(|h| u64::from_le_bytes([h[1], h[2], h[3], h[4], h[5], h[6], h[7], h[8]]));
            let stop = length.and_then(|l| usize::try_from(l).ok()).and_then(|l| (at + RECORD_HEAD).checked_add(l)).filter(|s| *s <= end);
            let (Some(record), Some(stop)) = (record, stop) else {
                cut = Some("a chunk ends inside a record; what came before it is used");
                break;
            };
            match record[0] {
                op::MESSAGE => {
                    entries.extend(message(buffer.clone(), at + RECORD_HEAD..stop).filter(|m| window.holds(m.log_time)).map(Entry::Message));
                }
                opcode @ (op::SCHEMA | op::CHANNEL) if lengths_fit(opcode, &buffer.bytes()[at + RECORD_HEAD..stop]) => {
                    if let Ok(record) = mcap::parse_record(opcode, &buffer.bytes()[at + RECORD_HEAD..stop]) {
                        declared.push(record.into_owned());
                    }
                }
                _ => {}
            }
            at = stop;
        }
        // A chunk of a file that was cut short is already listed once; a whole one that breaks is listed here.
        if whole && let Some(reason) = problem.or(cut.map(String::from)) {
            entries.push(damage(reason));
        }
        (entries, declared)
    }

    /// The attachments, and what could not be read of them.
    pub fn attachments(&self) -> impl Iterator<Item = std::result::Result<mcap::Attachment<'_>, Damage>> {
        self.attachments.iter().map(|body| {
            let bytes = &self.map[body.clone()];
            let damage = |reason: String| Damage { offset: body.start as u64, start_ns: 0, end_ns: 0, reason };
            if !lengths_fit(op::ATTACHMENT, bytes) {
                return Err(damage("an attachment's lengths do not add up".into()));
            }
            match mcap::parse_record(op::ATTACHMENT, bytes) {
                Ok(Record::Attachment { header, data, .. }) => Ok(mcap::Attachment {
                    log_time: header.log_time,
                    create_time: header.create_time,
                    name: header.name,
                    media_type: header.media_type,
                    data,
                }),
                Ok(_) => Err(damage("an attachment cannot be read".into())),
                Err(e) => Err(damage(format!("an attachment cannot be read: {e}"))),
            }
        })
    }
}

/// What reading a log yields.
pub enum Entry {
    /// a message
    Message(Message),
    /// a stretch that cannot be read
    Damaged(Damage),
}

fn message(buffer: Buffer, body: Range<usize>) -> Option<Message> {
    const HEAD: usize = 22;
    let head: [u8; HEAD] = buffer.bytes().get(body.start..body.start + HEAD).filter(|_| body.len() >= HEAD)?.try_into().ok()?;
    let u64_at = |i: usize| u64::from_le_bytes([head[i], head[i + 1], head[i + 2], head[i + 3], head[i + 4], head[i + 5], head[i + 6], head[i + 7]]);
    Some(Message {
        channel: u16::from_le_bytes([head[0], head[1]]),
        sequence: u32::from_le_bytes([head[2], head[3], head[4], head[5]]),
        log_time: u64_at(6),
        publish_time: u64_at(14),
        buffer,
        range: body.start + HEAD..body.end,
    })
}

struct ChunkHead<'b> {
    start: u64,
    end: u64,
    uncompressed_size: u64,
    crc: u32,
    compression: &'b str,
    /// where in the body the records lie, as far as the file goes
    data: Range<usize>,
}

fn chunk_head(body: &[u8]) -> Option<ChunkHead<'_>> {
    let u64_at = |i: usize| Some(u64::from_le_bytes(body.get(i..i + 8)?.try_into().ok()?));
    let u32_at = |i: usize| Some(u32::from_le_bytes(body.get(i..i + 4)?.try_into().ok()?));
    let name_length = u32_at(28)? as usize;
    let compression = std::str::from_utf8(body.get(32..32usize.checked_add(name_length)?)?).ok()?;
    let size_at = 32 + name_length;
    let size = usize::try_from(u64_at(size_at)?).unwrap_or(usize::MAX);
    let first = size_at + 8;
    Some(ChunkHead {
        start: u64_at(0)?,
        end: u64_at(8)?,
        uncompressed_size: u64_at(16)?,
        crc: u32_at(24)?,
        compression,
        data: first..first.saturating_add(size).min(body.len()),
    })
}

/// A chunk's records: `None` where they lie uncompressed in the map. What broke, if something did, comes beside as
/// much as could be had.
fn decompressed(head: &ChunkHead<'_>, body: &[u8]) -> std::result::Result<(Option<Vec<u8>>, Option<String>), String> {
    let compressed = &body[head.data.clone()];
    let reader: Box<dyn std::io::Read + '_> = match head.compression {
        "" => return Ok((None, None)),
        "zstd" => Box::new(zstd::Decoder::new(compressed).map_err(|e| format!("a zstd chunk cannot be opened: {e}"))?),
        "lz4" => Box::new(lz4::Decoder::new(compressed).map_err(|e| format!("an lz4 chunk cannot be opened: {e}"))?),
        other => return Err(format!("chunk compression {other:?} is not read")),
    };
    // The size is the chunk's own word: it bounds the reading but nothing is reserved on its account alone.
    let mut data = Vec::with_capacity(usize::try_from(head.uncompressed_size).unwrap_or(0).min(64 << 20));
    let problem = match reader.take(head.uncompressed_size).read_to_end(&mut data) {
        Ok(_) if (data.len() as u64) < head.uncompressed_size => Some("a chunk holds less than it says".into()),
        Ok(_) => None,
        Err(e) => Some(format!("a chunk cannot be decompressed to its end ({e})")),
    };
    Ok((Some(data), problem))
}
