//! Water that changes along the log: nodes of α in time, where held-out frames are predicted better
//! by them.
//!
//! α is linear in time between nodes at least a dozen frames apart, except across gaps in the log.
//! Of several logs each has one α.

use std::collections::BTreeMap;

use super::Dataset;
use super::quality::cross_validation;
use crate::config::Switch;
use crate::solver::terms::attenuation::TimeGrid;
use crate::solver::{Setup, sample_path, thinned};
use crate::stats;
use crate::units::Stamp;

/// Frames that a node needs.
const FRAMES_PER_NODE: usize = 12;
const MAX_NODES: usize = 24;
/// Observations that tell whether α changes.
const MAX_OBSERVATIONS: usize = 24_000;
/// α is not interpolated across gaps longer than this (s) and …
const GAP_S: f64 = 120.0;
/// … than this many intervals between frames.
const GAP_INTERVALS: f64 = 20.0;
/// `auto` requires altitude to pass through its range this many times; …
const MIN_PASSES: f64 = 2.5;
/// … reversals by less than this share of the range do not count.
const MIN_REVERSAL: f64 = 0.2;
/// `auto` requires held-out frames to be predicted better by this.
const MIN_IMPROVEMENT: f64 = 0.02;

/// Nodes of α in time.
#[derive(Clone, Debug)]
pub struct DriftFit {
    /// times in order, each with its node; none where logs overlap in time
    pub stamps: Vec<(Stamp, usize)>,
    /// position of each frame between the nodes
    pub grid: TimeGrid,
}

/// Nodes, where the log supports them.
pub fn find(data: &Dataset<'_>, setup: &Setup<'_>) -> Option<DriftFit> {
    let has_several_logs = data.frames.iter().any(|f| f.log > 0);
    let found = if has_several_logs { one_per_log(data) } else { nodes(data)? };
    if setup.config.drift == Switch::Auto && !has_several_logs && !altitude_recurs(data) {
        return None;
    }
    let (lamps, paths) = (data.lamps, &sample_path);
    let steady = Setup { free_strobe: false, segments: None, ..*setup };
    let tracks = &thinned(data.tracks, MAX_OBSERVATIONS);
    let without = cross_validation::residuals(tracks, &steady, lamps, paths)?;
    let with = cross_validation::residuals(
        tracks,
        &Setup { segments: Some(&found.grid), ..steady },
        lamps,
        paths,
    )?;
    let improvement = cross_validation::improvement(&without, &with);
    (setup.config.drift == Switch::On || improvement > MIN_IMPROVEMENT).then_some(found)
}

/// Whether the dive returns to its altitudes: in one long climb changing water cannot be separated
/// from errors that grow with altitude.
fn altitude_recurs(data: &Dataset<'_>) -> bool {
    let mut by_time: Vec<(i64, f64)> =
        data.frames.iter().map(|f| (f.stamp.0, f.camera_altitude_m)).collect();
    by_time.sort_by_key(|(t, _)| *t);
    let altitudes_m: Vec<f64> = by_time.iter().map(|(_, altitude_m)| *altitude_m).collect();
    passes(&altitudes_m) > MIN_PASSES
}

/// How many times altitude passes through its range.
fn passes(altitudes_m: &[f64]) -> f64 {
    let span = stats::quantile(altitudes_m, 0.95) - stats::quantile(altitudes_m, 0.05);
    // Hysteresis, so that reversals within `play` do not count.
    let play = MIN_REVERSAL / 2.0 * span;
    let mut at = altitudes_m.first().copied().unwrap_or_default();
    let mut passed = 0.0;
    for altitude_m in altitudes_m {
        let next = at.clamp(altitude_m - play, altitude_m + play);
        passed += (next - at).abs();
        at = next;
    }
    passed / (span - 2.0 * play)
}

fn nodes(data: &Dataset<'_>) -> Option<DriftFit> {
    let times: Vec<i64> = data.frames.iter().map(|f| f.stamp.0).collect();
    let (first, last) = (*times.iter().min()?, *times.iter().max()?);
    let intervals = (times.len() / FRAMES_PER_NODE).min(MAX_NODES - 1);
    if intervals == 0 || last <= first {
        return None;
    }
    let mut sorted = times.clone();
    sorted.sort_unstable();
    // Equal numbers of frames between nodes.
    let stamps: Vec<i64> =
        (0..=intervals).map(|k| sorted[k * (sorted.len() - 1) / intervals]).collect();
    let steps: Vec<f64> = sorted.windows(2).map(|w| (w[1] - w[0]) as f64 * 1e-9).collect();
    let gap_s = GAP_S.max(GAP_INTERVALS * stats::median(&steps));
    let joined = stamps.windows(2).map(|w| {
        let within = sorted.windows(2).filter(|s| s[0] >= w[0] && s[1] <= w[1]);
        within.map(|s| (s[1] - s[0]) as f64 * 1e-9).fold(0.0, f64::max) < gap_s
    });
    let position = |time: &i64| {
        let node = stamps.partition_point(|s| s <= time).saturating_sub(1).min(intervals - 1);
        let length = (stamps[node + 1] - stamps[node]).max(1) as f64;
        (node, ((time - stamps[node]) as f64 / length).clamp(0.0, 1.0))
    };
    let grid = TimeGrid {
        frames: times.iter().map(position).collect(),
        nodes: intervals + 1,
        is_joined: joined.collect(),
    };
    Some(DriftFit { stamps: stamps.into_iter().map(Stamp).zip(0..).collect(), grid })
}

/// One node for each log.
fn one_per_log(data: &Dataset<'_>) -> DriftFit {
    let mut spans: BTreeMap<usize, (Stamp, Stamp)> = BTreeMap::new();
    for frame in data.frames {
        let (first, last) = spans.entry(frame.log).or_insert((frame.stamp, frame.stamp));
        (*first, *last) = (frame.stamp.min(*first), frame.stamp.max(*last));
    }
    let mut in_time: Vec<(usize, (Stamp, Stamp))> = spans.into_iter().collect();
    in_time.sort_by_key(|(_, span)| *span);
    let overlap = in_time.windows(2).any(|pair| pair[0].1.1 >= pair[1].1.0);
    let ends = in_time.iter().zip(0..).flat_map(|((_, (first, last)), node)| {
        [Some((*first, node)), (first < last).then_some((*last, node))].into_iter().flatten()
    });
    let node_of: BTreeMap<usize, usize> = in_time.iter().map(|(log, _)| *log).zip(0..).collect();
    let grid = TimeGrid {
        frames: data.frames.iter().map(|f| (node_of[&f.log], 0.0)).collect(),
        nodes: in_time.len(),
        is_joined: vec![false; in_time.len() - 1],
    };
    DriftFit { stamps: if overlap { Vec::new() } else { ends.collect() }, grid }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::coordinates::Transform;
    use crate::estimate::FrameSamples;
    use crate::vehicle::Lamps;

    #[test]
    fn each_of_several_logs_has_a_node_in_the_order_of_time() {
        // The first log was recorded last.
        let frame = |log: usize, second: i64| FrameSamples {
            log,
            stamp: Stamp(second * 1_000_000_000),
            ..FrameSamples::of_level_seafloor(0, 2.0)
        };
        let frames = [frame(0, 100), frame(0, 101), frame(1, 7), frame(1, 8)];
        let (identity, lamps) = (Transform::identity(), Lamps::one(Transform::identity()));
        let of = |frames| one_per_log(&Dataset::plain(frames, &[], identity, lamps));
        let found = of(&frames);
        let seconds: Vec<_> = found.stamps.iter().map(|(t, n)| (t.0 / 1_000_000_000, *n)).collect();
        assert_eq!(seconds, [(7, 0), (8, 0), (100, 1), (101, 1)]);
        assert_eq!(found.grid.frames, [(1, 0.0), (1, 0.0), (0, 0.0), (0, 0.0)]);
        assert!(found.grid.is_of_logs() && found.grid.frames_per_node() == [2, 2]);
        let overlapping = of(&[frame(0, 1), frame(0, 3), frame(1, 2)]);
        assert!(overlapping.stamps.is_empty() && overlapping.grid.is_of_logs());
    }

    #[test]
    fn a_bobbing_climb_goes_through_its_range_once() {
        let climb = |frames: u32| {
            (0..frames).map(move |i| {
                1.5 + 1.5 * f64::from(i) / f64::from(frames) + 0.02 * (f64::from(i) * 1.3).sin()
            })
        };
        let of = |frames: u32| passes(&climb(frames).collect::<Vec<_>>());
        assert!(of(40) < 1.5 && of(400) < 1.5, "{} and {}", of(40), of(400));
        let swing: Vec<f64> =
            (0..200).map(|i| 2.2 + 0.7 * (f64::from(i) / 200.0 * 12.0).sin()).collect();
        assert!(passes(&swing) > 3.0, "{}", passes(&swing));
    }
}
