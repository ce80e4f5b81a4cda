//! Cross-validation: whether one form of the model predicts held-out frames better than another.
//!
//! Every third frame is held out; the solve uses the others. A point seen in both gets its
//! reflectance from the views in the solve, and the held-out view is predicted. More unknowns
//! always fit better what they were fitted to, but not this.

use crate::solver::{PathFor, Problem, Setup, Track};
use crate::stats;
use crate::vehicle::Lamps;

/// One frame in this many is held out.
const EVERY: u32 = 3;
/// Reweightings of the solve.
const ROUNDS: usize = 5;

/// Residuals of held-out views (log light); `None` where the others do not determine the solve.
pub fn residuals(
    tracks: &[Track],
    setup: &Setup<'_>,
    lamps: Lamps,
    paths: &PathFor<'_>,
) -> Option<Vec<f64>> {
    let is_held = |frame: u32| frame % EVERY == EVERY - 1;
    let kept: Vec<Track> =
        tracks.iter().map(|t| t.iter().filter(|o| !is_held(o.frame)).copied().collect()).collect();
    // Gains that were found are removed from the samples; a held-out frame determines none.
    let setup = &setup.without_gains();
    let mut problem = Problem::new(&kept, setup, lamps, paths)?;
    let solution = problem.solve(ROUNDS)?;
    let mut residuals = Vec::new();
    for (track, kept) in tracks.iter().zip(&kept) {
        let by = |o| problem.reflectance_by(&solution, o, lamps, paths);
        let seen: Vec<_> = kept.iter().filter_map(by).collect();
        if seen.is_empty() {
            continue;
        }
        for (value, direct_share) in track.iter().filter(|o| is_held(o.frame)).filter_map(by) {
            for b in 0..setup.bands {
                let total: f64 = seen.iter().map(|(_, d)| d[b] * d[b]).sum();
                let reflectance = seen.iter().map(|(v, d)| d[b] * d[b] * v[b]).sum::<f64>() / total;
                residuals.push((value[b] - reflectance) * direct_share[b]);
            }
        }
    }
    Some(residuals)
}

/// Mean Cauchy loss of residuals over a spread (log light).
fn loss(residuals: &[f64], spread: f64) -> f64 {
    residuals.iter().map(|e| (1.0 + (e / (2.0 * spread)).powi(2)).ln()).sum::<f64>()
        / residuals.len().max(1) as f64
}

/// Relative decrease of the loss: 0.1 is a tenth.
pub fn improvement(before: &[f64], after: &[f64]) -> f64 {
    let spread = stats::robust_std(before);
    1.0 - loss(after, spread) / loss(before, spread)
}
