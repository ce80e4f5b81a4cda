//! Pictures for people: the page of a run ([`page`]), one frame under every method ([`sheet`]), the
//! strip of seafloor that a dive has seen ([`mosaic`]); and for archives, the stills with what is
//! known of them ([`data_set`]).
//!
//! All of them read logs and models through the rooms below and decide nothing: no number of theirs
//! reaches a corrected log.

pub mod data_set;
pub mod dive;
pub mod mosaic;
pub mod page;
mod pictures;
mod places;
pub mod sheet;

use std::path::Path;

use crate::error::{Error, Result};

/// Writes a file under a temporary name in its folder and renames it.
///
/// # Errors
/// It cannot be written; nothing stands under its name then that did not before.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    let failed = |source| Error::Write { path: path.into(), source };
    let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let temporary = path.with_file_name(format!(".{name}.{}.part", std::process::id()));
    let written =
        std::fs::write(&temporary, bytes).and_then(|()| std::fs::rename(&temporary, path));
    written.map_err(|source| {
        let _gone = std::fs::remove_file(&temporary);
        failed(source)
    })
}
