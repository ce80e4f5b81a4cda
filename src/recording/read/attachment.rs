//! Attachments. They may be large: they are copied in small pieces.

use std::io;
use std::ops::Range;

use super::recording::Recording;
use super::records::{string_at, u64_at};
use super::types::Damage;
use crate::error::Result;

/// An attachment of the log; its data stay in the file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Attachment {
    /// when it was recorded (ns)
    pub log_time: u64,
    /// when it was made (ns)
    pub create_time: u64,
    /// file name
    pub name: String,
    /// MIME type
    pub media_type: String,
    /// of the data (byte)
    pub size: u64,
    /// index of the file it is in
    part: usize,
    body: Range<u64>,
    data_offset: u64,
}

impl Attachment {
    /// Length of the record's body (byte).
    pub fn body_length(&self) -> u64 {
        self.body.end - self.body.start
    }
}

/// Size of one read (byte).
const READ_SIZE: u64 = 1 << 20;
/// Largest part before the data; longer names and media types are damage (byte).
const MAX_HEADER: u64 = 64 << 10;

impl Recording {
    /// The attachments, and their damage.
    pub fn attachments(&self) -> impl Iterator<Item = std::result::Result<Attachment, Damage>> {
        self.attachments.iter().map(|(part, body)| {
            let damage = |reason: String| self.located(*part, Damage::at(body.start, reason));
            let unreadable = |e| damage(format!("an attachment cannot be read: {e}"));
            let attachment = self
                .attachment(*part, body.clone())
                .map_err(unreadable)?
                .ok_or_else(|| damage("the lengths of an attachment are inconsistent".into()))?;
            if self.is_checksum_valid(&attachment).map_err(unreadable)? {
                Ok(attachment)
            } else {
                Err(damage("an attachment cannot be read: its checksum is wrong".into()))
            }
        })
    }

    fn attachment(&self, part: usize, body: Range<u64>) -> io::Result<Option<Attachment>> {
        let head = self.source(part).bytes(body.start..body.end.min(body.start + MAX_HEADER))?;
        let parsed = || {
            let (name, at) = string_at(&head, 16)?;
            let (media_type, at) = string_at(&head, at)?;
            let size = u64_at(&head, at)?;
            let data_offset = body.start + at as u64 + 8;
            let end = data_offset.checked_add(size).and_then(|end| end.checked_add(4));
            let attachment = Attachment {
                log_time: u64_at(&head, 0)?,
                create_time: u64_at(&head, 8)?,
                name,
                media_type,
                size,
                part,
                body: body.clone(),
                data_offset,
            };
            (end == Some(body.end)).then_some(attachment)
        };
        Ok(parsed())
    }

    /// Whether the checksum is right, or absent.
    fn is_checksum_valid(&self, attachment: &Attachment) -> io::Result<bool> {
        let (source, Range { start, end }) =
            (self.source(attachment.part), attachment.body.clone());
        let stored = source.bytes(end - 4..end)?;
        if stored == [0; 4] {
            return Ok(true);
        }
        let mut hash = crc32fast::Hasher::new();
        for at in (start..end - 4).step_by(READ_SIZE as usize) {
            hash.update(&source.bytes(at..(at + READ_SIZE).min(end - 4))?);
        }
        Ok(stored == hash.finalize().to_le_bytes())
    }

    /// The body of an attachment record as in the file, in pieces.
    pub fn attachment_body(
        &self,
        attachment: &Attachment,
    ) -> impl Iterator<Item = Result<Vec<u8>>> {
        let Range { start, end } = attachment.body.clone();
        let part = attachment.part;
        (start..end).step_by(READ_SIZE as usize).map(move |at| {
            let bytes = self.source(part).bytes(at..(at + READ_SIZE).min(end));
            bytes.map_err(|e| self.failed(part, e))
        })
    }

    /// The data of an attachment.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn attachment_data(&self, attachment: &Attachment) -> Result<Vec<u8>> {
        self.source(attachment.part)
            .bytes(attachment.data_offset..attachment.data_offset + attachment.size)
            .map_err(|e| self.failed(attachment.part, e))
    }
}
