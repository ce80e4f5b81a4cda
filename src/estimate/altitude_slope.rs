//! Attenuation from log colour against altitude (paper §IV-B, Fig. 6), for logs without overlap or
//! texture.
//!
//! The paper plots the log of each frame's mean against altitude and takes half the slope, as ℓ ≈
//! 2a; with the sign that is missing there, α = −slope/2. Here each cell of the picture is followed
//! over the dive on its own, against its own path length: what is the same in every frame (beam
//! pattern, lens, the mean seafloor) stays in the cell's own level, and no ℓ ≈ 2a is needed. Far
//! cells, where scattered light takes over and the line bends (Fig. 6's plateau), are left out by
//! path length.

use std::collections::BTreeMap;

use super::samples::FrameSamples;
use crate::geometry::LightPath;
use crate::image::Bands;
use crate::solver::Sample;
use crate::stats;

/// Cells seen in fewer frames have no slope.
const LEAST_FRAMES: usize = 5;

/// The answer of the slopes.
#[derive(Clone, Debug, Default)]
pub struct AltitudeAnswer {
    /// α [1/m] per band
    pub attenuation_per_m: Bands,
    /// from the spread between stretches of frames [1/m]
    pub std_per_m: Bands,
    /// the paper's own number: −half the slope of log channel means against altitude [1/m]
    pub effective_by_channel_means_per_m: Bands,
    /// cells × frames used
    pub observations: usize,
    /// robust spread of what is left over [log light]
    pub residual: f64,
    /// path length beyond which cells were left out [m]
    pub farthest_m: f64,
}

struct Cell {
    frame: usize,
    length_m: f64,
    y: [f64; 3],
}

/// Slope over the cells of all frames; `known` is everything of Eq. 15 but the water.
pub fn attenuation(
    frames: &[FrameSamples],
    bands: usize,
    path: &dyn Fn(&FrameSamples, &Sample) -> Option<LightPath>,
    known: &dyn Fn(&LightPath) -> f64,
) -> Option<AltitudeAnswer> {
    let mut cells: BTreeMap<u32, Vec<Cell>> = BTreeMap::new();
    for (frame, samples) in frames.iter().enumerate() {
        for (index, sample) in &samples.grid {
            let Some(path) = path(samples, sample) else { continue };
            let y = std::array::from_fn(|b| {
                if b < bands { f64::from(sample.log_color[b]) - known(&path) } else { 0.0 }
            });
            cells.entry(*index).or_default().push(Cell { frame, length_m: path.length_m(), y });
        }
    }
    let lengths: Vec<f64> = cells.values().flatten().map(|c| c.length_m).collect();
    let farthest_m = stats::quantile(&lengths, 0.6);
    let mut answer = AltitudeAnswer { farthest_m, ..AltitudeAnswer::default() };
    answer.effective_by_channel_means_per_m = channel_means(frames, bands)?;

    // (frame, ℓ − cell's mean, y − cell's mean)
    let mut rows: Vec<(usize, f64, [f64; 3])> = Vec::new();
    for cell in cells.values() {
        let near: Vec<&Cell> = cell.iter().filter(|c| c.length_m <= farthest_m).collect();
        if near.len() < LEAST_FRAMES {
            continue;
        }
        let n = near.len() as f64;
        let mean_length = near.iter().map(|c| c.length_m).sum::<f64>() / n;
        let mean_y: [f64; 3] =
            std::array::from_fn(|b| near.iter().map(|c| c.y[b]).sum::<f64>() / n);
        rows.extend(near.iter().map(|c| {
            (c.frame, c.length_m - mean_length, std::array::from_fn(|b| c.y[b] - mean_y[b]))
        }));
    }
    if rows.len() < 10 * LEAST_FRAMES {
        return None;
    }
    let slope = |rows: &mut dyn Iterator<Item = (&(usize, f64, [f64; 3]), f64)>, b: usize| {
        let (num, den) =
            rows.fold((0.0, 0.0), |(n, d), ((_, l, y), w)| (n + w * l * y[b], d + w * l * l));
        (den > 1e-6).then_some(-num / den)
    };
    let mut weights = vec![1.0; rows.len()];
    for _ in 0..8 {
        for b in 0..bands {
            answer.attenuation_per_m[b] = slope(&mut rows.iter().zip(weights.iter().copied()), b)?;
        }
        let misfits: Vec<f64> = rows
            .iter()
            .map(|(_, l, y)| {
                (0..bands).map(|b| (y[b] + answer.attenuation_per_m[b] * l).abs()).sum::<f64>()
                    / bands as f64
            })
            .collect();
        answer.residual = stats::robust_std(&misfits);
        weights = misfits.iter().map(|e| stats::cauchy_weight(*e, answer.residual)).collect();
    }
    answer.observations = rows.len();
    // What a frame gets wrong it gets wrong in all its cells: the spread comes from leaving out
    // stretches of frames.
    let stretches = 10.min(frames.len());
    for b in 0..bands {
        let without: Vec<f64> = (0..stretches)
            .filter_map(|s| {
                slope(
                    &mut rows
                        .iter()
                        .zip(weights.iter().copied())
                        .filter(|(r, _)| r.0 * stretches / frames.len() != s),
                    b,
                )
            })
            .collect();
        let n = without.len() as f64;
        let mean = without.iter().sum::<f64>() / n;
        answer.std_per_m[b] =
            ((n - 1.0) / n * without.iter().map(|v| (v - mean).powi(2)).sum::<f64>()).sqrt();
    }
    Some(answer)
}

/// The paper's own reading of Fig. 6: α = −slope/2 of log channel means against altitude.
fn channel_means(frames: &[FrameSamples], bands: usize) -> Option<Bands> {
    let n = frames.len() as f64;
    let mean_altitude = frames.iter().map(|f| f.camera_altitude_m).sum::<f64>() / n;
    let spread: f64 = frames.iter().map(|f| (f.camera_altitude_m - mean_altitude).powi(2)).sum();
    let slope = |b: usize| {
        frames
            .iter()
            .map(|f| (f.camera_altitude_m - mean_altitude) * f.mean_light[b].max(1e-9).ln())
            .sum::<f64>()
            / spread
    };
    (frames.len() >= LEAST_FRAMES && spread > 1e-9)
        .then(|| std::array::from_fn(|b| if b < bands { -slope(b) / 2.0 } else { 0.0 }))
}
