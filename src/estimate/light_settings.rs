//! Exposure, gain and strobe power that change along the log (G of Eq. 10): which channels the pictures follow, and how.
//!
//! No driver says in its message whether its gain is a factor or counts decibels, nor whether a camera obeyed. The
//! pictures do: from one frame to the next, points seen in both change by the ratio of the settings. Each channel is
//! tried under both laws, and the one that explains most is taken, until none explains more. In: settings per
//! frame. Out: the laws, and each frame's log gain.

use std::collections::BTreeMap;

use super::robust;
use super::samples::FrameSamples;
use super::tracks::Track;
use crate::model::LightLaw;

/// Points that two frames must share for their light to be compared by them; else their means are.
const LEAST_SHARED: usize = 10;
/// A setting must explain this share of the mean change from frame to frame.
const LEAST_EXPLAINED: f64 = 0.2;

/// A channel that the frames follow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FollowedSetting {
    /// which of the settings
    pub index: usize,
    /// how it acts
    pub law: LightLaw,
    /// the setting that counts as gain 1
    pub reference: f64,
}

/// Which settings (each a number per frame) the frames follow.
pub fn followed(frames: &[FrameSamples], tracks: &[Track], settings: &[Vec<f64>]) -> Vec<FollowedSetting> {
    let mut changes = changes(frames, tracks);
    let mut found: Vec<FollowedSetting> = Vec::new();
    loop {
        let unexplained = mean_size(&changes);
        let mut best: Option<(f64, FollowedSetting, Vec<f64>)> = None;
        for (index, values) in settings.iter().enumerate().filter(|(i, _)| found.iter().all(|f| f.index != *i)) {
            for law in [LightLaw::Factor, LightLaw::Decibel] {
                let Some(logs) = values.iter().map(|v| law.log_light(*v)).collect::<Option<Vec<f64>>>() else { continue };
                let left: Vec<f64> = changes.iter().map(|(a, b, change)| change - (logs[*b] - logs[*a])).collect();
                let size = robust::mean_size(&left);
                if best.as_ref().is_none_or(|b| size < b.0) {
                    best = Some((size, FollowedSetting { index, law, reference: robust::median(values) }, left));
                }
            }
        }
        match best {
            Some((size, setting, left)) if size < (1.0 - LEAST_EXPLAINED) * unexplained => {
                changes.iter_mut().zip(left).for_each(|(c, left)| c.2 = left);
                found.push(setting);
            }
            _ => return found,
        }
    }
}

fn mean_size(changes: &[(usize, usize, f64)]) -> f64 {
    robust::mean_size(&changes.iter().map(|c| c.2).collect::<Vec<_>>())
}

/// Neighbouring frames and the change of log light between them.
fn changes(frames: &[FrameSamples], tracks: &[Track]) -> Vec<(usize, usize, f64)> {
    let mut shared: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
    for track in tracks {
        for pair in track.windows(2).filter(|p| p[1].frame == p[0].frame + 1) {
            let bands = frames[pair[0].frame as usize].bands;
            let change = (0..bands).map(|b| f64::from(pair[1].sight.log_color[b] - pair[0].sight.log_color[b])).sum::<f64>() / bands as f64;
            shared.entry(pair[0].frame as usize).or_default().push(change);
        }
    }
    let of_pair = |a: usize| {
        let by_mean = || {
            let log_mean = |f: &FrameSamples| (0..f.bands).map(|b| f.mean_light[b].max(1e-9).ln()).sum::<f64>() / f.bands as f64;
            log_mean(&frames[a + 1]) - log_mean(&frames[a])
        };
        let change = shared.get(&a).filter(|s| s.len() >= LEAST_SHARED).map_or_else(by_mean, |s| robust::median(s));
        (a, a + 1, change)
    };
    (0..frames.len().saturating_sub(1)).map(of_pair).collect()
}
