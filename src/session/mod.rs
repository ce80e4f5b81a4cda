//! A log that is open: what it holds (index), and what that means for one of its cameras (survey).

pub mod chosen_frames;
pub mod index;
pub mod survey;

use std::path::Path;

use sha2::Digest;

use crate::config::Config;
use crate::error::{Error, Result};
use crate::recording::{Recording, Window};
use crate::vehicle::RigFile;

pub use crate::parallel::Threads;
use index::{Scan, scan};
use survey::{Selection, Survey, survey};

/// A stretch of the run that takes time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// pass one: frames
    Estimate,
    /// pass one: pairs of frames
    Match,
    /// pass two: frames
    Correct,
}

/// Who is told how far the run is.
pub trait Progress {
    /// A step of so many units begins.
    fn begin(&self, step: Step, total: usize);
    /// So many more are done.
    fn advance(&self, units: usize);
    /// The step is over.
    fn end(&self);
}

/// Nobody is told.
pub struct Silent;

impl Progress for Silent {
    fn begin(&self, _: Step, _: usize) {}
    fn advance(&self, _: usize) {}
    fn end(&self) {}
}

/// All that a run is told, beside the input's name.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// choices
    pub config: Config,
    /// facts
    pub rig: RigFile,
    /// which channels
    pub selection: Selection,
    /// which stretch; all of it where `None`
    pub window: Option<Window>,
    /// cores; 0 means all
    pub threads: usize,
    /// overwrite the output
    pub force: bool,
}

impl Options {
    /// The segment that is read.
    pub fn window(&self) -> Window {
        self.window.unwrap_or(Window::ALL)
    }
}

/// A log that has been walked once and understood.
pub struct Prepared {
    /// the log
    pub recording: Recording,
    /// what it says
    pub scan: Scan,
    /// what that means
    pub survey: Survey,
}

/// Opens a log and walks it once.
///
/// # Errors
/// It cannot be read, or holds nothing.
pub fn open(path: &Path, options: &Options) -> Result<(Recording, Scan)> {
    let recording = Recording::open(path)?;
    let scan = scanned(&recording, options, &Threads::new(options.threads))?;
    Ok((recording, scan))
}

fn scanned(recording: &Recording, options: &Options, threads: &Threads) -> Result<Scan> {
    let scan = scan(recording, options.window(), &options.rig.dvl, threads)?;
    if scan.messages == 0 {
        let detail = match (scan.damage.len(), options.window) {
            (_, Some(_)) => " in the stretch that -S and -E leave".into(),
            (0, _) => String::new(),
            (n, _) => format!(" ({n} places are damaged: {})", scan.damage[0].reason),
        };
        return Err(Error::Empty { path: recording.path().into(), detail });
    }
    Ok(scan)
}

/// Opens a log, walks it once and finds camera, ranges and mounts.
///
/// # Errors
/// What is missing, and what supplies it.
pub fn prepare(path: &Path, options: &Options) -> Result<Prepared> {
    let (recording, scan) = open(path, options)?;
    prepared(recording, scan, options)
}

/// The same, with the log's fingerprint, which is computed meanwhile.
///
/// # Errors
/// As [`prepare`].
pub fn prepare_to_write(path: &Path, options: &Options, threads: &Threads) -> Result<Prepared> {
    let recording = Recording::open(path)?;
    let (fingerprint, scan) =
        threads.overlap(|| recording.sha256().map(drop), || scanned(&recording, options, threads));
    let scan = scan?;
    fingerprint?;
    prepared(recording, scan, options)
}

fn prepared(recording: Recording, mut scan: Scan, options: &Options) -> Result<Prepared> {
    let survey = survey(&recording, &mut scan, &options.selection, &options.rig, &options.config)?;
    scan.forget_readings();
    Ok(Prepared { recording, scan, survey })
}

/// A fingerprint in hexadecimal.
pub fn sha256(bytes: &[u8]) -> String {
    sha2::Sha256::digest(bytes).iter().map(|b| format!("{b:02x}")).collect()
}
