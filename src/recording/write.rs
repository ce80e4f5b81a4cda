//! Writing: a temporary file beside the output, renamed when complete. Until then nothing stands under the
//! output's name, and what is unfinished is removed when the run fails or is interrupted.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use mcap::records::MessageHeader;

use super::read::{Channel, Message, Schema};
use crate::config::{Compression, OutputConfig};
use crate::error::{Error, Result};

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

/// Refuses an output that is the input itself (also by another name of it), or that exists already.
///
/// # Errors
/// [`Error::OutputIsInput`], [`Error::OutputExists`].
pub fn ensure_distinct(input: &Path, output: &Path, force: bool) -> Result<()> {
    let same = match (fs::canonicalize(input), fs::canonicalize(output)) {
        (Ok(a), Ok(b)) => a == b || same_file(&a, &b),
        _ => false,
    };
    if same {
        return Err(Error::OutputIsInput { path: output.into() });
    }
    if output.is_dir() {
        let source = std::io::Error::new(std::io::ErrorKind::IsADirectory, "it is a folder; give a file name with -o");
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

/// The file that is written.
pub struct Output {
    target: PathBuf,
    temporary: PathBuf,
    writer: Option<mcap::Writer<BufWriter<File>>>,
    sequences: BTreeMap<u16, u32>,
}

impl Output {
    /// Opens a temporary file beside `target`.
    ///
    /// # Errors
    /// The folder cannot be written.
    pub fn create(target: &Path, profile: &str, config: &OutputConfig) -> Result<Self> {
        let name = target.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let temporary = target.with_file_name(format!(".{name}.{}.part", std::process::id()));
        let failed = |source| Error::Write { path: target.into(), source };
        let file = File::create(&temporary).map_err(failed)?;
        if let Ok(mut unfinished) = UNFINISHED.lock() {
            *unfinished = Some(temporary.clone());
        }
        let compression = match config.compression {
            Compression::Zstd => Some(mcap::Compression::Zstd),
            Compression::Lz4 => Some(mcap::Compression::Lz4),
            Compression::None => None,
        };
        let writer = mcap::WriteOptions::new()
            .compression(compression)
            .compression_level(1)
            .compression_threads(0) // the default follows the machine, and so would the bytes
            .chunk_size(Some(config.chunk_size_mib << 20))
            .profile(profile)
            .library(concat!("unwater ", env!("CARGO_PKG_VERSION")))
            .create(BufWriter::with_capacity(1 << 20, file));
        let mut output = Self { target: target.into(), temporary, writer: None, sequences: BTreeMap::new() };
        output.writer = Some(output.checked(writer)?);
        Ok(output)
    }

    fn checked<T>(&self, result: mcap::McapResult<T>) -> Result<T> {
        result.map_err(|e| match e {
            mcap::McapError::Io(source) => Error::Write { path: self.target.clone(), source },
            other => Error::WriteRecord { path: self.target.clone(), reason: other.to_string() },
        })
    }

    fn with<T>(&mut self, act: impl FnOnce(&mut mcap::Writer<BufWriter<File>>) -> mcap::McapResult<T>) -> Result<T> {
        let result = match &mut self.writer {
            Some(writer) => act(writer),
            None => return Err(Error::WriteRecord { path: self.target.clone(), reason: "it is finished already".into() }),
        };
        self.checked(result)
    }

    /// Takes over a schema under its own id.
    ///
    /// # Errors
    /// Writing failed.
    pub fn copy_schema(&mut self, id: u16, schema: &Schema) -> Result<()> {
        self.with(|w| w.add_schema_with_id(id, &schema.name, &schema.encoding, &schema.data)).map(drop)
    }

    /// Takes over a channel under its own id.
    ///
    /// # Errors
    /// Writing failed, or its schema is not there.
    pub fn copy_channel(&mut self, id: u16, channel: &Channel) -> Result<()> {
        self.with(|w| w.add_channel_with_id(id, channel.schema_id, &channel.topic, &channel.message_encoding, &channel.metadata)).map(drop)
    }

    /// Adds a channel of messages that are encoded so.
    ///
    /// # Errors
    /// Writing failed.
    pub fn add_channel(&mut self, topic: &str, message_encoding: &str, schema: &Schema) -> Result<NewChannel> {
        self.with(|w| {
            let schema = w.add_schema(&schema.name, &schema.encoding, &schema.data)?;
            w.add_channel(schema, topic, message_encoding, &BTreeMap::new())
        })
        .map(NewChannel)
    }

    /// Takes over a message, byte for byte.
    ///
    /// # Errors
    /// Writing failed.
    pub fn copy(&mut self, message: &Message) -> Result<()> {
        let header =
            MessageHeader { channel_id: message.channel, sequence: message.sequence, log_time: message.log_time, publish_time: message.publish_time };
        self.with(|w| w.write_to_known_channel(&header, message.data()))
    }

    /// Adds a message; it is numbered by its channel.
    ///
    /// # Errors
    /// Writing failed.
    pub fn write(&mut self, channel: NewChannel, log_time: u64, publish_time: u64, data: &[u8]) -> Result<()> {
        let next = self.sequences.entry(channel.0).or_default();
        let header = MessageHeader { channel_id: channel.0, sequence: *next, log_time, publish_time };
        *next = next.wrapping_add(1);
        self.with(|w| w.write_to_known_channel(&header, data))
    }

    /// Adds an attachment.
    ///
    /// # Errors
    /// Writing failed.
    pub fn attach(&mut self, attachment: &mcap::Attachment<'_>) -> Result<()> {
        self.with(|w| w.attach(attachment))
    }

    /// Adds a metadata record.
    ///
    /// # Errors
    /// Writing failed.
    pub fn metadata(&mut self, record: &mcap::records::Metadata) -> Result<()> {
        self.with(|w| w.write_metadata(record))
    }

    /// Completes the file and gives it its name.
    ///
    /// # Errors
    /// Writing failed; nothing stands under the name then.
    pub fn finish(mut self) -> Result<()> {
        self.with(mcap::Writer::finish).map(drop)?;
        let failed = |source| Error::Write { path: self.target.clone(), source };
        if let Some(writer) = self.writer.take() {
            let file = writer.into_inner().into_inner().map_err(|e| failed(e.into_error()))?;
            file.sync_all().map_err(failed)?;
        }
        fs::rename(&self.temporary, &self.target).map_err(failed)?;
        if let Ok(mut unfinished) = UNFINISHED.lock() {
            *unfinished = None;
        }
        Ok(())
    }
}

impl Drop for Output {
    fn drop(&mut self) {
        // The writer closes its file first; after `finish` succeeded there is nothing unfinished left to remove.
        drop(self.writer.take());
        remove_unfinished();
    }
}
