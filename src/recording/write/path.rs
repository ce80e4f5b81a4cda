//! The path of the output.

use std::fs;
use std::io;
use std::path::Path;

use crate::error::{Error, Result};
use crate::recording::identity::FileIdentity;

/// Refuses an output that is the input (links included), exists already, or is not a regular file.
///
/// # Errors
/// [`Error::OutputIsInput`], [`Error::OutputExists`], [`Error::Write`].
pub fn check_output_path(input: &Path, output: &Path, force: bool) -> Result<()> {
    if FileIdentity::is_same(input, output) {
        return Err(Error::OutputIsInput { path: output.into() });
    }
    let refused = |kind, reason| {
        Err(Error::Write { path: output.into(), source: io::Error::new(kind, reason) })
    };
    if output.is_dir() {
        let reason = "it is a folder; give a file name with -o";
        return refused(io::ErrorKind::IsADirectory, reason);
    }
    if fs::metadata(output).is_ok_and(|found| !found.is_file()) {
        let reason = "it is a device or a pipe; give the name of a file with -o";
        return refused(io::ErrorKind::InvalidInput, reason);
    }
    if output.symlink_metadata().is_ok() && !force {
        return Err(Error::OutputExists { path: output.into() });
    }
    Ok(())
}
