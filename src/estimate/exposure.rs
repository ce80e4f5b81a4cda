//! Exposure, gain and strobe power that change along the log (G of Eq. 10): which channels the
//! pictures follow, and how.
//!
//! No driver says in its message whether its gain is a factor or counts decibels, nor whether a
//! camera obeyed. The pictures do: from one frame to the next, points seen in both change by the
//! ratio of the settings, beside what the step in height changes. Each channel is tried under both
//! laws, and the one that explains most is taken, until none explains more. An exposure that
//! follows the height itself, as a camera's own control does, leaves the pictures no say: such a
//! channel is believed unless they contradict it. In: settings per frame. Out: the laws, and each
//! frame's log gain.

use std::collections::BTreeMap;

use nalgebra::{Matrix2, Vector2};

use super::samples::FrameSamples;

use crate::model::LightLaw;
use crate::solver::Track;
use crate::stats;

/// Points that two frames must share for their light to be compared by them; else their means are.
const LEAST_SHARED: usize = 10;
/// A setting must explain this share of the mean change from frame to frame that height does not, …
const LEAST_EXPLAINED: f64 = 0.2;
/// … but one that height explains, to this share, must only …
const OF_HEIGHT: f64 = 0.3;
/// … not contradict the pictures by more than this.
const MOST_CONTRADICTED: f64 = 0.05;
/// Fewer changes hold no slopes beside a setting.
const LEAST_CHANGES: usize = 8;

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

impl FollowedSetting {
    /// Log gain of each value of the setting over the reference.
    pub fn log_gains(&self, values: &[f64]) -> Vec<f64> {
        let reference = self.law.log_light(self.reference);
        let log_gain = |v: &f64| self.law.log_light(*v).zip(reference).map_or(0.0, |(v, r)| v - r);
        values.iter().map(log_gain).collect()
    }
}

/// What changes from one frame to the next.
struct Change {
    /// their indices
    frames: (usize, usize),
    /// mean over bands
    log_light: f64,
    /// of the camera over the floor (m), and the log of it
    height: [f64; 2],
}

/// Which settings (each a number per frame) the frames follow.
pub fn followed(
    frames: &[FrameSamples],
    tracks: &[Track],
    settings: &[Vec<f64>],
) -> Vec<FollowedSetting> {
    if settings.is_empty() { Vec::new() } else { followed_by(changes(frames, tracks), settings) }
}

fn followed_by(mut changes: Vec<Change>, settings: &[Vec<f64>]) -> Vec<FollowedSetting> {
    let mut found: Vec<FollowedSetting> = Vec::new();
    loop {
        let unexplained = beside_height(&changes, |c| c.log_light);
        let mut best: Option<(f64, FollowedSetting, Vec<f64>)> = None;
        for (index, values) in
            settings.iter().enumerate().filter(|(i, _)| found.iter().all(|f| f.index != *i))
        {
            for law in LightLaw::ALL {
                let logs: Option<Vec<f64>> =
                    values.iter().map(|v| law.log_light(*v).filter(|l| l.is_finite())).collect();
                let Some(logs) = logs else { continue };
                let step = |c: &Change| logs[c.frames.1] - logs[c.frames.0];
                let size = beside_height(&changes, |c| c.log_light - step(c));
                let whole = stats::mean_absolute(&changes.iter().map(step).collect::<Vec<_>>());
                let is_of_height = whole > 0.0
                    && changes.len() >= LEAST_CHANGES
                    && beside_height(&changes, step) < OF_HEIGHT * whole;
                let allowed =
                    if is_of_height { 1.0 + MOST_CONTRADICTED } else { 1.0 - LEAST_EXPLAINED };
                if size < allowed * unexplained && best.as_ref().is_none_or(|b| size < b.0) {
                    best = Some((
                        size,
                        FollowedSetting { index, law, reference: stats::median(values) },
                        logs,
                    ));
                }
            }
        }
        let Some((_, setting, logs)) = best else { return found };
        changes.iter_mut().for_each(|c| c.log_light -= logs[c.frames.1] - logs[c.frames.0]);
        found.push(setting);
    }
}

/// A setting must leave at most this share of the spread of gains found otherwise, and all together
/// at most that.
const MAX_LEFT: f64 = 0.7;
const MAX_LEFT_IN_ALL: f64 = 0.25;

/// Settings that explain gains of frames which were found without them. Together they do, or none
/// counts: a part of the truth would not be better than none.
pub fn explaining(log_gains: &[f64], settings: &[Vec<f64>]) -> Vec<FollowedSetting> {
    let spread = |values: &[f64]| {
        let middle = stats::median(values);
        stats::robust_std(&values.iter().map(|v| v - middle).collect::<Vec<_>>())
    };
    let whole = spread(log_gains);
    let (mut left, mut found) = (log_gains.to_vec(), Vec::<FollowedSetting>::new());
    loop {
        let is_new = |i: usize| found.iter().all(|f| f.index != i);
        let laws = (0..settings.len())
            .filter(|i| is_new(*i))
            .flat_map(|index| LightLaw::ALL.map(|law| (index, law)));
        let tried = laws.filter_map(|(index, law)| {
            let log_light = |v: &f64| law.log_light(*v).filter(|l| l.is_finite());
            let logs: Vec<f64> = settings[index].iter().map(log_light).collect::<Option<_>>()?;
            let without: Vec<f64> = left.iter().zip(logs).map(|(g, l)| g - l).collect();
            let setting =
                FollowedSetting { index, law, reference: stats::median(&settings[index]) };
            Some((spread(&without), setting, without))
        });
        let best = tried.min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((_, setting, without)) = best.filter(|b| b.0 < MAX_LEFT * spread(&left)) else {
            break;
        };
        found.push(setting);
        left = without;
    }
    if spread(&left) < MAX_LEFT_IN_ALL * whole { found } else { Vec::new() }
}

/// Rounds of reweighting.
const ROUNDS: usize = 4;

/// Mean size of what of a change is left when slopes over height and log height are taken out, by
/// least squares, strays (a strobe that failed) weighing less.
fn beside_height(changes: &[Change], of: impl Fn(&Change) -> f64) -> f64 {
    let values: Vec<f64> = changes.iter().map(of).collect();
    if changes.len() < LEAST_CHANGES {
        return stats::mean_absolute(&values);
    }
    let mut left = values.clone();
    for _ in 0..ROUNDS {
        let scale = stats::robust_std(&left);
        let (mut normal, mut right) = (Matrix2::identity() * 1e-12, Vector2::zeros());
        for ((change, value), left) in changes.iter().zip(&values).zip(&left) {
            let (row, weight) = (Vector2::from(change.height), stats::cauchy_weight(*left, scale));
            normal += row * row.transpose() * weight;
            right += row * *value * weight;
        }
        let Some(slopes) = normal.cholesky().map(|c| c.solve(&right)) else { break };
        left = changes
            .iter()
            .zip(&values)
            .map(|(c, v)| v - slopes.dot(&Vector2::from(c.height)))
            .collect();
    }
    stats::mean_absolute(&left)
}

/// From neighbour to neighbour.
fn changes(frames: &[FrameSamples], tracks: &[Track]) -> Vec<Change> {
    let mut shared: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
    for track in tracks {
        for pair in track.windows(2).filter(|p| p[1].frame == p[0].frame + 1) {
            let bands = frames[pair[0].frame as usize].bands;
            let change = (0..bands)
                .map(|b| f64::from(pair[1].sample.log_color[b] - pair[0].sample.log_color[b]))
                .sum::<f64>()
                / bands as f64;
            shared.entry(pair[0].frame as usize).or_default().push(change);
        }
    }
    let of_pair = |a: usize| {
        let by_mean = || {
            let log_mean = |f: &FrameSamples| {
                (0..f.bands).map(|b| f.mean_light[b].max(1e-9).ln()).sum::<f64>() / f.bands as f64
            };
            log_mean(&frames[a + 1]) - log_mean(&frames[a])
        };
        let log_light = shared
            .get(&a)
            .filter(|s| s.len() >= LEAST_SHARED)
            .map_or_else(by_mean, |s| stats::median(s));
        let (before, after) = (frames[a].camera_altitude_m, frames[a + 1].camera_altitude_m);
        Change { frames: (a, a + 1), log_light, height: [after - before, (after / before).ln()] }
    };
    (0..frames.len().saturating_sub(1)).map(of_pair).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A swing between 1.5 and 3 m; what the camera's settings were, whether it obeyed them.
    fn dive(setting: impl Fn(usize, f64) -> f64, obeyed: bool) -> Vec<FollowedSetting> {
        let height = |i: usize| 2.25 + 0.75 * (i as f64 * 0.35).sin();
        let by_height = |i: usize| -0.46 * height(i) - 2.0 * height(i).ln();
        let log_set: Vec<f64> = (0..40).map(|i| setting(i, by_height(i))).collect();
        let noise = |i: usize| 0.02 * ((i * 7919 % 101) as f64 / 50.0 - 1.0);
        let change = |i: usize| {
            let obeyed = if obeyed { log_set[i + 1] - log_set[i] } else { 0.0 };
            let log_light = by_height(i + 1) - by_height(i) + obeyed + noise(i);
            Change {
                frames: (i, i + 1),
                log_light,
                height: [height(i + 1) - height(i), (height(i + 1) / height(i)).ln()],
            }
        };
        let values = log_set.iter().map(|l| 800.0 * l.exp()).collect();
        followed_by((0..39).map(change).collect(), &[values])
    }

    #[test]
    fn a_camera_that_sets_itself_by_what_it_sees_is_followed() {
        for share in [1.0, 0.5, 0.15] {
            let found = dive(|_, light| -share * light, true);
            assert!(
                matches!(found.as_slice(), [FollowedSetting { law: LightLaw::Factor, .. }]),
                "{share}: {found:?}"
            );
        }
    }

    #[test]
    fn settings_at_random_are_followed_where_the_camera_obeys() {
        let at_random = |i: usize, _: f64| (i * 31 % 17) as f64 / 17.0;
        assert_eq!(dive(at_random, true).len(), 1);
        assert_eq!(dive(at_random, false).len(), 0);
        assert_eq!(dive(|_, _| 0.0, true).len(), 0, "a setting that never changes says nothing");
    }
}
