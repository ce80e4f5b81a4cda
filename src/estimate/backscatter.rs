//! Strength of backscatter (Eq. 5, 6), from its effect on contrast.
//!
//! Backscatter and attenuation are nearly degenerate for points of one reflectance: both change
//! light smoothly with altitude. But backscatter is added: in log light a dark pebble gains more
//! than bright sand beside it. Points of different reflectance, seen from several altitudes,
//! separate the two; the darkest are an upper bound.
//!
//! The strength b is a linearised unknown of the joint solve, S is tabulated again with the current
//! beam pattern and α, and the estimate is subtracted from the samples before the logarithm. In:
//! samples. Out: b, and samples without backscatter.

use std::cell::LazyCell;

use super::Dataset;
use super::angular_bins::completed;
use super::quality::cross_validation;
use super::samples::FrameSamples;
use crate::config::Switch;
use crate::image::Bands;
use crate::model::{
    Backscatter, BeamPattern, Frustum, ImagingModel, ScatterIntegral, ScatterSource, ScatterTable,
};
use crate::parallel::join;
use crate::solver::{
    Fit, JointAnswer, MIN_DIRECT_SHARE, Observation, Problem, Sample, Setup, Track, sample_path,
};
use crate::stats;

const STEPS: usize = 12;
const ROUNDS_PER_STEP: usize = 4;
/// Steps smaller than this share of b are not taken any more.
const SETTLED: f64 = 0.01;
/// The search ends after this many steps where there is not half the evidence required.
const FIRST_STEPS: usize = 2;
/// `auto` requires b of a band to exceed this many standard deviations …
const MIN_DEVIATIONS: f64 = 4.0;
/// … and held-out frames to be predicted better by this.
const MIN_IMPROVEMENT: f64 = 0.02;
/// Uniform backscatter is preferred where it predicts held-out frames better by this …
const BETTER_UNIFORM: f64 = 0.01;
/// … and at all by this: it has no spatial structure that could not arise by chance in few frames.
const MIN_UNIFORM_IMPROVEMENT: f64 = 0.05;

/// Backscatter of a log.
#[derive(Clone, Debug)]
pub struct BackscatterFit {
    /// the model's part
    pub backscatter: Backscatter,
    /// standard deviation of b_Λ (1/m)
    pub std_per_m: Bands,
    /// how much better held-out frames are predicted
    pub improvement: f64,
    /// median share of scattered light in what tracked points send, per band
    pub share: Bands,
    /// α with it modelled, roughly (1/m)
    pub attenuation_per_m: Bands,
    table: ScatterTable,
}

impl BackscatterFit {
    /// The same with the strength of the final solve.
    pub fn of_model(self, model: &ImagingModel) -> Self {
        Self { backscatter: model.backscatter.unwrap_or(self.backscatter), ..self }
    }

    /// S_Λ of a sample.
    pub fn scatter(&self, data: &Dataset<'_>, sample: &Sample) -> ScatterIntegral {
        let (x, y, s) = data.ray(sample);
        self.table.at(x, y, s)
    }

    /// Frames and tracks without backscatter.
    pub fn removed_from(&self, data: &Dataset<'_>) -> (Vec<FrameSamples>, Vec<Track>) {
        let bands = data.bands();
        let mut tracks = data.tracks.to_vec();
        for o in tracks.iter_mut().flatten() {
            let scattered = self.backscatter.light(&self.scatter(data, &o.sample));
            remove(&mut o.sample, bands, &scattered);
        }
        (
            remove_from_frames(data, |sample| self.backscatter.light(&self.scatter(data, sample))),
            tracks,
        )
    }
}

/// Frames whose grids are without scattered light; cells with little more than that are left out.
pub fn remove_from_frames(
    data: &Dataset<'_>,
    scattered: impl Fn(&Sample) -> Bands,
) -> Vec<FrameSamples> {
    let of_frame = |frame: &FrameSamples| {
        let clear = |(cell, sample): &(u32, Sample)| {
            let (scattered, mut sample) = (scattered(sample), *sample);
            let is_measured = (0..frame.bands).all(|b| {
                f64::from(sample.log_color[b]).exp() * (1.0 - MIN_DIRECT_SHARE) > scattered[b]
            });
            remove(&mut sample, frame.bands, &scattered);
            is_measured.then_some((*cell, sample))
        };
        frame.with_grid(frame.grid.iter().filter_map(clear).collect())
    };
    data.frames.iter().map(of_frame).collect()
}

fn remove(sample: &mut Sample, bands: usize, scattered: &Bands) {
    for b in 0..bands {
        let light = f64::from(sample.log_color[b]).exp();
        sample.log_color[b] = (light - scattered[b]).max(MIN_DIRECT_SHARE * light).ln() as f32;
    }
}

/// Whether b of a band exceeds this many standard deviations.
fn exceeds(answer: &JointAnswer, deviations: f64) -> bool {
    answer.backscatter.is_some_and(|(b, std)| {
        b.strength_per_m.iter().zip(std).any(|(b, std)| *b > deviations * std)
    })
}

/// Estimates b; `None` without evidence of backscatter. It is that of the strobe's light, unless
/// uniform backscatter predicts held-out frames better.
pub fn find(data: &Dataset<'_>, setup: &Setup<'_>) -> Option<BackscatterFit> {
    let plain = Setup { rounds: ROUNDS_PER_STEP, free_strobe: false, ..*setup };
    let mut problem = Problem::new(data.tracks, &plain, data.lamps, &sample_path)?;
    let solution = problem.solve(plain.rounds)?;
    let first = &problem.fit(&solution);
    let of = |source| move || find_of(data, &plain, first, source);
    let (strobe, uniform) = join(of(ScatterSource::Strobe), of(ScatterSource::Uniform));
    match (strobe, uniform) {
        (Some(strobe), Some(uniform)) => {
            let is_better = uniform.improvement > strobe.improvement + BETTER_UNIFORM;
            Some(if is_better { uniform } else { strobe })
        }
        (strobe, uniform) => strobe.or(uniform),
    }
}

/// Backscatter of one kind; `first` is the solve without it.
fn find_of(
    data: &Dataset<'_>,
    plain: &Setup<'_>,
    first: &Fit,
    source: ScatterSource,
) -> Option<BackscatterFit> {
    let mut fit = first.clone();
    let held_out_by = |setup: &Setup<'_>| {
        cross_validation::residuals(data.tracks, setup, data.lamps, &sample_path)
    };
    let without = LazyCell::new(|| held_out_by(plain));
    let rays = data.frames.iter().flat_map(|f| f.grid.iter().map(|(_, s)| data.ray(s)));
    let frustum = Frustum::around(rays);
    for step in 0..STEPS {
        let attenuation_per_m = fit.attenuation_per_m.map(|a| a.max(0.0));
        let before = Backscatter { source, attenuation_per_m, ..fit.backscatter };
        let of_strobe = || {
            let (mount, lamps) = (data.body_from_optical, &data.lamps);
            ScatterTable::of_strobe(&fit.beam, mount, lamps, &attenuation_per_m, frustum)
        };
        let table = match source {
            ScatterSource::Strobe => of_strobe(),
            ScatterSource::Uniform => ScatterTable::Uniform { attenuation_per_m },
        };
        let scatter = |o: &Observation| {
            let (x, y, s) = data.ray(&o.sample);
            table.at(x, y, s)
        };
        let with_scatter = Setup { scatter: Some((&before, &scatter)), ..*plain };
        let mut problem = Problem::new(data.tracks, &with_scatter, data.lamps, &sample_path)?;
        let solution = problem.solve(with_scatter.rounds)?;
        fit = problem.fit(&solution);
        let now = fit.backscatter;
        fit.beam = completed_beam(data, plain, &fit, &table);
        let predicted = || held_out_by(&Setup { scatter: Some((&now, &scatter)), ..*plain });
        if step + 1 == FIRST_STEPS && plain.config.backscatter != Switch::On {
            // Held-out frames come last: they cost a solve.
            let is_likely = exceeds(&problem.answer(&solution, &[])?, MIN_DEVIATIONS / 2.0)
                && cross_validation::improvement(without.as_ref()?, &predicted()?)
                    > MIN_IMPROVEMENT / 2.0;
            if !is_likely {
                return None;
            }
        }
        let is_settled = (0..plain.bands).all(|b| {
            let (now, before) = (now.strength_per_m[b], before.strength_per_m[b]);
            (now - before).abs() <= SETTLED * now
        });
        if is_settled || step + 1 == STEPS {
            let answer = problem.answer(&solution, &[])?;
            let improvement = cross_validation::improvement(without.as_ref()?, &predicted()?);
            return accepted(data, plain, &answer, improvement, table);
        }
    }
    None
}

/// The beam pattern as in the final model, so that the same directions count as seen.
fn completed_beam(
    data: &Dataset<'_>,
    setup: &Setup<'_>,
    fit: &Fit,
    table: &ScatterTable,
) -> BeamPattern {
    let frames = remove_from_frames(data, |sample| {
        let (x, y, s) = data.ray(sample);
        fit.backscatter.light(&table.at(x, y, s))
    });
    let data = Dataset { frames: &frames, ..*data };
    let beam = fit.beam.by_node();
    completed(&beam, &data, &fit.attenuation_per_m, setup.spreading, setup.config)
}

/// The fit, where the settings require it or the evidence suffices. With backscatter off it is
/// still reported.
fn accepted(
    data: &Dataset<'_>,
    setup: &Setup<'_>,
    answer: &JointAnswer,
    improvement: f64,
    table: ScatterTable,
) -> Option<BackscatterFit> {
    let (backscatter, std_per_m) = answer.backscatter?;
    let attenuation_per_m = answer.attenuation_per_m;
    let share = [0.0; 3];
    let mut fit =
        BackscatterFit { backscatter, std_per_m, improvement, share, attenuation_per_m, table };
    for b in 0..setup.bands {
        let share = |o: &Observation| {
            let scattered = backscatter.light(&fit.scatter(data, &o.sample))[b];
            scattered / f64::from(o.sample.log_color[b]).exp()
        };
        let shares: Vec<f64> = data.tracks.iter().flatten().map(share).collect();
        fit.share[b] = stats::median(&shares);
    }
    let is_there = match setup.config.backscatter {
        Switch::On => backscatter.strength_per_m.iter().any(|b| *b > 0.0),
        Switch::Auto | Switch::Off => {
            let least = match backscatter.source {
                ScatterSource::Strobe => MIN_IMPROVEMENT,
                ScatterSource::Uniform => MIN_UNIFORM_IMPROVEMENT,
            };
            exceeds(answer, MIN_DEVIATIONS) && improvement > least
        }
    };
    is_there.then_some(fit)
}
