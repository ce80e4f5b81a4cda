//! An open log.

use std::collections::BTreeMap;
use std::io;
use std::ops::Range;
use std::path::Path;
use std::sync::OnceLock;

use mcap::records::{Metadata, Record};
use sha2::Digest as _;

use super::super::source::Source;
use super::block::{Block, Contents, Entry};
use super::files::LogFiles;
use super::fingerprint::{Fingerprint, LogIdentity, hexadecimal};
use super::index::Index;
use super::part::Part;
use super::types::{Channel, Damage, Declarations, Schema, Window};
use crate::error::{Error, Result};

/// An open log.
#[derive(Default)]
pub struct Recording {
    files: LogFiles,
    name: String,
    parts: Vec<Part>,
    /// whether it has several parts, so that damage names its own
    is_split: bool,
    sha256: OnceLock<String>,
    /// of the indexes of all files
    index_hash: sha2::Sha256,
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
    /// bodies of the attachment records, with the index of their file (byte)
    pub(super) attachments: Vec<(usize, Range<u64>)>,
    /// damage of the file's structure; that of blocks is found when they are read
    pub damage: Vec<Damage>,
    /// number of chunks per compression
    pub compressions: BTreeMap<String, usize>,
    /// whether footer and magic are present
    pub is_complete: bool,
}

impl Recording {
    /// Opens a log, a file or a folder, and indexes its blocks.
    ///
    /// # Errors
    /// The file cannot be read, or is not MCAP.
    pub fn open(path: &Path) -> Result<Self> {
        Self::open_files(&path.into())
    }

    /// Opens a log of one file or several. A part that is no MCAP file is damage, where another
    /// one is.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn open_files(files: &LogFiles) -> Result<Self> {
        let files = files.expanded()?;
        let LogFiles { path, stem, parts, missing } = &files;
        let own_name = path.file_name().map(|n| n.to_string_lossy().into_owned());
        let name = own_name.filter(|_| parts.as_slice() == [path.clone()]);
        let name = name.unwrap_or_else(|| stem.clone());
        let is_split = parts.len() > 1;
        let known = Self { has_summary: true, is_complete: true, ..Self::default() };
        let mut recording = Self { name, is_split, ..known };
        let (mut unusable, mut first_error) = (Vec::new(), None);
        for part in parts {
            match Part::open(part) {
                Ok((part, index)) => recording.add(part, index)?,
                Err(error @ Error::NotMcap { .. }) => {
                    unusable.push(error.to_string());
                    first_error.get_or_insert(error);
                }
                Err(error) => return Err(error),
            }
        }
        match first_error {
            Some(error) if recording.parts.is_empty() => return Err(error),
            _ => {}
        }
        let missing = missing.iter().map(|part| format!("the part {part} is missing"));
        let lost = unusable.into_iter().chain(missing).map(|reason| Damage::at(0, reason));
        recording.damage.extend(lost);
        recording.files = files;
        Ok(recording)
    }

    fn add(&mut self, mut part: Part, index: Index) -> Result<()> {
        let mut declarations = Declarations {
            schemas: std::mem::take(&mut self.schemas),
            channels: std::mem::take(&mut self.channels),
        };
        part.declare(index.declarations, &mut declarations)?;
        Declarations { schemas: self.schemas, channels: self.channels } = declarations;
        let number = self.parts.len();
        for mut block in index.blocks {
            (block.number, block.part) = (self.blocks.len() as u32, number);
            block.rename_channels(|id| part.channel(id));
            self.blocks.push(block);
        }
        self.attachments.extend(index.attachments.into_iter().map(|body| (number, body)));
        self.metadata.extend(index.metadata);
        self.index_hash.update(index.hash.finalize());
        self.bare_messages += index.bare_messages;
        self.has_summary &= index.has_summary;
        self.is_complete &= index.is_complete;
        if self.profile.is_empty() {
            self.profile = index.profile;
        }
        for (name, chunks) in index.compressions {
            *self.compressions.entry(name).or_default() += chunks;
        }
        self.parts.push(part);
        for damage in index.damage {
            self.damage.push(self.located(number, damage));
        }
        Ok(())
    }

    /// Path of the file, of the folder, or of the first part.
    pub fn path(&self) -> &Path {
        &self.files.path
    }

    /// What it was opened from.
    pub fn files(&self) -> &LogFiles {
        &self.files
    }

    /// Name of the file or of the whole recording, without its folder.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Files, with their first and last log time as far as it is known (ns).
    pub fn parts(&self) -> impl Iterator<Item = (&Path, Option<(u64, u64)>)> {
        self.parts.iter().map(|part| (part.path.as_path(), part.times))
    }

    /// Length of all files (byte).
    pub fn length(&self) -> u64 {
        self.parts.iter().map(|part| part.source.length()).sum()
    }

    /// Bytes read so far.
    pub fn bytes_read(&self) -> u64 {
        self.parts.iter().map(|part| part.source.bytes_read()).sum()
    }

    /// SHA-256 of the file, or of all parts one after another, in hexadecimal; computed once.
    ///
    /// # Errors
    /// A file cannot be read.
    pub fn sha256(&self) -> Result<&str> {
        if let Some(known) = self.sha256.get() {
            return Ok(known);
        }
        let mut hash = sha2::Sha256::new();
        for (number, part) in self.parts.iter().enumerate() {
            let hashed = part.source.hash_into(&mut hash, 0..part.source.length());
            hashed.map_err(|source| self.failed(number, source))?;
        }
        Ok(self.keep_sha256(&hash.finalize()))
    }

    pub(super) fn keep_sha256(&self, hash: &[u8]) -> &str {
        self.sha256.get_or_init(|| hexadecimal(hash))
    }

    /// What identifies the log, as far as it was read: the fingerprint of its bytes where all of
    /// them were.
    pub fn identity(&self) -> LogIdentity {
        LogIdentity {
            sha256: self.sha256.get().cloned().unwrap_or_default(),
            index_sha256: hexadecimal(&self.index_hash.clone().finalize()),
        }
    }

    /// Whether it is the log of an identity. Of one whose bytes were all read, all are compared.
    ///
    /// # Errors
    /// A file cannot be read.
    pub fn equals(&self, other: &LogIdentity) -> Result<bool> {
        if other.sha256.is_empty() {
            return Ok(self.identity().is_same(other));
        }
        Ok(self.sha256()? == other.sha256)
    }

    /// The same, without reading what has not been read where the indexes can be compared.
    ///
    /// # Errors
    /// A file cannot be read.
    pub fn is(&self, other: &LogIdentity) -> Result<bool> {
        if other.index_sha256.is_empty() {
            return self.equals(other);
        }
        Ok(self.identity().is_same(other))
    }

    /// Begins the fingerprint that [`Self::sha256`] returns, of blocks that are read anyway.
    pub fn fingerprint(&self) -> Fingerprint<'_> {
        Fingerprint::new(self)
    }

    pub(super) fn part_count(&self) -> usize {
        self.parts.len()
    }

    pub(super) fn source(&self, part: usize) -> &Source {
        &self.parts[part].source
    }

    pub(super) fn failed(&self, part: usize, source: io::Error) -> Error {
        Error::Read { path: self.parts[part].path.clone(), source }
    }

    /// Damage in a file, which is named where there are several.
    pub(super) fn located(&self, part: usize, damage: Damage) -> Damage {
        match self.parts[part].path.file_name().filter(|_| self.is_split) {
            None => damage,
            Some(name) => {
                let reason = format!("{}: {}", name.to_string_lossy(), damage.reason);
                Damage { reason, ..damage }
            }
        }
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
        self.contents(block, window).map_err(|source| self.failed(block.part, source))
    }

    fn contents(&self, block: &Block, window: Window) -> io::Result<Contents> {
        let mut contents = block.read(self.source(block.part), window)?;
        self.parts[block.part].rename(&mut contents);
        if !contents.declared.iter().all(|record| self.has(record)) {
            contents.chunk = None;
        }
        for entry in &mut contents.entries {
            if let Entry::Damaged(damage) = entry {
                *damage = self.located(block.part, damage.clone());
            }
        }
        Ok(contents)
    }

    /// Messages whose log time lies in the window, and damage, in the order of the file.
    pub fn messages(&self, window: Window) -> impl Iterator<Item = Entry> + '_ {
        self.blocks.iter().filter(move |b| b.may_overlap(window)).flat_map(move |block| match self
            .contents(block, window)
        {
            Ok(contents) => contents.entries,
            Err(e) => {
                let reason = format!("it can no longer be read: {e}");
                vec![Entry::Damaged(Damage::at(0, reason))]
            }
        })
    }
}
