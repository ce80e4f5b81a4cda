//! A model with the exposure of the method that it is used with: exposure depends on what is
//! removed.

use super::beam_from::fit_log;
use super::camera_model::CameraModel;
use super::fit::Fit;
use super::model_of::exposure_of;
use super::pass_one::{PassOne, share_of_log};
use super::prepared_model::{removes_backscatter, scatter_table};
use crate::config::Estimator;
use crate::correct::MeanFrames;
use crate::error::{Error, Result};
use crate::estimate::{EmpiricalFit, FrameSamples, samples_for_model};
use crate::image::Bands;
use crate::model::{EmpiricalModel, ModelFile, RangeFactor};
use crate::parallel::Threads;
use crate::session::{CameraSession, Options, Progress};
use crate::vehicle::Rig;

/// Estimates a model with the exposure of the run's method.
///
/// # Errors
/// A log cannot be read, or attenuation cannot be estimated.
pub fn fit_with_exposure(
    logs: &[&CameraSession],
    options: &Options,
    threads: &Threads,
    progress: &dyn Progress,
) -> Result<Fit> {
    let fit = fit_log(logs, options, threads, progress)?;
    let model = fit.model.imaging_model().map_err(Error::Usage)?;
    // The samples of the estimate are without backscatter, whether the method removes it or not.
    if model.backscatter.is_none() || removes_backscatter(&model, options.config.render.method) {
        return Ok(fit);
    }
    let (model, _) = exposed(logs, fit.model, options, threads, progress)?;
    Ok(Fit { model, ..fit })
}

/// A model with an exposure from the samples of these logs, and the mean frames of the first.
/// Keypoints are not needed.
///
/// # Errors
/// A log cannot be read, or the model contradicts itself.
pub fn exposed(
    logs: &[&CameraSession],
    file: ModelFile,
    options: &Options,
    threads: &Threads,
    progress: &dyn Progress,
) -> Result<(ModelFile, MeanFrames)> {
    let mut config = options.config.clone();
    config.estimate.estimator = Estimator::Altitude;
    let (mut samples, mut means, mut of_first) = (Samples::default(), None, None);
    for (n, log) in logs.iter().enumerate() {
        let max_frames = share_of_log(config.estimate.max_frames, n, logs.len());
        let mut session = (*log).clone();
        let source = options.source.as_ref();
        let model = CameraModel::new(&mut session, file.clone(), source)?;
        let pass_one =
            PassOne { session: &session, config: &config, max_frames, threads, progress };
        let collected = pass_one.collect()?;
        means.get_or_insert(collected.means);
        samples.add(collected.frames, &session, &model);
        of_first.get_or_insert((session, model));
    }
    let Some((session, model)) = of_first else {
        return Err(Error::Usage("no log was given".into()));
    };
    let model = &model.prepared.model;
    let empirical = model.empirical.as_deref().map(|empirical| samples.fitted(empirical));
    let (mounts, white_level) = (session.survey.rig.extrinsics(), session.survey.white_level);
    let used = (model, empirical.as_ref());
    let rendering = exposure_of(&samples.frames, used, &mounts, (white_level, &options.config));
    Ok((ModelFile { rendering, ..file }, means.unwrap_or_default()))
}

/// Samples of all logs as the method meets them.
#[derive(Default)]
struct Samples {
    frames: Vec<FrameSamples>,
    /// per frame: of its slant ranges, in the empirical model
    ranges: Vec<RangeFactor>,
}

impl Samples {
    /// Adds the frames of a log, without their gains and the backscatter that the method removes.
    fn add(&mut self, frames: Vec<FrameSamples>, session: &CameraSession, model: &CameraModel) {
        let survey = &session.survey;
        let of_frame = |f: &FrameSamples| {
            let Some(frame) = survey.frames.get(f.frame) else { return Default::default() };
            let gain = model.frame_gain(session, frame, || f.mean_reading);
            (gain.map(f64::ln), model.range_factor(frame))
        };
        let (log_gains, ranges): (Vec<Bands>, Vec<RangeFactor>) =
            frames.iter().map(of_frame).unzip();
        let Rig { body_from_optical, strobe, .. } = &survey.rig;
        let imaging = &model.prepared.model;
        let is_removed = removes_backscatter(imaging, session.config.render.method);
        let table = is_removed.then(|| scatter_table(imaging, &survey.rig)).flatten();
        let scatter = imaging.backscatter.as_ref().zip(table.as_ref());
        self.frames.extend(samples_for_model(
            frames,
            &log_gains,
            *body_from_optical,
            strobe.lamps,
            scatter,
        ));
        self.ranges.extend(ranges);
    }

    /// The empirical model of these frames, whose gains are removed.
    fn fitted(&self, model: &EmpiricalModel) -> EmpiricalFit {
        EmpiricalFit {
            model: model.clone(),
            ranges: self.ranges.clone(),
            log_gains: vec![[0.0; 3]; self.frames.len()],
            residual: 0.0,
            observations: 0,
        }
    }
}
