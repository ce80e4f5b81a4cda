//! The parts of the output. Each piece is serialised on any thread and written in its turn.

use std::collections::BTreeMap;
use std::io::{self, Write as _};
use std::sync::Arc;

use mcap::records::op;

use super::super::read::RawChunk;
use super::records::{self, MessageHeader, RECORD_HEADER, RecordBuilder, message_index};
use crate::config::Compression;

/// A part of the output.
pub struct Piece(Kind);

enum Kind {
    /// declarations
    Records(Vec<u8>),
    /// a chunk of the input
    Copied(RawChunk),
    New(ChunkBuilder, Compression),
}

/// Channel id, log time (ns) and offset (byte) of every message of a chunk.
type Messages = Vec<(u16, u64, u64)>;
/// A chunk record in two parts: the fields before the records, and the compressed records.
type ChunkParts = Vec<Arc<Vec<u8>>>;

/// A chunk being filled.
#[derive(Default)]
pub struct ChunkBuilder {
    records: Vec<u8>,
    messages: Messages,
    /// size of messages with compressed images (byte)
    image_bytes: usize,
    /// whether it has messages of the input
    pub holds_input: bool,
}

/// A serialised piece.
pub struct PieceBytes {
    pub(super) parts: Vec<Arc<Vec<u8>>>,
    /// checksum of the parts, to be combined with those of other pieces
    pub(super) hash: crc32fast::Hasher,
    pub(super) chunk: Option<ChunkFacts>,
}

/// Summary of a chunk.
pub struct ChunkFacts {
    /// first and last log time (ns)
    pub times: (u64, u64),
    /// of the record (byte)
    pub length: u64,
    /// channel id, offset of its index after the chunk (byte), number of messages
    pub channels: Vec<(u16, u64, u64)>,
    /// of all indexes (byte)
    pub index_length: u64,
    pub compression: String,
    /// (byte)
    pub compressed_size: u64,
    /// (byte)
    pub uncompressed_size: u64,
}

impl Piece {
    pub(super) fn records(records: Vec<u8>) -> Self {
        Self(Kind::Records(records))
    }

    pub(super) fn copied(chunk: RawChunk) -> Self {
        Self(Kind::Copied(chunk))
    }

    pub(super) fn new_chunk(chunk: ChunkBuilder, compression: Compression) -> Self {
        Self(Kind::New(chunk, compression))
    }

    /// Size in memory (byte).
    pub fn memory_bytes(&self) -> usize {
        match &self.0 {
            Kind::Records(records) => records.len(),
            Kind::Copied(chunk) => chunk.record.len(),
            Kind::New(chunk, _) => chunk.len(),
        }
    }

    /// Serialises the piece: compresses it, and computes its indexes and checksums.
    ///
    /// # Errors
    /// The compressor fails.
    pub fn into_bytes(self) -> io::Result<PieceBytes> {
        let (mut parts, chunk) = match self.0 {
            Kind::Records(records) => (vec![Arc::new(records)], None),
            Kind::Copied(chunk) => {
                let (part, facts, messages) = copied(chunk);
                (vec![part], Some((facts, messages)))
            }
            Kind::New(chunk, compression) => {
                let (parts, facts, messages) = chunk.compressed(compression)?;
                (parts, Some((facts, messages)))
            }
        };
        let chunk = chunk.map(|(facts, messages)| {
            let (facts, index) = indexed(facts, messages);
            parts.push(Arc::new(index));
            facts
        });
        let mut hash = crc32fast::Hasher::new();
        parts.iter().for_each(|part| hash.update(part));
        Ok(PieceBytes { parts, hash, chunk })
    }
}

/// The record of a copied chunk.
fn copied(chunk: RawChunk) -> (Arc<Vec<u8>>, ChunkFacts, Messages) {
    let RawChunk { record, compression, uncompressed_size, times, messages } = chunk;
    // Fields of the body before the compressed records: five numbers, and the compression.
    let header = RECORD_HEADER + 8 + 8 + 8 + 4 + 4 + compression.len() + 8;
    let facts = ChunkFacts {
        times,
        length: record.len() as u64,
        channels: Vec::new(),
        index_length: 0,
        compression,
        compressed_size: record.len().saturating_sub(header) as u64,
        uncompressed_size,
    };
    (record, facts, messages)
}

/// The message indexes of a chunk.
fn indexed(mut facts: ChunkFacts, messages: Messages) -> (ChunkFacts, Vec<u8>) {
    let mut by_channel: BTreeMap<u16, Vec<(u64, u64)>> = BTreeMap::new();
    for (channel, time, offset) in messages {
        by_channel.entry(channel).or_default().push((time, offset));
    }
    let mut index = Vec::new();
    for (channel, messages) in by_channel {
        facts.channels.push((channel, index.len() as u64, messages.len() as u64));
        index.extend(message_index(channel, &messages));
    }
    facts.index_length = index.len() as u64;
    (facts, index)
}

impl ChunkBuilder {
    /// Size of its records (byte).
    pub fn len(&self) -> usize {
        self.records.len()
    }

    pub fn is_empty(&self) -> bool {
        self.messages.is_empty()
    }

    /// Adds a message.
    pub fn push(&mut self, header: &MessageHeader, data: &[u8]) {
        self.messages.push((header.channel, header.log_time, self.records.len() as u64));
        let head = records::message(header, data.len());
        self.records.reserve(head.len() + data.len());
        self.records.extend_from_slice(&head);
        self.records.extend_from_slice(data);
        if has_compressed_image(data) {
            self.image_bytes += data.len();
        }
    }

    /// The chunk record in two parts: the fields before the records, and the compressed records.
    fn compressed(
        self,
        compression: Compression,
    ) -> io::Result<(ChunkParts, ChunkFacts, Messages)> {
        let uncompressed_size = self.records.len() as u64;
        let crc = crc32fast::hash(&self.records);
        let times = self.messages.iter().map(|m| m.1);
        let times = (times.clone().min().unwrap_or(0), times.max().unwrap_or(0));
        // JPEG, PNG and WebP are compressed already: a second time takes time and saves nothing.
        let is_mostly_images = self.image_bytes * 2 > self.records.len();
        let (name, data) = match compression {
            Compression::Auto if is_mostly_images => ("", self.records),
            Compression::Auto | Compression::Zstd => {
                ("zstd", zstd::bulk::compress(&self.records, LEVEL)?)
            }
            Compression::Lz4 => {
                let mut encoder =
                    lz4::EncoderBuilder::new().level(LEVEL as u32).build(Vec::new())?;
                encoder.write_all(&self.records)?;
                let (data, finished) = encoder.finish();
                finished?;
                ("lz4", data)
            }
            Compression::None => ("", self.records),
        };
        let compressed_size = data.len() as u64;
        let head = RecordBuilder::new(op::CHUNK)
            .u64(times.0)
            .u64(times.1)
            .u64(uncompressed_size)
            .u32(crc)
            .text(name)
            .u64(compressed_size)
            .finish_before(compressed_size);
        let facts = ChunkFacts {
            times,
            length: head.len() as u64 + compressed_size,
            channels: Vec::new(),
            index_length: 0,
            compression: name.into(),
            compressed_size,
            uncompressed_size,
        };
        Ok((vec![Arc::new(head), Arc::new(data)], facts, self.messages))
    }
}

/// Compression level, the fastest.
const LEVEL: i32 = 1;

/// Whether a message holds a JPEG, PNG or WebP file, which begins shortly after its header.
fn has_compressed_image(data: &[u8]) -> bool {
    const MAX_OFFSET: usize = 512;
    const MIN_SIZE: usize = 4096;
    let start = &data[..data.len().min(MAX_OFFSET)];
    let has = |magic: &[u8]| start.windows(magic.len()).any(|w| w == magic);
    data.len() >= MIN_SIZE
        && (has(&[0xff, 0xd8, 0xff])
            || has(b"\x89PNG\r\n\x1a\n")
            || start.windows(12).any(|w| w.starts_with(b"RIFF") && w.ends_with(b"WEBP")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn compressed_images_are_recognised_by_their_magic() {
        let message = |magic: &[u8]| [&[7; 40], magic, &[1; 8192]].concat();
        for magic in [&b"\xff\xd8\xff\xe0"[..], b"\x89PNG\r\n\x1a\n", b"RIFF\x10\x20\x00\x00WEBP"] {
            assert!(has_compressed_image(&message(magic)));
        }
        assert!(
            !has_compressed_image(&message(b"RIFF\x10\x20\x00\x00WAVE"))
                && !has_compressed_image(&message(b""))
                && !has_compressed_image(b"\xff\xd8\xff")
        );
    }
}
