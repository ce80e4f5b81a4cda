//! The whole run on one screen: index the log, survey its cameras, estimate (pass one), correct
//! (pass two).
//!
//! The files depend on each other in this order: `pass_one`, `mount_check`, `log_samples`,
//! `pooled`, `model_of`, `fit`, `samples_file`, `dvl_yaw`, `camera_joint`, `beam_from`,
//! `output_names`, `prepared_model`, `camera_model`, `exposure`, `corrector`, `jpeg_quality`,
//! `frame_corrector`, `bench`, `clouds`, `camera_output`, `ready`, `topics`, `pass_two`, `join`,
//! `memory`, `output_size`.

mod beam_from;
pub mod bench;
mod camera_joint;
mod camera_model;
mod camera_output;
pub mod clock_offsets;
mod clouds;
mod corrector;
mod dvl_yaw;
mod exposure;
mod fit;
mod frame_corrector;
mod join;
mod jpeg_quality;
mod log_samples;
pub mod memory;
mod model_of;
mod mount_check;
mod output_names;
pub mod output_size;
mod pass_one;
mod pass_two;
mod pooled;
mod prepared_model;
mod ready;
mod samples_file;
mod topics;

use std::collections::BTreeMap;
use std::path::Path;

use crate::diagnostics::{Diagnostic, LogFact};
use crate::error::{Error, Result};
use crate::messages::writer::WireFormat;
use crate::model::ModelFile;
use crate::parallel::Threads;
use crate::recording::{ChannelDigest, LogFiles, Output, check_output_path};
use crate::report::Report;
use crate::session::{CameraSession, Log, Options, Progress};
use crate::vehicle::CameraFacts;

pub use corrector::CorrectedFrame;
use exposure::fit_with_exposure;
use fit::Fit;
pub use frame_corrector::FrameCorrector;
pub use join::{join, shard_of};
use log_samples::{SampledLog, ensure_same_camera};
use output_names::output_wire;
pub use output_names::{corrected_topic, ensure_not_corrected, method_name, output_container};
use pass_two::{Input, pass_two};
pub use ready::request_sha256;
use ready::{ReadyCamera, only};
pub use samples_file::estimate_samples;
use samples_file::samples_file;

/// Estimates a model from one log or several of the same dive, camera and strobe: paths of files or
/// of folders, or [`LogFiles`].
///
/// # Errors
/// A log cannot be used, or attenuation cannot be estimated.
pub fn estimate_logs<L: Clone + Into<LogFiles>>(
    logs: &[L],
    options: &Options,
    progress: &dyn Progress,
) -> Result<(ModelFile, Vec<Diagnostic>)> {
    let (fit, diagnostics) = fit_logs(logs, options, progress)?;
    Ok((fit.model, diagnostics))
}

/// The same of one log, with the samples that the model is estimated from: the contents of a file
/// for [`estimate_samples`].
///
/// # Errors
/// As [`estimate_logs`].
pub fn estimate_and_sample(
    log: &LogFiles,
    options: &Options,
    progress: &dyn Progress,
) -> Result<(ModelFile, Vec<Diagnostic>, Vec<u8>)> {
    let options = Options { keep_samples: true, ..options.clone() };
    let (Fit { model, mut samples, .. }, diagnostics) =
        fit_logs(std::slice::from_ref(log), &options, progress)?;
    let Some(samples) = samples.pop() else {
        return Err(Error::Usage("a model with the beam pattern of another has no samples".into()));
    };
    let file = samples_file(samples, &model)?;
    Ok((model, diagnostics, file))
}

fn fit_logs<L: Clone + Into<LogFiles>>(
    logs: &[L],
    options: &Options,
    progress: &dyn Progress,
) -> Result<(Fit, Vec<Diagnostic>)> {
    let threads = Threads::new(options.threads);
    let open = |files: &L| {
        let files = files.clone().into();
        CameraSession::new(&Log::open_with_sha256(&files, options, &threads)?, options)
    };
    let sessions = logs.iter().map(open).collect::<Result<Vec<_>>>()?;
    let logs: Vec<&CameraSession> = sessions.iter().collect();
    let known: Vec<SampledLog> = logs.iter().map(|log| SampledLog::of(log)).collect();
    ensure_same_camera(&known.iter().collect::<Vec<_>>())?;
    let diagnostics = logs.iter().flat_map(|log| log.survey.diagnostics.clone()).collect();
    Ok((fit_with_exposure(&logs, options, &threads, progress)?, diagnostics))
}

/// Estimates a model from surveyed logs of one camera.
///
/// # Errors
/// A log cannot be read, or attenuation cannot be estimated.
pub fn estimate(
    logs: &[&CameraSession],
    options: &Options,
    progress: &dyn Progress,
) -> Result<ModelFile> {
    if options.window.is_none() {
        logs.iter().try_for_each(|log| log.recording.sha256().map(drop))?;
    }
    Ok(fit_with_exposure(logs, options, &Threads::new(options.threads), progress)?.model)
}

/// Corrects one camera of a log with a given model, or estimates one first. The log is the path of
/// a file or of a folder, or [`LogFiles`].
///
/// # Errors
/// Nothing is written under the output's name then. Several cameras of which none is selected are
/// an error too.
pub fn correct(
    input: impl Into<LogFiles>,
    output: &Path,
    model: Option<ModelFile>,
    options: &Options,
    progress: &dyn Progress,
) -> Result<(Report, ModelFile)> {
    let input = input.into();
    ensure_writable(&input, output, options)?;
    let threads = Threads::new(options.threads);
    let log = Log::open_with_sha256(&input, options, &threads)?;
    let session = CameraSession::new(&log, options)?;
    drop(log); // and the readings of its sensors
    let camera = ReadyCamera::new(session, model, options, &threads, progress)?;
    let done = write(output, vec![camera], Vec::new(), options, (&threads, progress))?;
    done.into_iter().next().ok_or_else(|| Error::Usage("no camera".into()))
}

/// As [`correct`]; where the log has several cameras and none is selected, corrects each with a
/// model of its own.
///
/// # Errors
/// As [`correct`]. A camera that cannot be corrected is left as it is and reported, where another
/// one can.
pub fn correct_all(
    input: impl Into<LogFiles>,
    output: &Path,
    model: Option<ModelFile>,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Vec<(Report, ModelFile)>> {
    let input = input.into();
    ensure_writable(&input, output, options)?;
    let threads = Threads::new(options.threads);
    let log = Log::open_with_sha256(&input, options, &threads)?;
    // A model and a rig file are of one camera.
    let is_of_one = model.is_some() || options.rig.camera != CameraFacts::default();
    let sessions = match CameraSession::new(&log, options) {
        Err(Error::SeveralCameras { topics }) if !is_of_one => {
            let survey = |topic: &String| CameraSession::new(&log, &options.for_camera(topic));
            topics.iter().map(|topic| (topic.clone(), survey(topic))).collect()
        }
        session => vec![(String::new(), Ok(session?))],
    };
    drop(log); // and the readings of its sensors
    let (mut cameras, mut left_out, mut first_error) = (Vec::new(), Vec::new(), None);
    for (topic, session) in sessions {
        let ready = |session| ReadyCamera::new(session, model.clone(), options, &threads, progress);
        match session.and_then(ready) {
            Ok(camera) => cameras.push(camera),
            Err(e) => {
                let reason = e.to_string();
                left_out.push(Diagnostic::on(&topic, LogFact::CameraLeftOut { reason }));
                first_error.get_or_insert(e);
            }
        }
    }
    match first_error {
        Some(error) if cameras.is_empty() => Err(error),
        _ => write(output, cameras, left_out, options, (&threads, progress)),
    }
}

fn ensure_writable(input: &LogFiles, output: &Path, options: &Options) -> Result<()> {
    options.config.ensure_valid().map_err(Error::Usage)?;
    for file in input.files()? {
        check_output_path(&file, output, options.force)?;
    }
    only(options).map(drop)
}

/// Pass two over all cameras at once.
fn write(
    output: &Path,
    cameras: Vec<ReadyCamera>,
    left_out: Vec<Diagnostic>,
    options: &Options,
    (threads, progress): (&Threads, &dyn Progress),
) -> Result<Vec<(Report, ModelFile)>> {
    let first = &cameras.first().ok_or_else(no_camera)?.session;
    let wire = output_wire(first);
    // A profile promises how every channel is encoded.
    let profile = match (first.recording.profile.as_str(), wire) {
        ("ros1", WireFormat::Cdr | WireFormat::Protobuf)
        | ("ros2", WireFormat::Ros1 | WireFormat::Protobuf) => "",
        (profile, _) => profile,
    };
    let file = Output::create(output, profile, &options.config.output)?;
    let outputs = cameras.iter().enumerate().map(|(i, camera)| camera.output(i == 0, wire));
    let input = Input::new(outputs.collect(), options.window(), only(options)?.as_ref());
    let mut input = input.ok_or_else(no_camera)?;
    input.shard = options.shard;
    let (reports, _) = pass_two(&input, file, left_out, threads, progress)?;
    Ok(reports.into_iter().zip(cameras).map(|(report, c)| (report, c.model.file)).collect())
}

fn no_camera() -> Error {
    Error::Usage("no camera".into())
}

/// Pass two again over the cameras of a log, each with its options and its model, without an
/// output. Returns fingerprints of the messages that it would add, by topic.
///
/// # Errors
/// As [`correct`].
pub fn repeat(
    input: &LogFiles,
    cameras: Vec<(Options, ModelFile)>,
    progress: &dyn Progress,
) -> Result<BTreeMap<String, ChannelDigest>> {
    let (first, _) = cameras.first().ok_or_else(no_camera)?;
    // No topic of the input is needed, not even one that was added before.
    let no_topic = |options: &Options| {
        let mut options = options.clone();
        options.config.output.only = Some("^$".into());
        options
    };
    let options = no_topic(first);
    let threads = Threads::new(options.threads);
    let log = Log::open_with_sha256(input, &options, &threads)?;
    let ready = |(options, model): (Options, ModelFile)| {
        let options = no_topic(&options);
        let session = CameraSession::new(&log, &options)?;
        ReadyCamera::new(session, Some(model), &options, &threads, progress)
    };
    let cameras = cameras.into_iter().map(ready).collect::<Result<Vec<_>>>()?;
    drop(log); // and the readings of its sensors
    let wire = output_wire(&cameras.first().ok_or_else(no_camera)?.session);
    let outputs = cameras.iter().enumerate().map(|(i, camera)| camera.output(i == 0, wire));
    let input = Input::new(outputs.collect(), options.window(), only(&options)?.as_ref());
    let discarded = Output::discarding(&options.config.output);
    let input = input.ok_or_else(no_camera)?;
    let (_, output) = pass_two(&input, discarded, Vec::new(), &threads, progress)?;
    Ok(output.digests())
}
