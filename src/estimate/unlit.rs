//! Frames without the strobe between frames with it: some cameras take every other image by
//! daylight alone. They are recognised as a second kind, which is darker, takes turns with the
//! first, and does not show the pattern of its light; frames of another gain show it.

use std::collections::BTreeMap;

use super::samples::FrameSamples;
use crate::stats;

/// Fewest frames of which kinds are distinguished, and of each kind, as a share.
const MIN_FRAMES: usize = 8;
const MIN_SHARE: f64 = 0.2;
/// Smallest gap between the kinds (log light), and over the largest gap within one.
const MIN_GAP: f64 = 0.7;
const MIN_GAP_RATIO: f64 = 2.0;
/// Smallest share of frames that are followed by one of the other kind.
const MIN_TURNS: f64 = 0.3;
/// Darker frames are black (share of full scale).
const LEAST_LIGHT: f64 = 1e-9;
/// Smallest spread over the image of the log ratio of both kinds, and over that of the brighter
/// kind. A wrong transfer curve bends the pattern of another gain by a third.
const MIN_RATIO_SPREAD: f64 = 0.1;
const MIN_PATTERN_SHARE: f64 = 0.5;

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
fn brightness(frame: &FrameSamples) -> f64 {
    frame.mean_reading[..frame.bands].iter().sum::<f64>() / frame.bands as f64
}

impl Unlit {
    /// Of the frames of a log, in the order of time. `None` where all are of one kind.
    pub fn among(frames: &[FrameSamples]) -> Option<Self> {
        let light: Vec<f64> = frames.iter().map(brightness).collect();
        let below = two_kinds(&light)?;
        let (unlit, lit): (Vec<f64>, Vec<f64>) = light.iter().partition(|light| **light < below);
        let ratio = stats::median(&lit) / stats::median(&unlit).max(LEAST_LIGHT);
        let found = Self { below, frames: unlit.len(), ratio };
        found.has_other_pattern(frames).then_some(found)
    }

    /// Whether a frame is one of them.
    pub fn has(&self, frame: &FrameSamples) -> bool {
        brightness(frame) < self.below
    }

    /// Whether the pattern of light over the image is another one than that of the brighter kind.
    fn has_other_pattern(&self, frames: &[FrameSamples]) -> bool {
        let mut cells: BTreeMap<u32, [(f64, f64); 2]> = BTreeMap::new();
        for frame in frames {
            let kind = usize::from(self.has(frame));
            for (cell, sample) in frame.grid.iter().chain(&frame.dark) {
                let bands = sample.log_color[..frame.bands].iter();
                let mean = bands.map(|v| f64::from(*v)).sum::<f64>() / frame.bands as f64;
                if mean.is_finite() {
                    let (sum, count) = &mut cells.entry(*cell).or_default()[kind];
                    (*sum, *count) = (*sum + mean, *count + 1.0);
                }
            }
        }
        let means = |kinds: &[(f64, f64); 2]| kinds.map(|(sum, count)| sum / count);
        let known = cells.values().map(means).filter(|[lit, unlit]| (lit - unlit).is_finite());
        let (lit, ratio): (Vec<f64>, Vec<f64>) =
            known.map(|[lit, unlit]| (lit, lit - unlit)).unzip();
        let [lit, ratio] = [lit, ratio].map(|values| {
            let middle = stats::median(&values);
            stats::robust_std(&values.iter().map(|v| v - middle).collect::<Vec<_>>())
        });
        ratio >= MIN_RATIO_SPREAD.max(MIN_PATTERN_SHARE * lit)
    }
}

/// Light between two kinds of frames that take turns.
pub fn two_kinds(light: &[f64]) -> Option<f64> {
    let below = threshold(light)?;
    let turns = light.windows(2).filter(|w| (w[0] < below) != (w[1] < below)).count();
    (turns as f64 >= MIN_TURNS * (light.len() - 1) as f64).then_some(below)
}

/// Middle of the gap between two kinds.
fn threshold(light: &[f64]) -> Option<f64> {
    let mut sorted: Vec<f64> = light.iter().map(|light| light.max(LEAST_LIGHT).ln()).collect();
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
    (is_gap && is_kind).then(|| ((sorted[at] + sorted[at + 1]) / 2.0).exp())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_have_a_gap_between_them_and_a_change_of_altitude_has_none() {
        let kinds = |light: &dyn Fn(usize) -> f64| {
            two_kinds(&(0..24).map(|k| light(k).exp()).collect::<Vec<_>>())
        };
        let swing = |k: usize| -2.4 + 0.8 * (k as f64 * 0.2).sin();
        let below = kinds(&|k| if k % 2 == 1 { -4.0 } else { swing(k) }).expect("two kinds");
        assert!((-4.0..-3.2).contains(&below.ln()), "{below}");
        assert_eq!(kinds(&swing), None);
        // One frame that failed is no kind, and half a dive in the dark takes no turns.
        assert_eq!(kinds(&|k| if k == 5 { -6.0 } else { swing(k) }), None);
        assert_eq!(kinds(&|k| if k < 12 { -6.0 } else { swing(k) }), None);
    }
}
