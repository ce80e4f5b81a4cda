//! Frames without the strobe between frames with it: some cameras take every other image by
//! daylight alone. They are recognised as a second kind, which is darker, takes turns with the
//! first, and shows nothing of the strobe's beam pattern; frames of another gain show it.

use std::collections::BTreeMap;

use super::samples::FrameSamples;
use crate::stats;

/// Fewest frames of which kinds are told apart, and of each kind, as a share.
const MIN_FRAMES: usize = 8;
const MIN_SHARE: f64 = 0.2;
/// Smallest gap between the kinds (log light), and over the largest gap within one.
const MIN_GAP: f64 = 0.7;
const MIN_GAP_RATIO: f64 = 2.0;
/// Smallest share of frames that are followed by one of the other kind.
const MIN_TURNS: f64 = 0.3;
/// Smallest spread over the image of the log ratio of both kinds.
const MIN_PATTERN: f64 = 0.25;

/// Frames without the strobe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unlit {
    /// their mean light is below this, that of the others above it
    pub below: f64,
    /// how many
    pub frames: usize,
    /// median light of the others over theirs
    pub ratio: f64,
}

/// Mean light over the bands of a frame, as the camera gave it.
fn log_light(frame: &FrameSamples) -> f64 {
    let bands = &frame.mean_reading[..frame.bands];
    (bands.iter().sum::<f64>() / bands.len() as f64).max(1e-9).ln()
}

impl Unlit {
    /// Of the frames of a log, in the order of time. `None` where all are of one kind.
    pub fn among(frames: &[FrameSamples]) -> Option<Self> {
        let light: Vec<f64> = frames.iter().map(log_light).collect();
        let below = two_kinds(&light)?;
        let is_unlit = |light: &f64| *light < below;
        let (unlit, lit): (Vec<f64>, Vec<f64>) = light.iter().copied().partition(is_unlit);
        let found = Self {
            below: below.exp(),
            frames: unlit.len(),
            ratio: (stats::median(&lit) - stats::median(&unlit)).exp(),
        };
        (pattern(frames, &found) >= MIN_PATTERN).then_some(found)
    }

    /// Whether a frame is one of them.
    pub fn has(&self, frame: &FrameSamples) -> bool {
        log_light(frame) < self.below.ln()
    }
}

/// Log light between two kinds of frames that take turns.
pub fn two_kinds(log_light: &[f64]) -> Option<f64> {
    let below = threshold(log_light)?;
    let turns = log_light.windows(2).filter(|w| (w[0] < below) != (w[1] < below)).count();
    (turns as f64 >= MIN_TURNS * (log_light.len() - 1) as f64).then_some(below)
}

/// Middle of the gap between two kinds.
fn threshold(log_light: &[f64]) -> Option<f64> {
    let mut sorted = log_light.to_vec();
    sorted.sort_by(f64::total_cmp);
    if sorted.len() < MIN_FRAMES {
        return None;
    }
    let gap = |i: usize| sorted[i + 1] - sorted[i];
    let at = (0..sorted.len() - 1).max_by(|a, b| gap(*a).total_cmp(&gap(*b)))?;
    let others = (0..sorted.len() - 1).filter(|i| *i != at).map(gap);
    let within = others.fold(0.0, f64::max);
    let smaller = (at + 1).min(sorted.len() - at - 1);
    let is_gap = gap(at) >= MIN_GAP.max(MIN_GAP_RATIO * within);
    let is_kind = smaller as f64 >= MIN_SHARE * sorted.len() as f64;
    (is_gap && is_kind).then(|| (sorted[at] + sorted[at + 1]) / 2.0)
}

/// Spread over the image of the log ratio of the mean light of both kinds.
fn pattern(frames: &[FrameSamples], unlit: &Unlit) -> f64 {
    let mut cells: BTreeMap<u32, [(f64, f64); 2]> = BTreeMap::new();
    for frame in frames {
        let kind = usize::from(unlit.has(frame));
        for (cell, sample) in frame.grid.iter().chain(&frame.dark) {
            let bands = &sample.log_color[..frame.bands];
            let known: Vec<f64> = bands.iter().map(|v| f64::from(*v)).collect();
            let mean = known.iter().sum::<f64>() / known.len() as f64;
            if mean.is_finite() {
                let (sum, count) = &mut cells.entry(*cell).or_default()[kind];
                (*sum, *count) = (*sum + mean, *count + 1.0);
            }
        }
    }
    let ratio = |[lit, unlit]: &[(f64, f64); 2]| lit.0 / lit.1 - unlit.0 / unlit.1;
    let ratios: Vec<f64> = cells.values().map(ratio).filter(|r| r.is_finite()).collect();
    let middle = stats::median(&ratios);
    stats::robust_std(&ratios.iter().map(|r| r - middle).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_have_a_gap_between_them_and_a_change_of_altitude_has_none() {
        let swing = |k: usize| -2.4 + 0.8 * (k as f64 * 0.2).sin();
        let every_other = |k: usize| if k % 2 == 1 { -4.0 } else { swing(k) };
        let below = threshold(&(0..24).map(every_other).collect::<Vec<_>>()).expect("two kinds");
        assert!((-4.0..-3.2).contains(&below), "{below}");
        assert_eq!(threshold(&(0..24).map(swing).collect::<Vec<_>>()), None);
        // One frame that failed is no kind.
        let one = |k: usize| if k == 5 { -6.0 } else { swing(k) };
        assert_eq!(threshold(&(0..24).map(one).collect::<Vec<_>>()), None);
    }
}
