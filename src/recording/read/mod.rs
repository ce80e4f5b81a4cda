//! Reading: an index of the file's blocks, made in one pass over the record headers, and positioned
//! reads of single blocks.
//!
//! No summary is needed, so a truncated log reads like any other, up to the last whole record of
//! its last chunk. A chunk is read on request, verified against its checksum, and not kept: memory
//! scales with the chunk, not with the log. A chunk with a wrong size is read as far as its data
//! goes.
//!
//! A log of several files (`files`: the parts of a split recording) reads like one: blocks are
//! numbered through, and where a part numbers its channels otherwise, they are renamed (`part`).
//!
//! The files depend on each other in this order: `records`, `types` and `message`, `block`,
//! `index`, `files` and `part`, `recording`, `fingerprint`, `attachment` and `notes`.

mod attachment;
mod block;
mod files;
mod fingerprint;
mod index;
mod message;
mod notes;
mod part;
mod recording;
mod records;
mod types;

pub use attachment::Attachment;
pub use block::{Block, Contents, Entry, RawChunk};
pub use files::LogFiles;
pub use fingerprint::{Fingerprint, LogIdentity};
pub use message::{FrameId, Message};
pub use recording::Recording;
pub use records::{MAGIC, MessageHeader, RECORD_HEADER};
pub use types::{Channel, Damage, Declarations, Schema, Window, free_id};
