//! One frame and a model → a corrected frame, for programs that read no log.

use crate::config::Config;
use crate::correct::{self, Correction, MeanFrames};
use crate::error::{Error, Result};
use crate::geometry::{SeafloorPlane, View};
use crate::image::EncodedImage;
use crate::image::decode::{CameraResponse, read_pixels};
use crate::image::flat_field::FlatField;
use crate::image::noise::{Electrons, Noise};
use crate::image::response::ResponseTable;
use crate::image::transfer::SrgbTable;
use crate::model::{CameraFile, ImagingModel, ModelFile, RangeFactor, RenderingFile};
use crate::units::Stamp;
use crate::vehicle::{Camera, Rig};

use super::corrector::{CorrectedFrame, gain_and_balance, render};
use super::model_of::strobe_of;
use super::output_names::method_name;
use super::prepared_model::{PreparedModel, Rendering, Sensor};

/// Corrects single frames with a given model; needs no log.
///
/// Pixels are converted to light by the settings of `light`, and by what a `model.json` found of
/// its camera: transfer curve, vignetting, black level, and the law by which it sets its gain. The
/// gains of single frames, their tilts and the recorded exposures in it belong to the frames of its
/// log and are not applied.
pub struct FrameCorrector {
    model: PreparedModel,
    exposure: RenderingFile,
    rig: Rig,
    config: Config,
    means: MeanFrames,
    srgb: SrgbTable,
    camera: CameraFile,
    response: Option<ResponseTable>,
    flat_field: Option<FlatField>,
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
        let corrector = Self::new(model, file.rendering.clone(), rig, config)?;
        let Some(camera) = file.camera.clone() else { return Ok(corrector) };
        let size = (corrector.rig.camera.width, corrector.rig.camera.height);
        let lens = camera.lens(&corrector.rig.camera);
        let flat_field = match camera.dark() {
            Some(dark) => {
                Some(lens.unwrap_or_else(|| FlatField::even(size.0, size.1)).with_dark(dark))
            }
            None => lens,
        };
        let response = camera.response_table().map_err(Error::Usage)?;
        Ok(Self { camera, response, flat_field, ..corrector })
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
                srgb: SrgbTable::new(correct::tone(&config.render, &exposure)),
                means: MeanFrames::default(),
                camera: CameraFile::default(),
                response: None,
                flat_field: None,
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
        let table = self.response.as_ref();
        let response = CameraResponse { transfer: light.transfer, white_level, response: table };
        let pixels = read_pixels(image, response).map_err(Error::Image)?;
        let (width, height) = (pixels.width, pixels.height);
        let camera = self.rig.camera.scaled_to(width, height).ok_or_else(|| {
            let Rig { camera: Camera { width: w, height: h, .. }, .. } = self.rig;
            Error::Image(format!("the image is {width}×{height}, the calibration of {w}×{h}"))
        })?;
        let flat_field = self.flat_field.as_ref().map(|f| f.for_size(width, height)).transpose();
        let flat_field = flat_field.map_err(Error::Image)?;
        let law = self.camera.gain_law.as_ref();
        let gains = law.map_or([1.0; 3], |l| l.log_gains(&pixels.mean_light()).map(f64::exp));
        let (gain, balance) = gain_and_balance(gains);
        let rendering = Rendering { config, exposure: &self.exposure, means: &self.means };
        let sensor =
            Sensor { clipped_above: estimate.clipped_above, electrons: Electrons::default() };
        let correction = self.model.correction(&self.rig, sensor, rendering);
        let model = stamp.map(|stamp| correction.model.at(stamp));
        let rectified = config.rectify.then(|| camera.rectified());
        let raw = correct::Frame {
            codes: &pixels,
            flat_field: flat_field.as_deref(),
            view: &View { camera: &camera, rig: &self.rig, plane, terrain: None },
            gain,
            balance,
            range_factor: RangeFactor::default(),
            noise: &Noise::of(&pixels.coding, response, sensor.electrons),
            rectified: rectified.as_ref(),
        };
        let correction =
            Correction { model: model.as_ref().unwrap_or(correction.model), ..correction };
        let corrected = render(&correction, &raw, &self.srgb, Vec::new());
        corrected.map_err(|reason| Error::Image(reason.to_string()))
    }
}
