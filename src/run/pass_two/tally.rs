//! Running counts of pass two, for the report.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::super::camera_output::{FrameOutput, ImageMessages};
use crate::diagnostics::{Diagnostic, Reason, Uncorrected};
use crate::report::Report;

/// Running counts over the frames.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Tally {
    corrected: usize,
    uncorrected: Vec<Uncorrected>,
    planes: BTreeMap<String, usize>,
    altitude: Option<[f64; 2]>,
    /// sums in units of [`SHARE_UNIT`]: whole numbers, so that the order of adding does not matter
    shares: BTreeMap<String, u64>,
}

/// Shares are added in steps of this.
const SHARE_UNIT: f64 = 1.0 / (1_u64 << 40) as f64;

impl Tally {
    pub fn count(&mut self, frame: &FrameOutput) {
        if let Some(plane) = &frame.plane {
            *self.planes.entry(plane.support.word().into()).or_default() += 1;
        }
        match &frame.result {
            Err(reason) => match self.uncorrected.iter_mut().find(|u| u.reason == *reason) {
                Some(known) => known.frames += 1,
                None => self.uncorrected.push(Uncorrected { frames: 1, reason: reason.clone() }),
            },
            Ok(ImageMessages { facts: f, .. }) => {
                self.corrected += 1;
                let [low, high] = self.altitude.unwrap_or([f64::INFINITY, f64::NEG_INFINITY]);
                self.altitude = Some([low.min(f.camera_altitude_m), high.max(f.camera_altitude_m)]);
                for (name, share) in [
                    ("clipped_input", f.clipped_input_share),
                    ("clipped_output", f.clipped_output_share),
                    ("gain_capped", f.gain_capped_share),
                    ("off_surface", f.off_surface_share),
                    ("unseen_beam", f.unseen_beam_share),
                    ("low_signal", f.low_signal_share),
                    ("restored_highlights", f.restored_share),
                ] {
                    *self.shares.entry(name.into()).or_default() +=
                        (share / SHARE_UNIT).round() as u64;
                }
            }
        }
    }

    /// Frames so far that were not corrected for this reason.
    pub fn frames_of(&self, reason: &Reason) -> usize {
        self.uncorrected.iter().find(|u| u.reason == *reason).map_or(0, |u| u.frames)
    }

    /// Adds the frames that follow.
    pub fn append(&mut self, next: &Self) {
        self.corrected += next.corrected;
        for found in &next.uncorrected {
            match self.uncorrected.iter_mut().find(|u| u.reason == found.reason) {
                Some(known) => known.frames += found.frames,
                None => self.uncorrected.push(found.clone()),
            }
        }
        for (word, planes) in &next.planes {
            *self.planes.entry(word.clone()).or_default() += planes;
        }
        let both = self.altitude.zip(next.altitude);
        let both = both.map(|([a, b], [c, d])| [a.min(c), b.max(d)]);
        self.altitude = both.or(self.altitude).or(next.altitude);
        for (name, share) in &next.shares {
            *self.shares.entry(name.clone()).or_default() += share;
        }
    }

    pub fn into_report(self, report: &mut Report) {
        report.corrected = self.corrected;
        let by_reason = self.uncorrected.iter().map(|u| (u.reason.to_string(), u.frames));
        report.uncorrected = by_reason.collect();
        report.diagnostics.extend(self.uncorrected.into_iter().map(Diagnostic::from));
        report.planes = self.planes;
        report.camera_altitude_m = self.altitude;
        report.mean_shares = self
            .shares
            .into_iter()
            .map(|(k, v)| (k, v as f64 * SHARE_UNIT / self.corrected.max(1) as f64))
            .collect();
    }
}
