//! A block of the log on its way through pass two: as a whole where nothing in it is left out, else
//! message by message.

use std::collections::BTreeMap;

use super::{Done, PassTwo};
use crate::error::{Error, Result};
use crate::image::transfer::SrgbTable;
use crate::parallel::Job;
use crate::recording::{Block, Entry, Message, Output, RawChunk};

/// What a block gives, in its order. `in_chunk` is true of a message that goes through in a chunk
/// as it is.
pub enum Item {
    Chunk { chunk: RawChunk, has_frames: bool },
    Frame { camera: usize, message: Message, in_chunk: bool },
    Other(Message),
    Failed(Error),
}

/// A frame before the work on it.
pub struct Frame {
    pub camera: usize,
    pub index: usize,
    pub message: Message,
    pub in_chunk: bool,
}

/// An item when its turn comes.
pub enum Outcome {
    Chunk(RawChunk),
    Frame { camera: usize, done: Box<Done>, in_chunk: bool },
    Other(Message),
    Failed(Error),
}

/// What is under way weighs so much, frames so much that there are [`FRAMES_PER_CORE`] for each
/// core.
pub const UNDER_WAY: usize = 32 << 20;
pub const FRAMES_PER_CORE: usize = 2;

impl PassTwo<'_> {
    /// Reads a block and takes it apart, on whichever core.
    pub(super) fn items(&self, block: &Block, kept: &BTreeMap<u16, bool>) -> Result<Vec<Item>> {
        let contents = self.recording.read(block, self.window)?;
        let is_kept = |channel: &u16| kept.get(channel).copied().unwrap_or(false);
        let whole = contents.chunk.filter(|chunk| {
            Output::can_copy(self.config.output.compression, chunk)
                && chunk.messages.iter().all(|m| is_kept(&m.0))
        });
        let in_chunk = whole.is_some();
        let mut items = Vec::new();
        for entry in contents.entries {
            let Entry::Message(message) = entry else { continue }; // damage: the scan has listed it
            match self
                .cameras
                .iter()
                .position(|c| c.survey.camera_channels.contains(&message.channel))
            {
                Some(camera) => items.push(Item::Frame { camera, message, in_chunk }),
                None if !in_chunk && is_kept(&message.channel) => items.push(Item::Other(message)),
                None => {}
            }
        }
        if let Some(chunk) = whole {
            items.insert(0, Item::Chunk { chunk, has_frames: !items.is_empty() });
        }
        Ok(items)
    }

    /// An item as work, with its weight; frames are numbered as they come.
    pub(super) fn job(
        &self,
        item: Item,
        next_frame: &mut [usize],
        threads: usize,
    ) -> (usize, Job<Frame, Outcome>) {
        match item {
            // The frames of a chunk stand for it.
            Item::Chunk { chunk, has_frames } => {
                (if has_frames { 0 } else { chunk.record.len() }, Job::Done(Outcome::Chunk(chunk)))
            }
            Item::Other(message) => (message.data().len() + 64, Job::Done(Outcome::Other(message))),
            Item::Failed(error) => (0, Job::Done(Outcome::Failed(error))),
            Item::Frame { camera, message, in_chunk } => {
                let index = next_frame[camera];
                next_frame[camera] += 1;
                (
                    UNDER_WAY / (FRAMES_PER_CORE * threads),
                    Job::Work(Frame { camera, index, message, in_chunk }),
                )
            }
        }
    }

    /// The work on a frame.
    pub(super) fn worked(&self, frame: Frame, srgb: &SrgbTable) -> Outcome {
        let Frame { camera, index, message, in_chunk } = frame;
        let mut done = self.cameras[camera].frame(index, message, srgb);
        if in_chunk {
            // Its chunk need not wait in memory for its turn.
            done.message = done.message.without_data();
        }
        Outcome::Frame { camera, done: Box::new(done), in_chunk }
    }
}
