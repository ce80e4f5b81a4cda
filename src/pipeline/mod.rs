//! The whole run on one screen: scan the log, survey it, estimate (pass one), correct (pass two).

mod beam_picture;
pub mod clock_offsets;
mod mount_words;
mod ordered_map;
mod pass_one;
mod pass_two;
pub mod scan;
pub mod survey;

use std::path::Path;

use sha2::Digest;

use crate::config::{Config, Estimator, Method, OutputEncoding, Spreading};
use crate::correct::{Correction, MeanFrames, rendering};
use crate::error::{Error, Result};
use crate::estimate::{Estimate, FollowedSetting, FoundBackscatter, FrameSamples, MatchedPair, PlacedStrobe, tracks, understand};
use crate::geometry::LightPath;
use crate::image::{Bands, Container};
use crate::messages::writer::OutputWire;
use crate::model::{
    BackscatterFile, BeamPatternFile, FORMAT, FrameGainFile, Frustum, GlowTable, ImagingModel, InputFile, LampFile, LightSettingFile, ModelFile,
    RenderingFile, SpreadingModel, StrobeFile,
};
use crate::recording::{Output, Recording, Window, ensure_distinct};
use crate::report::Report;
use crate::spaces::{Body, Optical, Strobe, Transform};
use crate::vehicle::{CameraFacts, Lamp, Lamps, MountFacts, Rig, RigFile, SettingSeries, StrobeMount};

use mount_words::mount_check;
use ordered_map::Threads;
use pass_one::{Collected, collect};
use pass_two::{OfCamera, PassTwo, place_of};
pub use pass_two::{corrected_topic, method_name, output_container};
use scan::{Scan, scan};
use survey::{Selection, Survey, survey};

/// A stretch of the run that takes time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// pass one: frames
    Estimate,
    /// pass one: pairs of frames
    Match,
    /// pass two: frames
    Correct,
}

/// Who is told how far the run is.
pub trait Progress {
    /// A step of so many units begins.
    fn begin(&self, step: Step, total: usize);
    /// So many more are done.
    fn advance(&self, units: usize);
    /// The step is over.
    fn end(&self);
}

/// Nobody is told.
pub struct Silent;

impl Progress for Silent {
    fn begin(&self, _: Step, _: usize) {}
    fn advance(&self, _: usize) {}
    fn end(&self) {}
}

/// All that a run is told, beside the input's name.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// choices
    pub config: Config,
    /// facts
    pub rig: RigFile,
    /// which channels
    pub selection: Selection,
    /// which stretch; all of it where `None`
    pub window: Option<Window>,
    /// cores; 0 means all
    pub threads: usize,
    /// overwrite the output
    pub force: bool,
}

impl Options {
    fn window(&self) -> Window {
        self.window.unwrap_or(Window::ALL)
    }
}

/// A log that has been walked once and understood.
pub struct Prepared {
    /// the log
    pub recording: Recording,
    /// what it says
    pub scan: Scan,
    /// what that means
    pub survey: Survey,
}

/// Opens a log and walks it once.
///
/// # Errors
/// It cannot be read, or holds nothing.
pub fn open(path: &Path, options: &Options) -> Result<(Recording, Scan)> {
    let recording = Recording::open(path)?;
    let scan = scan(&recording, options.window(), &options.rig.dvl);
    if scan.messages == 0 {
        let detail = match (scan.damage.len(), options.window) {
            (_, Some(_)) => " in the stretch that -S and -E leave".into(),
            (0, _) => String::new(),
            (n, _) => format!(" ({n} places are damaged: {})", scan.damage[0].reason),
        };
        return Err(Error::Empty { path: path.into(), detail });
    }
    Ok((recording, scan))
}

/// Opens a log, walks it once and finds camera, ranges and mounts.
///
/// # Errors
/// What is missing, and what supplies it.
pub fn prepare(path: &Path, options: &Options) -> Result<Prepared> {
    let (recording, mut scan) = open(path, options)?;
    let survey = survey(&recording, &mut scan, &options.selection, &options.rig, &options.config)?;
    Ok(Prepared { recording, scan, survey })
}

/// Pass one over one log or several of the same dive, camera and strobe.
///
/// # Errors
/// A log cannot be used, or attenuation cannot be estimated.
pub fn estimate_logs(paths: &[&Path], options: &Options, progress: &dyn Progress) -> Result<(ModelFile, Vec<String>)> {
    let threads = Threads::new(options.threads);
    let logs = paths.iter().map(|path| prepare(path, options)).collect::<Result<Vec<_>>>()?;
    let warnings = logs.iter().flat_map(|p| p.survey.warnings.clone()).collect();
    let collected = logs.iter().map(|log| Ok((log, pass_one(log, options, &threads, progress)?))).collect::<Result<Vec<_>>>()?;
    Ok((model_of(collected, options)?, warnings))
}

/// Both passes, or pass two alone where a model is given, of one camera: IN → OUT.
///
/// # Errors
/// Nothing stands under OUT's name then. Several cameras of which none was chosen are an error too.
pub fn correct(input: &Path, output: &Path, model: Option<ModelFile>, options: &Options, progress: &dyn Progress) -> Result<(Report, ModelFile)> {
    ensure_writable(input, output, options)?;
    let threads = Threads::new(options.threads);
    let ready = make_ready(input, model, options, &threads, progress)?;
    let mut done = write_corrected(output, vec![ready], options, &threads, progress, Vec::new())?;
    done.pop().ok_or_else(|| Error::Usage("no camera".into()))
}

/// As [`correct`]; where the log has several cameras and none was chosen, each with a model of its own.
///
/// # Errors
/// As [`correct`]; a camera that cannot be corrected is left as it is, and listed, where another one can.
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
                        left_out.push(format!("{topic}: {e}"));
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
    ensure_distinct(input, output, options.force)?;
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
    glow: Option<GlowTable>,
    means: MeanFrames,
    rig_toml: String,
}

fn make_ready(input: &Path, model: Option<ModelFile>, options: &Options, threads: &Threads, progress: &dyn Progress) -> Result<Ready> {
    let mut prepared = prepare(input, options)?;
    let method = options.config.render.method;
    let (mut file, means) = match model {
        // Exposure goes with what is removed: a model made for another method is shown anew, from samples without keypoints.
        Some(file) if file.rendering.method == method && !method.needs_mean_frames() => (file, Default::default()),
        Some(mut file) => {
            let mut quick = options.clone();
            quick.config.estimate.estimator = Estimator::Altitude;
            let collected = pass_one(&prepared, &quick, threads, progress)?;
            let imaging_model = file.imaging_model().map_err(Error::Usage)?;
            let mount = strobe_of(&file, &prepared.survey.rig).lamps;
            file.rendering = shown(&collected.frames, &imaging_model, mount, prepared.survey.white_level, &options.config);
            (file, collected.means)
        }
        None => {
            let mut collected = pass_one(&prepared, options, threads, progress)?;
            let means = std::mem::take(&mut collected.means);
            (model_of(vec![(&prepared, collected)], options)?, means)
        }
    };
    // Exposure is the model's; how highlights are shown is this run's.
    file.rendering.shoulder_from = Some(options.config.render.shoulder_from);
    // The pattern's angles are about the strobe that the model was made with.
    prepared.survey.rig.strobe = strobe_of(&file, &prepared.survey.rig);
    // A model from elsewhere knows its camera's full scale; this log's own bits say less when it is dark.
    prepared.survey.white_level = options.config.light.white_level.or(file.rendering.white_level).or(prepared.survey.white_level);
    ensure_not_corrected(&prepared, &options.config, only(options)?.as_ref())?;
    let model = file.imaging_model().map_err(Error::Usage)?;
    let glow = glow_table(&model, &prepared.survey.rig, method);
    let rig_toml = toml::to_string_pretty(&survey::rig_facts(&prepared.survey.rig, &options.rig)).unwrap_or_default();
    Ok(Ready { prepared, file, model, glow, means, rig_toml })
}

impl Ready {
    fn for_pass_two<'r>(&'r self, is_first: bool, options: &'r Options, wire: OutputWire) -> OfCamera<'r> {
        let Self { prepared: Prepared { scan, survey, .. }, file, model, glow, means, rig_toml } = self;
        let correction = Correction {
            model,
            glow: model.backscatter.as_ref().zip(glow.as_ref()),
            rendering: &file.rendering,
            config: &options.config.render,
            means,
            clipped_above: options.config.estimate.clipped_above as f32,
            electrons: survey.electrons,
        };
        let place = if is_first { String::new() } else { place_of(&survey.camera_topic) };
        OfCamera { scan, survey, config: &options.config, wire, file, model, correction, rig_toml, place }
    }
}

/// Pass two over all cameras at once.
fn write_corrected(
    output: &Path,
    cameras: Vec<Ready>,
    options: &Options,
    threads: &Threads,
    progress: &dyn Progress,
    left_out: Vec<String>,
) -> Result<Vec<(Report, ModelFile)>> {
    let Some(first) = cameras.first().map(|c| &c.prepared) else { return Err(Error::Usage("no camera".into())) };
    let wire = output_wire(first, &options.config);
    // A profile promises how every channel is encoded.
    let profile = match (first.recording.profile.as_str(), wire) {
        ("ros1", OutputWire::Cdr | OutputWire::Protobuf) | ("ros2", OutputWire::Ros1 | OutputWire::Protobuf) => "",
        (profile, _) => profile,
    };
    let source_sha256 = sha256(first.recording.bytes());
    let out = Output::create(output, profile, &options.config.output)?;
    let pass_two = PassTwo {
        recording: &first.recording,
        window: options.window(),
        config: &options.config,
        cameras: cameras.iter().enumerate().map(|(i, camera)| camera.for_pass_two(i == 0, options, wire)).collect(),
        source_sha256: &source_sha256,
        only: only(options)?,
        left_out,
    };
    let reports = pass_two.run(out, threads, progress)?;
    Ok(reports.into_iter().zip(cameras).map(|(report, camera)| (report, camera.file)).collect())
}

/// What the water scatters back, ray by ray, for methods that take the water away.
fn glow_table(model: &ImagingModel, rig: &Rig, method: Method) -> Option<GlowTable> {
    let backscatter = model.backscatter.filter(|_| matches!(method, Method::Full | Method::Attenuation))?;
    let (w, h) = ((rig.camera.width - 1) as f64, (rig.camera.height - 1) as f64);
    let edge = (0..=16).map(|k| f64::from(k) / 16.0).flat_map(|t| [(t * w, 0.0), (t * w, h), (0.0, t * h), (w, t * h)]);
    let rays = edge.filter_map(|(u, v)| rig.camera.image_plane(u, v)).map(|(x, y)| (x, y, GLOW_REACHES_M));
    Some(GlowTable::new(&model.beam_pattern, rig.body_from_optical, &rig.strobe.lamps, &backscatter.attenuation_per_m, Frustum::around(rays)))
}

/// Beyond this the strobe's light adds nothing to what the water has scattered back [m].
const GLOW_REACHES_M: f64 = 12.0;

fn pass_one(log: &Prepared, options: &Options, threads: &Threads, progress: &dyn Progress) -> Result<Collected> {
    collect(&log.recording, &log.scan, &log.survey, options.window(), &options.config, threads, progress)
}

/// Samples of all logs → one model.
fn model_of(logs: Vec<(&Prepared, Collected)>, options: &Options) -> Result<ModelFile> {
    let Some((first, _)) = logs.first() else { return Err(Error::Usage("no log was given".into())) };
    let first = *first;
    let (mut frames, mut pairs, mut inputs) = (Vec::new(), Vec::new(), Vec::new());
    let mut settings: Vec<Vec<f64>> = vec![Vec::new(); first.survey.settings.len()];
    for (log, mut collected) in logs {
        let offset = frames.len();
        inputs.push(InputFile {
            name: log.recording.path().file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default(),
            sha256: sha256(log.recording.bytes()),
            camera_topic: log.survey.camera_topic.clone(),
            dvl_topic: log.survey.dvl_topic.clone(),
            frames: collected.frames.len(),
        });
        for (values, series) in settings.iter_mut().zip(&first.survey.settings) {
            let same = log.survey.settings.iter().find(|s| (&s.topic, &s.name) == (&series.topic, &series.name));
            values.extend(collected.frames.iter().map(|f| same.and_then(|s| s.at(f.stamp)).unwrap_or(f64::NAN)));
        }
        frames.append(&mut collected.frames);
        pairs.extend(collected.pairs.into_iter().map(|p| MatchedPair { a: p.a + offset, b: p.b + offset, ..p }));
    }
    if frames.is_empty() {
        let reason = match first.survey.frames.len() {
            0 => "the camera has no pictures".to_string(),
            n => format!("none of {n} pictures has a seafloor below it and can be decoded"),
        };
        return Err(Error::NotEstimated { reason, remedy: "`unwater inspect` says what is missing".into() });
    }
    let config = &options.config;
    let tracks = tracks(&frames, &pairs);
    let rig = &first.survey.rig;
    let given = (rig.strobe.lamps, rig.strobe.source.is_some());
    let found = understand(frames, tracks, rig.body_from_optical, given, &settings, rig.body_from_dvl.origin().vector(), &config.estimate)?;
    let mount = found.strobe.lamps;
    let rendering = shown(&found.frames, &found.estimate.model, mount, first.survey.white_level, config);
    let uneven = found.frames.iter().zip(&found.log_gains).filter(|(_, g)| **g != 0.0);
    let frame_gains: Vec<FrameGainFile> = uneven.map(|(f, g)| FrameGainFile { stamp_ns: f.stamp.0, gain: g.exp() }).collect();
    let mut warnings: Vec<String> = found.strobe.warning.iter().cloned().collect();
    if !frame_gains.is_empty() {
        warnings
            .push(format!("{} frames got another amount of light than their neighbours (strobe drop-outs); they are set right", frame_gains.len()));
    }
    let camera_topic = &first.survey.camera_topic;
    let offset_s = options.rig.time_offset_s.get(camera_topic).copied().unwrap_or(0.0);
    let mount_check = found.mounts.map(|m| mount_check(&m, rig, camera_topic, offset_s)).map(|(file, said)| {
        warnings.extend(said);
        file
    });
    let light_setting = |f: &FollowedSetting| {
        let SettingSeries { topic, name, .. } = &first.survey.settings[f.index];
        LightSettingFile { topic: topic.clone(), name: name.clone(), law: f.law, reference: f.reference }
    };
    let light_settings = found.followed.iter().map(light_setting).collect();
    let strobe = Some(strobe_file(&found.strobe, rig));
    let backscatter = found.backscatter.as_ref().map(|b| backscatter_file(b, found.estimate.model.bands));
    Ok(ModelFile { strobe, mount_check, backscatter, frame_gains, light_settings, warnings, ..file_of(found.estimate, rendering, inputs, config) })
}

fn backscatter_file(found: &FoundBackscatter, bands: usize) -> BackscatterFile {
    let of = |values: &Bands| values[..bands].to_vec();
    BackscatterFile {
        strength_per_m: of(&found.backscatter.strength_per_m),
        strength_std_per_m: of(&found.std_per_m),
        attenuation_per_m: of(&found.backscatter.attenuation_per_m),
        shape: found.backscatter.shape,
        median_share: of(&found.share),
        held_out_improvement: found.improvement,
    }
}

/// Exposure and white balance, from the samples' corrected light.
fn shown(frames: &[FrameSamples], model: &ImagingModel, mount: Lamps, white_level: Option<u16>, config: &Config) -> RenderingFile {
    let lit = frames.iter().flat_map(|f| f.grid.iter().filter_map(move |(_, s)| Some((s.log_color, s.path(mount)?))));
    let lit: Vec<([f32; 3], LightPath)> = lit.collect();
    rendering(&lit, model, white_level, &config.render)
}

/// The strobe a model was made with, in this rig; the rig's own where the model says nothing.
fn strobe_of(file: &ModelFile, rig: &Rig) -> StrobeMount {
    match &file.strobe {
        Some(s) => {
            let optical_from_strobe: Transform<Optical, Strobe> = Transform::from_parts(s.position_in_optical_m, s.rotation_xyzw);
            let first: Transform<Body, Strobe> = rig.body_from_optical * optical_from_strobe;
            let of_lamp = |l: &LampFile| (first * Transform::from_parts(l.offset_m, l.rotation_xyzw), l.share);
            let lamps = Lamps::several(&s.lamps.iter().map(of_lamp).collect::<Vec<_>>()).unwrap_or_else(|| Lamps::one(first));
            StrobeMount { lamps, source: Some(s.source.clone()) }
        }
        None => rig.strobe.clone(),
    }
}

fn strobe_file(placed: &PlacedStrobe, rig: &Rig) -> StrobeFile {
    let facts = MountFacts::of((rig.body_from_optical.inverse() * placed.lamps.body_from_strobe()).isometry());
    let lamp = |l: &Lamp| LampFile { offset_m: l.offset.into(), rotation_xyzw: l.turn.coords.into(), share: l.share };
    let lamps = if placed.lamps.lamps().len() > 1 { placed.lamps.lamps().iter().map(lamp).collect() } else { Vec::new() };
    StrobeFile {
        lamps,
        position_in_optical_m: facts.translation_m,
        rotation_xyzw: facts.rotation_xyzw.unwrap_or([0.0, 0.0, 0.0, 1.0]),
        source: placed.source.map(String::from).or_else(|| rig.strobe.source.clone()).unwrap_or_else(|| "camera".into()),
        position_std_m: placed.search.as_ref().map(|s| s.std_m).filter(|s| s.iter().all(|v| v.is_finite())),
        moved_m: placed.search.as_ref().map(|s| s.moved_m),
    }
}

fn file_of(found: Estimate, rendering: RenderingFile, inputs: Vec<InputFile>, config: &Config) -> ModelFile {
    let bands = found.model.bands;
    let SpreadingModel { strobe_leg, camera_leg } = found.model.spreading;
    ModelFile {
        format: FORMAT.into(),
        version: 1,
        spreading: config.estimate.spreading,
        spreading_exponents: Some([strobe_leg, camera_leg]),
        incidence: found.model.incidence,
        attenuation_per_m: found.model.attenuation_per_m[..bands].to_vec(),
        attenuation_std_per_m: found.attenuation_std_per_m[..bands].iter().map(|s| s.is_finite().then_some(*s)).collect(),
        attenuation_kind: if config.estimate.spreading == Spreading::None { "effective" } else { "physical" }.into(),
        identified: found.not_identified_because.is_none(),
        not_identified_because: found.not_identified_because,
        estimator: found.estimator.into(),
        estimators: found.answers,
        beam_pattern: BeamPatternFile::of(&found.model.beam_pattern),
        strobe: None,
        mount_check: None,
        backscatter: None,
        frame_gains: Vec::new(),
        light_settings: Vec::new(),
        warnings: Vec::new(),
        segments: found.model.over_time.clone(),
        rendering,
        inputs,
    }
}

/// How added messages are encoded.
fn output_wire(prepared: &Prepared, config: &Config) -> OutputWire {
    let of_camera = prepared.survey.camera_channels.first().and_then(|id| prepared.recording.channels.get(id));
    match config.output.encoding {
        OutputEncoding::Auto if of_camera.is_some_and(|c| c.message_encoding == "protobuf") => OutputWire::Protobuf,
        OutputEncoding::Auto | OutputEncoding::Cdr => OutputWire::Cdr,
        OutputEncoding::Ros1 => OutputWire::Ros1,
        OutputEncoding::Protobuf => OutputWire::Protobuf,
    }
}

/// Refuses a log that holds what would be added: old and new would be one channel.
fn ensure_not_corrected(prepared: &Prepared, config: &Config, only: Option<&regex::Regex>) -> Result<()> {
    let corrected = corrected_topic(&prepared.survey.camera_topic, output_container(prepared.survey.container, config) != Container::Raw);
    let is_ours = |topic: &str| topic == corrected || topic.starts_with("/unwater/");
    match prepared.recording.channels.values().find(|c| is_ours(&c.topic) && only.is_none_or(|o| o.is_match(&c.topic))) {
        Some(channel) => Err(Error::Usage(format!(
            "the log holds {} already: it has been corrected before; correct the original, or leave these topics out with --only",
            channel.topic
        ))),
        None => Ok(()),
    }
}

/// A fingerprint in hexadecimal.
pub fn sha256(bytes: &[u8]) -> String {
    sha2::Sha256::digest(bytes).iter().map(|b| format!("{b:02x}")).collect()
}
