//! The file that is written: a temporary one beside the output, renamed when complete. Until then
//! nothing stands under the output's name, and what is unfinished is removed when the run fails or
//! is interrupted.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use mcap::records::op;

use super::super::read::{Attachment, Recording};
use super::Output;
use super::piece::{ChunkFacts, PieceBytes};
use super::records::{self, RecordBytes};
use crate::error::{Error, Result};

const MAGIC: &[u8] = b"\x89MCAP0\r\n";

/// The unfinished file of this process, for the handler of an interruption.
static UNFINISHED: Mutex<Option<PathBuf>> = Mutex::new(None);

/// Removes the unfinished output, if there is one: for the handler of an interruption.
pub fn remove_unfinished() {
    if let Ok(mut unfinished) = UNFINISHED.lock()
        && let Some(path) = unfinished.take()
    {
        let _gone = fs::remove_file(path);
    }
}

/// An attachment that is added.
pub struct NewAttachment<'a> {
    /// when it was recorded [ns]
    pub log_time: u64,
    /// when it was made [ns]
    pub create_time: u64,
    /// name
    pub name: &'a str,
    /// media type
    pub media_type: &'a str,
    /// data
    pub data: &'a [u8],
}

/// The output's file.
pub struct OutputFile {
    target: PathBuf,
    temporary: PathBuf,
    file: Option<BufWriter<File>>,
    at: u64,
    hash: crc32fast::Hasher,
    /// records of the summary, ready
    chunk_indexes: Vec<u8>,
    attachment_indexes: Vec<u8>,
    metadata_indexes: Vec<u8>,
    counts: Counts,
}

/// What the statistics record says.
#[derive(Default)]
struct Counts {
    messages: u64,
    attachments: u32,
    metadata: u32,
    chunks: u32,
    times: Option<(u64, u64)>,
    by_channel: BTreeMap<u16, u64>,
}

impl OutputFile {
    pub(super) fn create(target: &Path, profile: &str) -> Result<Self> {
        let name = target.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let temporary = target.with_file_name(format!(".{name}.{}.part", std::process::id()));
        let file = File::create(&temporary)
            .map_err(|source| Error::Write { path: target.into(), source })?;
        if let Ok(mut unfinished) = UNFINISHED.lock() {
            *unfinished = Some(temporary.clone());
        }
        let mut output = Self {
            target: target.into(),
            temporary,
            file: Some(BufWriter::with_capacity(1 << 20, file)),
            at: 0,
            hash: crc32fast::Hasher::new(),
            chunk_indexes: Vec::new(),
            attachment_indexes: Vec::new(),
            metadata_indexes: Vec::new(),
            counts: Counts::default(),
        };
        output.put_bytes(MAGIC)?;
        output
            .put_bytes(&records::header(profile, concat!("unwater ", env!("CARGO_PKG_VERSION"))))?;
        Ok(output)
    }

    fn failed(&self, source: io::Error) -> Error {
        Error::Write { path: self.target.clone(), source }
    }

    fn put_unhashed(&mut self, bytes: &[u8]) -> Result<()> {
        let written = match &mut self.file {
            Some(file) => file.write_all(bytes),
            None => Err(io::Error::other("it is finished already")),
        };
        written.map_err(|e| self.failed(e))?;
        self.at += bytes.len() as u64;
        Ok(())
    }

    fn put_bytes(&mut self, bytes: &[u8]) -> Result<()> {
        self.hash.update(bytes);
        self.put_unhashed(bytes)
    }

    /// Writes a piece whose turn has come.
    ///
    /// # Errors
    /// Writing failed, or making the bytes did.
    pub fn put(&mut self, piece: io::Result<PieceBytes>) -> Result<()> {
        let piece = piece.map_err(|e| self.failed(e))?;
        let start = self.at;
        for part in &piece.parts {
            self.put_unhashed(part)?;
        }
        self.hash.combine(&piece.hash);
        if let Some(chunk) = piece.chunk {
            self.list(&chunk, start);
        }
        Ok(())
    }

    /// Lists a chunk in the summary.
    fn list(&mut self, chunk: &ChunkFacts, start: u64) {
        let index_at = start + chunk.length;
        let record = RecordBytes::new(op::CHUNK_INDEX)
            .u64(chunk.times.0)
            .u64(chunk.times.1)
            .u64(start)
            .u64(chunk.length);
        let record = record.u32(10 * chunk.channels.len() as u32);
        let record = chunk
            .channels
            .iter()
            .fold(record, |record, (channel, at, _)| record.u16(*channel).u64(index_at + at));
        let record = record
            .u64(chunk.index_length)
            .text(&chunk.compression)
            .u64(chunk.compressed_size)
            .u64(chunk.uncompressed_size);
        self.chunk_indexes.extend(record.done());
        self.counts.chunks += 1;
        for (channel, _, messages) in &chunk.channels {
            *self.counts.by_channel.entry(*channel).or_default() += messages;
            self.counts.messages += messages;
        }
        if !chunk.channels.is_empty() {
            let (first, last) = self.counts.times.unwrap_or(chunk.times);
            self.counts.times = Some((first.min(chunk.times.0), last.max(chunk.times.1)));
        }
    }

    /// Takes over an attachment as it lies in the input.
    ///
    /// # Errors
    /// Reading or writing failed.
    pub fn copy_attachment(&mut self, input: &Recording, attachment: &Attachment) -> Result<()> {
        let start = self.at;
        self.put_bytes(&RecordBytes::new(op::ATTACHMENT).done_before(attachment.body_length()))?;
        for piece in input.attachment_body(attachment) {
            self.put_bytes(&piece?)?;
        }
        let Attachment { log_time, create_time, size, name, media_type, .. } = attachment;
        self.list_attachment(start, *log_time, *create_time, *size, name, media_type);
        Ok(())
    }

    /// Adds an attachment.
    ///
    /// # Errors
    /// Writing failed.
    pub fn attach(&mut self, attachment: &NewAttachment<'_>) -> Result<()> {
        let start = self.at;
        let NewAttachment { log_time, create_time, name, media_type, data } = *attachment;
        let record = RecordBytes::new(op::ATTACHMENT)
            .u64(log_time)
            .u64(create_time)
            .text(name)
            .text(media_type);
        let head = record.u64(data.len() as u64).done_before(data.len() as u64 + 4);
        let mut crc = crc32fast::Hasher::new();
        crc.update(&head[9..]);
        crc.update(data);
        self.put_bytes(&head)?;
        self.put_bytes(data)?;
        self.put_bytes(&crc.finalize().to_le_bytes())?;
        self.list_attachment(start, log_time, create_time, data.len() as u64, name, media_type);
        Ok(())
    }

    fn list_attachment(
        &mut self,
        start: u64,
        log_time: u64,
        create_time: u64,
        size: u64,
        name: &str,
        media_type: &str,
    ) {
        let record = RecordBytes::new(op::ATTACHMENT_INDEX)
            .u64(start)
            .u64(self.at - start)
            .u64(log_time)
            .u64(create_time)
            .u64(size);
        self.attachment_indexes.extend(record.text(name).text(media_type).done());
        self.counts.attachments += 1;
    }

    /// Adds a metadata record.
    ///
    /// # Errors
    /// Writing failed.
    pub fn metadata(&mut self, name: &str, pairs: &BTreeMap<String, String>) -> Result<()> {
        let record = records::metadata(name, pairs);
        let index = RecordBytes::new(op::METADATA_INDEX)
            .u64(self.at)
            .u64(record.len() as u64)
            .text(name)
            .done();
        self.metadata_indexes.extend(index);
        self.counts.metadata += 1;
        self.put_bytes(&record)
    }

    /// Writes summary and footer, and gives the file its name.
    ///
    /// # Errors
    /// Writing failed; nothing stands under the name then.
    pub fn finish(mut self, output: &Output) -> Result<()> {
        let data_crc = std::mem::take(&mut self.hash).finalize();
        self.put_unhashed(&RecordBytes::new(op::DATA_END).u32(data_crc).done())?;
        let summary = self.at;
        let counts = std::mem::take(&mut self.counts);
        let (first, last) = counts.times.unwrap_or_default();
        let statistics = RecordBytes::new(op::STATISTICS)
            .u64(counts.messages)
            .u16(output.schemas.len() as u16)
            .u32(output.channels.len() as u32)
            .u32(counts.attachments)
            .u32(counts.metadata)
            .u32(counts.chunks)
            .u64(first)
            .u64(last)
            .u32(10 * counts.by_channel.len() as u32);
        let statistics = counts
            .by_channel
            .iter()
            .fold(statistics, |record, (channel, messages)| record.u16(*channel).u64(*messages))
            .done();
        let groups = [
            (
                op::SCHEMA,
                output.schemas.iter().flat_map(|(id, s)| records::schema(*id, s)).collect(),
            ),
            (
                op::CHANNEL,
                output.channels.iter().flat_map(|(id, c)| records::channel(*id, c)).collect(),
            ),
            (op::STATISTICS, statistics),
            (op::CHUNK_INDEX, std::mem::take(&mut self.chunk_indexes)),
            (op::ATTACHMENT_INDEX, std::mem::take(&mut self.attachment_indexes)),
            (op::METADATA_INDEX, std::mem::take(&mut self.metadata_indexes)),
        ];
        let mut offsets = Vec::new();
        for (opcode, group) in groups.iter().filter(|(_, group): &&(u8, Vec<u8>)| !group.is_empty())
        {
            let offset = RecordBytes::new(op::SUMMARY_OFFSET)
                .bytes(&[*opcode])
                .u64(self.at)
                .u64(group.len() as u64);
            offsets.extend(offset.done());
            self.put_bytes(group)?;
        }
        let offsets_at = self.at;
        self.put_bytes(&offsets)?;
        // The summary's checksum goes as far as the footer's own.
        let footer = RecordBytes::new(op::FOOTER).u64(summary).u64(offsets_at).done_before(4);
        self.put_bytes(&footer)?;
        let summary_crc = std::mem::take(&mut self.hash).finalize();
        self.put_unhashed(&summary_crc.to_le_bytes())?;
        self.put_unhashed(MAGIC)?;
        if let Some(file) = self.file.take() {
            let file = file.into_inner().map_err(|e| self.failed(e.into_error()))?;
            file.sync_all().map_err(|e| self.failed(e))?;
        }
        fs::rename(&self.temporary, &self.target).map_err(|e| self.failed(e))?;
        if let Ok(mut unfinished) = UNFINISHED.lock() {
            *unfinished = None;
        }
        Ok(())
    }
}

impl Drop for OutputFile {
    fn drop(&mut self) {
        // The file is closed first; after `finish` succeeded there is nothing unfinished left to
        // remove.
        drop(self.file.take());
        remove_unfinished();
    }
}
