//! Writing. [`Output`] arranges pieces: chunks of the input as they are, and new chunks after them.
//! Each piece is serialised on any thread ([`Piece::into_bytes`]); [`OutputFile`] writes them in
//! order.

mod file;
mod output;
mod path;
mod piece;
mod records;

pub use file::{NewAttachment, OutputFile, remove_unfinished};
pub use output::{NewChannel, Output};
pub use path::check_output_path;
pub use piece::{Piece, PieceBytes};
