//! The input file. Positioned reads, so that several threads read at once; no memory map and no
//! cache.

use std::fs::File;
use std::io;
use std::ops::Range;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

use sha2::Digest as _;

/// An open file of fixed length.
pub struct Source {
    file: File,
    length: u64,
    bytes_read: AtomicU64,
}

impl Source {
    /// Opens a regular file.
    pub fn open(path: &Path) -> io::Result<Self> {
        let file = File::open(path)?;
        let metadata = file.metadata()?;
        if metadata.is_dir() {
            return Err(io::Error::new(io::ErrorKind::IsADirectory, "it is a folder"));
        }
        if !metadata.is_file() {
            return Err(io::Error::new(
                io::ErrorKind::NotSeekable,
                "it is a stream or a device; write it to a file first",
            ));
        }
        Ok(Self { file, length: metadata.len(), bytes_read: AtomicU64::new(0) })
    }

    /// Length when it was opened (byte).
    pub fn length(&self) -> u64 {
        self.length
    }

    /// Bytes read so far.
    pub fn bytes_read(&self) -> u64 {
        self.bytes_read.load(Ordering::Relaxed)
    }

    /// The bytes of a range; an error where the file is shorter.
    pub fn bytes(&self, range: Range<u64>) -> io::Result<Vec<u8>> {
        let too_long = |_| {
            io::Error::new(
                io::ErrorKind::OutOfMemory,
                "a record of the file is too long for this machine",
            )
        };
        let size = usize::try_from(range.end.saturating_sub(range.start)).map_err(too_long)?;
        let mut buffer = vec![0; size];
        self.fill(&mut buffer, range.start)?;
        self.bytes_read.fetch_add(buffer.len() as u64, Ordering::Relaxed);
        Ok(buffer)
    }

    fn fill(&self, buffer: &mut [u8], offset: u64) -> io::Result<()> {
        read_exact_at(&self.file, buffer, offset).map_err(|e| match e.kind() {
            io::ErrorKind::UnexpectedEof => io::Error::new(
                e.kind(),
                "it became shorter while it was read; is it still being written or copied?",
            ),
            _ => e,
        })
    }

    /// Adds a range of the file to a fingerprint.
    pub fn hash_into(&self, hash: &mut sha2::Sha256, range: Range<u64>) -> io::Result<()> {
        let longest = range.end.saturating_sub(range.start).min(1 << 20) as usize;
        let mut buffer = vec![0; longest];
        let mut offset = range.start;
        while offset < range.end {
            let size = (range.end - offset).min(buffer.len() as u64) as usize;
            self.fill(&mut buffer[..size], offset)?;
            hash.update(&buffer[..size]);
            self.bytes_read.fetch_add(size as u64, Ordering::Relaxed);
            offset += size as u64;
        }
        Ok(())
    }
}

#[cfg(unix)]
fn read_exact_at(file: &File, buffer: &mut [u8], offset: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, buffer, offset)
}

#[cfg(windows)]
fn read_exact_at(file: &File, mut buffer: &mut [u8], mut offset: u64) -> io::Result<()> {
    while !buffer.is_empty() {
        match std::os::windows::fs::FileExt::seek_read(file, buffer, offset) {
            Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(n) => {
                buffer = &mut buffer[n..];
                offset += n as u64;
            }
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
    Ok(())
}
