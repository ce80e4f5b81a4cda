//! An imaging model, prepared for correction; nothing here refers to a log.

use std::sync::OnceLock;

use crate::config::{Method, RenderConfig};
use crate::correct::{Correction, MeanFrames};
use crate::image::noise::Electrons;
use crate::model::{Frustum, ImagingModel, RenderingFile, ScatterSource, ScatterTable};
use crate::vehicle::Rig;

/// Pass two reads the beam pattern from a grid this many times as fine.
const BEAM_REFINEMENT: usize = 8;
/// Share of the beam pattern that the gain's grid need not follow: its rim, where single nodes are
/// as rough as their noise.
const BEAM_ROUGHEST_SHARE: f64 = 0.05;
/// Beyond this distance the strobe adds nothing to the backscatter (m).
const BACKSCATTER_REACH_M: f64 = 12.0;

/// An imaging model with what correction derives from it once.
pub struct PreparedModel {
    /// the model
    pub model: ImagingModel,
    /// the same with a finer beam pattern
    fine: ImagingModel,
    /// of the finer beam pattern
    roughness: (f64, f64),
    /// of the rig of the first correction
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

/// Properties of the sensor that a correction needs beside the calibration.
#[derive(Clone, Copy)]
pub struct Sensor {
    /// input above this share of full scale counts as clipped
    pub clipped_above: f64,
    /// for its noise
    pub electrons: Electrons,
}

impl PreparedModel {
    /// Prepares a model.
    pub fn new(model: ImagingModel) -> Self {
        let beam_pattern = model.beam_pattern.refined(BEAM_REFINEMENT);
        Self {
            roughness: beam_pattern.roughness(BEAM_ROUGHEST_SHARE),
            fine: ImagingModel { beam_pattern, ..model.clone() },
            scatter: OnceLock::new(),
            model,
        }
    }

    /// How frames of this rig are corrected.
    pub fn correction<'c>(
        &'c self,
        rig: &Rig,
        sensor: Sensor,
        rendering: Rendering<'c>,
    ) -> Correction<'c> {
        let Rendering { config, exposure, means } = rendering;
        let table = || scatter_table(&self.model, rig);
        let is_removed = removes_backscatter(&self.model, config.method);
        let scatter = self.model.backscatter.as_ref().filter(|_| is_removed);
        Correction {
            model: &self.fine,
            roughness: self.roughness,
            rendering: exposure,
            config,
            backscatter: scatter
                .zip(scatter.and_then(|_| self.scatter.get_or_init(table).as_ref())),
            means,
            clipped_above: sensor.clipped_above as f32,
            electrons: sensor.electrons,
        }
    }
}

/// Whether a method removes attenuation and backscatter.
pub fn removes_water(method: Method) -> bool {
    matches!(method, Method::Full | Method::Attenuation)
}

/// Whether a method subtracts the backscatter of a model; an empirical one has its own.
pub fn removes_backscatter(model: &ImagingModel, method: Method) -> bool {
    let is_empirical = method == Method::Full && model.empirical.is_some();
    model.backscatter.is_some() && removes_water(method) && !is_empirical
}

/// The backscatter of every ray, where the model has backscatter.
pub fn scatter_table(model: &ImagingModel, rig: &Rig) -> Option<ScatterTable> {
    let backscatter = model.backscatter?;
    let attenuation_per_m = backscatter.attenuation_per_m;
    if backscatter.source == ScatterSource::Uniform {
        return Some(ScatterTable::Uniform { attenuation_per_m });
    }
    let (w, h) = ((rig.camera.width - 1) as f64, (rig.camera.height - 1) as f64);
    let edge = (0..=16)
        .map(|k| f64::from(k) / 16.0)
        .flat_map(|t| [(t * w, 0.0), (t * w, h), (0.0, t * h), (w, t * h)]);
    let rays = edge
        .filter_map(|(u, v)| rig.camera.image_plane(u, v))
        .map(|(x, y)| (x, y, BACKSCATTER_REACH_M));
    Some(ScatterTable::of_strobe(
        &model.beam_pattern,
        rig.body_from_optical,
        &rig.strobe.lamps,
        &attenuation_per_m,
        Frustum::around(rays),
    ))
}
