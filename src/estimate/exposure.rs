//! Exposure, gain and strobe power that change along the log (G of Eq. 10): which channels the
//! images follow, and by which law.
//!
//! Messages do not state whether a gain is a factor or in decibels, nor whether the camera applied
//! it. The images show it: from one frame to the next, points seen in both change by the ratio of
//! the settings, beside the effect of altitude. Each channel is tried under every law, and the one
//! that explains most is taken, until none explains more. An exposure that follows altitude, as
//! automatic exposure does, cannot be tested so: it is used unless the images contradict it. In:
//! settings per frame. Out: the laws, and the log gain of each frame.

use std::collections::BTreeMap;

use nalgebra::{Matrix2, Vector2};

use super::samples::FrameSamples;

use crate::model::LightLaw;
use crate::solver::Track;
use crate::stats;

/// Fewest points that two frames share to compare their light by these; else by their means.
const MIN_SHARED: usize = 10;
/// Share of the mean change from frame to frame, beside the effect of altitude, that a setting must
/// explain.
const MIN_EXPLAINED: f64 = 0.2;
/// A setting that follows altitude but for this share …
const OF_ALTITUDE: f64 = 0.3;
/// … must only not increase the mean change by more than this share.
const MAX_CONTRADICTED: f64 = 0.05;
/// Fewest changes to fit slopes over altitude.
const MIN_CHANGES: usize = 8;

/// A channel that the frames follow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FollowedSetting {
    /// which of the settings
    pub index: usize,
    /// how light depends on it
    pub law: LightLaw,
    /// the value of gain 1
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
    /// of the camera's altitude (m), and of its log
    altitude: [f64; 2],
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
        let unexplained = beside_altitude(&changes, |c| c.log_light);
        let mut best: Option<(f64, FollowedSetting, Vec<f64>)> = None;
        for (index, values) in
            settings.iter().enumerate().filter(|(i, _)| found.iter().all(|f| f.index != *i))
        {
            for law in LightLaw::ALL {
                let logs: Option<Vec<f64>> =
                    values.iter().map(|v| law.log_light(*v).filter(|l| l.is_finite())).collect();
                let Some(logs) = logs else { continue };
                let step = |c: &Change| logs[c.frames.1] - logs[c.frames.0];
                let size = beside_altitude(&changes, |c| c.log_light - step(c));
                let whole = stats::mean_absolute(&changes.iter().map(step).collect::<Vec<_>>());
                let is_of_altitude = whole > 0.0
                    && changes.len() >= MIN_CHANGES
                    && beside_altitude(&changes, step) < OF_ALTITUDE * whole;
                let allowed =
                    if is_of_altitude { 1.0 + MAX_CONTRADICTED } else { 1.0 - MIN_EXPLAINED };
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

/// Mean absolute change after slopes over altitude and log altitude are removed, by robust least
/// squares.
fn beside_altitude(changes: &[Change], of: impl Fn(&Change) -> f64) -> f64 {
    let values: Vec<f64> = changes.iter().map(of).collect();
    if changes.len() < MIN_CHANGES {
        return stats::mean_absolute(&values);
    }
    let mut left = values.clone();
    for _ in 0..ROUNDS {
        let scale = stats::robust_std(&left);
        let (mut normal, mut right) = (Matrix2::identity() * 1e-12, Vector2::zeros());
        for ((change, value), left) in changes.iter().zip(&values).zip(&left) {
            let (row, weight) =
                (Vector2::from(change.altitude), stats::cauchy_weight(*left, scale));
            normal += row * row.transpose() * weight;
            right += row * *value * weight;
        }
        let Some(slopes) = normal.cholesky().map(|c| c.solve(&right)) else { break };
        left = changes
            .iter()
            .zip(&values)
            .map(|(c, v)| v - slopes.dot(&Vector2::from(c.altitude)))
            .collect();
    }
    stats::mean_absolute(&left)
}

/// Changes from frame to frame.
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
            .filter(|s| s.len() >= MIN_SHARED)
            .map_or_else(by_mean, |s| stats::median(s));
        let (before, after) = (frames[a].camera_altitude_m, frames[a + 1].camera_altitude_m);
        Change { frames: (a, a + 1), log_light, altitude: [after - before, (after / before).ln()] }
    };
    (0..frames.len().saturating_sub(1)).map(of_pair).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A dive between 1.5 and 3 m altitude with these settings, applied by the camera or not.
    fn dive(setting: impl Fn(usize, f64) -> f64, applied: bool) -> Vec<FollowedSetting> {
        let altitude = |i: usize| 2.25 + 0.75 * (i as f64 * 0.35).sin();
        let by_altitude = |i: usize| -0.46 * altitude(i) - 2.0 * altitude(i).ln();
        let log_set: Vec<f64> = (0..40).map(|i| setting(i, by_altitude(i))).collect();
        let noise = |i: usize| 0.02 * ((i * 7919 % 101) as f64 / 50.0 - 1.0);
        let change = |i: usize| {
            let applied = if applied { log_set[i + 1] - log_set[i] } else { 0.0 };
            let log_light = by_altitude(i + 1) - by_altitude(i) + applied + noise(i);
            Change {
                frames: (i, i + 1),
                log_light,
                altitude: [altitude(i + 1) - altitude(i), (altitude(i + 1) / altitude(i)).ln()],
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
    fn settings_at_random_are_followed_where_the_camera_applies_them() {
        let at_random = |i: usize, _: f64| (i * 31 % 17) as f64 / 17.0;
        assert_eq!(dive(at_random, true).len(), 1);
        assert_eq!(dive(at_random, false).len(), 0);
        assert_eq!(dive(|_, _| 0.0, true).len(), 0, "a constant setting");
    }
}
