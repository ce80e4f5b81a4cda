//! MCAP in, MCAP out. The only room that knows the container; everything beyond is values.
//!
//! **What is kept.** Selection is opt-out: every message with its bytes, times, sequence number and order per
//! channel; every schema and channel with its metadata and id, empty ones too; attachments; metadata records.
//! **What is changed.** How records are chunked and compressed. Summary, indexes and checksums are made anew.
//! **Order.** Messages lie as in the input; what is added lies behind the message it belongs to. Attachments and
//! metadata lie at the end. **What is dropped.** Only what the user asks for (`--drop-raw`, `--only`, `-S`, `-E`), and
//! chunks whose checksum does not hold: those are listed with their time span.

mod read;
mod write;

pub use read::{Channel, Damage, Entry, Message, Recording, Schema, Window};
pub use write::{NewChannel, Output, ensure_distinct, remove_unfinished};
