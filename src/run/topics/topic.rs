//! One topic of the output.

use super::super::camera_output::{CameraOutput, FrameOutput};
use crate::messages::output::OutputType;

/// Passes the messages for a frame on, encoded.
pub type WriteTopic = fn(&FrameContext<'_>, &mut dyn FnMut(&[u8]));

/// A topic of the output. A table of these is simpler here than a trait: none has a state.
pub struct OutputTopic {
    /// order of the channel ids; topics of the same rank share a channel
    pub rank: u8,
    /// name; `None` where a run does not write it
    pub name: fn(&CameraOutput<'_>) -> Option<String>,
    /// type of its messages
    pub message_type: fn(&CameraOutput<'_>) -> OutputType,
    /// passes on the messages for a frame
    pub write: WriteTopic,
}

/// A frame as its topics see it.
pub struct FrameContext<'f> {
    /// the camera
    pub camera: &'f CameraOutput<'f>,
    /// the frame
    pub output: &'f FrameOutput,
    /// whether it is the camera's first
    pub is_first: bool,
    /// whether it is the first that is not corrected for its reason
    pub is_first_of_reason: bool,
}
