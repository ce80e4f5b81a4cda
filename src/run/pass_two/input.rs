//! What pass two works on: the log, its cameras, and which channels are kept.

use std::collections::BTreeMap;

use super::super::camera_output::CameraOutput;
use crate::config::Config;
use crate::diagnostics::{Diagnostic, LogFact};
use crate::recording::{Block, Channel, Output, Recording, Window};
use crate::session::Shard;

/// The input of pass two.
pub struct Input<'p> {
    /// the log
    pub recording: &'p Recording,
    /// the segment that is written
    pub window: Window,
    /// the part of the log that is written; all of it where `None`
    pub shard: Option<Shard>,
    /// the settings
    pub config: &'p Config,
    /// the cameras that are corrected
    pub cameras: Vec<CameraOutput<'p>>,
    /// whether a channel is kept, by id
    kept: BTreeMap<u16, bool>,
}

impl<'p> Input<'p> {
    /// The input with all channels but raw images where those are dropped, and but those that
    /// `only` excludes.
    pub fn new(
        cameras: Vec<CameraOutput<'p>>,
        window: Window,
        only: Option<&regex::Regex>,
    ) -> Option<Self> {
        let session = cameras.first()?.session;
        let (recording, config) = (&session.recording, &session.config);
        let is_raw = |id: &u16| {
            let mut cameras = cameras.iter();
            config.output.drop_raw && cameras.any(|c| c.session.survey.camera_channels.contains(id))
        };
        let is_kept = |(id, channel): (&u16, &Channel)| {
            let is_wanted = only.is_none_or(|only| only.is_match(&channel.topic));
            (*id, is_wanted && !is_raw(id))
        };
        let kept = recording.channels.iter().map(is_kept).collect();
        Some(Self { recording, window, shard: None, config, cameras, kept })
    }

    /// The blocks that are read.
    pub fn blocks(&self) -> impl Iterator<Item = &'p Block> + '_ {
        let blocks = self.recording.blocks();
        let range = self.shard.map_or(0..blocks.len(), |shard| shard.range(blocks.len()));
        blocks[range].iter().filter(|block| block.may_overlap(self.window))
    }

    /// Whether the messages of a channel are copied.
    pub fn is_kept(&self, channel: u16) -> bool {
        self.kept.get(&channel).copied().unwrap_or(false)
    }

    /// Whether a channel is dropped as raw images.
    pub fn is_dropped_raw(&self, channel: u16) -> bool {
        self.config.output.drop_raw && self.kept.get(&channel) == Some(&false)
    }

    /// Index of the camera whose images are on a channel.
    pub fn camera_of(&self, channel: u16) -> Option<usize> {
        self.cameras.iter().position(|c| c.session.survey.camera_channels.contains(&channel))
    }

    /// Copies every schema, and every channel that is kept.
    pub fn copy_declarations(&self, out: &mut Output) -> Vec<Diagnostic> {
        for (id, schema) in &self.recording.schemas {
            out.copy_schema(*id, schema);
        }
        out.reserve_channels(self.recording.channels.keys().copied());
        let mut diagnostics = Vec::new();
        for (id, channel) in self.recording.channels.iter().filter(|(id, _)| self.is_kept(**id)) {
            let schema_id = channel.schema_id;
            if schema_id != 0 && !self.recording.schemas.contains_key(&schema_id) {
                let fact = LogFact::SchemaMissing { schema_id };
                diagnostics.push(Diagnostic::on(&channel.topic, fact));
            }
            self.copy_channel(out, *id);
        }
        diagnostics
    }

    /// Copies a channel; without its schema where the log has none.
    pub fn copy_channel(&self, out: &mut Output, id: u16) {
        let Some(channel) = self.recording.channels.get(&id) else { return };
        let has_schema = self.recording.schemas.contains_key(&channel.schema_id);
        let schema_id = if has_schema { channel.schema_id } else { 0 };
        out.copy_channel(id, &Channel { schema_id, ..channel.clone() });
    }
}
