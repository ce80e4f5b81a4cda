//! What a command prints and writes.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use super::color::Paint;
use crate::diagnostics::{Diagnostic, Severity};
use crate::error::{Error, Result};

/// How a command ended, the worst last; `main` maps it to an exit status.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Outcome {
    /// 0
    Done,
    /// 3: done, with losses that are listed
    DoneWithLosses,
    /// 1: the log cannot be corrected, for reasons that are listed
    CannotCorrect,
}

/// Prints a result; a closed pipe (`| head`) is no error.
pub fn print(text: &str) {
    let _closed_pipe = std::io::stdout().write_all(text.as_bytes());
}

/// Prints where a result was written.
pub fn print_written(path: &Path) {
    print(&format!("written      {}\n", path.display()));
}

/// Prints warnings, with `-v` infos too, to stderr.
pub fn print_diagnostics(diagnostics: &[Diagnostic], verbose: u8) {
    let paint = Paint::of_stderr();
    let of = |severity| diagnostics.iter().filter(move |d| d.severity() == severity);
    for warning in of(Severity::Warning) {
        eprintln!("{} {warning}", paint.warning("warning:"));
        if let Some(remedy) = warning.remedy() {
            eprintln!("  help: {remedy}");
        }
    }
    of(Severity::Info).filter(|_| verbose > 0).for_each(|info| eprintln!("note: {info}"));
}

/// When damage lies in log time: `start` to `end` in nanoseconds, an end of 0 where unknown.
pub fn damage_time(start_ns: u64, end_ns: u64) -> String {
    match end_ns {
        0 => "time unknown".into(),
        _ => format!("log time {start_ns} to {end_ns}"),
    }
}

/// `dive.mcap` → `dive.<suffix>` beside it.
pub fn path_beside(input: &Path, suffix: &str) -> PathBuf {
    let name = input.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let stem = name.strip_suffix(".mcap").unwrap_or(&name);
    input.with_file_name(format!("{stem}.{suffix}"))
}

/// Whether the output is `-`, which stands for stdout.
pub fn is_stdout(path: &Path) -> bool {
    path.as_os_str() == "-"
}

/// Writes a file, complete or not at all; `-` is stdout, where a closed pipe is no error.
pub fn write_text(path: &Path, text: &str) -> Result<()> {
    if !is_stdout(path) {
        return crate::products::write_whole(path, text.as_bytes());
    }
    let mut stdout = std::io::stdout().lock();
    match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
        Err(source) if source.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Error::Write { path: "stdout".into(), source })
        }
        _ => Ok(()),
    }
}

/// Prints JSON.
pub fn print_json(text: serde_json::Result<String>) -> Result<()> {
    let failed =
        |e: serde_json::Error| Error::WriteRecord { path: "stdout".into(), reason: e.to_string() };
    write_text(Path::new("-"), &text.map_err(failed)?)
}

/// An image's file name extension selects its format; any other would misname it.
pub fn ensure_extension(output: &Path, extensions: &[&str]) -> Result<()> {
    let extension = output.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    if extension.is_none_or(|e| extensions.contains(&e.as_str())) {
        return Ok(());
    }
    let (path, known) = (output.display(), extensions.join(" or ."));
    Err(Error::Usage(format!("{path}: the image can be written as .{known}")))
}
