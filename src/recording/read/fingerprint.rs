//! SHA-256 of a log, of blocks that are read anyway; and of its index, where not all are read.

use serde::{Deserialize, Serialize};
use sha2::Digest as _;

use super::block::{Block, Contents};
use super::recording::Recording;
use crate::error::Result;

/// What identifies a log, wherever its files lie.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LogIdentity {
    /// SHA-256 of its files, one after another; empty where only a window was read
    pub sha256: String,
    /// SHA-256 of the places and beginnings of its records; empty in files of earlier versions
    pub index_sha256: String,
}

impl LogIdentity {
    /// Whether all bytes were read.
    pub fn is_whole(&self) -> bool {
        !self.sha256.is_empty()
    }

    /// Whether both are of one log, by all bytes where both were read as a whole.
    pub fn is_same(&self, other: &Self) -> bool {
        if self.is_whole() && other.is_whole() {
            return self.sha256 == other.sha256;
        }
        !self.index_sha256.is_empty() && self.index_sha256 == other.index_sha256
    }
}

impl std::fmt::Display for LogIdentity {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.is_whole() {
            write!(f, "SHA-256 {}", self.sha256)
        } else {
            write!(f, "SHA-256 of its index {}", self.index_sha256)
        }
    }
}

/// A fingerprint in hexadecimal.
pub fn hexadecimal(hash: &[u8]) -> String {
    hash.iter().map(|b| format!("{b:02x}")).collect()
}

/// SHA-256 of the files of a log, one after another, as far as they have been added.
pub struct Fingerprint<'r> {
    recording: &'r Recording,
    hash: sha2::Sha256,
    /// index of the file and offset in it up to which bytes have been added (byte)
    added: (usize, u64),
    /// whether a block came too late
    is_out_of_order: bool,
}

impl<'r> Fingerprint<'r> {
    pub(super) fn new(recording: &'r Recording) -> Self {
        let (hash, added) = (sha2::Sha256::new(), (0, 0));
        Self { recording, hash, added, is_out_of_order: false }
    }

    /// Adds a block that has been read. Blocks come in the order of the file; what lies between
    /// them is read here.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn add(&mut self, block: &Block, contents: &Contents) -> Result<()> {
        let (start, bytes) = (block.start(), &contents.raw);
        self.is_out_of_order |= (block.part, start) < self.added;
        if self.is_out_of_order || bytes.is_empty() {
            return Ok(());
        }
        self.read_up_to(block.part, start)?;
        self.hash.update(bytes.as_slice());
        self.added = (block.part, start + bytes.len() as u64);
        Ok(())
    }

    /// Adds the rest. The recording keeps the result.
    ///
    /// # Errors
    /// A file cannot be read.
    pub fn finish(mut self) -> Result<()> {
        if self.is_out_of_order {
            return self.recording.sha256().map(drop);
        }
        let parts = self.recording.part_count();
        self.read_up_to(parts, 0)?;
        self.recording.keep_sha256(&self.hash.finalize());
        Ok(())
    }

    /// Reads from where it is up to an offset in a part.
    fn read_up_to(&mut self, part: usize, offset: u64) -> Result<()> {
        while self.added < (part, offset) {
            let (current, from) = self.added;
            let source = self.recording.source(current);
            let is_last = current == part;
            let end = if is_last { offset } else { source.length() };
            let hashed = source.hash_into(&mut self.hash, from..end);
            hashed.map_err(|error| self.recording.failed(current, error))?;
            self.added = if is_last { (current, end) } else { (current + 1, 0) };
        }
        Ok(())
    }
}
