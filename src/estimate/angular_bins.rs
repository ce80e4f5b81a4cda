//! The beam pattern from angular bins (paper §IV-C, Eq. 17, Fig. 9).
//!
//! ```text
//! log BP(θ_i, φ_j) = mean over Λ, p of log c_Λ + α_Λ ℓ + spreading − log cos γ    Eq. 17
//! ```
//!
//! Λ are bands, p pixels. As printed, Eq. 17 *sums* over Λ; with Eq. 15 each band contributes one
//! log BP, so the sum of three is three times log BP, a factor that normalising does not remove. A
//! mean is meant.
//! Assumed: no spatial bias in the reflectance. A sample counts only where all bands are measured,
//! so no bin leans on one of them.

use super::Dataset;
use crate::config::EstimateConfig;
use crate::image::Bands;
use crate::model::{BeamGrid, BeamPattern, ImagingModel, Removal, SpreadingModel};
use crate::stats;

/// Bins with fewer samples are unseen.
const MIN_SAMPLES: f64 = 12.0;

/// Eq. 17 over the grids of all frames; `model` is Eq. 15 without its beam pattern.
pub fn beam_pattern(data: &Dataset<'_>, model: &ImagingModel, grid: BeamGrid) -> BeamPattern {
    let count = grid.count * grid.count;
    let (mut sums, mut weights) = (vec![0.0; count], vec![0.0; count]);
    for frame in data.frames {
        for (_, sample) in &frame.grid {
            let Some(path) = sample.path(data.lamps).filter(|p| grid.holds(p.angles)) else {
                continue;
            };
            let known = model.log_radiance(&path, Removal::FULL.without_beam());
            let of_band = |b: usize| f64::from(sample.log_color[b]) - known[b];
            let mean = (0..frame.bands).map(of_band).sum::<f64>() / frame.bands as f64;
            for (node, weight) in grid.weights(path.angles) {
                sums[node] += weight * mean;
                weights[node] += weight;
            }
        }
    }
    let mean = |(sum, weight): (&f64, &f64)| (*weight >= MIN_SAMPLES).then(|| sum / weight);
    let values: Vec<Option<f64>> = sums.iter().zip(&weights).map(mean).collect();
    BeamPattern::from_nodes(grid, &values)
}

/// A beam pattern by node, with directions that no track saw from Eq. 17, levelled where both are
/// known.
pub fn completed(
    beam: &[Option<f64>],
    data: &Dataset<'_>,
    alpha: &Bands,
    spreading: SpreadingModel,
    config: &EstimateConfig,
) -> BeamPattern {
    let grid = BeamGrid::new(config.beam_nodes, config.beam_limit_deg);
    if data.lamps.lamps().len() > 1 {
        return BeamPattern::from_nodes(grid, beam);
    }
    let model = data.model(*alpha, spreading, BeamPattern::uniform(grid), config);
    let bins = beam_pattern(data, &model, grid).by_node();
    let steps: Vec<f64> = beam.iter().zip(&bins).filter_map(|(a, b)| Some((*a)? - (*b)?)).collect();
    let level = stats::median(&steps);
    let levelled = |bin: &Option<f64>| bin.map(|b| b + level).filter(|v| v.is_finite());
    let values: Vec<Option<f64>> = beam.iter().zip(&bins).map(|(a, b)| a.or(levelled(b))).collect();
    BeamPattern::from_nodes(grid, &values)
}
