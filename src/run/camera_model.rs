//! A model, prepared for the frames of one camera.

use std::sync::OnceLock;

use crate::config::{Method, RenderConfig};
use crate::correct::{Correction, MeanFrames};
use crate::error::{Error, Result};
use crate::model::{Frustum, ImagingModel, ModelFile, RenderingFile, ScatterTable};
use crate::session::{CameraSession, FrameGains, FrameRef};
use crate::vehicle::Rig;

use super::model_of::strobe_of;

/// Pass two reads the beam pattern from a grid this many times as fine.
const BEAM_REFINEMENT: usize = 8;
/// Share of the beam pattern that the gain's grid need not follow: its rim, where single nodes are
/// as rough as their noise.
const BEAM_ROUGHEST_SHARE: f64 = 0.05;
/// Beyond this distance the strobe adds nothing to the backscatter (m).
const BACKSCATTER_REACH_M: f64 = 12.0;

/// A model, prepared for the frames of one camera.
pub struct CameraModel {
    /// as in `model.json`
    pub file: ModelFile,
    /// the same for computations
    pub model: ImagingModel,
    /// the same with a finer beam pattern
    fine: ImagingModel,
    /// of the finer beam pattern
    roughness: (f64, f64),
    gains: FrameGains,
    scatter: OnceLock<Option<ScatterTable>>,
}

/// What corrected frames look like.
#[derive(Clone, Copy)]
pub struct Rendering<'c> {
    /// method and format
    pub config: &'c RenderConfig,
    /// exposure and white balance
    pub exposure: &'c RenderingFile,
    /// mean frames, for the baselines that divide by them
    pub means: &'c MeanFrames,
}

impl CameraModel {
    /// Prepares a model. The camera takes over its strobe, as the angles of its beam pattern refer
    /// to that, and its white level, as a dark log uses fewer bits than the sensor has.
    ///
    /// # Errors
    /// The model's beam pattern cannot be read, or the log not.
    pub fn new(
        session: &mut CameraSession,
        file: ModelFile,
        source_sha256: Option<&str>,
    ) -> Result<Self> {
        let survey = &mut session.survey;
        survey.rig.strobe = strobe_of(&file, &survey.rig);
        let chosen = session.config.light.white_level;
        survey.white_level = chosen.or(file.rendering.white_level).or(survey.white_level);
        let model = file.imaging_model().map_err(Error::Usage)?;
        let beam_pattern = model.beam_pattern.refined(BEAM_REFINEMENT);
        Ok(Self {
            roughness: beam_pattern.roughness(BEAM_ROUGHEST_SHARE),
            fine: ImagingModel { beam_pattern, ..model.clone() },
            gains: FrameGains::new(&file, &session.recording, source_sha256)?,
            scatter: OnceLock::new(),
            file,
            model,
        })
    }

    /// Frames of other logs than this one that the model has a gain for.
    pub fn gains_of_other_logs(&self) -> usize {
        self.gains.of_other_logs
    }

    /// Light of a frame over its neighbours'.
    pub fn frame_gain(&self, session: &CameraSession, frame: &FrameRef) -> f64 {
        session.survey.frame_gain(&self.file, &self.gains, frame)
    }

    /// How frames of this camera are corrected.
    pub fn correction<'c>(
        &'c self,
        session: &'c CameraSession,
        rendering: Rendering<'c>,
    ) -> Correction<'c> {
        let Rendering { config, exposure, means } = rendering;
        let table = || scatter_table(&self.model, &session.survey.rig);
        let scatter = self.model.backscatter.as_ref().filter(|_| removes_water(config.method));
        Correction {
            model: &self.fine,
            roughness: self.roughness,
            rendering: exposure,
            config,
            glow: scatter.zip(scatter.and_then(|_| self.scatter.get_or_init(table).as_ref())),
            means,
            clipped_above: session.config.estimate.clipped_above as f32,
            electrons: session.survey.electrons,
        }
    }
}

/// Whether a method removes attenuation and backscatter.
pub fn removes_water(method: Method) -> bool {
    matches!(method, Method::Full | Method::Attenuation)
}

/// The backscatter of every ray, where the model has backscatter.
pub fn scatter_table(model: &ImagingModel, rig: &Rig) -> Option<ScatterTable> {
    let backscatter = model.backscatter?;
    let (w, h) = ((rig.camera.width - 1) as f64, (rig.camera.height - 1) as f64);
    let edge = (0..=16)
        .map(|k| f64::from(k) / 16.0)
        .flat_map(|t| [(t * w, 0.0), (t * w, h), (0.0, t * h), (w, t * h)]);
    let rays = edge
        .filter_map(|(u, v)| rig.camera.image_plane(u, v))
        .map(|(x, y)| (x, y, BACKSCATTER_REACH_M));
    Some(ScatterTable::new(
        &model.beam_pattern,
        rig.body_from_optical,
        &rig.strobe.lamps,
        &backscatter.attenuation_per_m,
        Frustum::around(rays),
    ))
}
