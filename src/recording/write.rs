//! Writing. [`Output`] puts pieces together: chunks of the input as they are, and chunks of our own
//! behind them. Each piece becomes bytes on whichever core ([`Piece::into_bytes`]); [`OutputFile`]
//! writes them in order.

mod file;
mod piece;
mod records;

use std::collections::{BTreeMap, VecDeque};
use std::fs;
use std::path::Path;

use super::read::{Channel, Message, RawChunk, Schema};
use crate::config::{Compression, OutputConfig};
use crate::error::{Error, Result};

pub use file::{NewAttachment, OutputFile, remove_unfinished};
pub use piece::{Piece, PieceBytes};

/// Refuses an output that is the input itself (also by another name of it), or that exists already.
///
/// # Errors
/// [`Error::OutputIsInput`], [`Error::OutputExists`].
pub fn check_output_path(input: &Path, output: &Path, force: bool) -> Result<()> {
    let same = match (fs::canonicalize(input), fs::canonicalize(output)) {
        (Ok(a), Ok(b)) => a == b || same_file(&a, &b),
        _ => false,
    };
    if same {
        return Err(Error::OutputIsInput { path: output.into() });
    }
    if output.is_dir() {
        let source = std::io::Error::new(
            std::io::ErrorKind::IsADirectory,
            "it is a folder; give a file name with -o",
        );
        return Err(Error::Write { path: output.into(), source });
    }
    if fs::metadata(output).is_ok_and(|found| !found.is_file()) {
        let source = std::io::Error::new(
            std::io::ErrorKind::InvalidInput,
            "it is a device or a pipe; give the name of a file with -o",
        );
        return Err(Error::Write { path: output.into(), source });
    }
    if output.symlink_metadata().is_ok() && !force {
        return Err(Error::OutputExists { path: output.into() });
    }
    Ok(())
}

#[cfg(unix)]
fn same_file(a: &Path, b: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    matches!((fs::metadata(a), fs::metadata(b)), (Ok(a), Ok(b)) if a.dev() == b.dev() && a.ino() == b.ino())
}

#[cfg(not(unix))]
fn same_file(_: &Path, _: &Path) -> bool {
    false
}

/// A channel that is added; ids are chosen free of the input's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NewChannel(u16);

/// What is to be written, until it goes out in pieces.
pub struct Output {
    compression: Compression,
    chunk_size: usize,
    schemas: BTreeMap<u16, Schema>,
    channels: BTreeMap<u16, Channel>,
    sequences: BTreeMap<u16, u32>,
    open: piece::OpenChunk,
    pieces: VecDeque<Piece>,
}

impl Output {
    /// An output of such a profile, and its temporary file beside `target`.
    ///
    /// # Errors
    /// The folder cannot be written.
    pub fn create(
        target: &Path,
        profile: &str,
        config: &OutputConfig,
    ) -> Result<(Self, OutputFile)> {
        let output = Self {
            compression: config.compression,
            chunk_size: usize::try_from(config.chunk_size_mib << 20).unwrap_or(usize::MAX),
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            sequences: BTreeMap::new(),
            open: piece::OpenChunk::default(),
            pieces: VecDeque::new(),
        };
        Ok((output, OutputFile::create(target, profile)?))
    }

    /// Takes over a schema under its own id. Declarations lie before the chunks, for readers that
    /// do not seek.
    pub fn copy_schema(&mut self, id: u16, schema: &Schema) {
        self.pieces.push_back(Piece::bare(records::schema(id, schema)));
        self.schemas.insert(id, schema.clone());
    }

    /// Takes over a channel under its own id.
    pub fn copy_channel(&mut self, id: u16, channel: &Channel) {
        if self.channels.insert(id, channel.clone()).is_none() {
            self.pieces.push_back(Piece::bare(records::channel(id, channel)));
        }
    }

    /// Adds a channel of messages that are encoded so.
    ///
    /// # Errors
    /// The log has as many schemas or channels as MCAP can number.
    pub fn add_channel(
        &mut self,
        topic: &str,
        message_encoding: &str,
        schema: &Schema,
    ) -> Result<NewChannel> {
        let full = |what: &str| {
            Error::Usage(format!(
                "the log has as many {what} as MCAP can number; leave some out with --only"
            ))
        };
        let known = self.schemas.iter().find(|(_, s)| *s == schema).map(|(id, _)| *id);
        let schema_id = match known {
            Some(id) => id,
            None => {
                let id = free_id(&self.schemas).ok_or_else(|| full("schemas"))?;
                self.copy_schema(id, schema);
                id
            }
        };
        let id = free_id(&self.channels).ok_or_else(|| full("channels"))?;
        self.copy_channel(
            id,
            &Channel {
                schema_id,
                topic: topic.into(),
                message_encoding: message_encoding.into(),
                metadata: BTreeMap::new(),
            },
        );
        Ok(NewChannel(id))
    }

    /// Whether a chunk of the input may stand in the output as it is: in the compression that was
    /// asked for, if one was.
    pub fn can_copy(compression: Compression, chunk: &RawChunk) -> bool {
        match compression {
            Compression::Auto => true,
            Compression::Zstd => chunk.compression == "zstd",
            Compression::Lz4 => chunk.compression == "lz4",
            Compression::None => chunk.compression.is_empty(),
        }
    }

    /// Takes over a chunk as it is, with all its messages.
    pub fn copy_chunk(&mut self, chunk: RawChunk) {
        // Messages of the input keep their order; what is added may follow later.
        if self.open.holds_input {
            self.flush();
        }
        self.pieces.push_back(Piece::packed(chunk));
    }

    /// Takes over a message, byte for byte.
    pub fn copy_message(&mut self, message: &Message) {
        self.open.holds_input = true;
        self.message(
            message.channel,
            message.sequence,
            message.log_time,
            message.publish_time,
            message.data(),
        );
    }

    /// Adds a message; it is numbered by its channel.
    pub fn write(&mut self, channel: NewChannel, log_time: u64, publish_time: u64, data: &[u8]) {
        let next = self.sequences.entry(channel.0).or_default();
        let sequence = *next;
        *next = next.wrapping_add(1);
        self.message(channel.0, sequence, log_time, publish_time, data);
    }

    fn message(
        &mut self,
        channel: u16,
        sequence: u32,
        log_time: u64,
        publish_time: u64,
        data: &[u8],
    ) {
        let open = &mut self.open;
        open.messages.push((channel, log_time, open.records.len() as u64));
        let head = records::message_head(channel, sequence, log_time, publish_time, data.len());
        open.records.reserve(head.len() + data.len());
        open.records.extend_from_slice(&head);
        open.records.extend_from_slice(data);
        if piece::carries_picture(data) {
            open.picture_bytes += data.len();
        }
        if open.records.len() >= self.chunk_size {
            self.flush();
        }
    }

    /// Closes the chunk that is being filled.
    pub fn flush(&mut self) {
        let chunk = std::mem::take(&mut self.open);
        if !chunk.messages.is_empty() {
            self.pieces.push_back(Piece::open(chunk, self.compression));
        }
    }

    /// The next piece that is complete.
    pub fn next_piece(&mut self) -> Option<Piece> {
        self.pieces.pop_front()
    }
}

/// An id that is not taken: behind the last one, or in a gap. 0 is no schema's.
fn free_id<T>(taken: &BTreeMap<u16, T>) -> Option<u16> {
    let behind = taken.last_key_value().map_or(Some(1), |(last, _)| last.checked_add(1));
    behind.or_else(|| (1..=u16::MAX).find(|id| !taken.contains_key(id)))
}
