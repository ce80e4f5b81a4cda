//! What the output is made of, in order: each piece becomes bytes on whichever core, and is written
//! when its turn comes.

use std::collections::BTreeMap;
use std::io::{self, Write as _};
use std::sync::Arc;

use mcap::records::op;

use super::super::read::RawChunk;
use super::records::{RecordBytes, message_index};
use crate::config::Compression;

/// A piece of the output that waits for its turn.
pub struct Piece(Kind);

enum Kind {
    /// declarations
    Bare(Vec<u8>),
    /// a chunk of the input as it is
    Packed(RawChunk),
    /// a chunk of our own
    Open(OpenChunk, Compression),
}

/// A chunk that is filled.
#[derive(Default)]
pub struct OpenChunk {
    /// its records
    pub records: Vec<u8>,
    /// channel, log time [ns] and place [byte] of every message
    pub messages: Vec<(u16, u64, u64)>,
    /// how much of it is in pictures that are compressed already [byte]
    pub picture_bytes: usize,
    /// whether it holds messages of the input
    pub holds_input: bool,
}

/// The bytes of a piece.
pub struct PieceBytes {
    pub(super) parts: Vec<Arc<Vec<u8>>>,
    /// their checksum, to be joined with those of other pieces
    pub(super) hash: crc32fast::Hasher,
    pub(super) chunk: Option<ChunkFacts>,
}

/// What the summary says of a chunk.
pub struct ChunkFacts {
    /// first and last log time [ns]
    pub times: (u64, u64),
    /// its record [byte]
    pub length: u64,
    /// channel, where its index begins behind the chunk [byte], messages
    pub channels: Vec<(u16, u64, u64)>,
    /// all indexes [byte]
    pub index_length: u64,
    pub compression: String,
    pub compressed_size: u64,
    pub uncompressed_size: u64,
}

impl Piece {
    pub(super) fn bare(records: Vec<u8>) -> Self {
        Self(Kind::Bare(records))
    }

    pub(super) fn packed(chunk: RawChunk) -> Self {
        Self(Kind::Packed(chunk))
    }

    pub(super) fn open(chunk: OpenChunk, compression: Compression) -> Self {
        Self(Kind::Open(chunk, compression))
    }

    /// What it takes in memory [byte].
    pub fn weight(&self) -> usize {
        match &self.0 {
            Kind::Bare(records) => records.len(),
            Kind::Packed(chunk) => chunk.record.len(),
            Kind::Open(chunk, _) => chunk.records.len(),
        }
    }

    /// Compresses it and makes its indexes and checksums.
    ///
    /// # Errors
    /// The compressor fails.
    pub fn into_bytes(self) -> io::Result<PieceBytes> {
        let (mut parts, facts, messages) = match self.0 {
            Kind::Bare(records) => (vec![Arc::new(records)], None, Vec::new()),
            Kind::Packed(RawChunk { record, compression, uncompressed_size, times, messages }) => {
                // Before the compressed records: the record's head, five numbers, and the name of
                // the compression.
                let head = 9 + 8 + 8 + 8 + 4 + 4 + compression.len() + 8;
                let (length, compressed_size) =
                    (record.len() as u64, record.len().saturating_sub(head) as u64);
                let facts = ChunkFacts {
                    times,
                    length,
                    channels: Vec::new(),
                    index_length: 0,
                    compression,
                    compressed_size,
                    uncompressed_size,
                };
                (vec![record], Some(facts), messages)
            }
            Kind::Open(chunk, compression) => {
                let (parts, facts, messages) = chunk.packed(compression)?;
                (parts, Some(facts), messages)
            }
        };
        let chunk = facts.map(|mut facts| {
            let mut by_channel: BTreeMap<u16, Vec<(u64, u64)>> = BTreeMap::new();
            for (channel, time, place) in messages {
                by_channel.entry(channel).or_default().push((time, place));
            }
            let mut index = Vec::new();
            for (channel, messages) in by_channel {
                facts.channels.push((channel, index.len() as u64, messages.len() as u64));
                index.extend(message_index(channel, &messages));
            }
            facts.index_length = index.len() as u64;
            parts.push(Arc::new(index));
            facts
        });
        let mut hash = crc32fast::Hasher::new();
        parts.iter().for_each(|part| hash.update(part));
        Ok(PieceBytes { parts, hash, chunk })
    }
}

type Parts = Vec<Arc<Vec<u8>>>;
type Messages = Vec<(u16, u64, u64)>;

impl OpenChunk {
    /// Its record in parts: head and compressed records.
    fn packed(self, compression: Compression) -> io::Result<(Parts, ChunkFacts, Messages)> {
        let size = self.records.len() as u64;
        let crc = crc32fast::hash(&self.records);
        let times = self.messages.iter().map(|m| m.1);
        let times = (times.clone().min().unwrap_or(0), times.max().unwrap_or(0));
        // JPEG, PNG and WebP are compressed already: doing it again costs time and gains nothing.
        let mostly_pictures = self.picture_bytes * 2 > self.records.len();
        let (name, data) = match compression {
            Compression::Auto if mostly_pictures => ("", self.records),
            Compression::Auto | Compression::Zstd => {
                ("zstd", zstd::bulk::compress(&self.records, LEVEL)?)
            }
            Compression::Lz4 => {
                let mut encoder =
                    lz4::EncoderBuilder::new().level(LEVEL as u32).build(Vec::new())?;
                encoder.write_all(&self.records)?;
                let (data, ended) = encoder.finish();
                ended?;
                ("lz4", data)
            }
            Compression::None => ("", self.records),
        };
        let compressed_size = data.len() as u64;
        let head = RecordBytes::new(op::CHUNK)
            .u64(times.0)
            .u64(times.1)
            .u64(size)
            .u32(crc)
            .text(name)
            .u64(compressed_size);
        let head = head.done_before(compressed_size);
        let facts = ChunkFacts {
            times,
            length: head.len() as u64 + compressed_size,
            channels: Vec::new(),
            index_length: 0,
            compression: name.into(),
            compressed_size,
            uncompressed_size: size,
        };
        Ok((vec![Arc::new(head), Arc::new(data)], facts, self.messages))
    }
}

/// Compression level: the quickest that compresses.
const LEVEL: i32 = 1;

/// Whether a message carries a JPEG, PNG or WebP file. It begins near the message's own beginning,
/// behind its header.
pub fn carries_picture(data: &[u8]) -> bool {
    const LOOK: usize = 512;
    const LEAST: usize = 4096;
    let near = &data[..data.len().min(LOOK)];
    let has = |magic: &[u8]| near.windows(magic.len()).any(|w| w == magic);
    data.len() >= LEAST
        && (has(&[0xff, 0xd8, 0xff])
            || has(b"\x89PNG\r\n\x1a\n")
            || near.windows(12).any(|w| w.starts_with(b"RIFF") && w.ends_with(b"WEBP")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_known_by_their_bytes() {
        let message = |magic: &[u8]| [&[7; 40], magic, &[1; 8192]].concat();
        for magic in [&b"\xff\xd8\xff\xe0"[..], b"\x89PNG\r\n\x1a\n", b"RIFF\x10\x20\x00\x00WEBP"] {
            assert!(carries_picture(&message(magic)));
        }
        assert!(
            !carries_picture(&message(b"RIFF\x10\x20\x00\x00WAVE"))
                && !carries_picture(&message(b""))
                && !carries_picture(b"\xff\xd8\xff")
        );
    }
}
