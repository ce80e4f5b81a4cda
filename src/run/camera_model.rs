//! A model for the frames of one camera of a log.

use crate::config::Method;
use crate::correct::Correction;
use crate::error::{Error, Result};
use crate::image::Bands;
use crate::model::{ModelFile, RangeFactor};
use crate::session::{CameraSession, Frame, FrameGains, FrameRef, Tilts};

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
        source_sha256: Option<&str>,
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
        // Clock and tilts are those of a recording.
        let is_of_log = file.tilts.is_some() || file.geometry.is_some();
        let own = if is_of_log { session.recording.sha256()? } else { "" };
        let is_own = |sha256: &str| sha256 == own || Some(sha256) == source_sha256;
        survey.tilts = Tilts::of(&file, &is_own);
        if let Some(mut geometry) = file.geometry.clone() {
            if !file.inputs.iter().any(|input| is_own(&input.sha256)) {
                geometry.clock_offset_s = None;
            }
            survey.take_geometry(&geometry, &session.config.seafloor);
        }
        Ok(Self {
            prepared: PreparedModel::new(file.imaging_model().map_err(Error::Usage)?),
            gains: FrameGains::new(&file, &session.recording, source_sha256)?,
            file,
        })
    }

    /// Frames of other logs than this one that the model has a gain for.
    pub fn gains_of_other_logs(&self) -> usize {
        self.gains.of_other_logs
    }

    /// Light of a frame over that of others, per band.
    pub fn frame_gain(&self, session: &CameraSession, frame: &Frame<'_>) -> Bands {
        let mean_light = || frame.pixels.mean_light();
        session.survey.frame_gain(&self.file, &self.gains, &frame.at, mean_light)
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
