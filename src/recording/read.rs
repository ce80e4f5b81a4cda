//! Reading: positioned reads and an index of the file's blocks, made by walking the record heads
//! once.
//!
//! No summary is needed, so a log that was cut short reads like any other, up to the last whole
//! record of its last chunk. A chunk is read when it is asked for, checked against its checksum,
//! and forgotten. Memory scales with the chunk, not with the log. A chunk that lies about its size
//! is read as far as its data goes.

mod attachment;
mod block;
mod lengths;
mod message;
mod notes;
mod walk;

use std::collections::BTreeMap;
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use mcap::records::Record;

use super::source::Source;
use crate::error::{Error, Result};
use walk::MAGIC;

pub use attachment::Attachment;
pub use block::{Block, Contents, RawChunk};
pub use message::Message;

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

/// Something that could not be read.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
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
    pub fn contains(&self, log_time: u64) -> bool {
        log_time >= self.start && (log_time < self.end || self.end == u64::MAX)
    }
}

/// What reading a log yields.
pub enum Entry {
    /// a message
    Message(Message),
    /// a stretch that cannot be read
    Damaged(Damage),
}

/// An opened log.
pub struct Recording {
    path: PathBuf,
    source: Arc<Source>,
    sha256: OnceLock<String>,
    blocks: Vec<Block>,
    /// messages outside of chunks
    bare_messages: u64,
    has_summary: bool,
    /// header: profile
    pub profile: String,
    /// schemas by id
    pub schemas: BTreeMap<u16, Schema>,
    /// channels by id
    pub channels: BTreeMap<u16, Channel>,
    /// metadata records in order
    pub metadata: Vec<mcap::records::Metadata>,
    attachments: Vec<Range<u64>>,
    /// what the walk met
    pub damage: Vec<Damage>,
    /// chunks, and their compressions by count
    pub compressions: BTreeMap<String, usize>,
    /// whether the file ends as it should
    pub is_complete: bool,
}

impl Recording {
    /// Opens a log and indexes its blocks.
    ///
    /// # Errors
    /// The file cannot be read, or is not MCAP.
    pub fn open(path: &Path) -> Result<Self> {
        let read = |source| Error::Read { path: path.into(), source };
        let source = Arc::new(Source::open(path).map_err(read)?);
        let magic = source.bytes(0..source.length().min(MAGIC.len() as u64)).map_err(read)?;
        if magic != MAGIC {
            let hint = match &magic[..] {
                [] => " (it is empty)",
                [b'#', b'R', b'O', b'S', b'B', b'A', b'G', ..] => {
                    " but a ROS 1 bag; convert it first: `mcap convert in.bag out.mcap`"
                }
                [b'S', b'Q', b'L', b'i', b't', b'e', ..] => {
                    " but a ROS 2 SQLite bag; convert it first: `ros2 bag convert`"
                }
                [0x28, 0xb5, 0x2f, 0xfd, ..] => " but a zstd file; decompress it first: `zstd -d`",
                _ => "",
            };
            return Err(Error::NotMcap { path: path.into(), hint });
        }
        let mut recording = Self {
            path: path.into(),
            source,
            sha256: OnceLock::new(),
            blocks: Vec::new(),
            bare_messages: 0,
            has_summary: false,
            profile: String::new(),
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            metadata: Vec::new(),
            attachments: Vec::new(),
            damage: Vec::new(),
            compressions: BTreeMap::new(),
            is_complete: false,
        };
        recording.index().map_err(read)?;
        // Without a summary, or with one that repeats no channels, they stand only inside chunks.
        if !recording.is_complete || recording.channels.is_empty() {
            for number in 0..recording.blocks.len() {
                let inside = recording
                    .contents(&recording.blocks[number], Window::ALL)
                    .map_err(read)?
                    .declared;
                inside.into_iter().for_each(|r| recording.declare(r));
            }
        }
        Ok(recording)
    }

    /// Where it came from.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Length of the file [byte].
    pub fn length(&self) -> u64 {
        self.source.length()
    }

    /// What has been read of it so far, its fingerprint aside [byte].
    pub fn bytes_read(&self) -> u64 {
        self.source.bytes_read()
    }

    /// The file's fingerprint in hexadecimal. It is taken once.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn sha256(&self) -> Result<&str> {
        if let Some(known) = self.sha256.get() {
            return Ok(known);
        }
        let taken = self.source.sha256().map_err(|source| self.failed(source))?;
        Ok(self.sha256.get_or_init(|| taken))
    }

    fn failed(&self, source: io::Error) -> Error {
        Error::Read { path: self.path.clone(), source }
    }

    /// Chunks, and stretches of messages outside of any, in the order of the file.
    pub fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// Chunks of the file.
    pub fn chunk_count(&self) -> usize {
        self.blocks.iter().filter(|b| b.is_chunk()).count()
    }

    fn declare(&mut self, record: Record<'_>) {
        match record {
            Record::Schema { header, data } if header.id != 0 => {
                let schema = Schema {
                    name: header.name,
                    encoding: header.encoding,
                    data: data.into_owned(),
                };
                self.schemas.entry(header.id).or_insert(schema);
            }
            Record::Channel(c) => {
                let channel = Channel {
                    schema_id: c.schema_id,
                    topic: c.topic,
                    message_encoding: c.message_encoding,
                    metadata: c.metadata,
                };
                self.channels.entry(c.id).or_insert(channel);
            }
            _ => {}
        }
    }

    /// Whether a declaration says what the log says, so that it may stand in the output as it is.
    fn declares(&self, record: &Record<'_>) -> bool {
        match record {
            Record::Schema { header, data } => self.schemas.get(&header.id).is_some_and(|s| {
                s.name == header.name && s.encoding == header.encoding && s.data == data[..]
            }),
            Record::Channel(c) => self.channels.get(&c.id).is_some_and(|known| {
                let has_schema = c.schema_id == 0 || self.schemas.contains_key(&c.schema_id);
                let alike = (known.schema_id, &known.topic, &known.message_encoding)
                    == (c.schema_id, &c.topic, &c.message_encoding);
                has_schema && alike && known.metadata == c.metadata
            }),
            _ => false,
        }
    }

    /// Messages whose log time lies in the window, in the order of the file, with what could not be
    /// read.
    pub fn messages(&self, window: Window) -> impl Iterator<Item = Entry> + '_ {
        self.blocks.iter().filter(move |b| b.may_overlap(window)).flat_map(move |block| match self
            .contents(block, window)
        {
            Ok(contents) => contents.entries,
            Err(e) => {
                let reason = format!("it cannot be read any more: {e}");
                vec![Entry::Damaged(Damage { offset: 0, start_ns: 0, end_ns: 0, reason })]
            }
        })
    }
}
