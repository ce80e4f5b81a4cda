//! How much the water scatters back (Eq. 5, 6), from what it does to contrast.
//!
//! Backscatter and attenuation are nearly degenerate where one grey level is followed over
//! altitude: both change it smoothly. But scattered light is *added*: a dark pebble gains more of
//! it than bright sand beside it, in log light. Points of many reflectances, seen from several
//! heights, so tell the two apart; the darkest of all bound it from above.
//!
//! The strength b joins the joint solve to first order, S is tabulated anew from the beam and α in
//! hand, and what is known is taken off the colours before the logarithm. In: samples. Out: b, and
//! colours freed of it.

use std::cell::LazyCell;

use super::candidates::completed;
use super::joint::{JointAnswer, LEAST_DIRECT_SHARE, Problem, Setting};
use super::samples::{FrameSamples, Sample};
use super::tracks::{Observation, Track};
use super::{Samples, held_out};
use crate::config::Switch;
use crate::image::Bands;
use crate::model::{Backscatter, Frustum, ScatterIntegral, ScatterTable};
use crate::stats;

const STEPS: usize = 12;
const ROUNDS_PER_STEP: usize = 4;
/// Steps smaller than this share of b are not taken any more.
const SETTLED: f64 = 0.01;
/// After so many steps it shows whether there is half the evidence that there must be; if not, the
/// rest is not gone into.
const FIRST_STEPS: usize = 2;
/// `auto` wants b to be surer than this many standard deviations in a band …
const SURE: f64 = 4.0;
/// … and held-out frames to be foretold better by this.
const LEAST_IMPROVEMENT: f64 = 0.02;

/// What was found.
#[derive(Clone, Debug)]
pub struct BackscatterFit {
    /// the model's part
    pub backscatter: Backscatter,
    /// standard deviation of b_Λ [1/m]
    pub std_per_m: Bands,
    /// how much better held-out frames are foretold
    pub improvement: f64,
    /// median share of scattered light in what tracked points send, per band
    pub share: Bands,
    /// α with it modelled, roughly [1/m]
    pub attenuation_per_m: Bands,
    table: ScatterTable,
}

impl BackscatterFit {
    /// S_Λ of a sample.
    pub fn glow(&self, samples: &Samples<'_>, sample: &Sample) -> ScatterIntegral {
        let (x, y, s) = samples.ray(sample);
        self.table.at(x, y, s)
    }

    /// Frames and tracks with what was scattered back taken off.
    pub fn taken_off(&self, samples: &Samples<'_>) -> (Vec<FrameSamples>, Vec<Track>) {
        let bands = samples.bands();
        let mut tracks = samples.tracks.to_vec();
        for o in tracks.iter_mut().flatten() {
            let veil = self.backscatter.light(&self.glow(samples, &o.sample));
            take_off(&mut o.sample, bands, &veil);
        }
        (off_frames(samples, |sample| self.backscatter.light(&self.glow(samples, sample))), tracks)
    }
}

/// Frames with a veil taken off their grids; cells that are hardly more than veil are left out.
pub fn off_frames(samples: &Samples<'_>, veil: impl Fn(&Sample) -> Bands) -> Vec<FrameSamples> {
    let of_frame = |frame: &FrameSamples| {
        let clear = |(cell, sample): &(u32, Sample)| {
            let (veil, mut sample) = (veil(sample), *sample);
            let is_measured = (0..frame.bands).all(|b| {
                f64::from(sample.log_color[b]).exp() * (1.0 - LEAST_DIRECT_SHARE) > veil[b]
            });
            take_off(&mut sample, frame.bands, &veil);
            is_measured.then_some((*cell, sample))
        };
        frame.with_grid(frame.grid.iter().filter_map(clear).collect())
    };
    samples.frames.iter().map(of_frame).collect()
}

fn take_off(sample: &mut Sample, bands: usize, veil: &Bands) {
    for b in 0..bands {
        let light = f64::from(sample.log_color[b]).exp();
        sample.log_color[b] = (light - veil[b]).max(LEAST_DIRECT_SHARE * light).ln() as f32;
    }
}

/// Whether b of a band is so many standard deviations above nothing.
fn surely(answer: &JointAnswer, sure: f64) -> bool {
    answer
        .backscatter
        .is_some_and(|(b, std)| b.strength_per_m.iter().zip(std).any(|(b, std)| *b > sure * std))
}

/// Finds b; `None` where the log shows none (or, for `auto`, no evidence of it).
pub fn find(samples: &Samples<'_>, setting: &Setting<'_>) -> Option<BackscatterFit> {
    let (mount, paths) = (samples.lamps, &|o: &Observation, mount| samples.path_from(o, mount));
    let plain = Setting { rounds: ROUNDS_PER_STEP, free_strobe: false, ..*setting };
    let mut problem = Problem::new(samples.tracks, &plain, mount, paths)?;
    let solution = problem.solve(plain.rounds)?;
    let mut said = problem.said(&solution);
    let without = LazyCell::new(|| held_out::misfits(samples.tracks, &plain, mount, paths));
    let frustum = Frustum::around(
        samples.frames.iter().flat_map(|f| f.grid.iter().map(|(_, s)| samples.ray(s))),
    );
    let mut now = Backscatter::NONE;
    let mut settled = None;
    for step in 0..STEPS {
        now.attenuation_per_m = said.attenuation_per_m.map(|a| a.max(0.0));
        let table = ScatterTable::new(
            &said.beam,
            samples.body_from_optical,
            &mount,
            &now.attenuation_per_m,
            frustum,
        );
        let glow = |o: &Observation| {
            let (x, y, s) = samples.ray(&o.sample);
            table.at(x, y, s)
        };
        let before = now;
        let with_glow = Setting { glow: Some((&before, &glow)), ..plain };
        let mut problem = Problem::new(samples.tracks, &with_glow, mount, paths)?;
        let solution = problem.solve(with_glow.rounds)?;
        said = problem.said(&solution);
        now = said.backscatter;
        // The pattern as the model will have it, so that what counts as seen is the same in both
        // passes.
        let frames = off_frames(samples, |sample| {
            let (x, y, s) = samples.ray(sample);
            now.light(&table.at(x, y, s))
        });
        said.beam = completed(
            &said.beam.by_node(),
            &Samples { frames: &frames, ..*samples },
            &said.attenuation_per_m,
            setting.spreading,
            setting.config,
        );
        let foretold = |now: &Backscatter| {
            held_out::misfits(
                samples.tracks,
                &Setting { glow: Some((now, &glow)), ..plain },
                mount,
                paths,
            )
        };
        if step + 1 == FIRST_STEPS && setting.config.backscatter != Switch::On {
            // Held-out frames are asked last: each time it is a solve.
            let is_sure = surely(&problem.answer(&solution)?, SURE / 2.0);
            if !is_sure
                || held_out::improvement(without.as_ref()?, &foretold(&now)?)
                    <= LEAST_IMPROVEMENT / 2.0
            {
                return None;
            }
        }
        let has_settled = (0..setting.bands).all(|b| {
            (now.strength_per_m[b] - before.strength_per_m[b]).abs()
                <= SETTLED * now.strength_per_m[b]
        });
        if has_settled || step + 1 == STEPS {
            let answer = problem.answer(&solution)?;
            settled = Some((answer, foretold(&now)?, table));
            break;
        }
    }
    let (answer, with, table) = settled?;
    let (backscatter, std_per_m) = answer.backscatter?;
    let is_sure = surely(&answer, SURE);
    let improvement = held_out::improvement(without.as_ref()?, &with);
    let attenuation_per_m = answer.attenuation_per_m;
    let mut found = BackscatterFit {
        backscatter,
        std_per_m,
        improvement,
        share: [0.0; 3],
        attenuation_per_m,
        table,
    };
    for b in 0..setting.bands {
        let share = |o: &Observation| {
            backscatter.light(&found.glow(samples, &o.sample))[b]
                / f64::from(o.sample.log_color[b]).exp()
        };
        found.share[b] =
            stats::median(&samples.tracks.iter().flatten().map(share).collect::<Vec<_>>());
    }
    let is_there = match setting.config.backscatter {
        Switch::On => backscatter.strength_per_m.iter().any(|b| *b > 0.0),
        // Where it is not to be modelled, it is still told that it is there.
        Switch::Auto | Switch::Off => is_sure && improvement > LEAST_IMPROVEMENT,
    };
    is_there.then_some(found)
}
