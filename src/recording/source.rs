//! The file that is read, by positioned reads: nothing is mapped, nothing is kept, and many cores
//! may read at once.

use std::fs::File;
use std::io;
use std::ops::Range;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

use sha2::Digest;

/// An opened file of a length that is known.
pub struct Source {
    file: File,
    length: u64,
    read: AtomicU64,
}

impl Source {
    /// Opens a file; a folder is refused.
    pub fn open(path: &Path) -> io::Result<Self> {
        let file = File::open(path)?;
        let facts = file.metadata()?;
        if facts.is_dir() {
            return Err(io::Error::new(
                io::ErrorKind::IsADirectory,
                "it is a folder; give the .mcap file inside it",
            ));
        }
        if !facts.is_file() {
            return Err(io::Error::new(
                io::ErrorKind::NotSeekable,
                "it is no file but a stream or a device; write it to a file first",
            ));
        }
        Ok(Self { file, length: facts.len(), read: AtomicU64::new(0) })
    }

    /// Length when it was opened [byte].
    pub fn length(&self) -> u64 {
        self.length
    }

    /// Bytes that have been read so far, of the file's own and not of its fingerprint.
    pub fn bytes_read(&self) -> u64 {
        self.read.load(Ordering::Relaxed)
    }

    /// A stretch of it, all of it or an error.
    pub fn bytes(&self, place: Range<u64>) -> io::Result<Vec<u8>> {
        let too_long = |_| {
            io::Error::new(
                io::ErrorKind::OutOfMemory,
                "a stretch of the file is too long for this machine",
            )
        };
        let mut buffer =
            vec![0; usize::try_from(place.end.saturating_sub(place.start)).map_err(too_long)?];
        self.fill(&mut buffer, place.start)?;
        self.read.fetch_add(buffer.len() as u64, Ordering::Relaxed);
        Ok(buffer)
    }

    fn fill(&self, buffer: &mut [u8], at: u64) -> io::Result<()> {
        read_exact_at(&self.file, buffer, at).map_err(|e| match e.kind() {
            io::ErrorKind::UnexpectedEof => io::Error::new(
                e.kind(),
                "it became shorter while it was read; is it still being written or copied?",
            ),
            _ => e,
        })
    }

    /// SHA-256 of the whole file in hexadecimal.
    pub fn sha256(&self) -> io::Result<String> {
        let mut buffer = vec![0; 1 << 20];
        let mut hash = sha2::Sha256::new();
        let mut at = 0;
        while at < self.length {
            let size = (self.length - at).min(buffer.len() as u64) as usize;
            self.fill(&mut buffer[..size], at)?;
            hash.update(&buffer[..size]);
            at += size as u64;
        }
        Ok(hash.finalize().iter().map(|b| format!("{b:02x}")).collect())
    }
}

#[cfg(unix)]
fn read_exact_at(file: &File, buffer: &mut [u8], at: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, buffer, at)
}

#[cfg(windows)]
fn read_exact_at(file: &File, mut buffer: &mut [u8], mut at: u64) -> io::Result<()> {
    while !buffer.is_empty() {
        match std::os::windows::fs::FileExt::seek_read(file, buffer, at) {
            Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(n) => {
                buffer = &mut buffer[n..];
                at += n as u64;
            }
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
    Ok(())
}
