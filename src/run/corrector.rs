//! Frame → corrected frame. A faster kernel replaces this file; nothing here reads or writes
//! messages.

use crate::correct::{self, Corrected, Correction, FrameFacts};
use crate::diagnostics::Reason;
use crate::error::{self, Error};
use crate::image::transfer::SrgbTable;
use crate::image::{Bands, ImageShape, encode, interleaved};
use crate::session::{CameraSession, Frame};
use crate::vehicle::Camera;

use super::camera_model::CameraModel;
use super::prepared_model::Rendering;

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

impl CorrectedFrame {
    /// The image as a PNG file.
    ///
    /// # Errors
    /// The encoder's message.
    pub fn to_png(&self) -> error::Result<Vec<u8>> {
        encode::png(&self.samples, self.shape, self.depth).map_err(Error::Image)
    }
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
            srgb: SrgbTable::new(correct::tone(rendering.config, rendering.exposure)),
        }
    }

    /// Corrects a frame. The buffer is reused for its samples.
    ///
    /// # Errors
    /// The image has other bands than the model, or no pixel sees the seafloor.
    pub fn correct(&self, frame: &Frame<'_>, buffer: Vec<u8>) -> Result<CorrectedFrame, Reason> {
        let rectified = self.correction.config.rectify.then(|| frame.camera.rectified());
        self.with_raw(frame, rectified.as_ref(), |correction, raw| {
            render(correction, raw, &self.srgb, buffer)
        })
    }

    /// Corrects a frame row by row in linear light, where 1 is white; `take` receives the bands of
    /// a row one after another.
    pub fn rows(
        &self,
        frame: &Frame<'_>,
        rectified: Option<&Camera>,
        take: impl FnMut(&mut [f32]),
    ) -> Corrected {
        self.with_raw(frame, rectified, |correction, raw| correction.apply(raw, take))
    }

    /// Passes on the frame as the correction takes it, and the correction at its time.
    fn with_raw<R>(
        &self,
        frame: &Frame<'_>,
        rectified: Option<&Camera>,
        work: impl FnOnce(&Correction<'_>, &correct::Frame<'_>) -> R,
    ) -> R {
        let model = self.correction.model.at(frame.at.stamp);
        let (gain, balance) =
            gain_and_balance(
                self.model.frame_gain(self.session, &frame.at, || frame.pixels.mean_light()),
            );
        let raw = correct::Frame {
            codes: &frame.pixels,
            flat_field: frame.flat_field.as_deref(),
            view: &frame.view(),
            gain,
            balance,
            range_factor: self.model.range_factor(&frame.at),
            noise: &frame.noise(),
            rectified,
        };
        work(&Correction { model: &model, ..self.correction }, &raw)
    }
}

/// The mean gain of the bands, and each band's own over that.
pub fn gain_and_balance(gains: Bands) -> (f64, Bands) {
    if gains[0] == gains[1] && gains[1] == gains[2] {
        return (gains[0], [1.0; 3]);
    }
    let gain = gains.iter().product::<f64>().cbrt();
    (gain, gains.map(|of_band| of_band / gain))
}

/// Corrects a frame to pixel values. The buffer is reused for them.
///
/// # Errors
/// The image has other bands than the model, or no pixel sees the seafloor.
pub fn render(
    correction: &Correction<'_>,
    raw: &correct::Frame<'_>,
    srgb: &SrgbTable,
    buffer: Vec<u8>,
) -> Result<CorrectedFrame, Reason> {
    let (bands, of_model) = (raw.codes.bands(), correction.model.bands);
    if bands != of_model {
        let reason = format!("it has {bands} bands, the model {of_model}");
        return Err(Reason::Undecodable { reason });
    }
    let depth = correction.config.depth;
    let (width, height) = (raw.codes.width, raw.codes.height);
    let (out_width, out_height) = raw.rectified.map_or((width, height), |c| (c.width, c.height));
    let row_bytes = out_width * bands * usize::from(depth / 8);
    // Not cleared: every row is written.
    let mut samples = buffer;
    samples.resize(out_height * row_bytes, 0);
    let mut rows = samples.chunks_exact_mut(row_bytes);
    let take = |row: &mut [f32]| {
        let Some(out) = rows.next() else { return };
        match depth {
            16 => {
                let value = |v: f32| ((v.clamp(0.0, 1.0) * 65535.0).round() as u16).to_ne_bytes();
                let values = out.as_chunks_mut::<2>().0.iter_mut();
                values.zip(interleaved(row, bands)).for_each(|(out, v)| *out = value(v));
            }
            _ => srgb.encode_row(row, bands, out),
        }
    };
    let Corrected { mask, facts } = correction.apply(raw, take);
    if facts.off_surface_share >= 1.0 {
        return Err(Reason::OffSeafloor);
    }
    let camera = *raw.rectified.unwrap_or(raw.view.camera);
    let shape = ImageShape { width: out_width, height: out_height, bands };
    Ok(CorrectedFrame { samples, shape, depth, camera, mask, facts })
}
