//! The whole run on one screen: index the log, survey it, estimate (pass one), correct (pass two).

mod beam_picture;
pub mod bench;
pub mod clock_offsets;
pub mod memory;
mod model_of;
mod mount_check;
mod pass_one;
mod pass_two;

use std::path::Path;

use crate::config::{Config, EstimateConfig, Estimator, Method, OutputEncoding};
use crate::correct::{Correction, MeanFrames};
use crate::diagnostics::{Diagnostic, LogFact};
use crate::error::{Error, Result};
use crate::estimate::samples_for_model;
use crate::image::Container;
use crate::messages::writer::WireFormat;
use crate::model::{Frustum, ImagingModel, ModelFile, ScatterTable};
use crate::parallel::Threads;
use crate::recording::{Output, Recording, check_output_path};
use crate::report::Report;
use crate::session::survey::{self, Survey};
use crate::session::{Options, Prepared, Progress, prepare_to_write};
use crate::vehicle::{CameraFacts, Rig};

use model_of::{model_of, shown, strobe_of};
use pass_one::{Collected, collect};
use pass_two::{OfCamera, PassTwo, place_of};
pub use pass_two::{corrected_topic, method_name, output_container};

/// Pass one over one log or several of the same dive, camera and strobe.
///
/// # Errors
/// A log cannot be used, or attenuation cannot be estimated.
pub fn estimate_logs(
    paths: &[&Path],
    options: &Options,
    progress: &dyn Progress,
) -> Result<(ModelFile, Vec<Diagnostic>)> {
    let threads = Threads::new(options.threads);
    let logs = paths
        .iter()
        .map(|path| prepare_to_write(path, options, &threads))
        .collect::<Result<Vec<_>>>()?;
    ensure_alike(&logs)?;
    let diagnostics = logs.iter().flat_map(|p| p.survey.diagnostics.clone()).collect();
    Ok((learnt(&logs, options, &threads, progress)?.0, diagnostics))
}

/// Logs of one model must be of one camera, and each must be another.
fn ensure_alike(logs: &[Prepared]) -> Result<()> {
    let name = |log: &Prepared| log.recording.path().display().to_string();
    for (n, log) in logs.iter().enumerate() {
        for before in &logs[..n] {
            if log.recording.sha256()? == before.recording.sha256()? {
                return Err(Error::Usage(format!(
                    "{} and {} are the same log",
                    name(before),
                    name(log)
                )));
            }
            let of = |log: &Prepared| {
                (log.survey.rig.camera.width, log.survey.rig.camera.height, log.survey.container)
            };
            let ((w, h, _), (v, g, _)) = (of(before), of(log));
            if of(log) != of(before) {
                return Err(Error::Usage(format!(
                    "{} ({w}×{h}) and {} ({v}×{g}) are of different cameras or picture formats; a \
                     model is of one camera and strobe",
                    name(before),
                    name(log)
                )));
            }
        }
    }
    Ok(())
}

/// Pass one over more and more frames, until attenuation is known as well as
/// `estimate.precision_per_m` asks for; and the mean frames of the first log.
fn learnt(
    logs: &[Prepared],
    options: &Options,
    threads: &Threads,
    progress: &dyn Progress,
) -> Result<(ModelFile, MeanFrames)> {
    let EstimateConfig { first_frames, max_frames, precision_per_m, .. } = options.config.estimate;
    // Mean frames want many, whatever is known of the water.
    let wants_all = options.config.render.method.needs_mean_frames() || precision_per_m == 0.0;
    let mut most = if wants_all { max_frames } else { first_frames.min(max_frames) };
    loop {
        let pass_one = |log| Ok((log, pass_one(log, options, most, threads, progress)?));
        let mut collected =
            logs.iter().map(pass_one).collect::<Result<Vec<(&Prepared, Collected)>>>()?;
        let is_all = collected.iter().all(|(_, c)| c.is_all);
        let means =
            collected.first_mut().map(|(_, c)| std::mem::take(&mut c.means)).unwrap_or_default();
        let model = threads.install(|| model_of(collected, options));
        if is_all || most >= max_frames {
            return Ok((model?, means));
        }
        let is_precise = |m: &ModelFile| {
            m.attenuation_std_per_m.iter().all(|std| std.is_some_and(|std| std <= precision_per_m))
        };
        // Where the light or the water changed among a few frames, it did so among others.
        let is_steady = |m: &ModelFile| m.frame_gains.is_empty() && m.segments.0.is_empty();
        match model {
            Ok(model) if model.identified && is_steady(&model) && is_precise(&model) => {
                return Ok((model, means));
            }
            Ok(model) if model.identified && is_steady(&model) => most = (2 * most).min(max_frames),
            // What a few stretches do not tell is for all to tell.
            _ => most = max_frames,
        }
    }
}

/// Both passes, or pass two alone where a model is given, of one camera: IN → OUT.
///
/// # Errors
/// Nothing stands under OUT's name then. Several cameras of which none was chosen are an error too.
pub fn correct(
    input: &Path,
    output: &Path,
    model: Option<ModelFile>,
    options: &Options,
    progress: &dyn Progress,
) -> Result<(Report, ModelFile)> {
    ensure_writable(input, output, options)?;
    let threads = Threads::new(options.threads);
    let ready = make_ready(input, model, options, &threads, progress)?;
    let mut done = write_corrected(output, vec![ready], options, &threads, progress, Vec::new())?;
    done.pop().ok_or_else(|| Error::Usage("no camera".into()))
}

/// As [`correct`]; where the log has several cameras and none was chosen, each with a model of its
/// own.
///
/// # Errors
/// As [`correct`]; a camera that cannot be corrected is left as it is, and listed, where another
/// one can.
pub fn correct_all(
    input: &Path,
    output: &Path,
    model: Option<ModelFile>,
    options: &Options,
    progress: &dyn Progress,
) -> Result<Vec<(Report, ModelFile)>> {
    ensure_writable(input, output, options)?;
    let threads = Threads::new(options.threads);
    let of_one = model.is_some() || options.rig.camera != CameraFacts::default();
    let (mut ready, mut left_out) = (Vec::new(), Vec::new());
    match make_ready(input, model, options, &threads, progress) {
        // A model and a rig file speak of one camera.
        Err(Error::SeveralCameras { topics }) if !of_one => {
            let mut first_error = None;
            for topic in topics {
                let mut chosen = options.clone();
                chosen.selection.camera = Some(topic.clone());
                match make_ready(input, None, &chosen, &threads, progress) {
                    Ok(camera) => ready.push(camera),
                    Err(e) => {
                        let reason = e.to_string();
                        left_out.push(Diagnostic::on(&topic, LogFact::CameraLeftOut { reason }));
                        first_error.get_or_insert(e);
                    }
                }
            }
            if let (true, Some(error)) = (ready.is_empty(), first_error) {
                return Err(error);
            }
        }
        one => ready.push(one?),
    }
    write_corrected(output, ready, options, &threads, progress, left_out)
}

fn ensure_writable(input: &Path, output: &Path, options: &Options) -> Result<()> {
    options.config.ensure_valid().map_err(Error::Usage)?;
    check_output_path(input, output, options.force)?;
    only(options).map(drop)
}

/// `--only`
fn only(options: &Options) -> Result<Option<regex::Regex>> {
    let only = options.config.output.only.as_ref().map(|o| regex::Regex::new(o)).transpose();
    only.map_err(|e| Error::Usage(format!("--only: {e}")))
}

/// A camera of which all is known that pass two needs.
struct Ready {
    prepared: Prepared,
    file: ModelFile,
    model: ImagingModel,
    /// the same with a finer beam pattern
    fine: ImagingModel,
    glow: Option<ScatterTable>,
    means: MeanFrames,
    rig_toml: String,
    /// those of the model
    diagnostics: Vec<Diagnostic>,
}

fn make_ready(
    input: &Path,
    model: Option<ModelFile>,
    options: &Options,
    threads: &Threads,
    progress: &dyn Progress,
) -> Result<Ready> {
    let mut prepared = prepare_to_write(input, options, threads)?;
    let method = options.config.render.method;
    let (mut file, means) = match model {
        // Exposure goes with what is removed: a model made for another method is shown anew, from
        // samples without keypoints.
        Some(file) if file.rendering.method == method && !method.needs_mean_frames() => {
            (file, Default::default())
        }
        Some(mut file) => {
            let mut quick = options.clone();
            quick.config.estimate.estimator = Estimator::Altitude;
            let collected =
                pass_one(&prepared, &quick, quick.config.estimate.max_frames, threads, progress)?;
            let imaging_model = file.imaging_model().map_err(Error::Usage)?;
            let Survey { rig, .. } = &prepared.survey;
            let strobe = strobe_of(&file, rig);
            let mount = strobe.lamps;
            let glow = glow_table(&imaging_model, &Rig { strobe, ..rig.clone() }, method);
            let log_gains: Vec<f64> = collected
                .frames
                .iter()
                .map(|f| prepared.survey.frame_gain(&file, f.stamp).ln())
                .collect();
            let veil = imaging_model.backscatter.as_ref().zip(glow.as_ref());
            let frames =
                samples_for_model(collected.frames, &log_gains, rig.body_from_optical, mount, veil);
            file.rendering =
                shown(&frames, &imaging_model, mount, prepared.survey.white_level, &options.config);
            (file, collected.means)
        }
        None => learnt(std::slice::from_ref(&prepared), options, threads, progress)?,
    };
    // Exposure is the model's; how highlights are shown is this run's.
    file.rendering.shoulder_from = Some(options.config.render.shoulder_from);
    // The pattern's angles are about the strobe that the model was made with.
    prepared.survey.rig.strobe = strobe_of(&file, &prepared.survey.rig);
    // A model from elsewhere knows its camera's full scale; this log's own bits say less when it is
    // dark.
    prepared.survey.white_level = options
        .config
        .light
        .white_level
        .or(file.rendering.white_level)
        .or(prepared.survey.white_level);
    ensure_not_corrected(
        &prepared.recording,
        &prepared.survey,
        &options.config,
        only(options)?.as_ref(),
    )?;
    let missing = prepared.survey.missing_settings(&file);
    prepared.survey.diagnostics.extend(missing);
    let own = prepared.recording.sha256()?;
    let is_of_this_log = file.inputs.iter().any(|input| input.sha256 == own);
    let mut diagnostics = file.diagnostics.clone();
    if !is_of_this_log {
        let logs: Vec<&str> = file.inputs.iter().map(|input| input.name.as_str()).collect();
        diagnostics.iter_mut().for_each(|d| d.model_log = Some(logs.join(", ")));
    }
    let model = file.imaging_model().map_err(Error::Usage)?;
    let glow = glow_table(&model, &prepared.survey.rig, method);
    let rig_toml = toml::to_string_pretty(&survey::rig_facts(&prepared.survey.rig, &options.rig))
        .unwrap_or_default();
    let fine =
        ImagingModel { beam_pattern: model.beam_pattern.refined(BEAM_REFINED), ..model.clone() };
    Ok(Ready { prepared, file, model, fine, glow, means, rig_toml, diagnostics })
}

impl Ready {
    fn for_pass_two<'r>(
        &'r self,
        is_first: bool,
        options: &'r Options,
        wire: WireFormat,
    ) -> OfCamera<'r> {
        let Self {
            prepared: Prepared { scan, survey, .. },
            file,
            model,
            fine,
            glow,
            means,
            rig_toml,
            diagnostics,
        } = self;
        let correction = Correction {
            model: fine,
            roughness: fine.beam_pattern.roughness(BEAM_ROUGHEST),
            glow: model.backscatter.as_ref().zip(glow.as_ref()),
            rendering: &file.rendering,
            config: &options.config.render,
            means,
            clipped_above: options.config.estimate.clipped_above as f32,
            electrons: survey.electrons,
        };
        let place = if is_first { String::new() } else { place_of(&survey.camera_topic) };
        OfCamera {
            scan,
            survey,
            config: &options.config,
            wire,
            file,
            model,
            correction,
            rig_toml,
            model_diagnostics: diagnostics,
            place,
        }
    }
}

/// Pass two over all cameras at once.
fn write_corrected(
    output: &Path,
    cameras: Vec<Ready>,
    options: &Options,
    threads: &Threads,
    progress: &dyn Progress,
    left_out: Vec<Diagnostic>,
) -> Result<Vec<(Report, ModelFile)>> {
    let Some(first) = cameras.first().map(|c| &c.prepared) else {
        return Err(Error::Usage("no camera".into()));
    };
    let wire = output_wire(first, &options.config);
    // A profile promises how every channel is encoded.
    let profile = match (first.recording.profile.as_str(), wire) {
        ("ros1", WireFormat::Cdr | WireFormat::Protobuf)
        | ("ros2", WireFormat::Ros1 | WireFormat::Protobuf) => "",
        (profile, _) => profile,
    };
    let source_sha256 = first.recording.sha256()?;
    let (out, file) = Output::create(output, profile, &options.config.output)?;
    let pass_two = PassTwo {
        recording: &first.recording,
        window: options.window(),
        config: &options.config,
        cameras: cameras
            .iter()
            .enumerate()
            .map(|(i, camera)| camera.for_pass_two(i == 0, options, wire))
            .collect(),
        source_sha256,
        only: only(options)?,
        left_out,
    };
    let reports = pass_two.run(out, file, threads, progress)?;
    Ok(reports.into_iter().zip(cameras).map(|(report, camera)| (report, camera.file)).collect())
}

/// What the water scatters back, ray by ray, for methods that take the water away.
fn glow_table(model: &ImagingModel, rig: &Rig, method: Method) -> Option<ScatterTable> {
    let backscatter =
        model.backscatter.filter(|_| matches!(method, Method::Full | Method::Attenuation))?;
    let (w, h) = ((rig.camera.width - 1) as f64, (rig.camera.height - 1) as f64);
    let edge = (0..=16)
        .map(|k| f64::from(k) / 16.0)
        .flat_map(|t| [(t * w, 0.0), (t * w, h), (0.0, t * h), (w, t * h)]);
    let rays =
        edge.filter_map(|(u, v)| rig.camera.image_plane(u, v)).map(|(x, y)| (x, y, GLOW_REACHES_M));
    Some(ScatterTable::new(
        &model.beam_pattern,
        rig.body_from_optical,
        &rig.strobe.lamps,
        &backscatter.attenuation_per_m,
        Frustum::around(rays),
    ))
}

/// Pass two reads the beam pattern from a grid so many times as fine.
const BEAM_REFINED: usize = 8;
/// The gain's grid follows the pattern but for so much of it: its rim, where single nodes are as
/// rough as their noise.
const BEAM_ROUGHEST: f64 = 0.05;
/// Beyond this the strobe's light adds nothing to what the water has scattered back [m].
const GLOW_REACHES_M: f64 = 12.0;

fn pass_one(
    log: &Prepared,
    options: &Options,
    most: usize,
    threads: &Threads,
    progress: &dyn Progress,
) -> Result<Collected> {
    collect(&log.recording, &log.scan, &log.survey, &options.config, most, threads, progress)
}

/// How added messages are encoded.
fn output_wire(prepared: &Prepared, config: &Config) -> WireFormat {
    let of_camera =
        prepared.survey.camera_channels.first().and_then(|id| prepared.recording.channels.get(id));
    match config.output.encoding {
        OutputEncoding::Auto if of_camera.is_some_and(|c| c.message_encoding == "protobuf") => {
            WireFormat::Protobuf
        }
        OutputEncoding::Auto | OutputEncoding::Cdr => WireFormat::Cdr,
        OutputEncoding::Ros1 => WireFormat::Ros1,
        OutputEncoding::Protobuf => WireFormat::Protobuf,
    }
}

/// Refuses a log that holds what would be added: old and new would be one channel.
///
/// # Errors
/// That, with the remedy.
pub fn ensure_not_corrected(
    recording: &Recording,
    survey: &Survey,
    config: &Config,
    only: Option<&regex::Regex>,
) -> Result<()> {
    let corrected = corrected_topic(
        &survey.camera_topic,
        output_container(survey.container, config) != Container::Raw,
    );
    let is_ours = |topic: &str| topic == corrected || topic.starts_with("/unwater/");
    match recording
        .channels
        .values()
        .find(|c| is_ours(&c.topic) && only.is_none_or(|o| o.is_match(&c.topic)))
    {
        Some(channel) => Err(Error::Usage(format!(
            "the log holds {} already: it has been corrected before; correct the original, or \
             leave these topics out with --only",
            channel.topic
        ))),
        None => Ok(()),
    }
}
