//! The order of the output's pieces, with its schemas and channels.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::path::Path;

use super::super::digest::{ChannelDigest, Fingerprinted};
use super::super::read::{Channel, Declarations, Message, RawChunk, Schema, free_id};
use super::file::OutputFile;
use super::piece::{ChunkBuilder, Piece};
use super::records::{self, MessageHeader};
use crate::config::{Compression, OutputConfig};
use crate::error::{Error, Result};

/// A channel added to those of the input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NewChannel(u16);

impl NewChannel {
    /// Its id in the file.
    pub fn id(self) -> u16 {
        self.0
    }
}

/// The contents of the output, a queue of pieces.
pub struct Output {
    compression: Compression,
    /// uncompressed (byte)
    chunk_size: usize,
    declarations: Declarations,
    /// channel ids of the input, also of channels that are left out: they may still be copied
    reserved: BTreeSet<u16>,
    /// next sequence number of added channels
    sequences: BTreeMap<u16, u32>,
    /// fingerprints of added messages, where nothing is written
    digests: Option<BTreeMap<u16, ChannelDigest>>,
    /// schemas (true) and channels in the order of their declaration
    declared: Vec<(bool, u16)>,
    /// per chunk that is one of the input, the number of messages written before it
    copied_chunks: Vec<Option<u64>>,
    /// messages written one by one
    written: u64,
    open: ChunkBuilder,
    pieces: VecDeque<Piece>,
}

impl Output {
    /// An empty output, and its temporary file beside `target`.
    ///
    /// # Errors
    /// The file cannot be created.
    pub fn create(
        target: &Path,
        profile: &str,
        config: &OutputConfig,
    ) -> Result<(Self, OutputFile)> {
        Ok((Self::empty(config), OutputFile::create(target, profile)?))
    }

    /// An output that is not written: what remains of it are the fingerprints of added messages.
    pub fn discarding(config: &OutputConfig) -> (Self, OutputFile) {
        let output = Self { digests: Some(BTreeMap::new()), ..Self::empty(config) };
        (output, OutputFile::discarding())
    }

    fn empty(config: &OutputConfig) -> Self {
        Self {
            compression: config.compression,
            chunk_size: usize::try_from(config.chunk_size_mib << 20).unwrap_or(usize::MAX),
            declarations: Declarations::default(),
            reserved: BTreeSet::new(),
            sequences: BTreeMap::new(),
            digests: None,
            declared: Vec::new(),
            copied_chunks: Vec::new(),
            written: 0,
            open: ChunkBuilder::default(),
            pieces: VecDeque::new(),
        }
    }

    /// Fingerprints of added messages by topic, one by one; empty where the output was written.
    pub fn digests(self) -> BTreeMap<String, ChannelDigest> {
        let channels = &self.declarations.channels;
        let named =
            |(id, digest): (u16, ChannelDigest)| Some((channels.get(&id)?.topic.clone(), digest));
        self.digests.unwrap_or_default().into_iter().filter_map(named).collect()
    }

    /// Schemas and channels so far.
    pub fn declarations(&self) -> &Declarations {
        &self.declarations
    }

    /// Copies a schema with its id. Declarations precede the chunks, for readers that do not seek.
    pub fn copy_schema(&mut self, id: u16, schema: &Schema) {
        self.pieces.push_back(Piece::records(records::schema(id, schema)));
        self.declarations.schemas.insert(id, schema.clone());
        self.declared.push((true, id));
    }

    /// Keeps these ids from added channels.
    pub fn reserve_channels(&mut self, ids: impl Iterator<Item = u16>) {
        self.reserved.extend(ids);
    }

    /// Copies a channel with its id.
    pub fn copy_channel(&mut self, id: u16, channel: &Channel) {
        if self.declarations.channels.insert(id, channel.clone()).is_none() {
            self.pieces.push_back(Piece::records(records::channel(id, channel)));
            self.declared.push((false, id));
        }
    }

    /// Adds a channel under an unused id.
    ///
    /// # Errors
    /// All ids of schemas or channels are in use.
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
        let known = self.declarations.schemas.iter().find(|(_, s)| *s == schema).map(|(id, _)| *id);
        let schema_id = match known {
            Some(id) => id,
            None => {
                let id = free_id(&self.declarations.schemas).ok_or_else(|| full("schemas"))?;
                self.copy_schema(id, schema);
                id
            }
        };
        let used = self.declarations.channels.keys().chain(&self.reserved);
        let used: BTreeMap<u16, ()> = used.map(|id| (*id, ())).collect();
        let id = free_id(&used).ok_or_else(|| full("channels"))?;
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

    /// Schemas (true) and channels so far, in the order of their declaration.
    pub fn declared(&self) -> &[(bool, u16)] {
        &self.declared
    }

    /// Per chunk so far, if it is one of the input, the number of messages that were written one by
    /// one before it; they may be in a later chunk.
    pub fn copied_chunks(&self) -> &[Option<u64>] {
        &self.copied_chunks
    }

    /// A declared channel as one that messages are added to.
    pub fn added_channel(&self, id: u16) -> Option<NewChannel> {
        self.declarations.channels.contains_key(&id).then_some(NewChannel(id))
    }

    /// Sequence number of the next message of an added channel.
    pub fn next_sequence(&self, channel: NewChannel) -> u32 {
        self.sequences.get(&channel.0).copied().unwrap_or_default()
    }

    /// Whether a chunk of the input has the configured compression, so that it can be copied.
    pub fn can_copy(compression: Compression, chunk: &RawChunk) -> bool {
        match compression {
            Compression::Auto => true,
            Compression::Zstd => chunk.compression == "zstd",
            Compression::Lz4 => chunk.compression == "lz4",
            Compression::None => chunk.compression.is_empty(),
        }
    }

    /// Copies a chunk as it is, with all its messages.
    pub fn copy_chunk(&mut self, chunk: RawChunk) {
        // Messages of the input keep their order; added ones may follow later.
        if self.open.holds_input {
            self.flush();
        }
        self.copied_chunks.push(Some(self.written));
        self.pieces.push_back(Piece::copied(chunk));
    }

    /// Copies a message byte for byte.
    pub fn copy_message(&mut self, message: &Message) {
        self.open.holds_input = true;
        let header = MessageHeader {
            channel: message.channel,
            sequence: message.sequence,
            log_time: message.log_time,
            publish_time: message.publish_time,
        };
        self.push(&header, message.data());
    }

    /// Adds a message with the next sequence number of its channel.
    pub fn write(&mut self, channel: NewChannel, log_time: u64, publish_time: u64, data: &[u8]) {
        let next = self.sequences.entry(channel.0).or_default();
        let header = MessageHeader { channel: channel.0, sequence: *next, log_time, publish_time };
        *next = next.wrapping_add(1);
        let Some(digests) = &mut self.digests else { return self.push(&header, data) };
        let digest = digests.entry(channel.0).or_insert_with(|| ChannelDigest::of_groups(1));
        let sequence = header.sequence;
        digest.add(Fingerprinted { sequence, log_time, publish_time, data });
    }

    fn push(&mut self, header: &MessageHeader, data: &[u8]) {
        self.written += 1;
        self.open.push(header, data);
        if self.open.len() >= self.chunk_size {
            self.flush();
        }
    }

    /// Closes the open chunk.
    pub fn flush(&mut self) {
        let chunk = std::mem::take(&mut self.open);
        if !chunk.is_empty() {
            self.copied_chunks.push(None);
            self.pieces.push_back(Piece::new_chunk(chunk, self.compression));
        }
    }

    /// The next complete piece.
    pub fn next_piece(&mut self) -> Option<Piece> {
        self.pieces.pop_front()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A channel that is left out may still be copied, for a frame without a corrected version.
    #[test]
    fn added_channels_take_no_id_of_the_input() {
        let (mut out, _) = Output::discarding(&OutputConfig::default());
        let channel = |topic: &str| Channel {
            schema_id: 0,
            topic: topic.into(),
            message_encoding: "json".into(),
            metadata: BTreeMap::new(),
        };
        out.reserve_channels([1, 2, 3].into_iter());
        out.copy_channel(1, &channel("/imu"));
        let schema = Schema { name: "S".into(), encoding: "jsonschema".into(), data: Vec::new() };
        let added = out.add_channel("/unwater/frame", "json", &schema).expect("a channel");
        assert!(added.id() > 3);
        out.copy_channel(3, &channel("/camera"));
        let topic = |id: u16| out.declarations().channels[&id].topic.clone();
        assert_eq!((topic(3), topic(added.id())), ("/camera".into(), "/unwater/frame".into()));
    }
}
