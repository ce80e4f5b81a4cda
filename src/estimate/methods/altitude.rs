//! Attenuation from log colour against altitude (paper §IV-B, Fig. 6), for logs without overlap or
//! texture.
//!
//! The paper plots the log of each frame's mean against altitude and takes half the slope, as ℓ ≈
//! 2a; with the sign that is missing there, α = −slope/2. Here each cell of the image is followed
//! over the dive on its own, against its own path length: what is the same in every frame (beam
//! pattern, lens, the mean seafloor) stays in the cell's own level, and no ℓ ≈ 2a is needed. Far
//! cells, where backscatter dominates and the line bends (Fig. 6's plateau), are left out by path
//! length.

use std::collections::BTreeMap;

use super::{Candidate, Sweeps, one_lamp};
use crate::config::EstimateConfig;
use crate::diagnostics::NoAnswer;
use crate::estimate::Dataset;
use crate::estimate::samples::FrameSamples;
use crate::geometry::LightPath;
use crate::image::Bands;
use crate::model::BeamGrid;
use crate::stats;

/// Fewest frames of a cell, and of a log.
const MIN_FRAMES: usize = 5;
/// Reweightings.
const ROUNDS: usize = 8;
/// Cells beyond this quantile of path length are left out.
const NEAR_SHARE: f64 = 0.6;
/// Segments of frames for the jackknife.
const SEGMENTS: usize = 10;

/// The estimate of the slopes.
#[derive(Clone, Debug, Default)]
struct AltitudeAnswer {
    /// α (1/m) per band
    attenuation_per_m: Bands,
    /// from the spread between segments of frames (1/m)
    std_per_m: Bands,
    /// the paper's own number: −half the slope of log channel means against altitude (1/m)
    effective_by_channel_means_per_m: Bands,
    /// cells × frames used
    observations: usize,
    /// robust spread of the residuals (log light)
    residual: f64,
    /// path length beyond which cells were left out (m)
    farthest_m: f64,
}

/// One cell of one frame; in `rows` less the cell's mean over the frames.
struct Cell {
    frame: usize,
    /// ℓ (m)
    length_m: f64,
    /// log c without the known parts
    y: Bands,
}

/// The slope of Fig. 6 and Eq. 17 in sweeps.
///
/// # Errors
/// Several lamps, an altitude that hardly varies, or too few frames that share lit cells.
pub fn estimate(
    data: &Dataset<'_>,
    grid: BeamGrid,
    config: &EstimateConfig,
) -> Result<Candidate, NoAnswer> {
    one_lamp(data)?;
    let spread = data.altitude_spread();
    if data.frames.len() < MIN_FRAMES || !data.altitude_varies(config) {
        return Err(NoAnswer::AltitudeRange {
            altitude_ratio: spread,
            frames: data.frames.len(),
            needed_ratio: config.least_altitude_spread,
        });
    }
    let sweeps = Sweeps {
        data,
        grid,
        config,
        estimate: &|known| attenuation(data, known).ok_or(NoAnswer::FewSharedCells),
        attenuation_per_m: |answer| answer.attenuation_per_m,
    };
    let (_, answer, beam_pattern) = sweeps.run()?;
    let names =
        ["channel_means_red_per_m", "channel_means_green_per_m", "channel_means_blue_per_m"];
    let mut details = vec![("altitude_spread", spread), ("farthest_m", answer.farthest_m)];
    let by_means = answer.effective_by_channel_means_per_m;
    details.extend(names.into_iter().zip(by_means).take(data.bands()));
    let model = data.model_by(answer.attenuation_per_m, beam_pattern, config);
    let fit = (answer.observations, answer.residual);
    Ok(Candidate::new(model, answer.std_per_m, fit, &details))
}

/// Slope over the cells of all frames; `known` is log radiance without attenuation.
fn attenuation(data: &Dataset<'_>, known: &dyn Fn(&LightPath) -> f64) -> Option<AltitudeAnswer> {
    let (frames, bands) = (data.frames, data.bands());
    let cells = cells(data, known);
    let lengths: Vec<f64> = cells.values().flatten().map(|c| c.length_m).collect();
    let farthest_m = stats::quantile(&lengths, NEAR_SHARE);
    let mut answer = AltitudeAnswer { farthest_m, ..AltitudeAnswer::default() };
    answer.effective_by_channel_means_per_m = channel_means(frames, bands)?;
    let rows: Vec<Cell> = cells.values().flat_map(|cell| centred(cell, farthest_m)).collect();
    if rows.len() < 10 * MIN_FRAMES {
        return None;
    }
    let mut weights = vec![1.0; rows.len()];
    for _ in 0..ROUNDS {
        for b in 0..bands {
            answer.attenuation_per_m[b] = slope(rows.iter().zip(weights.iter().copied()), b)?;
        }
        let residual = |c: &Cell| {
            let of_band = |b: usize| (c.y[b] + answer.attenuation_per_m[b] * c.length_m).abs();
            (0..bands).map(of_band).sum::<f64>() / bands as f64
        };
        let residuals: Vec<f64> = rows.iter().map(residual).collect();
        answer.residual = stats::robust_std(&residuals);
        weights = residuals.iter().map(|e| stats::cauchy_weight(*e, answer.residual)).collect();
    }
    answer.observations = rows.len();
    // An error of a frame is common to all its cells: the spread comes from leaving out segments of
    // frames.
    let segments = SEGMENTS.min(frames.len());
    for b in 0..bands {
        let without = |s: usize| {
            let weighted = rows.iter().zip(weights.iter().copied());
            slope(weighted.filter(|(c, _)| c.frame * segments / frames.len() != s), b)
        };
        answer.std_per_m[b] = jackknife_std(&(0..segments).filter_map(without).collect::<Vec<_>>());
    }
    Some(answer)
}

/// Cells of all frames, by their index in the grid.
fn cells(data: &Dataset<'_>, known: &dyn Fn(&LightPath) -> f64) -> BTreeMap<u32, Vec<Cell>> {
    let bands = data.bands();
    let mut cells: BTreeMap<u32, Vec<Cell>> = BTreeMap::new();
    for (frame, samples) in data.frames.iter().enumerate() {
        for (index, sample) in &samples.grid {
            let Some(path) = sample.path(data.lamps) else { continue };
            let y = std::array::from_fn(|b| {
                if b < bands { f64::from(sample.log_color[b]) - known(&path) } else { 0.0 }
            });
            cells.entry(*index).or_default().push(Cell { frame, length_m: path.length_m(), y });
        }
    }
    cells
}

/// One cell's near views less their mean; none where there are too few.
fn centred(cell: &[Cell], farthest_m: f64) -> Vec<Cell> {
    let near: Vec<&Cell> = cell.iter().filter(|c| c.length_m <= farthest_m).collect();
    if near.len() < MIN_FRAMES {
        return Vec::new();
    }
    let n = near.len() as f64;
    let mean_length = near.iter().map(|c| c.length_m).sum::<f64>() / n;
    let mean_y: Bands = std::array::from_fn(|b| near.iter().map(|c| c.y[b]).sum::<f64>() / n);
    let centred = |c: &&Cell| Cell {
        frame: c.frame,
        length_m: c.length_m - mean_length,
        y: std::array::from_fn(|b| c.y[b] - mean_y[b]),
    };
    near.iter().map(centred).collect()
}

/// −slope of y over ℓ by weighted least squares.
fn slope<'c>(cells: impl Iterator<Item = (&'c Cell, f64)>, band: usize) -> Option<f64> {
    let (num, den) = cells.fold((0.0, 0.0), |(n, d), (c, w)| {
        (n + w * c.length_m * c.y[band], d + w * c.length_m * c.length_m)
    });
    (den > 1e-6).then_some(-num / den)
}

/// Standard deviation from estimates with one segment left out each.
fn jackknife_std(without: &[f64]) -> f64 {
    let n = without.len() as f64;
    let mean = without.iter().sum::<f64>() / n;
    ((n - 1.0) / n * without.iter().map(|v| (v - mean).powi(2)).sum::<f64>()).sqrt()
}

/// The paper's own reading of Fig. 6: α = −slope/2 of log channel means against altitude.
fn channel_means(frames: &[FrameSamples], bands: usize) -> Option<Bands> {
    let n = frames.len() as f64;
    let mean_altitude = frames.iter().map(|f| f.camera_altitude_m).sum::<f64>() / n;
    let spread: f64 = frames.iter().map(|f| (f.camera_altitude_m - mean_altitude).powi(2)).sum();
    let slope = |b: usize| {
        let of_frame = |f: &FrameSamples| {
            (f.camera_altitude_m - mean_altitude) * f.mean_light[b].max(1e-9).ln()
        };
        frames.iter().map(of_frame).sum::<f64>() / spread
    };
    (frames.len() >= MIN_FRAMES && spread > 1e-9)
        .then(|| std::array::from_fn(|b| if b < bands { -slope(b) / 2.0 } else { 0.0 }))
}
