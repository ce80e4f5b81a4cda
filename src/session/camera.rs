//! One camera of a log: what the log holds, and what that means for this camera.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

use super::index::LogIndex;
use super::log::Log;
use super::options::Options;
use super::survey::{Survey, survey};
use crate::config::Config;
use crate::error::Result;
use crate::parallel::{Job, Threads};
use crate::recording::{Entry, FrameId, Message, Recording, Window};

/// A camera of a scanned log.
#[derive(Clone)]
pub struct CameraSession {
    /// the file
    pub recording: Arc<Recording>,
    /// what it holds
    pub index: Arc<LogIndex>,
    /// camera, range instrument, mounts
    pub survey: Survey,
    /// the settings
    pub config: Config,
}

/// Bytes of blocks in flight, for each thread.
const IN_FLIGHT: usize = 8 << 20;
/// Frames in flight, for each thread.
const FRAMES_PER_THREAD: usize = 2;

impl CameraSession {
    /// Surveys the camera that the options select.
    ///
    /// # Errors
    /// What is missing in the log, and what supplies it.
    pub fn new(log: &Log, options: &Options) -> Result<Self> {
        Ok(Self {
            recording: Arc::clone(&log.recording),
            index: Arc::clone(&log.index),
            survey: survey(log, options)?,
            config: options.config.clone(),
        })
    }

    /// Opens a log, scans it and surveys its camera.
    ///
    /// # Errors
    /// As [`Log::open`] and [`CameraSession::new`].
    pub fn open(path: &Path, options: &Options) -> Result<Self> {
        Self::new(&Log::open(path, options)?, options)
    }

    /// The file's name without its folder, or that of a split recording.
    pub fn file_name(&self) -> String {
        self.recording.name().into()
    }

    /// Runs `work` in parallel over the messages of chosen frames of the camera, and passes the
    /// results to `sink` in the order of the file. Only blocks are read that hold one of them.
    ///
    /// # Errors
    /// The file cannot be read, or the sink's own.
    pub fn for_frames<R: Send>(
        &self,
        chosen: &BTreeSet<FrameId>,
        threads: &Threads,
        work: impl Fn(Message) -> R + Sync,
        mut sink: impl FnMut(R) -> Result<()>,
    ) -> Result<()> {
        let mut blocks: BTreeMap<u32, BTreeSet<FrameId>> = BTreeMap::new();
        for id in chosen {
            blocks.entry(id.block).or_default().insert(*id);
        }
        let block = |number: u32| self.recording.blocks().get(number as usize);
        let read = |(number, frames): (u32, BTreeSet<FrameId>)| -> Result<Vec<Message>> {
            let Some(block) = block(number) else { return Ok(Vec::new()) };
            let is_chosen = |entry: Entry| match entry {
                Entry::Message(message) => frames.contains(&message.id).then_some(message),
                Entry::Damaged(_) => None,
            };
            let entries = self.recording.read(block, Window::ALL)?.entries;
            Ok(entries.into_iter().filter_map(is_chosen).collect())
        };
        let work = |frame| Ok(work(frame));
        let in_flight = threads.count() * IN_FLIGHT;
        threads.scope(|scope| {
            let memory = |number| block(number).map_or(0, |b| b.memory_bytes().min(in_flight / 2));
            let blocks = scope.in_order(
                blocks.into_iter().map(|block| (memory(block.0), Job::Work(block))),
                in_flight,
                &read,
            );
            let frames = blocks.flat_map(|frames| match frames {
                Ok(frames) => frames.into_iter().map(|frame| (1, Job::Work(frame))).collect(),
                Err(e) => vec![(0, Job::Done(Err(e)))],
            });
            scope
                .in_order(frames, FRAMES_PER_THREAD * threads.count(), &work)
                .try_for_each(|result| sink(result?))
        })
    }
}
