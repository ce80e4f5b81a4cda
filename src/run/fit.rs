//! Pass one over more and more frames, until the model is good enough.

use serde::{Deserialize, Serialize};

use crate::config::{Config, EstimateConfig, Estimator};
use crate::correct::MeanFrames;
use crate::diagnostics::{ClockFact, Diagnostic, EstimateFact, Fact, MountFact};
use crate::error::{Error, Result};
use crate::model::{
    CameraFile, GeometryFile, ModelFile, MountCheckFile, ResponseFile, TiltFile, TiltsFile,
};
use crate::parallel::Threads;
use crate::session::{CameraSession, Options, Progress, Tilts};
use crate::stats;

use super::log_samples::LogSamples;
use super::model_of::{model_of, tilts_found};
use super::pass_one::{PassOne, share_of_log};

/// The result of pass one.
pub struct Fit {
    /// the model
    pub model: ModelFile,
    /// mean frames of the first log
    pub means: MeanFrames,
    /// the samples that the model comes from, per log, where the options ask for them
    pub samples: Vec<LogSamples>,
}

/// Estimates a model. Where the log shows another transfer curve, clock or mount, or other planes,
/// the frames are sampled again with these.
///
/// # Errors
/// A log cannot be read, or attenuation cannot be estimated.
pub fn fit_model(
    logs: &[&CameraSession],
    options: &Options,
    threads: &Threads,
    progress: &dyn Progress,
) -> Result<Fit> {
    let mut fitted = fit(logs, options, threads, progress)?;
    let mut found = Replaced::of(&fitted.model, None);
    let mut sessions: Vec<CameraSession> = Vec::new();
    for _ in 0..MAX_RESAMPLED {
        let Some(replaced) = found else { break };
        let before: Vec<&CameraSession> =
            if sessions.is_empty() { logs.to_vec() } else { sessions.iter().collect() };
        let of_logs = before.iter().enumerate();
        let next: Vec<CameraSession> =
            of_logs.map(|(n, log)| replaced.applied_to(log, n)).collect::<Result<_>>()?;
        let mut again = fit(&next.iter().collect::<Vec<_>>(), options, threads, progress)?;
        let camera = fitted.model.camera.as_ref();
        found = Replaced::of(&again.model, camera.and_then(|c| c.response.as_ref()));
        Kept::of(&fitted.model).keep_in(&mut again.model);
        if let Some(found) = &mut found {
            found.tilts = measured_tilts(&again.model);
        }
        (fitted, sessions) = (again, next);
    }
    Ok(fitted)
}

/// Residual of the joint solve; infinite where there is none.
pub fn joint_residual(fit: &Result<Fit>) -> f64 {
    let answers = fit.as_ref().ok().map(|fit| &fit.model.estimators);
    answers.and_then(|a| a.get(&Estimator::Joint)?.residual).unwrap_or(f64::INFINITY)
}

/// Times that frames are sampled again.
const MAX_RESAMPLED: usize = 2;
/// A transfer curve that changes by less than this need not be sampled by again (log light), at
/// pixel values from this one on (share of full scale).
const SAME_CURVE: f64 = 0.05;
const LEAST_VALUE: f64 = 0.08;

/// Planes that are tilted by less than this show patches of the right size (deg).
const SAME_PLANES_DEG: f64 = 0.5;

/// What frames have to be sampled again for.
struct Replaced {
    camera: Option<CameraFile>,
    geometry: Option<GeometryFile>,
    tilts: Option<TiltsFile>,
}

/// Tilts that places of points show.
fn measured_tilts(model: &ModelFile) -> Option<TiltsFile> {
    model.tilts.clone().filter(|tilts| tilts.is_measured)
}

impl Replaced {
    /// What a model found; `known` is the transfer curve that its frames were sampled by.
    fn of(model: &ModelFile, known: Option<&ResponseFile>) -> Option<Self> {
        let is_new = |found: &ResponseFile| known.is_none_or(|known| differ(found, known));
        let camera = model.camera.clone().filter(|c| c.response.as_ref().is_some_and(is_new));
        let geometry = model.geometry.clone();
        let tilts = measured_tilts(model);
        let is_off = tilts.as_ref().is_some_and(|tilts| {
            let sizes: Vec<f64> = tilts.frames.iter().map(TiltFile::size_deg).collect();
            stats::median(&sizes) > SAME_PLANES_DEG
        });
        let found = Self { camera, geometry, tilts };
        (is_off || found.camera.is_some() || found.geometry.is_some()).then_some(found)
    }

    /// To log number `n`.
    fn applied_to(&self, log: &CameraSession, n: usize) -> Result<CameraSession> {
        let mut changed = log.clone();
        if let Some(camera) = &self.camera {
            changed.survey.take_response(camera)?;
        }
        if let Some(geometry) = &self.geometry {
            changed.survey.take_geometry(geometry, &log.config.seafloor);
        }
        if let Some(tilts) = &self.tilts {
            changed.survey.tilts = Tilts::of(tilts, |input| input == n);
        }
        Ok(changed)
    }
}

/// Whether two transfer curves are not the same but for a factor.
fn differ(a: &ResponseFile, b: &ResponseFile) -> bool {
    let pairs = a.points.iter().zip(&b.points).filter(|(a, _)| a[0] > LEAST_VALUE);
    let ratios: Vec<f64> = pairs.map(|(a, b)| (a[1] / b[1]).ln()).collect();
    let middle = stats::median(&ratios);
    ratios.iter().any(|ratio| (ratio - middle).abs() > SAME_CURVE)
}

/// What a model replaced before its frames were sampled again.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Kept {
    /// transfer curve, and the residuals without and with it
    response: Option<(ResponseFile, [f64; 2])>,
    geometry: Option<GeometryFile>,
    mount_check: Option<MountCheckFile>,
    tilts: Option<TiltsFile>,
    diagnostics: Vec<Diagnostic>,
}

impl Kept {
    /// What a model says that it replaced.
    pub fn of(model: &ModelFile) -> Self {
        let response = |camera: &CameraFile| Some((camera.response.clone()?, camera.residual));
        Self {
            response: model.camera.as_ref().and_then(response),
            geometry: model.geometry.clone(),
            mount_check: model.mount_check.clone(),
            tilts: measured_tilts(model),
            diagnostics: model.diagnostics.iter().filter(|d| is_of_replaced(d)).cloned().collect(),
        }
    }

    /// What all logs have in common; of one log everything, of several no clock.
    pub fn common(of_logs: Vec<Self>) -> Option<Self> {
        let is_alone = of_logs.len() == 1;
        let tilts = TiltsFile::of_logs(of_logs.iter().map(|log| log.tilts.clone()));
        let of_several = |Self { response, geometry, .. }: Self| {
            let without_clock = |g: GeometryFile| GeometryFile { clock_offset_s: None, ..g };
            let geometry = geometry.map(without_clock).filter(|g| *g != GeometryFile::default());
            Self { response, geometry, ..Self::default() }
        };
        let mut of_logs =
            of_logs.into_iter().map(|kept| if is_alone { kept } else { of_several(kept) });
        let first = of_logs.next()?;
        // A mount is that of all logs or of none.
        let is_same = of_logs.all(|kept| kept.geometry == first.geometry);
        Some(Self { geometry: first.geometry.clone().filter(|_| is_same), tilts, ..first })
    }

    /// What was replaced for a model is said by it, too.
    pub fn keep_in(self, model: &mut ModelFile) {
        if let Some((response, residual)) = self.response {
            let camera = model
                .camera
                .get_or_insert_with(|| CameraFile { residual, ..CameraFile::default() });
            camera.response.get_or_insert(response);
            let summary = camera.summary();
            model.diagnostics.retain(|d| !is_of_camera(d));
            model.diagnostics.push(EstimateFact::CameraFound { summary }.into());
        }
        if let Some(before) = self.geometry {
            let geometry = model.geometry.get_or_insert_with(GeometryFile::default);
            geometry.clock_offset_s = geometry.clock_offset_s.or(before.clock_offset_s);
            geometry.dvl_rotation_xyzw = geometry.dvl_rotation_xyzw.or(before.dvl_rotation_xyzw);
            geometry.is_camera_held |= before.is_camera_held;
            model.mount_check = self.mount_check.or(model.mount_check.take());
        }
        if let Some(before) = self.tilts {
            let tilts = match model.tilts.take() {
                Some(found) => found.after(&before),
                None => before,
            };
            model.diagnostics.retain(|d| !is_of_tilts(d));
            model.diagnostics.push(tilts_found(&tilts));
            model.tilts = Some(tilts);
        }
        let of_before = self.diagnostics.into_iter();
        let kept: Vec<Diagnostic> = of_before.filter(|d| !model.diagnostics.contains(d)).collect();
        model.diagnostics.extend(kept);
        model.warnings = model.diagnostics.iter().map(Diagnostic::with_remedy).collect();
    }
}

fn is_of_camera(diagnostic: &Diagnostic) -> bool {
    matches!(diagnostic.fact, Fact::EstimateFact(EstimateFact::CameraFound { .. }))
}

fn is_of_tilts(diagnostic: &Diagnostic) -> bool {
    matches!(diagnostic.fact, Fact::EstimateFact(EstimateFact::TiltsFound { .. }))
}

fn is_of_replaced(diagnostic: &Diagnostic) -> bool {
    matches!(
        diagnostic.fact,
        Fact::ClockFact(ClockFact::CameraReplaced { .. })
            | Fact::MountFact(
                MountFact::DvlReplaced { .. }
                    | MountFact::DvlTurned { .. }
                    | MountFact::AttitudeTurned { .. }
                    | MountFact::JointContradicted { .. }
            )
    )
}

/// Samples of logs, the mean frames of the first, and whether all their frames were used.
///
/// # Errors
/// A log cannot be read, or no frame of any can be used.
pub fn collect(
    logs: &[&CameraSession],
    config: &Config,
    max_frames: usize,
    (threads, progress): (&Threads, &dyn Progress),
) -> Result<(Vec<LogSamples>, MeanFrames, bool)> {
    let (mut samples, mut of_first, mut is_all) = (Vec::new(), None, true);
    for (n, session) in logs.iter().enumerate() {
        let max_frames = share_of_log(max_frames, n, logs.len());
        let pass_one = PassOne { session, config, max_frames, threads, progress };
        let mut collected = pass_one.collect()?;
        is_all &= collected.is_all;
        of_first.get_or_insert_with(|| std::mem::take(&mut collected.means));
        samples.push(LogSamples::new(session, collected));
    }
    if let Some(first) = logs.first().filter(|_| samples.iter().all(|s| s.frames.is_empty())) {
        first.frames_with_seafloor()?;
        let topic = &first.survey.camera_topic;
        return Err(Error::Data(format!("no image of {topic} can be decoded and used")));
    }
    Ok((samples, of_first.unwrap_or_default(), is_all))
}

/// Estimates a model from more and more frames, until attenuation is known as well as
/// `estimate.precision_per_m` asks for.
///
/// # Errors
/// A log cannot be read, or attenuation cannot be estimated.
fn fit(
    logs: &[&CameraSession],
    options: &Options,
    threads: &Threads,
    progress: &dyn Progress,
) -> Result<Fit> {
    let config = &options.config;
    let EstimateConfig { first_frames, max_frames, precision_per_m, .. } = config.estimate;
    // Mean frames need many, however well the attenuation is known.
    let needs_all = config.render.method.needs_mean_frames() || precision_per_m == 0.0;
    let mut frames = if needs_all { max_frames } else { first_frames.min(max_frames) };
    loop {
        let (of_logs, means, is_all) = collect(logs, config, frames, (threads, progress))?;
        let samples = if options.keep_samples { of_logs.clone() } else { Vec::new() };
        let model = threads.install(|| model_of(of_logs, options));
        let fit = |model| Fit { model, means, samples };
        if is_all || frames >= max_frames {
            return model.map(fit);
        }
        // Where the strobe or the water changed among a few frames, it did so among others.
        let is_steady = |m: &ModelFile| m.frame_gains.is_empty() && m.segments.0.is_empty();
        let is_precise = |m: &ModelFile| {
            m.attenuation_std_per_m.iter().all(|std| std.is_some_and(|std| std <= precision_per_m))
        };
        match model {
            Ok(model) if model.identified && is_steady(&model) => {
                if is_precise(&model) {
                    return Ok(fit(model));
                }
                frames = (2 * frames).min(max_frames);
            }
            // A few windows are not enough.
            _ => frames = max_frames,
        }
    }
}
