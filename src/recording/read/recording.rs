//! An open log.

use std::collections::BTreeMap;
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use mcap::records::{Metadata, Record};

use super::super::source::Source;
use super::block::{Block, Contents, Entry};
use super::index::Index;
use super::records::MAGIC;
use super::types::{Channel, Damage, Declarations, Schema, Window};
use crate::error::{Error, Result};

/// An open log.
pub struct Recording {
    path: PathBuf,
    pub(super) source: Source,
    sha256: OnceLock<String>,
    blocks: Vec<Block>,
    /// messages outside of chunks
    pub(super) bare_messages: u64,
    pub(super) has_summary: bool,
    /// `ros1`, `ros2`, or empty
    pub profile: String,
    /// by id
    pub schemas: BTreeMap<u16, Schema>,
    /// by id
    pub channels: BTreeMap<u16, Channel>,
    /// in the order of the file
    pub metadata: Vec<Metadata>,
    /// bodies of the attachment records (byte)
    pub(super) attachments: Vec<Range<u64>>,
    /// damage of the file's structure; that of blocks is found when they are read
    pub damage: Vec<Damage>,
    /// number of chunks per compression
    pub compressions: BTreeMap<String, usize>,
    /// whether footer and magic are present
    pub is_complete: bool,
}

impl Recording {
    /// Opens a log and indexes its blocks.
    ///
    /// # Errors
    /// The file cannot be read, or is not MCAP.
    pub fn open(path: &Path) -> Result<Self> {
        let read = |source| Error::Read { path: path.into(), source };
        let source = Source::open(path).map_err(read)?;
        let magic = source.bytes(0..source.length().min(MAGIC.len() as u64)).map_err(read)?;
        if magic != MAGIC {
            return Err(Error::NotMcap { path: path.into(), hint: hint(&magic) });
        }
        let Index {
            mut blocks,
            bare_messages,
            has_summary,
            is_complete,
            profile,
            mut declarations,
            metadata,
            attachments,
            damage,
            compressions,
        } = Index::read(&source).map_err(read)?;
        (0..).zip(&mut blocks).for_each(|(number, block)| block.number = number);
        // Without a summary, or with one that repeats no channels, they are only inside chunks.
        if !is_complete || declarations.channels.is_empty() {
            for block in &blocks {
                let declared = block.read(&source, Window::ALL).map_err(read)?.declared;
                declared.into_iter().for_each(|record| declarations.add(record));
            }
        }
        let Declarations { schemas, channels } = declarations;
        Ok(Self {
            path: path.into(),
            source,
            sha256: OnceLock::new(),
            blocks,
            bare_messages,
            has_summary,
            profile,
            schemas,
            channels,
            metadata,
            attachments,
            damage,
            compressions,
            is_complete,
        })
    }

    /// As given to [`Self::open`].
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Length of the file (byte).
    pub fn length(&self) -> u64 {
        self.source.length()
    }

    /// Bytes read so far, without those read by [`Self::sha256`].
    pub fn bytes_read(&self) -> u64 {
        self.source.bytes_read()
    }

    /// SHA-256 of the file, in hexadecimal; computed once.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn sha256(&self) -> Result<&str> {
        if let Some(known) = self.sha256.get() {
            return Ok(known);
        }
        let computed = self.source.sha256().map_err(|source| self.failed(source))?;
        Ok(self.sha256.get_or_init(|| computed))
    }

    pub(super) fn failed(&self, source: io::Error) -> Error {
        Error::Read { path: self.path.clone(), source }
    }

    /// Chunks, and runs of messages outside of chunks, in the order of the file.
    pub fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// Number of chunks.
    pub fn chunk_count(&self) -> usize {
        self.blocks.iter().filter(|b| b.is_chunk()).count()
    }

    /// Whether a declaration inside a chunk equals the log's own, so that the chunk can be copied.
    fn has(&self, record: &Record<'_>) -> bool {
        match record {
            Record::Schema { header, data } => self.schemas.get(&header.id).is_some_and(|s| {
                s.name == header.name && s.encoding == header.encoding && s.data == data[..]
            }),
            Record::Channel(c) => self.channels.get(&c.id).is_some_and(|known| {
                let has_schema = c.schema_id == 0 || self.schemas.contains_key(&c.schema_id);
                let is_equal = (known.schema_id, &known.topic, &known.message_encoding)
                    == (c.schema_id, &c.topic, &c.message_encoding);
                has_schema && is_equal && known.metadata == c.metadata
            }),
            _ => false,
        }
    }

    /// Reads the messages of a block whose log time lies in the window, and its damage.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn read(&self, block: &Block, window: Window) -> Result<Contents> {
        let mut contents =
            block.read(&self.source, window).map_err(|source| self.failed(source))?;
        if !contents.declared.iter().all(|record| self.has(record)) {
            contents.chunk = None;
        }
        Ok(contents)
    }

    /// Messages whose log time lies in the window, and damage, in the order of the file.
    pub fn messages(&self, window: Window) -> impl Iterator<Item = Entry> + '_ {
        self.blocks.iter().filter(move |b| b.may_overlap(window)).flat_map(move |block| match block
            .read(&self.source, window)
        {
            Ok(contents) => contents.entries,
            Err(e) => {
                let reason = format!("it can no longer be read: {e}");
                vec![Entry::Damaged(Damage::at(0, reason))]
            }
        })
    }
}

/// What a file with another magic is, and how to convert it.
fn hint(magic: &[u8]) -> &'static str {
    match magic {
        [] => " (it is empty)",
        [b'#', b'R', b'O', b'S', b'B', b'A', b'G', ..] => {
            " but a ROS 1 bag; convert it first: `mcap convert in.bag out.mcap`"
        }
        [b'S', b'Q', b'L', b'i', b't', b'e', ..] => {
            " but a ROS 2 SQLite bag; convert it first: `ros2 bag convert`"
        }
        [0x28, 0xb5, 0x2f, 0xfd, ..] => " but a zstd file; decompress it first: `zstd -d`",
        _ => "",
    }
}
