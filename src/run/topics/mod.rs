//! Topics of the output, one file per family. A topic is a name, a message type, and its messages
//! for a frame.

mod attenuation;
mod beam_image;
mod frame_facts;
mod images;
mod seafloor;
mod strobe;
mod topic;

use std::collections::BTreeMap;

use super::camera_output::CameraOutput;
use crate::error::Result;
use crate::messages::output::OutputSchema;
use crate::recording::{NewChannel, Output, Schema};
pub use images::{encoded_images, needs_preview, preview};
use topic::OutputTopic;

/// All topics, in the order of a frame's messages.
const TOPICS: [&OutputTopic; 18] = [
    &frame_facts::OPENING_LOG,
    &strobe::BEAM_PATTERN,
    &strobe::BEAM_PATTERN_IMAGE,
    &images::RAW_PREVIEW,
    &images::CORRECTED,
    &seafloor::CLOUD,
    &images::MASK,
    &images::CAMERA_INFO,
    &strobe::POSE,
    &attenuation::ATTENUATION,
    &attenuation::PLOT,
    &seafloor::PLANE,
    &seafloor::TRANSFORM,
    &strobe::BEAM,
    &seafloor::ALTITUDE_PLOT,
    &seafloor::RESIDUAL_PLOT,
    &frame_facts::FRAME,
    &frame_facts::LOG,
];

/// The channels of a camera's topics, by their rank.
pub struct Channels(BTreeMap<u8, NewChannel>);

impl Channels {
    /// Declares the channels of the topics that this run writes.
    ///
    /// # Errors
    /// The log has no free channel ids.
    pub fn declare(camera: &CameraOutput<'_>, out: &mut Output) -> Result<Self> {
        let by_rank: BTreeMap<u8, &OutputTopic> = TOPICS.iter().map(|t| (t.rank, *t)).collect();
        let mut channels = BTreeMap::new();
        for (rank, topic) in by_rank {
            let Some(name) = (topic.name)(camera) else { continue };
            let OutputSchema { name: schema, encoding, data, message_encoding } =
                (topic.message_type)(camera).schema_in(camera.wire);
            let schema = Schema { name: schema, encoding: encoding.into(), data };
            channels.insert(rank, out.add_channel(&name, message_encoding, &schema)?);
        }
        Ok(Self(channels))
    }

    /// All of them.
    pub fn all(&self) -> impl Iterator<Item = NewChannel> {
        self.0.values().copied()
    }

    /// The one of the notes.
    pub fn log(&self) -> Option<NewChannel> {
        self.0.get(&frame_facts::LOG.rank).copied()
    }

    /// Writes the messages of a frame; returns their number.
    pub fn write(&self, frame: &FrameContext<'_>, out: &mut Output) -> u64 {
        let (log_time, publish_time) =
            (frame.output.message.log_time, frame.output.message.publish_time);
        let mut count = 0;
        for topic in TOPICS {
            let Some(channel) = self.0.get(&topic.rank) else { continue };
            (topic.write)(frame, &mut |data| {
                count += 1;
                out.write(*channel, log_time, publish_time, data);
            });
        }
        count
    }
}

pub use topic::FrameContext;
