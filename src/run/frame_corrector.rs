//! One frame and a model → a corrected frame, for programs that read no log.

use crate::config::Config;
use crate::correct::{self, Correction, MeanFrames};
use crate::error::{Error, Result};
use crate::geometry::{SeafloorPlane, View};
use crate::image::EncodedImage;
use crate::image::decode::{CameraResponse, read_pixels};
use crate::image::noise::{Electrons, Noise};
use crate::image::transfer::{Shoulder, SrgbTable};
use crate::model::{ImagingModel, ModelFile, RenderingFile};
use crate::units::Stamp;
use crate::vehicle::{Camera, Rig};

use super::corrector::{CorrectedFrame, render};
use super::model_of::strobe_of;
use super::output_names::method_name;
use super::prepared_model::{PreparedModel, Rendering, Sensor};

/// Corrects single frames with a given model; needs no log.
///
/// Pixels are converted to light by the settings of `light`, without a response table or flat
/// field. The gains of single frames and the recorded exposures in a `model.json` belong to the
/// frames of its log and are not applied.
pub struct FrameCorrector {
    model: PreparedModel,
    exposure: RenderingFile,
    rig: Rig,
    config: Config,
    means: MeanFrames,
    srgb: SrgbTable,
}

impl FrameCorrector {
    /// From the contents of a `model.json`. Its strobe replaces that of the rig, as the angles of
    /// its beam pattern refer to it.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn from_file(file: &ModelFile, rig: Rig, config: Config) -> Result<Self> {
        let model = file.imaging_model().map_err(Error::Usage)?;
        let rig = Rig { strobe: strobe_of(file, &rig), ..rig };
        Self::new(model, file.rendering.clone(), rig, config)
    }

    /// From a model, its exposure and white balance, and the rig.
    ///
    /// # Errors
    /// A setting is invalid, the exposure is for another method or other bands, or the method
    /// divides by mean frames of a log.
    pub fn new(
        model: ImagingModel,
        exposure: RenderingFile,
        rig: Rig,
        config: Config,
    ) -> Result<Self> {
        config.ensure_valid().map_err(Error::Usage)?;
        let (method, bands) = (config.render.method, model.bands);
        let reason = if method.needs_mean_frames() {
            Some(format!("{} needs the mean frames of a log", method_name(method)))
        } else if method != exposure.method {
            let (of_model, chosen) = (method_name(exposure.method), method_name(method));
            Some(format!("the exposure is for the method {of_model}, not {chosen}"))
        } else if exposure.gain.len() != bands || exposure.median_correction.len() != bands {
            Some(format!("the exposure needs one value for each of {bands} bands"))
        } else {
            None
        };
        match reason {
            Some(reason) => Err(Error::Usage(reason)),
            None => Ok(Self {
                model: PreparedModel::new(model),
                srgb: SrgbTable::new(Shoulder { knee: config.render.shoulder_from }),
                means: MeanFrames::default(),
                exposure,
                rig,
                config,
            }),
        }
    }

    /// The rig, with the strobe of the model.
    pub fn rig(&self) -> &Rig {
        &self.rig
    }

    /// Corrects an image of flat seafloor. `stamp` selects the attenuation where the model has one
    /// that changes with time; without it the mean is used.
    ///
    /// # Errors
    /// The image cannot be decoded, has another aspect ratio than the calibration or other bands
    /// than the model, or no pixel sees the seafloor.
    pub fn correct(
        &self,
        image: &EncodedImage<'_>,
        plane: &SeafloorPlane,
        stamp: Option<Stamp>,
    ) -> Result<CorrectedFrame> {
        let Config { light, render: config, estimate, .. } = &self.config;
        let white_level = light.white_level.or(self.exposure.white_level);
        let response = CameraResponse { transfer: light.transfer, white_level, response: None };
        let pixels = read_pixels(image, response).map_err(Error::Image)?;
        let (width, height) = (pixels.width, pixels.height);
        let camera = self.rig.camera.scaled_to(width, height).ok_or_else(|| {
            let Rig { camera: Camera { width: w, height: h, .. }, .. } = self.rig;
            Error::Image(format!("the image is {width}×{height}, the calibration of {w}×{h}"))
        })?;
        let rendering = Rendering { config, exposure: &self.exposure, means: &self.means };
        let sensor =
            Sensor { clipped_above: estimate.clipped_above, electrons: Electrons::default() };
        let correction = self.model.correction(&self.rig, sensor, rendering);
        let model = stamp.map(|stamp| correction.model.at(stamp));
        let rectified = config.rectify.then(|| camera.rectified());
        let raw = correct::Frame {
            codes: &pixels,
            flat_field: None,
            view: &View { camera: &camera, rig: &self.rig, plane, terrain: None },
            gain: 1.0,
            balance: [1.0; 3],
            range_factor: 1.0,
            noise: &Noise::of(&pixels.coding, response, sensor.electrons),
            rectified: rectified.as_ref(),
        };
        let correction =
            Correction { model: model.as_ref().unwrap_or(correction.model), ..correction };
        let corrected = render(&correction, &raw, &self.srgb, Vec::new());
        corrected.map_err(|reason| Error::Image(reason.to_string()))
    }
}
