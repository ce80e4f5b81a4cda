//! MCAP input and output. The container format is known to this module only.
//!
//! **Kept.** Every message with its bytes, times, sequence number and order per channel; every
//! schema and channel with its metadata and id, including those without messages; attachments;
//! metadata records. **Changed.** Declarations precede all chunks; summary and indexes are new. A
//! chunk of which nothing is left out is copied byte for byte; the messages of others are chunked
//! and compressed again. **Order.** Messages are in the order of the input; an added message
//! follows the message it belongs to, in a chunk of its own. Attachments and metadata are at the
//! end. **Dropped.** Only what the user excludes (`--drop-raw`, `--only`, `-S`, `-E`), and chunks
//! with a wrong checksum, which are listed with their time span.

mod digest;
mod identity;
mod read;
mod source;
mod write;

pub use digest::{ChannelDigest, Difference, Fingerprinted};
pub use identity::FileIdentity;
pub use read::{
    Attachment, Block, Channel, Contents, Damage, Declarations, Entry, Fingerprint, FrameId,
    LogFiles, LogIdentity, Message, RawChunk, Recording, Schema, Window,
};
pub use write::{
    NewAttachment, NewChannel, Output, OutputFile, Piece, PieceBytes, check_output_path,
    remove_unfinished,
};
