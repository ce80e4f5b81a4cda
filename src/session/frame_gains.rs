//! Gains of single frames (strobe drop-outs) by a model, for the frames of one log.

use std::collections::BTreeMap;

use super::index::FrameRef;
use crate::error::Result;
use crate::image::Bands;
use crate::model::{FrameGainFile, InputFile, ModelFile, RangeFactor};
use crate::recording::{FrameId, LogIdentity, Recording};
use crate::units::Stamp;

/// Light and slant ranges of a frame, over what they would be: gain per band and range factor.
type Factors = (Bands, RangeFactor);

/// Gains and range factors of the frames of one log; 1 for all others.
#[derive(Debug, Default)]
pub struct FrameGains {
    by_id: BTreeMap<FrameId, Factors>,
    /// for models and logs without identities
    by_stamp: BTreeMap<Stamp, Factors>,
    /// gains of frames of other logs
    pub of_other_logs: usize,
}

impl FrameGains {
    /// The gains of a model for this log. A log that was corrected keeps the stamps, not the
    /// identities, of its source.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn new(
        file: &ModelFile,
        recording: &Recording,
        source: Option<&LogIdentity>,
    ) -> Result<Self> {
        let mut gains = Self::default();
        if file.frame_gains.is_empty() {
            return Ok(gains);
        }
        let of_input = |input: &InputFile| recording.is(&input.identity());
        let is_own = file.inputs.iter().map(of_input).collect::<Result<Vec<bool>>>()?;
        for of_frame in &file.frame_gains {
            let FrameGainFile { stamp_ns, gain, balance, frame, input, .. } = of_frame;
            let gain = balance.map_or([*gain; 3], |of_band| of_band.map(|own| own * gain));
            let is_own = is_own.get(*input).copied().unwrap_or(false);
            let identity = file.inputs.get(*input).map(InputFile::identity);
            let is_of_source = || identity.zip(source).is_some_and(|(a, b)| a.is_same(b));
            match frame {
                Some(id) if is_own => {
                    gains.by_id.insert(*id, (gain, of_frame.ranges()));
                }
                // Models of earlier versions have stamps alone.
                frame if frame.is_none() || is_of_source() => {
                    gains.by_stamp.entry(Stamp(*stamp_ns)).or_insert((gain, of_frame.ranges()));
                }
                _ => gains.of_other_logs += 1,
            }
        }
        Ok(gains)
    }

    /// The gains of a frame per band, where the model has them.
    pub fn of(&self, frame: &FrameRef) -> Option<Bands> {
        self.factors(frame).map(|factors| factors.0)
    }

    /// The factor of a frame's slant ranges, in the empirical model.
    pub fn range_factor(&self, frame: &FrameRef) -> RangeFactor {
        self.factors(frame).map_or(RangeFactor::default(), |factors| factors.1)
    }

    fn factors(&self, frame: &FrameRef) -> Option<Factors> {
        self.by_id.get(&frame.id).or_else(|| self.by_stamp.get(&frame.stamp)).copied()
    }
}
