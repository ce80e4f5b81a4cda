//! SHA-256 of a log, of blocks that are read anyway.

use sha2::Digest as _;

use super::block::{Block, Contents};
use super::recording::Recording;
use crate::error::Result;

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
