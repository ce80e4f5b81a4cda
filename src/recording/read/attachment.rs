//! Attachments: any size, so they are copied as they lie, a little at a time.

use std::io;
use std::ops::Range;

use super::block::{sized_text, u64_at};
use super::{Damage, Recording};
use crate::error::Result;

/// An attachment of the log; its data stay in the file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Attachment {
    /// when it was recorded [ns]
    pub log_time: u64,
    /// when it was made [ns]
    pub create_time: u64,
    /// name
    pub name: String,
    /// media type
    pub media_type: String,
    /// size of its data [byte]
    pub size: u64,
    body: Range<u64>,
    data_at: u64,
}

impl Attachment {
    /// Length of its record's body [byte].
    pub fn body_length(&self) -> u64 {
        self.body.end - self.body.start
    }
}

/// Read at once [byte].
const STEP: u64 = 1 << 20;
/// Names and media types longer than this are damage [byte].
const LONGEST_HEAD: u64 = 64 << 10;

impl Recording {
    /// The attachments, and what could not be read of them.
    pub fn attachments(&self) -> impl Iterator<Item = std::result::Result<Attachment, Damage>> {
        self.attachments.iter().map(|body| {
            let damage =
                |reason: String| Damage { offset: body.start, start_ns: 0, end_ns: 0, reason };
            let attachment = self
                .attachment(body.clone())
                .map_err(|e| damage(format!("an attachment cannot be read: {e}")))?;
            let attachment =
                attachment.ok_or_else(|| damage("an attachment's lengths do not add up".into()))?;
            match self.attachment_holds(&attachment) {
                Ok(true) => Ok(attachment),
                Ok(false) => {
                    Err(damage("an attachment cannot be read: its checksum does not hold".into()))
                }
                Err(e) => Err(damage(format!("an attachment cannot be read: {e}"))),
            }
        })
    }

    fn attachment(&self, body: Range<u64>) -> io::Result<Option<Attachment>> {
        let head = self.source.bytes(body.start..body.end.min(body.start + LONGEST_HEAD))?;
        let parsed = || {
            let (name, at) = sized_text(&head, 16)?;
            let (media_type, at) = sized_text(&head, at)?;
            let size = u64_at(&head, at)?;
            let data_at = body.start + at as u64 + 8;
            let fits =
                data_at.checked_add(size).and_then(|end| end.checked_add(4)) == Some(body.end);
            let attachment = Attachment {
                log_time: u64_at(&head, 0)?,
                create_time: u64_at(&head, 8)?,
                name,
                media_type,
                size,
                body: body.clone(),
                data_at,
            };
            fits.then_some(attachment)
        };
        Ok(parsed())
    }

    /// Its checksum; none at all is as good as one that holds.
    fn attachment_holds(&self, attachment: &Attachment) -> io::Result<bool> {
        let Range { start, end } = attachment.body;
        let stored = self.source.bytes(end - 4..end)?;
        if stored == [0; 4] {
            return Ok(true);
        }
        let mut hash = crc32fast::Hasher::new();
        for at in (start..end - 4).step_by(STEP as usize) {
            hash.update(&self.source.bytes(at..(at + STEP).min(end - 4))?);
        }
        Ok(stored == hash.finalize().to_le_bytes())
    }

    /// An attachment's record body as it lies in the file, piece by piece.
    pub fn attachment_body(
        &self,
        attachment: &Attachment,
    ) -> impl Iterator<Item = Result<Vec<u8>>> {
        let Range { start, end } = attachment.body;
        (start..end)
            .step_by(STEP as usize)
            .map(move |at| self.source.bytes(at..(at + STEP).min(end)).map_err(|e| self.failed(e)))
    }

    /// An attachment's data.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn attachment_data(&self, attachment: &Attachment) -> Result<Vec<u8>> {
        self.source
            .bytes(attachment.data_at..attachment.data_at + attachment.size)
            .map_err(|e| self.failed(e))
    }
}
