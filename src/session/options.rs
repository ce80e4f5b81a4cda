//! What a run is given beside its input, and whom it reports its progress to.

use std::ops::Range;
use std::str::FromStr;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::config::Config;
use crate::model::ModelFile;
use crate::recording::{LogIdentity, Window};
use crate::vehicle::RigFile;

/// Choices between the channels of a log.
#[derive(Clone, Debug, Default)]
pub struct Selection {
    /// `--camera`
    pub camera: Option<String>,
    /// `--dvl`
    pub dvl: Option<String>,
    /// `--strobe-frame`
    pub strobe_frame: Option<String>,
}

/// All that a run is given, beside its input.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// settings
    pub config: Config,
    /// rig file
    pub rig: RigFile,
    /// channels
    pub selection: Selection,
    /// segment of the log; all of it where `None`
    pub window: Option<Window>,
    /// number of threads; 0 for one per core
    pub threads: usize,
    /// overwrite the output
    pub force: bool,
    /// the part of the log whose frames are corrected; all of them where `None`
    pub shard: Option<Shard>,
    /// a model whose beam pattern, strobe position, transfer curve and vignetting are used; only
    /// attenuation is estimated
    pub beam_from: Option<Arc<ModelFile>>,
    /// keep the samples that a model is estimated from
    pub keep_samples: bool,
    /// the raw log, where the log that is read was corrected before
    pub source: Option<LogIdentity>,
}

/// One of several parts of a log that are corrected apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Shard {
    /// from 1 to `count`
    pub index: usize,
    /// number of parts
    pub count: usize,
}

impl Shard {
    /// The part of a sequence of `length` things.
    pub fn range(self, length: usize) -> Range<usize> {
        let Self { index, count } = self;
        length * (index - 1) / count..length * index / count
    }
}

impl FromStr for Shard {
    type Err = String;

    /// `I/N`; `0/N` is `N/N`, for those who count from 0.
    fn from_str(text: &str) -> Result<Self, String> {
        let parsed = text.split_once('/').and_then(|(index, count)| {
            let (index, count): (usize, usize) = (index.parse().ok()?, count.parse().ok()?);
            (index <= count && (1..=MAX_SHARDS).contains(&count)).then_some((index, count))
        });
        let (index, count) = parsed.ok_or("I/N is expected, with I from 1 to N")?;
        Ok(Self { index: if index == 0 { count } else { index }, count })
    }
}

/// More parts than any log has frames to share.
const MAX_SHARDS: usize = 10_000;

impl Options {
    /// The segment that is read.
    pub fn window(&self) -> Window {
        self.window.unwrap_or(Window::ALL)
    }

    /// The same for one camera of several.
    #[must_use]
    pub fn for_camera(&self, topic: &str) -> Self {
        let mut options = self.clone();
        options.selection.camera = Some(topic.into());
        options
    }
}

/// A step of the run that takes time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// pass one: frames
    Estimate,
    /// pass one: pairs of frames
    Match,
    /// pass two: frames
    Correct,
}

/// Receiver of the progress of a run.
pub trait Progress {
    /// A step of this many units begins.
    fn begin(&self, step: Step, total: usize);
    /// This many more units are done.
    fn advance(&self, units: usize);
    /// The step is over.
    fn end(&self);
}

/// Ignores all progress.
pub struct Silent;

impl Progress for Silent {
    fn begin(&self, _: Step, _: usize) {}
    fn advance(&self, _: usize) {}
    fn end(&self) {}
}
