//! A block of the log on its way through pass two: as a whole where nothing in it is left out, else
//! message by message.

use super::super::camera_output::FrameOutput;
use super::input::Input;
use super::worker::work;
use crate::error::{Error, Result};
use crate::parallel::Job;
use crate::recording::{Block, Entry, Message, Output, RawChunk};

/// Contents of a block, in order.
pub enum Item {
    Chunk { chunk: RawChunk, has_frames: bool },
    Frame(CameraMessage),
    Other(Message),
    Failed(Error),
}

/// A frame before the work on it.
pub struct CameraMessage {
    /// index of its camera
    camera: usize,
    message: Message,
    /// whether its chunk is copied as it is
    is_in_chunk: bool,
}

/// An item after the work on it.
pub enum Outcome {
    Chunk(RawChunk),
    Frame { camera: usize, frame: Box<FrameOutput>, is_in_chunk: bool },
    Other(Message),
    Failed(Error),
}

/// Bytes of items in flight. Frames count for so much that there are [`FRAMES_PER_THREAD`] for each
/// thread.
pub const IN_FLIGHT: usize = 32 << 20;
pub const FRAMES_PER_THREAD: usize = 2;
/// What a message takes beside its payload (byte).
const MESSAGE_BYTES: usize = 64;

impl Input<'_> {
    /// Reads a block and splits it, on any thread.
    pub fn items(&self, block: &Block) -> Result<Vec<Item>> {
        let contents = self.recording.read(block, self.window)?;
        let whole = contents.chunk.filter(|chunk| {
            Output::can_copy(self.config.output.compression, chunk)
                && chunk.messages.iter().all(|m| self.is_kept(m.0))
        });
        let is_in_chunk = whole.is_some();
        let mut items = Vec::new();
        for entry in contents.entries {
            let Entry::Message(message) = entry else { continue }; // damage: the index lists it
            match self.camera_of(message.channel) {
                Some(camera) => {
                    items.push(Item::Frame(CameraMessage { camera, message, is_in_chunk }));
                }
                None if !is_in_chunk && self.is_kept(message.channel) => {
                    items.push(Item::Other(message));
                }
                None => {}
            }
        }
        if let Some(chunk) = whole {
            items.insert(0, Item::Chunk { chunk, has_frames: !items.is_empty() });
        }
        Ok(items)
    }

    /// The work on a frame.
    pub fn work(&self, frame: CameraMessage) -> Outcome {
        let CameraMessage { camera, message, is_in_chunk } = frame;
        let mut frame = work(&self.cameras[camera], message);
        if is_in_chunk {
            // Releases the chunk before the frame's turn.
            frame.message = frame.message.without_data();
        }
        Outcome::Frame { camera, frame: Box::new(frame), is_in_chunk }
    }
}

/// An item as a job, with its bytes.
pub fn job(item: Item, threads: usize) -> (usize, Job<CameraMessage, Outcome>) {
    match item {
        // The frames of a chunk count for it.
        Item::Chunk { chunk, has_frames } => {
            (if has_frames { 0 } else { chunk.record.len() }, Job::Done(Outcome::Chunk(chunk)))
        }
        Item::Other(message) => {
            (message.data().len() + MESSAGE_BYTES, Job::Done(Outcome::Other(message)))
        }
        Item::Failed(error) => (0, Job::Done(Outcome::Failed(error))),
        Item::Frame(frame) => (IN_FLIGHT / (FRAMES_PER_THREAD * threads), Job::Work(frame)),
    }
}
