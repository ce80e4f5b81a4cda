//! Pairs of frames that may see the same seafloor, and their matched keypoints.

use crate::config::Config;
use crate::coordinates::Point;
use crate::error::Result;
use crate::estimate::{FrameSamples, Matchable, MatchedPair, matches};
use crate::parallel::{Threads, ordered_map};
use crate::session::survey::Survey;
use crate::session::{CameraSession, Progress, Step};

use super::pace::Pace;

/// Frames this many times as far apart as neighbours may be of crossing tracks.
const CROSSING_FRAMES: usize = 3;
/// Their views lie within this share of the altitude.
const CROSSING_SHARE: f64 = 0.5;
/// At most this many crossings are tried for each frame.
const MAX_CROSSINGS_PER_FRAME: usize = 2;
/// Pairs in flight.
const PAIRS_IN_FLIGHT: usize = 16;

/// Frames far apart in time that see the same seafloor by the trajectory of the instrument:
/// crossing tracks, return legs. `nearest` is the distance of the farthest neighbours in frames.
fn crossings(frames: &[FrameSamples], survey: &Survey, nearest: usize) -> Vec<(usize, usize)> {
    let view_center = |f: &FrameSamples| {
        if f.grid.is_empty() {
            return None;
        }
        let sum: nalgebra::Vector3<f64> = f.grid.iter().map(|(_, s)| s.hit.vector()).sum();
        let center = Point::from_vector(sum / f.grid.len() as f64);
        survey.pings.in_world(f.stamp, center, &survey.rig)
    };
    let centers: Vec<_> = frames.iter().map(view_center).collect();
    let distance = |a: usize, b: usize| {
        let ((s, p), (t, q)) = (centers[a]?, centers[b]?);
        let altitude_m = (frames[a].camera_altitude_m + frames[b].camera_altitude_m) / 2.0;
        let distance_m = (p - q).norm();
        (s == t && distance_m < CROSSING_SHARE * altitude_m).then_some(distance_m)
    };
    let mut found = Vec::new();
    for a in 0..frames.len() {
        let later = (a + 1..frames.len())
            .filter(|b| frames[*b].frame - frames[a].frame > CROSSING_FRAMES * nearest);
        let mut of_frame: Vec<(f64, usize)> =
            later.filter_map(|b| Some((distance(a, b)?, b))).collect();
        of_frame.sort_by(|x, y| x.0.total_cmp(&y.0));
        found.extend(of_frame.into_iter().take(MAX_CROSSINGS_PER_FRAME).map(|(_, b)| (a, b)));
    }
    found
}

/// Pairs that are matched, as indices of `frames`: neighbours and crossings.
fn candidates(
    frames: &[FrameSamples],
    session: &CameraSession,
    config: &Config,
    Pace { step, spacing }: Pace,
) -> Vec<(usize, usize)> {
    let neighbours = config.matching.neighbours;
    let later =
        |a: usize| (1..=neighbours).map(move |n| a + n * spacing).filter(|b| *b < frames.len());
    let near = (0..frames.len()).flat_map(|a| later(a).map(move |b| (a, b)));
    // Frames of one window are neighbours; the last of one and the first of the next are not.
    let farthest = neighbours * spacing * step;
    let near = near.filter(|(a, b)| frames[*b].frame - frames[*a].frame <= farthest);
    near.chain(crossings(frames, &session.survey, farthest)).collect()
}

/// Matches neighbours and crossings.
pub fn matched(
    frames: &[FrameSamples],
    session: &CameraSession,
    config: &Config,
    pace: Pace,
    (threads, progress): (&Threads, &dyn Progress),
) -> Result<Vec<MatchedPair>> {
    let candidates = candidates(frames, session, config, pace);
    progress.begin(Step::Match, candidates.len());
    let camera = &session.survey.rig.camera;
    let reduction = config.matching.reduction(camera.width, camera.height) as f64;
    let inlier = config.matching.inlier_px * reduction / camera.fx;
    let matchable =
        |i: usize| Matchable { keypoints: &frames[i].keypoints, places: &frames[i].places };
    let work = |(a, b): (usize, usize)| {
        let seed = (a as u64) << 32 | b as u64;
        let keypoints = matches(&matchable(a), &matchable(b), &config.matching, inlier, seed);
        MatchedPair { a, b, keypoints }
    };
    let mut pairs = Vec::new();
    let sink = |pair: MatchedPair| -> Result<()> {
        progress.advance(1);
        if !pair.keypoints.is_empty() {
            pairs.push(pair);
        }
        Ok(())
    };
    ordered_map(candidates.into_iter(), PAIRS_IN_FLIGHT, |_| 1, threads, work, sink)?;
    progress.end();
    Ok(pairs)
}
