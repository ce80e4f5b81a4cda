//! MCAP in, MCAP out. The only room that knows the container; everything beyond is values.
//!
//! **What is kept.** Selection is opt-out: every message with its bytes, times, sequence number and
//! order per channel; every schema and channel with its metadata and id, empty ones too;
//! attachments; metadata records. **What is changed.** Declarations lie before all chunks; summary
//! and indexes are made anew. A chunk that holds nothing to leave out goes through byte for byte;
//! the messages of others are chunked and compressed anew. **Order.** Messages lie as in the input;
//! what is added lies behind the message it belongs to, in chunks of its own. Attachments and
//! metadata lie at the end. **What is dropped.** Only what the user asks for (`--drop-raw`,
//! `--only`, `-S`, `-E`), and chunks whose checksum does not hold: those are listed with their time
//! span.

mod read;
mod source;
mod write;

pub use read::{
    Attachment, Block, Channel, Contents, Damage, Entry, Message, RawChunk, Recording, Schema,
    Window,
};
pub use write::{
    NewAttachment, NewChannel, Output, OutputFile, Piece, PieceBytes, check_output_path,
    remove_unfinished,
};
