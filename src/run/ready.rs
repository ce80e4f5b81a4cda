//! A camera that is ready for pass two: surveyed, with a model and all that is made of it.

use crate::config::JpegQuality;
use crate::correct::{self, MeanFrames};
use crate::diagnostics::{ClockFact, Diagnostic, EstimateFact};
use crate::error::{Error, Result};
use crate::image::tone::Tone;
use crate::messages::writer::WireFormat;
use crate::model::{InputFile, ModelFile};
use crate::parallel::Threads;
use crate::session::survey::rig_facts;
use crate::session::{CameraSession, Options, Progress, sha256};

use super::camera_model::CameraModel;
use super::camera_output::CameraOutput;
use super::clouds::Clouds;
use super::corrector::Corrector;
use super::exposure::{exposed, fit_with_exposure};
use super::jpeg_quality::jpeg_quality;
use super::output_names::{camera_name, ensure_not_corrected};
use super::prepared_model::Rendering;

/// A camera that is ready for pass two.
pub struct ReadyCamera {
    /// log and survey
    pub session: CameraSession,
    /// its model
    pub model: CameraModel,
    means: MeanFrames,
    clouds: Clouds,
    rig_toml: String,
    /// fingerprint of what the run was given beside its input
    request: String,
    /// those of the model
    diagnostics: Vec<Diagnostic>,
}

/// `--only`
pub fn only(options: &Options) -> Result<Option<regex::Regex>> {
    let only = options.config.output.only.as_ref().map(|o| regex::Regex::new(o)).transpose();
    only.map_err(|e| Error::Usage(format!("--only: {e}")))
}

/// Fingerprint of what a run is given beside its input: version, settings, rig file, channels,
/// window and model. Runs of the same input with the same fingerprint write the same bytes.
///
/// # Errors
/// The model cannot be written as JSON.
pub fn request_sha256(options: &Options, model: Option<&ModelFile>) -> Result<String> {
    let failed = |e: serde_json::Error| Error::WriteRecord {
        path: "model.json".into(),
        reason: e.to_string(),
    };
    let model = model.map(ModelFile::to_json).transpose().map_err(failed)?;
    let Options { config, rig, selection, window, beam_from, .. } = options;
    let shared = beam_from.as_deref().map(ModelFile::to_json).transpose().map_err(failed)?;
    let flat_field = rig.camera.flat_field.as_ref().and_then(|path| std::fs::read(path).ok());
    let flat_field = flat_field.map(|bytes| sha256(&bytes));
    let version = env!("CARGO_PKG_VERSION");
    let request = (version, config, rig, selection, window, flat_field, model, shared);
    Ok(sha256(format!("{request:?}").as_bytes()))
}

impl ReadyCamera {
    /// Prepares a camera with a given model, or estimates one first.
    ///
    /// # Errors
    /// Attenuation cannot be estimated, the model contradicts itself, the log has been corrected
    /// before, or the rig cannot be written.
    pub fn new(
        mut session: CameraSession,
        model: Option<ModelFile>,
        options: &Options,
        threads: &Threads,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let method = options.config.render.method;
        let source = options.source.as_ref();
        let request = request_sha256(options, model.as_ref())?;
        let (mut file, means) = match model {
            None => {
                let fit = fit_with_exposure(&[&session], options, threads, progress)?;
                (fit.model, fit.means)
            }
            Some(file) if file.rendering.method == method && !method.needs_mean_frames() => {
                (file, MeanFrames::default())
            }
            // Made for another method, or without the mean frames of this log.
            Some(file) => exposed(&[&session], file, options, threads, progress)?,
        };
        // Exposure belongs to the model, the treatment of highlights to this run.
        let tone = correct::tone(&options.config.render, &file.rendering);
        file.rendering.shoulder_from = Some(options.config.render.shoulder_from);
        file.rendering.contrast_curve = match tone {
            Tone::Contrast(curve) => Some(curve),
            Tone::Shoulder { .. } => None,
        };
        let model = CameraModel::new(&mut session, file, source)?;
        ensure_not_corrected(&session, only(options)?.as_ref())?;
        let missing = session.survey.missing_settings(&model.file);
        session.survey.diagnostics.extend(missing);
        let diagnostics = model_diagnostics(&session, &model)?;
        let rig = rig_facts(&session.survey.rig, &options.rig);
        let rig_toml = toml::to_string_pretty(&rig)
            .map_err(|e| Error::WriteRecord { path: "rig.toml".into(), reason: e.to_string() })?;
        let rendering = Rendering {
            config: &session.config.render,
            exposure: &model.file.rendering,
            means: &means,
        };
        // The settings that are written with the log say what was chosen.
        let quality = jpeg_quality(&session, &model, rendering, threads)?;
        session.config.render.jpeg_quality = JpegQuality::Of(quality);
        let clouds = Clouds::of(&session);
        Ok(Self { session, model, means, clouds, rig_toml, request, diagnostics })
    }

    /// The camera as pass two needs it.
    pub fn output(&self, is_first: bool, wire: WireFormat) -> CameraOutput<'_> {
        let Self { session, model, means, clouds, rig_toml, request, diagnostics } = self;
        let config = &session.config.render;
        let rendering = Rendering { config, exposure: &model.file.rendering, means };
        CameraOutput {
            session,
            model,
            corrector: Corrector::new(session, model, rendering),
            wire,
            rig_toml,
            request,
            clouds,
            model_diagnostics: diagnostics,
            name: if is_first { String::new() } else { camera_name(&session.survey.camera_topic) },
        }
    }
}

/// Diagnostics of the model, marked where it was estimated from other logs.
fn model_diagnostics(session: &CameraSession, model: &CameraModel) -> Result<Vec<Diagnostic>> {
    let inputs = &model.file.inputs;
    let of_input = |input: &InputFile| session.recording.is(&input.identity());
    let is_own = inputs.iter().map(of_input).collect::<Result<Vec<bool>>>()?;
    let mut diagnostics = model.file.diagnostics.clone();
    if !is_own.contains(&true) {
        let logs: Vec<&str> = inputs.iter().map(|input| input.name.as_str()).collect();
        diagnostics.iter_mut().for_each(|d| d.model_log = Some(logs.join(", ")));
        let frames = model.gains_of_other_logs();
        let unused = (frames > 0).then_some(EstimateFact::GainsOfOtherLogs { frames });
        diagnostics.extend(unused.map(Diagnostic::from));
        let daylight = model.file.daylight.as_ref().map(|_| EstimateFact::DaylightOfOtherLogs);
        let tilts = model.file.tilts.as_ref().map(|_| EstimateFact::TiltsOfOtherLogs);
        diagnostics.extend(daylight.into_iter().chain(tilts).map(Diagnostic::from));
        let offset_s = model.file.geometry.as_ref().and_then(|g| g.clock_offset_s);
        let topic = &session.survey.camera_topic;
        let clock = |time_offset_s| ClockFact::OfOtherLogs { time_offset_s };
        diagnostics.extend(offset_s.map(|s| Diagnostic::on(topic, clock(s))));
    }
    Ok(diagnostics)
}
