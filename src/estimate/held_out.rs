//! Whether one form of the model explains frames it has not seen better than another.
//!
//! Every third frame is held out; the solve sees the others. A point seen in both gets its
//! reflectance from the views the solve saw, and the held-out view is foretold. More unknowns
//! always fit better what they were fitted to, not this.

use crate::solver::{PathFor, Problem, Setup, Track};
use crate::stats;
use crate::vehicle::Lamps;

/// One frame in so many is held out.
const EVERY: u32 = 3;
const ROUNDS: usize = 5;

/// Misfits of held-out views [log light]; `None` where what is left does not hold the solve.
pub fn misfits(
    tracks: &[Track],
    setup: &Setup<'_>,
    mount: Lamps,
    paths: &PathFor<'_>,
) -> Option<Vec<f64>> {
    let is_held = |frame: u32| frame % EVERY == EVERY - 1;
    let shown: Vec<Track> =
        tracks.iter().map(|t| t.iter().filter(|o| !is_held(o.frame)).copied().collect()).collect();
    let mut problem = Problem::new(&shown, setup, mount, paths)?;
    let solution = problem.solve(ROUNDS)?;
    let mut misfits = Vec::new();
    for (track, shown) in tracks.iter().zip(&shown) {
        let by = |o| problem.reflectance_by(&solution, o, mount, paths);
        let seen: Vec<_> = shown.iter().filter_map(by).collect();
        if seen.is_empty() {
            continue;
        }
        for (value, direct_share) in track.iter().filter(|o| is_held(o.frame)).filter_map(by) {
            for b in 0..setup.bands {
                let total: f64 = seen.iter().map(|(_, d)| d[b] * d[b]).sum();
                let reflectance = seen.iter().map(|(v, d)| d[b] * d[b] * v[b]).sum::<f64>() / total;
                misfits.push((value[b] - reflectance) * direct_share[b]);
            }
        }
    }
    Some(misfits)
}

/// Mean loss (Cauchy's) of misfits, measured against a spread [log light].
pub fn loss(misfits: &[f64], scale: f64) -> f64 {
    misfits.iter().map(|e| (1.0 + (e / (2.0 * scale)).powi(2)).ln()).sum::<f64>()
        / misfits.len().max(1) as f64
}

/// How much less the second loses than the first: 0.1 is a tenth.
pub fn improvement(before: &[f64], after: &[f64]) -> f64 {
    let scale = stats::robust_std(before);
    1.0 - loss(after, scale) / loss(before, scale)
}
