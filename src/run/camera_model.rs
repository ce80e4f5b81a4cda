//! A model for the frames of one camera of a log.

use crate::config::Method;
use crate::correct::Correction;
use crate::error::{Error, Result};
use crate::image::Bands;
use crate::model::{InputFile, ModelFile, RangeFactor};
use crate::recording::LogIdentity;
use crate::session::{CameraSession, FrameGains, FrameRef, Tilts};

use super::model_of::strobe_of;
use super::output_names::method_name;
use super::prepared_model::{PreparedModel, Rendering, Sensor, removes_water};

/// A model, prepared for the frames of one camera.
pub struct CameraModel {
    /// as in `model.json`
    pub file: ModelFile,
    /// the same for computations
    pub prepared: PreparedModel,
    gains: FrameGains,
}

impl CameraModel {
    /// Prepares a model. The camera takes over its strobe, as the angles of its beam pattern refer
    /// to that, and its white level, as a dark log uses fewer bits than the sensor has.
    ///
    /// # Errors
    /// The model's beam pattern cannot be read, or the log not; the method needs an attenuation and
    /// the model has none.
    pub fn new(
        session: &mut CameraSession,
        file: ModelFile,
        source: Option<&LogIdentity>,
    ) -> Result<Self> {
        let method = session.config.render.method;
        if !file.has_attenuation() && method != Method::Full && removes_water(method) {
            return Err(Error::Usage(format!(
                "the method {} needs an attenuation, and the log determines none: use \
                 --method full, or the model of another dive of the same water and strobe",
                method_name(method)
            )));
        }
        let survey = &mut session.survey;
        survey.rig.strobe = strobe_of(&file, &survey.rig);
        let chosen = session.config.light.white_level;
        survey.white_level = chosen.or(file.rendering.white_level).or(survey.white_level);
        if let Some(camera) = &file.camera {
            survey.take_camera(camera)?;
        }
        // Clock, tilts and kinds of frames are those of a recording.
        let has_unlit = file.inputs.iter().any(|input| input.unlit_below.is_some());
        let is_of_log = file.tilts.is_some() || file.geometry.is_some() || has_unlit;
        let recording = &session.recording;
        let is_source = |input: &InputFile| source.is_some_and(|s| s.is_same(&input.identity()));
        let is_input = |input: &InputFile| Ok(is_source(input) || recording.is(&input.identity())?);
        let inputs = file.inputs.iter().filter(|_| is_of_log);
        let is_own = inputs.map(is_input).collect::<Result<Vec<bool>>>()?;
        let is_of = |input: usize| is_own.get(input).is_some_and(|is_own| *is_own);
        survey.tilts = file.tilts.as_ref().and_then(|tilts| Tilts::of(tilts, is_of));
        let own = file.inputs.iter().zip(&is_own).find(|(_, is_own)| **is_own);
        survey.unlit_below = own.and_then(|(input, _)| input.unlit_below);
        if let Some(mut geometry) = file.geometry.clone() {
            if !is_own.contains(&true) {
                geometry.clock_offset_s = None;
            }
            survey.take_geometry(&geometry, &session.config.seafloor);
        }
        Ok(Self {
            prepared: PreparedModel::new(file.imaging_model().map_err(Error::Usage)?),
            gains: FrameGains::new(&file, &session.recording, source)?,
            file,
        })
    }

    /// Frames of other logs than this one that the model has a gain for.
    pub fn gains_of_other_logs(&self) -> usize {
        self.gains.of_other_logs
    }

    /// Light of a frame over that of others, per band; by its mean light, where the model has no
    /// gain of its own for it.
    pub fn frame_gain(
        &self,
        session: &CameraSession,
        frame: &FrameRef,
        mean_light: impl FnOnce() -> Bands,
    ) -> Bands {
        session.survey.frame_gain(&self.file, &self.gains, frame, mean_light)
    }

    /// Factor of a frame's slant ranges, in the empirical model.
    pub fn range_factor(&self, frame: &FrameRef) -> RangeFactor {
        self.gains.range_factor(frame)
    }

    /// How frames of this camera are corrected.
    pub fn correction<'c>(
        &'c self,
        session: &'c CameraSession,
        rendering: Rendering<'c>,
    ) -> Correction<'c> {
        let sensor = Sensor {
            clipped_above: session.config.estimate.clipped_above,
            electrons: session.survey.electrons,
        };
        self.prepared.correction(&session.survey.rig, sensor, rendering)
    }
}
