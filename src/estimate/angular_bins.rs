//! The beam pattern from angular bins (paper §IV-C, Eq. 17, Fig. 9).
//!
//! ```text
//! log BP(θ_i, φ_j) = mean over bands Λ and pixels p of  log c_Λ + α_Λ ℓ + spreading − log cos γ       Eq. 17
//! ```
//!
//! As printed, Eq. 17 *sums* over Λ; with Eq. 15 each band contributes one log BP, so the sum of
//! three is three times log BP, a factor that normalising does not remove. A mean is meant.
//! Assumed: no spatial bias in the reflectance. A sample counts only where all bands are measured,
//! so no bin leans on one of them.

use super::samples::FrameSamples;
use crate::geometry::LightPath;
use crate::model::{BeamGrid, BeamPattern, ImagingModel, Removal};
use crate::solver::Sample;

/// Bins with fewer samples are unseen.
const MIN_SAMPLES: f64 = 12.0;

/// Eq. 17 over the grids of all frames; `model` is Eq. 15 without its beam pattern.
pub fn beam_pattern(
    frames: &[FrameSamples],
    model: &ImagingModel,
    grid: BeamGrid,
    path: &dyn Fn(&Sample) -> Option<LightPath>,
) -> BeamPattern {
    let count = grid.count * grid.count;
    let (mut sums, mut weights) = (vec![0.0; count], vec![0.0; count]);
    for frame in frames {
        for (_, sample) in &frame.grid {
            let Some(path) = path(sample).filter(|p| grid.holds(p.angles)) else { continue };
            let known = model.log_radiance(&path, Removal::FULL.without_beam());
            let of_band = |b: usize| f64::from(sample.log_color[b]) - known[b];
            let mean = (0..frame.bands).map(of_band).sum::<f64>() / frame.bands as f64;
            for (node, weight) in grid.weights(path.angles) {
                sums[node] += weight * mean;
                weights[node] += weight;
            }
        }
    }
    let values: Vec<Option<f64>> =
        sums.iter().zip(&weights).map(|(s, w)| (*w >= MIN_SAMPLES).then(|| s / w)).collect();
    BeamPattern::from_nodes(grid, &values)
}
