//! Frames that got another amount of light: a strobe at half power, a changed exposure that no
//! channel tells of.
//!
//! A free gain per frame would take the level of α with it, as gain and altitude are nearly
//! degenerate. So gains are sought only to find the frames that stand out from their neighbours;
//! those are set right, all others keep gain 1.
//!
//! ```text
//! e_o = log c − log light = ρ_t + g_f        least squares over tracks t and frames f, ρ eliminated, g held to 0 weakly
//! ```

use nalgebra::{DMatrix, DVector};

use super::Samples;
use super::joint::Problem;
use super::samples::FrameSamples;
use super::tracks::Track;
use crate::config::EstimateConfig;
use crate::model::{BeamGrid, ImagingModel, SpreadingModel};
use crate::stats;

/// A frame stands out where its log gain differs from its neighbours' by this [log light], and by
/// so many spreads.
const STANDS_OUT: f64 = 0.15;
const SPREADS: f64 = 6.0;
/// Neighbours on either side that a frame is compared with.
const NEIGHBOURS: usize = 4;
/// Reweightings of the solve that gains are seen against.
const ROUNDS: usize = 6;
/// Weight that holds a gain to 0, in observations.
const HOLD: f64 = 1.0;

/// Log gains of the frames that got another amount of light than their neighbours; 0 for all
/// others.
///
/// Where frames do not overlap there is no telling, and all are 0.
pub fn uneven_light(samples: &Samples<'_>, config: &EstimateConfig) -> Vec<f64> {
    let model = || {
        let spreading = SpreadingModel::of(config.spreading);
        let setting =
            samples.setting(BeamGrid::new(config.beam_nodes, config.beam_limit_deg), config);
        let mut problem = Problem::new(samples.tracks, &setting, samples.lamps, &|o, mount| {
            samples.path_from(o, mount)
        })?;
        let solution = problem.solve(ROUNDS)?;
        let said = problem.said(&solution);
        Some(samples.model(said.attenuation_per_m, spreading, said.beam, config))
    };
    let enough = samples.tracks.len() >= config.least_pairs;
    enough
        .then(model)
        .flatten()
        .map_or_else(|| vec![0.0; samples.frames.len()], |model| frame_gains(samples, &model))
}

/// Takes gains out of the samples, so that all frames are lit alike.
pub fn set_right(frames: &mut [FrameSamples], tracks: &mut [Track], log_gains: &[f64]) {
    for (frame, gain) in frames.iter_mut().zip(log_gains).filter(|(_, g)| **g != 0.0) {
        frame
            .grid
            .iter_mut()
            .for_each(|(_, sample)| sample.log_color.iter_mut().for_each(|v| *v -= *gain as f32));
        frame.mean_light.iter_mut().for_each(|v| *v /= gain.exp());
    }
    for o in tracks.iter_mut().flatten() {
        let gain = log_gains[o.frame as usize] as f32;
        o.sample.log_color.iter_mut().for_each(|v| *v -= gain);
    }
}

/// Log gain of each frame: 0 but for those that stand out.
fn frame_gains(samples: &Samples<'_>, model: &ImagingModel) -> Vec<f64> {
    let frames = samples.frames.len();
    // (frame, mean misfit over the bands) per view of each track
    let tracks: Vec<Vec<(usize, f64)>> = samples
        .tracks
        .iter()
        .map(|track| {
            let view = |o: &super::Observation| {
                let path = samples.path(o)?;
                let misfit = (0..model.bands)
                    .map(|b| f64::from(o.sample.log_color[b]) - model.log_light(&path, b))
                    .sum::<f64>();
                Some((o.frame as usize, misfit / model.bands as f64))
            };
            track.iter().filter_map(view).collect()
        })
        .collect();
    let mut gains = DVector::<f64>::zeros(frames);
    let mut scale = 0.5;
    for _ in 0..8 {
        let mut normal = DMatrix::<f64>::from_diagonal_element(frames, frames, HOLD);
        let mut right = DVector::<f64>::zeros(frames);
        let mut misfits = Vec::new();
        for track in tracks.iter().filter(|t| t.len() >= 2) {
            // Against the track's median: one frame in twenty stands out, not the others.
            let level =
                stats::median(&track.iter().map(|(f, e)| e - gains[*f]).collect::<Vec<_>>());
            let weights: Vec<f64> =
                track.iter().map(|(f, e)| stats::cauchy(e - gains[*f] - level, scale)).collect();
            misfits.extend(track.iter().map(|(f, e)| e - gains[*f] - level));
            let total: f64 = weights.iter().sum();
            let mean = track.iter().zip(&weights).map(|((_, e), w)| w * e).sum::<f64>() / total;
            for ((f, e), w) in track.iter().zip(&weights) {
                right[*f] += w * (e - mean);
                normal[(*f, *f)] += w;
                for ((g, _), v) in track.iter().zip(&weights) {
                    normal[(*f, *g)] -= w * v / total;
                }
            }
        }
        let Some(factor) = normal.cholesky() else { return vec![0.0; frames] };
        gains = factor.solve(&right);
        scale = stats::scale(&misfits).max(0.02);
    }
    let relative: Vec<f64> = (0..frames)
        .map(|f| {
            let around: Vec<f64> = (f.saturating_sub(NEIGHBOURS)..(f + NEIGHBOURS + 1).min(frames))
                .filter(|g| *g != f)
                .map(|g| gains[g])
                .collect();
            gains[f] - stats::median(&around)
        })
        .collect();
    let spread = stats::scale(&relative);
    let limit = STANDS_OUT.max(SPREADS * spread);
    relative.into_iter().map(|g| if g.abs() > limit { g } else { 0.0 }).collect()
}
