//! Frames with another amount of light: a strobe at half power, a changed exposure that no channel
//! reports.
//!
//! A free gain per frame would leave the level of α undetermined, as gain and altitude are nearly
//! degenerate. So gains are estimated only to find frames that differ from their neighbours; those
//! are corrected, all others keep gain 1.
//!
//! ```text
//! e_o = log c − log radiance = ρ_t + g_f     tracks t, frames f; ρ eliminated, g held to 0 weakly
//! ```

use nalgebra::DVector;

use super::Dataset;
use super::samples::FrameSamples;
use crate::config::EstimateConfig;
use crate::image::Bands;
use crate::model::{BeamGrid, ImagingModel, Removal};
use crate::solver::terms::frame_gain::FrameGain;
use crate::solver::terms::{PriorEquations, TermList};
use crate::solver::{Equation, LinearSystem, Observation, Problem, Track, sample_path};
use crate::stats;

/// A frame differs where its log gain is off its neighbours' by this (log light), and by this many
/// spreads.
const STANDS_OUT: f64 = 0.15;
const SPREADS: f64 = 6.0;
/// Neighbours on either side that a frame is compared with.
const NEIGHBOURS: usize = 4;
/// Reweightings of the solve whose residuals the gains explain.
const ROUNDS: usize = 6;
/// Reweightings of the gains, the spread they begin with, and the least it becomes (log light).
const GAIN_ROUNDS: usize = 8;
const FIRST_SPREAD: f64 = 0.5;
const MIN_SPREAD: f64 = 0.02;
/// Weight that holds a gain to 0, in observations.
const HOLD_WEIGHT: f64 = 1.0;

/// Log gains of the frames with another amount of light than their neighbours; 0 for all others,
/// and for all where frames do not overlap.
pub fn uneven_light(data: &Dataset<'_>, config: &EstimateConfig) -> Vec<f64> {
    let model = || {
        let setup = data.setup(BeamGrid::new(config.beam_nodes, config.beam_limit_deg), config);
        let mut problem = Problem::new(data.tracks, &setup, data.lamps, &sample_path)?;
        let solution = problem.solve(ROUNDS)?;
        Some(problem.imaging_model(&solution))
    };
    let model = (data.tracks.len() >= config.least_pairs).then(model).flatten();
    model.map_or_else(|| vec![0.0; data.frames.len()], |model| frame_gains(data, &model))
}

/// Divides the samples by the frames' gains, so that all frames have the same light.
pub fn remove_gains(frames: &mut [FrameSamples], tracks: &mut [Track], log_gains: &[Bands]) {
    let divide = |color: &mut [f32; 3], gain: &Bands| {
        color.iter_mut().zip(gain).for_each(|(v, gain)| *v -= *gain as f32);
    };
    for (frame, gain) in frames.iter_mut().zip(log_gains).filter(|(_, g)| **g != [0.0; 3]) {
        let samples = frame.grid.iter_mut().chain(&mut frame.dark);
        samples.for_each(|(_, sample)| divide(&mut sample.log_color, gain));
        frame.mean_light.iter_mut().zip(gain).for_each(|(v, gain)| *v /= gain.exp());
    }
    for o in tracks.iter_mut().flatten() {
        divide(&mut o.sample.log_color, &log_gains[o.frame as usize]);
    }
}

/// Log gain of each frame: 0 but for those that stand out.
fn frame_gains(data: &Dataset<'_>, model: &ImagingModel) -> Vec<f64> {
    let frames = data.frames.len();
    let (equations, ends) = residual_equations(data, model);
    let term = FrameGain::common(frames, HOLD_WEIGHT);
    let list = TermList::of(&term);
    let mut prior = PriorEquations::none(frames);
    prior.add(&term, 0);
    let mut gains = DVector::<f64>::zeros(frames);
    let mut spread = FIRST_SPREAD;
    for _ in 0..GAIN_ROUNDS {
        let (mut weights, mut residuals) = (Vec::new(), Vec::new());
        let mut start = 0;
        for end in &ends {
            let beyond_gain = |e: &Equation| e.y[0] - gains[e.frame as usize];
            let of_track: Vec<f64> = equations[start..*end].iter().map(beyond_gain).collect();
            // Against the track's median: one frame in twenty stands out, not the others.
            let level = stats::median(&of_track);
            weights.extend(
                of_track.iter().map(|e| [stats::cauchy_weight(e - level, spread), 0.0, 0.0]),
            );
            residuals.extend(of_track.iter().map(|e| e - level));
            start = *end;
        }
        let system = LinearSystem {
            equations: &equations,
            ends: &ends,
            weights: &weights,
            bands: 1,
            terms: &list,
        };
        let (normal, right) = system.normal_equations(prior.clone());
        let Some(factor) = normal.cholesky() else { return vec![0.0; frames] };
        gains = factor.solve(&right);
        spread = stats::robust_std(&residuals).max(MIN_SPREAD);
    }
    outliers(gains.as_slice())
}

/// Mean residual over the bands of every observation of a model, and the end of each track.
fn residual_equations(data: &Dataset<'_>, model: &ImagingModel) -> (Vec<Equation>, Vec<usize>) {
    let of_observation = |o: &Observation| {
        let predicted = model.log_radiance(&data.path(o)?, Removal::FULL);
        let residual = |b: usize| f64::from(o.sample.log_color[b]) - predicted[b];
        let mean = (0..model.bands).map(residual).sum::<f64>() / model.bands as f64;
        Some(Equation::of_residual(o.frame, mean))
    };
    let (mut equations, mut ends) = (Vec::new(), Vec::new());
    for track in data.tracks {
        let of_track: Vec<Equation> = track.iter().filter_map(of_observation).collect();
        if of_track.len() >= 2 {
            equations.extend(of_track);
            ends.push(equations.len());
        }
    }
    (equations, ends)
}

/// Log gains over the neighbours' where they stand out, else 0.
fn outliers(gains: &[f64]) -> Vec<f64> {
    let relative = |f: usize| {
        let around = f.saturating_sub(NEIGHBOURS)..(f + NEIGHBOURS + 1).min(gains.len());
        let around: Vec<f64> = around.filter(|g| *g != f).map(|g| gains[g]).collect();
        gains[f] - stats::median(&around)
    };
    let relative: Vec<f64> = (0..gains.len()).map(relative).collect();
    let limit = STANDS_OUT.max(SPREADS * stats::robust_std(&relative));
    relative.into_iter().map(|g| if g.abs() > limit { g } else { 0.0 }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_frames_that_stand_out_get_a_gain() {
        let mut gains: Vec<f64> = (0..30).map(|i| 0.02 * f64::from(i % 3)).collect();
        gains[11] = -0.7;
        let found = outliers(&gains);
        assert!((found[11] + 0.72).abs() < 0.03, "{}", found[11]);
        assert_eq!(found.iter().filter(|g| **g != 0.0).count(), 1);
    }
}
