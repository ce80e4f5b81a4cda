//! Frame → corrected frame. A faster kernel replaces this file; nothing here reads or writes
//! messages.

use crate::correct::{self, Corrected, Correction, FrameFacts};
use crate::diagnostics::Reason;
use crate::image::ImageShape;
use crate::image::transfer::{Shoulder, SrgbTable};
use crate::session::{CameraSession, Frame};
use crate::vehicle::Camera;

use super::camera_model::{CameraModel, Rendering};

/// Corrects the frames of one camera.
pub struct Corrector<'c> {
    session: &'c CameraSession,
    model: &'c CameraModel,
    correction: Correction<'c>,
    /// light to 8-bit pixel values
    pub srgb: SrgbTable,
}

/// A corrected frame in memory.
pub struct CorrectedFrame {
    /// `height × width × bands` pixel values, sRGB with 8 bits or linear with 16, in the machine's
    /// byte order
    pub samples: Vec<u8>,
    /// size of the image
    pub shape: ImageShape,
    /// 8 or 16
    pub depth: u8,
    /// calibration of the image
    pub camera: Camera,
    /// bits per pixel, where `--mask` asks for them
    pub mask: Option<Vec<u8>>,
    /// path lengths and shares
    pub facts: FrameFacts,
}

impl<'c> Corrector<'c> {
    /// A corrector for this camera and model.
    pub fn new(
        session: &'c CameraSession,
        model: &'c CameraModel,
        rendering: Rendering<'c>,
    ) -> Self {
        Self {
            session,
            model,
            correction: model.correction(session, rendering),
            srgb: SrgbTable::new(Shoulder { knee: rendering.config.shoulder_from }),
        }
    }

    /// Corrects a frame. The buffer is reused for its samples.
    ///
    /// # Errors
    /// The image has other bands than the model, or no pixel sees the seafloor.
    pub fn correct(&self, frame: &Frame<'_>, buffer: Vec<u8>) -> Result<CorrectedFrame, Reason> {
        let (bands, of_model) = (frame.pixels.bands(), self.model.model.bands);
        if bands != of_model {
            let reason = format!("it has {bands} bands, the model {of_model}");
            return Err(Reason::Undecodable { reason });
        }
        let config = self.correction.config;
        let rectified = config.rectify.then(|| frame.camera.rectified());
        let (width, height) = (frame.pixels.width, frame.pixels.height);
        let mut samples = buffer;
        samples.clear();
        samples.reserve(width * height * bands * usize::from(config.depth / 8));
        let take = |row: &mut [f32]| match config.depth {
            16 => samples.extend(
                row.iter()
                    .flat_map(|v| ((v.clamp(0.0, 1.0) * 65535.0).round() as u16).to_ne_bytes()),
            ),
            _ => self.srgb.encode_row(row, &mut samples),
        };
        let Corrected { mask, facts } = self.rows(frame, rectified.as_ref(), take);
        if facts.off_surface_share >= 1.0 {
            return Err(Reason::OffSeafloor);
        }
        let camera = rectified.unwrap_or(frame.camera);
        let (width, height) = rectified.map_or((width, height), |c| (c.width, c.height));
        let shape = ImageShape { width, height, bands };
        Ok(CorrectedFrame { samples, shape, depth: config.depth, camera, mask, facts })
    }

    /// Corrects a frame row by row in linear light, where 1 is white.
    pub fn rows(
        &self,
        frame: &Frame<'_>,
        rectified: Option<&Camera>,
        take: impl FnMut(&mut [f32]),
    ) -> Corrected {
        let model = self.correction.model.at(frame.at.stamp);
        let raw = correct::Frame {
            codes: &frame.pixels,
            flat_field: self.session.survey.flat_field.as_ref(),
            view: &frame.view(),
            gain: self.model.frame_gain(self.session, &frame.at),
            noise: &frame.noise(),
            rectified,
        };
        Correction { model: &model, ..self.correction }.apply(&raw, take)
    }
}
