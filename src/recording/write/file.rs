//! The output file: a temporary file beside the target, renamed when complete. It is removed when
//! the run fails or is interrupted.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use mcap::records::op;

use super::super::read::{Attachment, Declarations, MAGIC, Recording};
use super::piece::{ChunkFacts, PieceBytes};
use super::records::{self, RECORD_HEADER, RecordBuilder};
use crate::error::{Error, Result};

/// The temporary file of this process, for the signal handler.
static UNFINISHED: Mutex<Option<PathBuf>> = Mutex::new(None);

/// Removes the temporary file, if there is one: for the signal handler.
pub fn remove_unfinished() {
    if let Ok(mut unfinished) = UNFINISHED.lock()
        && let Some(path) = unfinished.take()
    {
        let _removed = fs::remove_file(path);
    }
}

/// An added attachment.
pub struct NewAttachment<'a> {
    /// when it was recorded (ns)
    pub log_time: u64,
    /// when it was made (ns)
    pub create_time: u64,
    /// file name
    pub name: &'a str,
    /// MIME type
    pub media_type: &'a str,
    /// contents
    pub data: &'a [u8],
}

/// The output file.
pub struct OutputFile {
    target: PathBuf,
    temporary: PathBuf,
    file: Option<BufWriter<File>>,
    /// bytes written
    offset: u64,
    /// whether nothing is written
    is_discarded: bool,
    /// checksum of the current section
    hash: crc32fast::Hasher,
    /// index records of the summary
    indexes: Indexes,
    statistics: Statistics,
}

#[derive(Default)]
struct Indexes {
    chunks: Vec<u8>,
    attachments: Vec<u8>,
    metadata: Vec<u8>,
}

#[derive(Default)]
struct Statistics {
    messages: u64,
    attachments: u32,
    metadata: u32,
    chunks: u32,
    /// first and last log time (ns)
    times: Option<(u64, u64)>,
    /// messages by channel id
    by_channel: BTreeMap<u16, u64>,
}

impl Statistics {
    fn add(&mut self, chunk: &ChunkFacts) {
        self.chunks += 1;
        for (channel, _, messages) in &chunk.channels {
            *self.by_channel.entry(*channel).or_default() += messages;
            self.messages += messages;
        }
        if !chunk.channels.is_empty() {
            let (first, last) = self.times.unwrap_or(chunk.times);
            self.times = Some((first.min(chunk.times.0), last.max(chunk.times.1)));
        }
    }

    fn record(&self, declarations: &Declarations) -> Vec<u8> {
        let (first, last) = self.times.unwrap_or_default();
        let record = RecordBuilder::new(op::STATISTICS)
            .u64(self.messages)
            .u16(declarations.schemas.len() as u16)
            .u32(declarations.channels.len() as u32)
            .u32(self.attachments)
            .u32(self.metadata)
            .u32(self.chunks)
            .u64(first)
            .u64(last)
            .u32(10 * self.by_channel.len() as u32);
        self.by_channel
            .iter()
            .fold(record, |record, (channel, messages)| record.u16(*channel).u64(*messages))
            .finish()
    }
}

/// Removes what killed runs on this output have left; files of runs that go on stay.
fn remove_left_behind(target: &Path, name: &str) {
    let folder = target.parent().filter(|f| !f.as_os_str().is_empty());
    let Ok(files) = std::fs::read_dir(folder.unwrap_or(Path::new("."))) else { return };
    // Where running processes cannot be listed, any may go on.
    let processes = Path::new("/proc");
    let is_running =
        |process: &str| !processes.join("self").exists() || processes.join(process).exists();
    for file in files.flatten() {
        let found = file.file_name().to_string_lossy().into_owned();
        let process =
            found.strip_prefix(&format!(".{name}.")).and_then(|f| f.strip_suffix(".part"));
        let is_of_run = |p: &&str| !p.is_empty() && p.bytes().all(|b| b.is_ascii_digit());
        if process.filter(is_of_run).is_some_and(|process| !is_running(process)) {
            // The run does not depend on it.
            let _kept = std::fs::remove_file(file.path());
        }
    }
}

impl OutputFile {
    pub(super) fn create(target: &Path, profile: &str) -> Result<Self> {
        let name = target.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let temporary = target.with_file_name(format!(".{name}.{}.part", std::process::id()));
        remove_left_behind(target, &name);
        let file = File::create(&temporary)
            .map_err(|source| Error::Write { path: target.into(), source })?;
        if let Ok(mut unfinished) = UNFINISHED.lock() {
            *unfinished = Some(temporary.clone());
        }
        let mut output = Self {
            target: target.into(),
            temporary,
            file: Some(BufWriter::with_capacity(1 << 20, file)),
            offset: 0,
            is_discarded: false,
            hash: crc32fast::Hasher::new(),
            indexes: Indexes::default(),
            statistics: Statistics::default(),
        };
        output.write(MAGIC)?;
        output.write(&records::header(profile, concat!("unwater ", env!("CARGO_PKG_VERSION"))))?;
        Ok(output)
    }

    /// A file that does not exist, and takes everything.
    pub(super) fn discarding() -> Self {
        Self {
            target: PathBuf::new(),
            temporary: PathBuf::new(),
            file: None,
            offset: 0,
            is_discarded: true,
            hash: crc32fast::Hasher::new(),
            indexes: Indexes::default(),
            statistics: Statistics::default(),
        }
    }

    fn failed(&self, source: io::Error) -> Error {
        Error::Write { path: self.target.clone(), source }
    }

    fn write_unhashed(&mut self, bytes: &[u8]) -> Result<()> {
        if self.is_discarded {
            return Ok(());
        }
        let written = match &mut self.file {
            Some(file) => file.write_all(bytes),
            None => Err(io::Error::other("it is finished already")),
        };
        written.map_err(|e| self.failed(e))?;
        self.offset += bytes.len() as u64;
        Ok(())
    }

    fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.hash.update(bytes);
        self.write_unhashed(bytes)
    }

    /// Writes the next piece.
    ///
    /// # Errors
    /// The piece could not be serialised or written.
    pub fn put(&mut self, piece: io::Result<PieceBytes>) -> Result<()> {
        let piece = piece.map_err(|e| self.failed(e))?;
        let start = self.offset;
        for part in &piece.parts {
            self.write_unhashed(part)?;
        }
        self.hash.combine(&piece.hash);
        if let Some(chunk) = piece.chunk {
            self.index_chunk(&chunk, start);
        }
        Ok(())
    }

    fn index_chunk(&mut self, chunk: &ChunkFacts, start: u64) {
        let index_start = start + chunk.length;
        let record = RecordBuilder::new(op::CHUNK_INDEX)
            .u64(chunk.times.0)
            .u64(chunk.times.1)
            .u64(start)
            .u64(chunk.length)
            .u32(10 * chunk.channels.len() as u32);
        let record = chunk.channels.iter().fold(record, |record, (channel, offset, _)| {
            record.u16(*channel).u64(index_start + offset)
        });
        let record = record
            .u64(chunk.index_length)
            .text(&chunk.compression)
            .u64(chunk.compressed_size)
            .u64(chunk.uncompressed_size);
        self.indexes.chunks.extend(record.finish());
        self.statistics.add(chunk);
    }

    /// Copies an attachment of the input.
    ///
    /// # Errors
    /// Reading or writing failed.
    pub fn copy_attachment(&mut self, input: &Recording, attachment: &Attachment) -> Result<()> {
        let start = self.offset;
        let head = RecordBuilder::new(op::ATTACHMENT).finish_before(attachment.body_length());
        self.write(&head)?;
        for piece in input.attachment_body(attachment) {
            self.write(&piece?)?;
        }
        let Attachment { log_time, create_time, size, name, media_type, .. } = attachment;
        let fields = attachment_fields((*log_time, *create_time), *size, name, media_type);
        self.index_attachment(start, fields);
        Ok(())
    }

    /// Adds an attachment.
    ///
    /// # Errors
    /// Writing failed.
    pub fn attach(&mut self, attachment: &NewAttachment<'_>) -> Result<()> {
        let start = self.offset;
        let NewAttachment { log_time, create_time, name, media_type, data } = *attachment;
        let size = data.len() as u64;
        let head = RecordBuilder::new(op::ATTACHMENT)
            .u64(log_time)
            .u64(create_time)
            .text(name)
            .text(media_type)
            .u64(size)
            .finish_before(size + 4);
        let mut crc = crc32fast::Hasher::new();
        crc.update(&head[RECORD_HEADER..]);
        crc.update(data);
        self.write(&head)?;
        self.write(data)?;
        self.write(&crc.finalize().to_le_bytes())?;
        self.index_attachment(
            start,
            attachment_fields((log_time, create_time), size, name, media_type),
        );
        Ok(())
    }

    /// Adds the index of an attachment record from `start` to the current offset.
    fn index_attachment(&mut self, start: u64, fields: Vec<u8>) {
        let record = RecordBuilder::new(op::ATTACHMENT_INDEX).u64(start).u64(self.offset - start);
        self.indexes.attachments.extend(record.bytes(&fields).finish());
        self.statistics.attachments += 1;
    }

    /// Adds a metadata record.
    ///
    /// # Errors
    /// Writing failed.
    pub fn metadata(&mut self, name: &str, pairs: &BTreeMap<String, String>) -> Result<()> {
        let record = records::metadata(name, pairs);
        let index = RecordBuilder::new(op::METADATA_INDEX)
            .u64(self.offset)
            .u64(record.len() as u64)
            .text(name)
            .finish();
        self.indexes.metadata.extend(index);
        self.statistics.metadata += 1;
        self.write(&record)
    }

    /// Writes summary and footer, and renames the file to its target.
    ///
    /// # Errors
    /// Writing failed; then there is no file at the target.
    pub fn finish(mut self, declarations: &Declarations) -> Result<()> {
        if self.is_discarded {
            return Ok(());
        }
        let data_crc = std::mem::take(&mut self.hash).finalize();
        self.write_unhashed(&RecordBuilder::new(op::DATA_END).u32(data_crc).finish())?;
        let summary_start = self.offset;
        let offsets = self.write_summary(declarations)?;
        let offsets_start = self.offset;
        self.write(&offsets)?;
        // The checksum of the summary includes the footer up to the checksum itself.
        let footer = RecordBuilder::new(op::FOOTER).u64(summary_start).u64(offsets_start);
        self.write(&footer.finish_before(4))?;
        let summary_crc = std::mem::take(&mut self.hash).finalize();
        self.write_unhashed(&summary_crc.to_le_bytes())?;
        self.write_unhashed(MAGIC)?;
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

    /// Writes the groups of the summary. Returns the summary offset records.
    fn write_summary(&mut self, declarations: &Declarations) -> Result<Vec<u8>> {
        let Declarations { schemas, channels } = declarations;
        let indexes = std::mem::take(&mut self.indexes);
        let groups: [(u8, Vec<u8>); 6] = [
            (op::SCHEMA, schemas.iter().flat_map(|(id, s)| records::schema(*id, s)).collect()),
            (op::CHANNEL, channels.iter().flat_map(|(id, c)| records::channel(*id, c)).collect()),
            (op::STATISTICS, self.statistics.record(declarations)),
            (op::CHUNK_INDEX, indexes.chunks),
            (op::ATTACHMENT_INDEX, indexes.attachments),
            (op::METADATA_INDEX, indexes.metadata),
        ];
        let mut offsets = Vec::new();
        for (opcode, group) in groups.iter().filter(|(_, group)| !group.is_empty()) {
            let offset = RecordBuilder::new(op::SUMMARY_OFFSET)
                .bytes(&[*opcode])
                .u64(self.offset)
                .u64(group.len() as u64);
            offsets.extend(offset.finish());
            self.write(group)?;
        }
        Ok(offsets)
    }
}

/// Last fields of an attachment index: log and create time (ns), size (byte), name, media type.
fn attachment_fields(times: (u64, u64), size: u64, name: &str, media_type: &str) -> Vec<u8> {
    let fields = RecordBuilder::new(op::ATTACHMENT_INDEX).u64(times.0).u64(times.1).u64(size);
    fields.text(name).text(media_type).finish().split_off(RECORD_HEADER)
}

impl Drop for OutputFile {
    fn drop(&mut self) {
        // Close the file before removing it. After a successful `finish` nothing is left to remove.
        if !self.is_discarded {
            drop(self.file.take());
            remove_unfinished();
        }
    }
}
