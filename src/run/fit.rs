//! Pass one over more and more frames, until the model is good enough.

use crate::config::{EstimateConfig, Estimator};
use crate::correct::MeanFrames;
use crate::diagnostics::{ClockFact, Diagnostic, EstimateFact, Fact, MountFact};
use crate::error::{Error, Result};
use crate::model::{CameraFile, GeometryFile, ModelFile, ResponseFile};
use crate::parallel::Threads;
use crate::session::{CameraSession, Options, Progress};
use crate::stats;

use super::model_of::model_of;
use super::pass_one::{Collected, PassOne, share_of_log};

/// Logs of one model must be different logs of the same camera.
///
/// # Errors
/// That.
pub fn ensure_same_camera(logs: &[&CameraSession]) -> Result<()> {
    let name = |log: &CameraSession| log.recording.path().display().to_string();
    let format = |log: &CameraSession| {
        let camera = &log.survey.rig.camera;
        (camera.width, camera.height, log.survey.container)
    };
    for (n, log) in logs.iter().enumerate() {
        for before in &logs[..n] {
            let (a, b) = (name(before), name(log));
            if log.recording.identity().is_same(&before.recording.identity()) {
                return Err(Error::Usage(format!("{a} and {b} are the same log")));
            }
            let ((w, h, _), (v, g, _)) = (format(before), format(log));
            if format(log) != format(before) {
                return Err(Error::Usage(format!(
                    "{a} ({w}×{h}) and {b} ({v}×{g}) are of different cameras or image formats; \
                     a model is of one camera and strobe"
                )));
            }
        }
    }
    Ok(())
}

/// Estimates a model. Where the log shows another transfer curve, clock or mount, the frames are
/// sampled again with these. Returns it with the mean frames of the first log.
///
/// # Errors
/// A log cannot be read, or attenuation cannot be estimated.
pub fn fit_model(
    logs: &[&CameraSession],
    options: &Options,
    threads: &Threads,
    progress: &dyn Progress,
) -> Result<(ModelFile, MeanFrames)> {
    let (mut model, mut means) = fit(logs, options, threads, progress)?;
    let mut found = Replaced::of(&model, None);
    let mut sessions: Vec<CameraSession> = Vec::new();
    for _ in 0..MAX_RESAMPLED {
        let Some(replaced) = found else { break };
        let before: Vec<&CameraSession> =
            if sessions.is_empty() { logs.to_vec() } else { sessions.iter().collect() };
        let next: Vec<CameraSession> =
            before.iter().map(|log| replaced.applied_to(log)).collect::<Result<_>>()?;
        let (mut again, means_again) =
            fit(&next.iter().collect::<Vec<_>>(), options, threads, progress)?;
        found = Replaced::of(&again, model.camera.as_ref().and_then(|c| c.response.as_ref()));
        keep(&model, &mut again);
        (model, means, sessions) = (again, means_again, next);
    }
    Ok((model, means))
}

/// Residual of the joint solve; infinite where there is none.
pub fn joint_residual(fit: &Result<(ModelFile, MeanFrames)>) -> f64 {
    let answers = fit.as_ref().ok().map(|(model, _)| &model.estimators);
    answers.and_then(|a| a.get(&Estimator::Joint)?.residual).unwrap_or(f64::INFINITY)
}

/// Times that frames are sampled again.
const MAX_RESAMPLED: usize = 2;
/// A transfer curve that changes by less than this need not be sampled by again (log light), at
/// pixel values from this one on (share of full scale).
const SAME_CURVE: f64 = 0.05;
const LEAST_VALUE: f64 = 0.08;

/// What frames have to be sampled again for.
struct Replaced {
    camera: Option<CameraFile>,
    geometry: Option<GeometryFile>,
}

impl Replaced {
    /// What a model found; `known` is the transfer curve that its frames were sampled by.
    fn of(model: &ModelFile, known: Option<&ResponseFile>) -> Option<Self> {
        let is_new = |found: &ResponseFile| known.is_none_or(|known| differ(found, known));
        let camera = model.camera.clone().filter(|c| c.response.as_ref().is_some_and(is_new));
        let geometry = model.geometry.clone();
        let found = Self { camera, geometry };
        (found.camera.is_some() || found.geometry.is_some()).then_some(found)
    }

    fn applied_to(&self, log: &CameraSession) -> Result<CameraSession> {
        let mut changed = log.clone();
        if let Some(camera) = &self.camera {
            changed.survey.take_response(camera)?;
        }
        if let Some(geometry) = &self.geometry {
            changed.survey.take_geometry(geometry, &log.config.seafloor);
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

/// What was replaced for a model is said by it, too.
fn keep(before: &ModelFile, model: &mut ModelFile) {
    if let Some(CameraFile { response: Some(response), residual, .. }) = &before.camera {
        let camera = model
            .camera
            .get_or_insert_with(|| CameraFile { residual: *residual, ..CameraFile::default() });
        camera.response.get_or_insert_with(|| response.clone());
        let summary = camera.summary();
        model.diagnostics.retain(|d| !is_of_camera(d));
        model.diagnostics.push(EstimateFact::CameraFound { summary }.into());
    }
    if let Some(before_it) = &before.geometry {
        let geometry = model.geometry.get_or_insert_with(GeometryFile::default);
        geometry.clock_offset_s = geometry.clock_offset_s.or(before_it.clock_offset_s);
        geometry.dvl_rotation_xyzw = geometry.dvl_rotation_xyzw.or(before_it.dvl_rotation_xyzw);
        model.mount_check = before.mount_check.clone();
    }
    let of_before = before.diagnostics.iter().filter(|d| is_of_replaced(d)).cloned();
    let kept: Vec<Diagnostic> = of_before.filter(|d| !model.diagnostics.contains(d)).collect();
    model.warnings.extend(kept.iter().map(Diagnostic::with_remedy));
    model.diagnostics.extend(kept);
}

fn is_of_camera(diagnostic: &Diagnostic) -> bool {
    matches!(diagnostic.fact, Fact::EstimateFact(EstimateFact::CameraFound { .. }))
}

fn is_of_replaced(diagnostic: &Diagnostic) -> bool {
    matches!(
        diagnostic.fact,
        Fact::ClockFact(ClockFact::CameraReplaced { .. })
            | Fact::MountFact(MountFact::DvlReplaced { .. })
    )
}

/// Estimates a model from more and more frames, until attenuation is known as well as
/// `estimate.precision_per_m` asks for. Returns it with the mean frames of the first log.
///
/// # Errors
/// A log cannot be read, or attenuation cannot be estimated.
fn fit(
    logs: &[&CameraSession],
    options: &Options,
    threads: &Threads,
    progress: &dyn Progress,
) -> Result<(ModelFile, MeanFrames)> {
    let config = &options.config;
    let EstimateConfig { first_frames, max_frames, precision_per_m, .. } = config.estimate;
    // Mean frames need many, however well the attenuation is known.
    let needs_all = config.render.method.needs_mean_frames() || precision_per_m == 0.0;
    let mut frames = if needs_all { max_frames } else { first_frames.min(max_frames) };
    loop {
        let pass_one = |(n, session): (usize, &&'_ CameraSession)| -> Result<Collected> {
            let max_frames = share_of_log(frames, n, logs.len());
            PassOne { session, config, max_frames, threads, progress }.collect()
        };
        let mut collected = logs.iter().enumerate().map(pass_one).collect::<Result<Vec<_>>>()?;
        let is_all = collected.iter().all(|c| c.is_all);
        let means = collected.first_mut().map(|c| std::mem::take(&mut c.means)).unwrap_or_default();
        let samples = logs.iter().copied().zip(collected).collect();
        let model = threads.install(|| model_of(samples, options));
        if is_all || frames >= max_frames {
            return Ok((model?, means));
        }
        // Where the strobe or the water changed among a few frames, it did so among others.
        let is_steady = |m: &ModelFile| m.frame_gains.is_empty() && m.segments.0.is_empty();
        let is_precise = |m: &ModelFile| {
            m.attenuation_std_per_m.iter().all(|std| std.is_some_and(|std| std <= precision_per_m))
        };
        match model {
            Ok(model) if model.identified && is_steady(&model) => {
                if is_precise(&model) {
                    return Ok((model, means));
                }
                frames = (2 * frames).min(max_frames);
            }
            // A few windows are not enough.
            _ => frames = max_frames,
        }
    }
}
