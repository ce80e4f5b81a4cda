//! One strobe, many waters: a model whose beam pattern, strobe position, transfer curve and
//! vignetting are those of an earlier model. Attenuation is all that is left to estimate:
//!
//! ```text
//! y = log c − log BP − spreading − log cos γ = log r − α ℓ
//! ```
//!
//! The reflectance r of a seafloor point is the same in every frame that sees it, so that α is the
//! slope of y over the path length ℓ within the points, by robust least squares. Its standard
//! deviation is that of the answers without one window of frames each.

use std::collections::BTreeMap;

use super::camera_joint::fit_model_and_joint;
use super::fit::{Fit, collect};
use super::model_of::{exposure, strobe_of};
use super::pooled::Pooled;
use crate::config::Estimator;
use crate::diagnostics::{Diagnostic, EstimateFact, NoAnswer, NotIdentified};
use crate::error::{Error, Result};
use crate::estimate::{FrameSamples, Observation, Track, samples_for_model};
use crate::image::Bands;
use crate::model::{
    CameraFile, EstimatorAnswer, GeometryFile, ImagingModel, InputFile, ModelFile, Removal,
    RenderingFile,
};
use crate::parallel::Threads;
use crate::recording::FrameId;
use crate::session::{CameraSession, FrameGains, Options, Progress};
use crate::stats;
use crate::vehicle::Lamps;

/// Reweightings.
const ROUNDS: usize = 10;
/// Windows of frames for the standard deviation.
const WINDOWS: usize = 12;
/// Residual of this dive over that of the model's own, from which on the beam pattern does not fit.
const MAX_RESIDUAL: f64 = 2.0;
/// A larger standard deviation identifies nothing (1/m).
const MAX_STD_PER_M: f64 = 0.05;

/// Estimates a model: all of it, or attenuation alone where the options give a model for the rest.
///
/// # Errors
/// A log cannot be read, or attenuation cannot be estimated.
pub fn fit_log(
    logs: &[&CameraSession],
    options: &Options,
    threads: &Threads,
    progress: &dyn Progress,
) -> Result<Fit> {
    let Some(shared) = options.beam_from.as_deref() else {
        return fit_model_and_joint(logs, options, threads, progress);
    };
    ensure_usable(shared)?;
    let sessions =
        logs.iter().map(|log| with_strobe(log, shared)).collect::<Result<Vec<CameraSession>>>()?;
    let (config, borrowed) = (&options.config, sessions.iter().collect::<Vec<_>>());
    let max_frames = config.estimate.max_frames;
    let (of_logs, means, _) = collect(&borrowed, config, max_frames, (threads, progress))?;
    let model = threads.install(|| of_samples(&sessions, Pooled::new(of_logs)?, shared, options));
    Ok(Fit { model: model?, means, samples: Vec::new() })
}

/// What a model must be so that attenuation alone is left.
fn ensure_usable(shared: &ModelFile) -> Result<()> {
    let refused = |reason: &str| Err(Error::Usage(format!("--beam-from: {reason}")));
    let has_gains = |c: &CameraFile| c.gains.is_some() || c.gain_law.is_some();
    if shared.empirical.is_some() {
        return refused("an empirical model has no beam pattern; give a physical one");
    }
    if shared.residual_light.is_some() {
        return refused("its beam pattern does not explain the light of its own dive");
    }
    if shared.daylight.is_some() {
        return refused(
            "in the dive of the model daylight lit the seafloor; how much there is here, a beam \
             pattern does not say: estimate all, without it",
        );
    }
    if shared.camera.as_ref().is_some_and(has_gains) {
        return refused(
            "in the dive of the model the camera set its own exposure or white balance; where it \
             does, a beam pattern alone does not determine attenuation: estimate all, without it",
        );
    }
    Ok(())
}

/// The session with strobe, transfer curve, vignetting and mount of the earlier model.
fn with_strobe(log: &CameraSession, shared: &ModelFile) -> Result<CameraSession> {
    let mut session = log.clone();
    let survey = &mut session.survey;
    survey.rig.strobe = strobe_of(shared, &survey.rig);
    let chosen = session.config.light.white_level;
    survey.white_level = chosen.or(shared.rendering.white_level).or(survey.white_level);
    if let Some(camera) = &shared.camera {
        survey.take_camera(camera)?;
    }
    if let Some(mut geometry) = shared.geometry.clone() {
        // A clock is that of a recording.
        geometry.clock_offset_s = None;
        survey.take_geometry(&geometry, &session.config.seafloor);
    }
    Ok(session)
}

fn of_samples(
    sessions: &[CameraSession],
    pooled: Pooled,
    shared: &ModelFile,
    options: &Options,
) -> Result<ModelFile> {
    let Pooled { first, frames, tracks, inputs, origins, diagnostics, .. } = pooled;
    let mounts = &first.extrinsics;
    let lamps = mounts.strobe.lamps;
    let log_gains = log_gains(sessions, shared, &frames, &origins)?;
    let mut model = shared.imaging_model().map_err(Error::Usage)?;
    (model.over_time, model.backscatter, model.daylight) = (Default::default(), None, None);
    let slope = Slope { tracks: &tracks, frames: &frames, log_gains: &log_gains, lamps };
    let needed = options.config.estimate.least_pairs;
    let Some(found) = slope.solve(&mut model).filter(|_| tracks.len() >= needed) else {
        let reason = NoAnswer::FewTracks { tracks: tracks.len(), needed }.to_string();
        let remedy = "use the whole model of a dive in the same water: --model MODEL.json";
        return Err(Error::NotEstimated { reason, remedy: remedy.into() });
    };
    let frames = samples_for_model(frames, &log_gains, mounts.body_from_optical, lamps, None);
    let rendering = exposure(&frames, &model, lamps, first.white_level, &options.config);
    let mut file = file_of(shared, (&model, found), rendering, inputs, first.not_identified);
    file.diagnostics.extend(diagnostics);
    Ok(file)
}

/// The earlier model with another attenuation, without what is of its own dive.
fn file_of(
    shared: &ModelFile,
    (model, found): (&ImagingModel, Found),
    rendering: RenderingFile,
    inputs: Vec<InputFile>,
    slope: Option<NotIdentified>,
) -> ModelFile {
    let of_bands = |values: &Bands| values[..model.bands].to_vec();
    let attenuation_per_m = of_bands(&model.attenuation_per_m);
    let std_per_m = of_bands(&found.std_per_m);
    let answer = EstimatorAnswer {
        attenuation_per_m: Some(attenuation_per_m.clone()),
        attenuation_std_per_m: Some(std_per_m.clone()),
        observations: found.observations,
        residual: Some(found.residual),
        ..EstimatorAnswer::default()
    };
    let mount = |g: &GeometryFile| GeometryFile { clock_offset_s: None, ..g.clone() };
    let geometry = shared.geometry.as_ref().map(mount);
    let file = ModelFile {
        attenuation_per_m,
        attenuation_std_per_m: std_per_m.iter().copied().map(Some).collect(),
        estimator: Estimator::Pairs,
        estimators: [(Estimator::Pairs, answer)].into(),
        geometry: geometry.filter(|g| *g != GeometryFile::default()),
        mount_check: None,
        backscatter: None,
        daylight: None,
        tilts: None,
        verdict: None,
        frame_gains: Vec::new(),
        segments: Default::default(),
        rendering,
        inputs,
        ..shared.clone()
    };
    let (diagnostics, not_identified) = judged(shared, &file.attenuation_per_m, &found);
    file.with_diagnostics(diagnostics, not_identified.or(slope))
}

/// What the attenuation rests on, and whether it is identified.
fn judged(
    shared: &ModelFile,
    attenuation_per_m: &[f64],
    found: &Found,
) -> (Vec<Diagnostic>, Option<NotIdentified>) {
    let logs: Vec<&str> = shared.inputs.iter().map(|input| input.name.as_str()).collect();
    let mut diagnostics: Vec<Diagnostic> =
        vec![EstimateFact::BeamFrom { logs: logs.join(", ") }.into()];
    if shared.backscatter.is_some() {
        diagnostics.push(EstimateFact::BackscatterOfOtherWater.into());
    }
    let worst = found.std_per_m[..attenuation_per_m.len()].iter().copied().fold(0.0, f64::max);
    let lowest = attenuation_per_m.iter().copied().fold(f64::INFINITY, f64::min);
    // What the beam pattern does not explain here shows in the residual.
    let usual = shared.estimators.get(&shared.estimator).and_then(|answer| answer.residual);
    let is_misfit = usual.is_some_and(|usual| found.residual > MAX_RESIDUAL * usual);
    let not_identified = if !shared.identified {
        Some(NotIdentified::SharedBeam)
    } else if lowest <= 0.0 {
        Some(NotIdentified::NotPhysical { attenuation_per_m: lowest })
    } else if is_misfit {
        Some(NotIdentified::Misfit { systematic: found.residual })
    } else {
        (worst > MAX_STD_PER_M).then_some(NotIdentified::Uncertain { std_per_m: worst })
    };
    (diagnostics, not_identified)
}

/// Log gains of the frames, by the recorded settings that the earlier model follows.
fn log_gains(
    sessions: &[CameraSession],
    shared: &ModelFile,
    frames: &[FrameSamples],
    origins: &[(usize, Option<FrameId>)],
) -> Result<Vec<Bands>> {
    let none = ModelFile { frame_gains: Vec::new(), ..shared.clone() };
    let gains = |session: &CameraSession| FrameGains::new(&none, &session.recording, None);
    let gains = sessions.iter().map(gains).collect::<Result<Vec<_>>>()?;
    let of_frame = |(frame, (log, _)): (&FrameSamples, &(usize, _))| {
        let found = sessions.get(*log).zip(gains.get(*log)).and_then(|(session, gains)| {
            let at = session.survey.frames.get(frame.frame)?;
            Some(session.survey.frame_gain(&none, gains, at, || frame.mean_reading))
        });
        found.map_or([0.0; 3], |gain| gain.map(f64::ln))
    };
    Ok(frames.iter().zip(origins).map(of_frame).collect())
}

/// The slope of light over path length within points that are seen several times.
struct Slope<'s> {
    tracks: &'s [Track],
    frames: &'s [FrameSamples],
    log_gains: &'s [Bands],
    lamps: Lamps,
}

/// The answer; attenuation is in the model.
struct Found {
    std_per_m: Bands,
    observations: usize,
    residual: f64,
}

/// Path length and light without beam pattern and geometry, of one observation.
type View = (f64, Bands);

impl Slope<'_> {
    /// Estimates the attenuation of a model, in place.
    fn solve(&self, model: &mut ImagingModel) -> Option<Found> {
        let mut weights: Vec<Vec<f64>> = self.tracks.iter().map(|t| vec![1.0; t.len()]).collect();
        let mut found = None;
        for _ in 0..ROUNDS {
            let views: Vec<Vec<Option<View>>> = self
                .tracks
                .iter()
                .map(|track| track.iter().map(|o| self.view(o, model)).collect())
                .collect();
            let sums = self.sums(&views, &weights, model.bands);
            let total = sums.values().fold([[0.0; 2]; 3], |a, s| add(a, *s, 1.0));
            let alpha = slopes(&total, model.bands)?;
            model.attenuation_per_m = alpha;
            let residuals = self.reweight(&views, &mut weights, &alpha, model.bands);
            found = Some(Found {
                std_per_m: jackknife(&sums, &total, model.bands)?,
                observations: residuals.len(),
                residual: stats::robust_std(&residuals),
            });
        }
        found
    }

    fn view(&self, o: &Observation, model: &ImagingModel) -> Option<View> {
        let path = o.sample.path(self.lamps)?;
        let gains = self.log_gains.get(o.frame as usize)?;
        // Of several lamps each has its own path; attenuation over the mean path is put back.
        let light = model.log_radiance(&path, Removal::FULL);
        let length_m = path.length_m();
        let y = std::array::from_fn(|b| {
            let known = light[b] + model.attenuation_per_m[b] * length_m;
            f64::from(o.sample.log_color[b]) - gains[b] - known
        });
        let is_finite = |y: &Bands| y[..model.bands].iter().all(|v| v.is_finite());
        is_finite(&y).then_some((length_m, y))
    }

    /// Per window of frames and band: sums of products of light and length, and of squared lengths,
    /// about the means of the points.
    fn sums(
        &self,
        views: &[Vec<Option<View>>],
        weights: &[Vec<f64>],
        bands: usize,
    ) -> BTreeMap<usize, [[f64; 2]; 3]> {
        let mut sums: BTreeMap<usize, [[f64; 2]; 3]> = BTreeMap::new();
        let size = self.frames.len().div_ceil(WINDOWS).max(1);
        for ((track, views), weights) in self.tracks.iter().zip(views).zip(weights) {
            let window = track.first().map_or(0, |o| o.frame as usize / size);
            let seen: Vec<(View, f64)> =
                views.iter().zip(weights).filter_map(|(v, w)| Some(((*v)?, *w))).collect();
            let Some((length_m, light)) = mean(&seen) else { continue };
            let sum = sums.entry(window).or_default();
            for ((at, y), weight) in &seen {
                for (b, sum) in sum.iter_mut().enumerate().take(bands) {
                    sum[0] += weight * (at - length_m) * (y[b] - light[b]);
                    sum[1] += weight * (at - length_m) * (at - length_m);
                }
            }
        }
        sums
    }

    /// Weights by the residuals of all bands; returns those of single bands.
    fn reweight(
        &self,
        views: &[Vec<Option<View>>],
        weights: &mut [Vec<f64>],
        alpha: &Bands,
        bands: usize,
    ) -> Vec<f64> {
        let mut largest: Vec<Vec<f64>> = Vec::new();
        let mut residuals = Vec::new();
        for (views, weights) in views.iter().zip(weights.iter()) {
            let seen: Vec<(View, f64)> =
                views.iter().zip(weights).filter_map(|(v, w)| Some(((*v)?, *w))).collect();
            let (length_m, light) = mean(&seen).unwrap_or_default();
            let of_view = |view: &Option<View>| {
                let Some((at, y)) = view else { return f64::INFINITY };
                let of_band = |b: usize| y[b] - light[b] + alpha[b] * (at - length_m);
                (0..bands).map(|b| of_band(b).abs()).fold(0.0, f64::max)
            };
            let of_track: Vec<f64> = views.iter().map(of_view).collect();
            residuals.extend(of_track.iter().copied().filter(|r| r.is_finite()));
            largest.push(of_track);
        }
        let scale = stats::robust_std(&residuals);
        for (weights, residuals) in weights.iter_mut().zip(&largest) {
            for (weight, residual) in weights.iter_mut().zip(residuals) {
                *weight = stats::cauchy_weight(*residual, scale);
            }
        }
        residuals
    }
}

/// Weighted means of length and light; `None` of fewer than two views.
fn mean(seen: &[(View, f64)]) -> Option<View> {
    let total: f64 = seen.iter().map(|(_, w)| w).sum();
    if seen.len() < 2 || total < 1e-6 {
        return None;
    }
    let of = |value: &dyn Fn(&View) -> f64| {
        seen.iter().map(|(view, w)| w * value(view)).sum::<f64>() / total
    };
    Some((of(&|v| v.0), std::array::from_fn(|b| of(&|v: &View| v.1[b]))))
}

fn add(a: [[f64; 2]; 3], b: [[f64; 2]; 3], sign: f64) -> [[f64; 2]; 3] {
    std::array::from_fn(|band| std::array::from_fn(|k| a[band][k] + sign * b[band][k]))
}

fn slopes(sums: &[[f64; 2]; 3], bands: usize) -> Option<Bands> {
    let is_determined = sums[..bands].iter().all(|[_, square]| *square > 1e-9);
    let slope = |b: usize| if b < bands { -sums[b][0] / sums[b][1] } else { 0.0 };
    is_determined.then(|| std::array::from_fn(slope))
}

/// Standard deviation, by leaving out one window each.
fn jackknife(
    sums: &BTreeMap<usize, [[f64; 2]; 3]>,
    total: &[[f64; 2]; 3],
    bands: usize,
) -> Option<Bands> {
    let without = |of_window: &[[f64; 2]; 3]| slopes(&add(*total, *of_window, -1.0), bands);
    let answers: Vec<Bands> = sums.values().map(without).collect::<Option<_>>()?;
    let n = answers.len() as f64;
    if n < 2.0 {
        return None;
    }
    Some(std::array::from_fn(|b| {
        let mean = answers.iter().map(|a| a[b]).sum::<f64>() / n;
        let square: f64 = answers.iter().map(|a| (a[b] - mean).powi(2)).sum();
        ((n - 1.0) / n * square).sqrt()
    }))
}
