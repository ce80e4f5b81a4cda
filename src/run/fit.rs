//! Pass one over more and more frames, until the model is good enough.

use crate::config::EstimateConfig;
use crate::correct::MeanFrames;
use crate::error::{Error, Result};
use crate::model::ModelFile;
use crate::parallel::Threads;
use crate::session::{CameraSession, Options, Progress};

use super::model_of::model_of;
use super::pass_one::{Collected, PassOne};

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
            if log.recording.sha256()? == before.recording.sha256()? {
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

/// Estimates a model from more and more frames, until attenuation is known as well as
/// `estimate.precision_per_m` asks for. Returns it with the mean frames of the first log.
///
/// # Errors
/// A log cannot be read, or attenuation cannot be estimated.
pub fn fit_model(
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
        let pass_one = |session: &&'_ CameraSession| -> Result<Collected> {
            PassOne { session, config, max_frames: frames, threads, progress }.collect()
        };
        let mut collected = logs.iter().map(pass_one).collect::<Result<Vec<_>>>()?;
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
