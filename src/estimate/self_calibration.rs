//! Which of the camera's own unknowns a log shows, and their values.
//!
//! Each hypothesis is one joint solve on part of the log, with gains per frame as random effects:
//! what a hypothesis does not explain shows in the residual within frames and in the variance of
//! the gains. Its cost is a description length per observation,
//!
//! ```text
//! J = ln residual + ln τ / 10
//! ```
//!
//! A term is added where it lowers the cost clearly, the best first. A camera without fault selects
//! none.

use super::Dataset;
use super::camera_fit::{
    CameraFit, CameraTermsFound, FIRST_GAIN_STD, common_gains, slope_of_gains,
};
use super::samples::FrameSamples;
use crate::config::EstimateConfig;
use crate::image::Bands;
use crate::image::response::TransferKnown;
use crate::image::transfer::Transfer;
use crate::model::{BeamGrid, Metered};
use crate::parallel::par_map;
use crate::solver::camera::{CameraUnknowns, FrameGains, ImageRadius, ReadingCurve, SPLINES};
use crate::solver::terms::attenuation::TimeGrid;
use crate::solver::{
    CameraSolution, Observation, PathFor, Problem, Setup, Track, sample_path, thinned,
};
use crate::stats;

/// Frames and observations that decide between hypotheses.
const TRIAL_FRAMES: usize = 72;
const TRIAL_OBSERVATIONS: usize = 8_000;
/// Consecutive frames that stay together.
const BLOCK: usize = 12;
/// Reweightings of a trial.
const TRIAL_ROUNDS: usize = 6;
/// Observations of the solve that determines the values.
const MAX_OBSERVATIONS: usize = 24_000;
/// Weight of the gains' variance in the cost.
const GAIN_WEIGHT: f64 = 0.1;
/// What is not modelled shows in the gains: clean dives have less than this (log light).
const QUIET_GAIN_STD: [f64; 2] = [0.006, 0.003];
/// Gains less uneven than this are errors of planes and attitudes (log light).
const MIN_GAIN_STD: f64 = 0.03;
/// κ and κ' of a law, at least one of them (finding: .003 to .006 without a law).
const MIN_LAW: f64 = 0.2;
const MAX_LAW: f64 = 20.0;
/// A law halves the variance of the gains.
const LAW_LEAVES: f64 = 0.5;

/// Log light in the corner, at most, where there is vignetting.
const MAX_CORNER: f64 = -0.05;
/// A free curve costs this much more than a named one.
const NAMED_FIRST: f64 = 0.2;

/// One hypothesis about the camera.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Hypothesis {
    terms: CameraTermsFound,
    transfer: Option<Transfer>,
}

/// A hypothesis and its solve.
struct Trial {
    hypothesis: Hypothesis,
    solution: CameraSolution,
    residual: f64,
}

impl Trial {
    /// Whether the gains show no sign of anything that is not modelled.
    fn is_quiet(&self) -> bool {
        self.solution.gain_std.iter().zip(QUIET_GAIN_STD).all(|(std, most)| *std < most)
    }

    /// Whether its transfer curve is free.
    fn is_fitted(&self) -> bool {
        self.hypothesis.terms.response
    }

    fn cost(&self) -> f64 {
        self.residual.ln() + GAIN_WEIGHT * self.solution.gain_std[0].ln()
    }
}

/// What is known of a camera beforehand.
#[derive(Clone, Copy, Debug, Default)]
pub struct CameraKnown {
    /// its transfer curve
    pub transfer: TransferKnown,
    /// its flat field
    pub flat_field: bool,
    /// its black level
    pub black_level: bool,
}

/// The problem that hypotheses are tried on.
struct Trials<'s> {
    data: Dataset<'s>,
    tracks: Vec<Track>,
    metered: Vec<Metered>,
    log_level: Bands,
    radius: ImageRadius,
    segments: Option<TimeGrid>,
    paths: &'s PathFor<'s>,
    config: &'s EstimateConfig,
}

/// The cost of samples as they are, and of what the camera adds to the model, if anything.
pub struct Calibration {
    /// J with gains of frames and nothing else of the camera
    pub cost_without: f64,
    /// whether the gains show no sign of anything that is not modelled
    pub is_quiet: bool,
    /// J with what was found
    pub cost: f64,
    /// what was found; `None`: nothing
    pub camera: Option<CameraFit>,
}

/// What a log shows of the camera; `None` where it determines no solve.
pub fn calibrate(
    data: &Dataset<'_>,
    known: CameraKnown,
    config: &EstimateConfig,
) -> Option<Calibration> {
    let radius = image_radius(data)?;
    let (frames, tracks, segments) = part_of(data);
    let part = Dataset { frames: &frames, tracks: &tracks, drift: None, ..*data };
    let trials = Trials {
        segments,
        ..Trials::new(part, (TRIAL_OBSERVATIONS, radius), &sample_path, config)
    };
    let response = known.transfer == TransferKnown::Fitted;
    let terms = CameraTermsFound { response, ..CameraTermsFound::default() };
    let none = Hypothesis { terms, transfer: None };
    let first = trials.run(none, TRIAL_ROUNDS)?;
    let (cost_without, first_residual) = (first.cost(), first.residual);
    let is_quiet = first.is_quiet();
    let nothing = Some(Calibration { cost_without, is_quiet, cost: cost_without, camera: None });
    if is_quiet && !response {
        return nothing;
    }
    let mut best = first;
    loop {
        let next = additions(&best.hypothesis, known);
        let tried = par_map(next, |h| trials.run(h, TRIAL_ROUNDS));
        let better = tried.into_iter().flatten().filter(|trial| is_evident(&best, trial));
        // A named curve before one with many unknowns.
        let cost = |t: &Trial| t.cost() + if t.is_fitted() { NAMED_FIRST } else { 0.0 };
        let Some(found) = better.min_by(|a, b| cost(a).total_cmp(&cost(b))) else { break };
        best = found;
    }
    let mut hypothesis = best.hypothesis;
    hypothesis.terms.gains =
        hypothesis.terms.law || are_uneven(&frames, &best.solution, data.bands());
    if hypothesis == (Hypothesis { terms: CameraTermsFound::default(), transfer: None }) {
        return nothing;
    }
    let whole = Trials {
        segments: data.drift.map(|drift| drift.grid.clone()),
        ..Trials::new(*data, (MAX_OBSERVATIONS, radius), &sample_path, config)
    };
    let last = whole.determine(hypothesis, &best)?;
    let law = (whole.metered.as_slice(), whole.log_level);
    let mut fit =
        CameraFit::new(&last.solution, hypothesis.terms, law, (radius, data.lamps), data.bands());
    fit.residual = [first_residual, best.residual];
    Some(Calibration { cost_without, is_quiet, cost: best.cost(), camera: Some(fit) })
}

/// Whether gains of frames are the camera's or the strobe's. Errors of planes dilute the
/// attenuation within frames, so that gains have to make up for the difference between them: they
/// fall with altitude, as no camera makes them, and drift rather than jump.
fn are_uneven(frames: &[FrameSamples], solution: &CameraSolution, bands: usize) -> bool {
    let [is_common, is_own] = solution.gain_std.map(|std| std > MIN_GAIN_STD);
    let gains: Vec<f64> = common_gains(&solution.log_gains, bands).collect();
    let jumps: Vec<f64> = gains.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let drift = stats::robust_std(&jumps) < MIN_GAIN_STD * 2f64.sqrt();
    let slope = slope_of_gains(frames, &solution.log_gains, bands);
    is_own || (is_common && !(drift && slope.is_some_and(|slope| slope < 0.0)))
}

/// Hypotheses with one more term.
fn additions(from: &Hypothesis, known: CameraKnown) -> Vec<Hypothesis> {
    let terms = from.terms;
    let with = |terms| Hypothesis { terms, ..*from };
    let mut next = Vec::new();
    if known.transfer == TransferKnown::Assumed && !terms.response {
        if from.transfer.is_none() {
            for transfer in [Transfer::Linear, Transfer::Gamma(2.2)] {
                next.push(Hypothesis { transfer: Some(transfer), ..*from });
            }
        }
        next.push(with(CameraTermsFound { response: true, ..terms }));
    }
    if !known.flat_field && !terms.vignetting {
        next.push(with(CameraTermsFound { vignetting: true, ..terms }));
    }
    let is_linear = known.transfer == TransferKnown::Surely;
    if is_linear && !known.black_level && !terms.black_level {
        next.push(with(CameraTermsFound { black_level: true, ..terms }));
    }
    if !terms.law {
        next.push(with(CameraTermsFound { law: true, ..terms }));
    }
    next
}

/// Least decrease of the cost for a term.
fn least_decrease(before: &Hypothesis, after: &Hypothesis) -> f64 {
    if before.transfer != after.transfer {
        0.1
    } else if before.terms.response != after.terms.response {
        // On top of a named curve a free one must explain more.
        if before.transfer.is_some() { 0.2 } else { 0.1 }
    } else if before.terms.black_level != after.terms.black_level {
        0.02
    } else {
        0.04
    }
}

/// Whether a trial is clearly better than the one before.
fn is_evident(before: &Trial, after: &Trial) -> bool {
    let decrease = before.cost() - after.cost();
    if after.hypothesis.terms.law && !before.hypothesis.terms.law {
        let is_law = |k: usize| {
            let kappa = -after.solution.law[k];
            (MIN_LAW..MAX_LAW).contains(&kappa)
                && after.solution.gain_std[k] < LAW_LEAVES * before.solution.gain_std[k]
        };
        return is_law(0) || is_law(1);
    }
    // A lens shades the corners; the opposite is an error of the planes.
    let corner: f64 = after.solution.vignetting.iter().sum();
    let is_vignetting = !after.hypothesis.terms.vignetting || corner < MAX_CORNER;
    is_vignetting && decrease > least_decrease(&before.hypothesis, &after.hypothesis)
}

impl<'s> Trials<'s> {
    fn new(
        data: Dataset<'s>,
        (observations, radius): (usize, ImageRadius),
        paths: &'s PathFor<'s>,
        config: &'s EstimateConfig,
    ) -> Self {
        let tracks = thinned(data.tracks, observations);
        let (metered, log_level) = metered(&data);
        Self { data, tracks, metered, log_level, radius, segments: None, paths, config }
    }

    fn setup(&self) -> Setup<'_> {
        let grid = BeamGrid::new(self.config.beam_nodes, self.config.beam_limit_deg);
        self.data.setup(grid, self.config)
    }

    /// The solve of a hypothesis, gains by evidence.
    fn run(&self, hypothesis: Hypothesis, rounds: usize) -> Option<Trial> {
        let mut curve = ReadingCurve::new([0.0; 3], hypothesis.transfer, [0.0; SPLINES]);
        if hypothesis.terms.response {
            // Free gains would take part of the curve.
            let held = self.solve(hypothesis, &curve, None, rounds)?;
            curve = held.solution.curve;
        }
        self.solve(hypothesis, &curve, Some(FIRST_GAIN_STD), rounds)
    }

    fn solve(
        &self,
        hypothesis: Hypothesis,
        start: &ReadingCurve,
        gain_std: Option<[f64; 2]>,
        rounds: usize,
    ) -> Option<Trial> {
        let terms = hypothesis.terms;
        let means = vec![[0.0; 3]; self.data.frames.len()];
        let gains = |std| FrameGains { means: &means, std, is_estimated: true };
        let camera = CameraUnknowns {
            gains: gain_std.map(gains),
            law: terms.law.then_some(self.metered.as_slice()),
            vignetting: terms.vignetting,
            response: terms.response,
            black_level: terms.black_level,
            start,
            radius: self.radius,
        };
        let segments = self.segments.as_ref();
        let setup = Setup { camera: Some(camera), segments, ..self.setup() };
        let mut problem = Problem::new(&self.tracks, &setup, self.data.lamps, self.paths)?;
        let solution = problem.solve(rounds)?;
        let (residual, solution) = (solution.residual, problem.camera(&solution));
        Some(Trial { hypothesis, solution, residual })
    }

    /// The values for all frames, from the curve that a trial found.
    fn determine(&self, hypothesis: Hypothesis, trial: &Trial) -> Option<Trial> {
        let gain_std = hypothesis.terms.gains.then_some(trial.solution.gain_std);
        self.solve(hypothesis, &trial.solution.curve, gain_std, self.config.rounds)
    }
}

/// What a camera may set its gain by of each frame, and the log of the log's mean reading.
fn metered(data: &Dataset<'_>) -> (Vec<Metered>, Bands) {
    let (frames, bands) = (data.frames, data.bands());
    let mean = |b: usize| {
        let logs = frames.iter().map(|f| f.mean_reading[b].max(1e-6).ln());
        logs.sum::<f64>() / frames.len().max(1) as f64
    };
    let log_level: Bands = std::array::from_fn(|b| if b < bands { mean(b) } else { 0.0 });
    let of = |f: &FrameSamples| Metered::of(&f.mean_reading, &log_level[..bands]);
    (frames.iter().map(of).collect(), log_level)
}

/// The camera's law as its only unknown, for a solve that is about something else.
pub fn with_law<R>(data: &Dataset<'_>, solve: impl FnOnce(CameraUnknowns<'_>) -> R) -> Option<R> {
    let (metered, _) = metered(data);
    Some(solve(CameraUnknowns {
        gains: None,
        law: Some(&metered),
        vignetting: false,
        response: false,
        black_level: false,
        start: &ReadingCurve::default(),
        radius: image_radius(data)?,
    }))
}

/// ϱ of this log's images: the grids of the frames reach nearly into the corners.
fn image_radius(data: &Dataset<'_>) -> Option<ImageRadius> {
    let unit = ImageRadius { body_from_optical: data.body_from_optical, corner_squared: 1.0 };
    let samples = data.frames.iter().flat_map(|f| f.grid.iter().map(|(_, s)| s));
    let corner_squared = samples.map(|s| unit.squared(s)).fold(0.0, f64::max);
    (corner_squared > 0.0).then_some(ImageRadius { corner_squared, ..unit })
}

/// The cost of samples with light paths of their own (another clock, another mount), with gains of
/// frames and nothing else of the camera.
pub fn cost_with(data: &Dataset<'_>, paths: &PathFor<'_>, config: &EstimateConfig) -> Option<f64> {
    let trials = Trials::new(*data, (TRIAL_OBSERVATIONS, image_radius(data)?), paths, config);
    let none = Hypothesis { terms: CameraTermsFound::default(), transfer: None };
    Some(trials.run(none, TRIAL_ROUNDS)?.cost())
}

/// Blocks of frames all over the log, the tracks among them, and the nodes of α in time.
fn part_of(data: &Dataset<'_>) -> (Vec<FrameSamples>, Vec<Track>, Option<TimeGrid>) {
    let count = data.frames.len();
    let every = count.div_ceil(TRIAL_FRAMES).max(1);
    let kept: Vec<usize> = (0..count).filter(|f| (f / BLOCK).is_multiple_of(every)).collect();
    let mut numbers = vec![None; count];
    kept.iter().zip(0..).for_each(|(old, new)| numbers[*old] = Some(new));
    let frames = kept.iter().map(|f| data.frames[*f].with_grid(Vec::new())).collect();
    let of_track = |track: &Track| {
        let renumbered =
            |o: &Observation| Some(Observation { frame: numbers[o.frame as usize]?, ..*o });
        let kept: Track = track.iter().filter_map(renumbered).collect();
        (kept.len() > 1).then_some(kept)
    };
    let segments = data.drift.map(|drift| TimeGrid {
        frames: kept.iter().map(|f| drift.grid.frames[*f]).collect(),
        ..drift.grid.clone()
    });
    (frames, data.tracks.iter().filter_map(of_track).collect(), segments)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gains_that_drift_and_fall_with_altitude_are_errors_of_planes() {
        let altitude_m = |f: usize| 2.2 + 0.6 * (0.3 * f as f64).sin();
        let frames: Vec<_> =
            (0..40).map(|f| FrameSamples::of_level_seafloor(f, altitude_m(f))).collect();
        let are_uneven = |slope_per_m: f64, drift: f64, flicker: f64| {
            let gain = |f: usize| {
                let slow = drift * (0.1 * f as f64).sin();
                slope_per_m * 2.0 * altitude_m(f) + slow + flicker * (7.0 * (f * f) as f64).sin()
            };
            let log_gains = (0..40).map(|f| [gain(f); 3]).collect();
            let solution =
                CameraSolution { log_gains, gain_std: [0.07, 0.001], ..CameraSolution::default() };
            are_uneven(&frames, &solution, 3)
        };
        assert!(!are_uneven(-0.08, 0.0, 0.02) && !are_uneven(-0.08, 0.05, 0.0));
        // Auto-exposure brightens what is far; a strobe does not know the altitude.
        assert!(are_uneven(0.08, 0.0, 0.02) && are_uneven(0.0, 0.0, 0.1));
        assert!(are_uneven(0.0, 0.1, 0.0) && are_uneven(-0.08, 0.0, 0.1));
    }
}
