//! What a shard records of itself, so that shards can be joined to the undivided log.

use serde::{Deserialize, Serialize};

use super::tally::Tally;
use crate::diagnostics::{Diagnostic, Reason};
use crate::recording::Damage;
use crate::report::Report;
use crate::session::Shard;

/// Name of the metadata record of a shard.
pub const SHARD_RECORD: &str = "unwater_shard";

/// A shard.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ShardRecord {
    /// which one
    pub shard: Shard,
    /// schemas (true) and channels in the order of their declaration, before the first message
    pub declared: Vec<(bool, u16)>,
    /// per chunk, if it is one of the input, the number of other messages before it
    pub copied_chunks: Vec<Option<u64>>,
    /// messages of the input
    pub copied: u64,
    /// the cameras
    pub cameras: Vec<CameraRecord>,
}

/// A camera of a shard, or of an undivided run.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct CameraRecord {
    /// follows `/unwater` in its names
    pub name: String,
    /// the report without the tally
    pub report: Report,
    /// running counts
    pub tally: Tally,
    /// of the log as a whole, for the first camera: diagnostics that follow those of the tally
    pub diagnostics: Vec<Diagnostic>,
    /// damage of the log, for the first camera
    pub damage: Vec<Damage>,
    /// ids of added channels
    pub channels: Vec<u16>,
    /// id of the channel of notes
    pub log_channel: u16,
    /// notes about the first frame that was not corrected for a reason: their sequence numbers
    pub reasons: Vec<(u32, Reason)>,
}

impl CameraRecord {
    /// The report of the run; `copied` are the messages of the input, for the first camera.
    pub fn into_report(self, copied: Option<u64>) -> Report {
        let Self { mut report, tally, diagnostics, damage, .. } = self;
        tally.into_report(&mut report);
        if let Some(copied) = copied {
            report.messages_copied = copied;
            report.diagnostics.extend(diagnostics);
            report.damage = damage;
        }
        report
    }

    /// Adds the frames of the next shard. Returns the sequence numbers of its notes that repeat
    /// earlier ones.
    pub fn append(&mut self, next: &Self) -> Vec<u32> {
        let repeated: Vec<u32> = next
            .reasons
            .iter()
            .filter(|(_, reason)| self.tally.frames_of(reason) > 0)
            .map(|(sequence, _)| *sequence)
            .collect();
        self.report.frames += next.report.frames;
        self.report.messages_added += next.report.messages_added - repeated.len() as u64;
        self.tally.append(&next.tally);
        repeated
    }
}
