//! Forecast of the output's size: what is copied, corrected images, clouds, and parameters of every
//! frame.

use super::clouds::Clouds;
use super::jpeg_quality::MAX_GROWTH;
use super::output_names::output_container;
use crate::image::Container;
use crate::session::CameraSession;

/// Messages of parameters, of a frame (byte).
const PARAMETERS_PER_FRAME: u64 = 2500;
/// Schemas, model, report and settings (byte).
const ATTACHMENTS: u64 = 110_000;
/// Corrected images of other sources as JPEG and as PNG, per value of a pixel (byte).
const JPEG_PER_VALUE: f64 = 0.25;
const PNG_PER_VALUE: f64 = 0.8;
/// A preview of a raw image for viewers, per pixel (byte).
const PREVIEW_PER_PIXEL: f64 = 0.15;

/// About how large the output of a run over one camera of a log is (byte).
pub fn forecast(session: &CameraSession) -> u64 {
    let (survey, config) = (&session.survey, &session.config);
    let (frames, images) = (survey.frames.len() as u64, survey.all_image_bytes as f64);
    let input = session.recording.length() as f64;
    let deep = f64::from(config.render.depth) / 8.0;
    let values = 3.0 * survey.image_pixels as f64 * frames as f64;
    let corrected = match output_container(survey.container, config) {
        Container::Jpeg { .. } if survey.jpeg_quality.is_some() => MAX_GROWTH * images,
        Container::Jpeg { .. } => JPEG_PER_VALUE * values,
        Container::Png => PNG_PER_VALUE * deep * values,
        Container::Raw => deep * values,
    };
    let is_previewed = survey.white_level.is_some() && !config.output.drop_raw;
    let side = config.output.raw_preview_side_px.min(survey.image_size.0) as f64;
    let pixels = side * side * survey.image_size.1 as f64 / survey.image_size.0.max(1) as f64;
    let previews = if is_previewed { PREVIEW_PER_PIXEL * pixels * frames as f64 } else { 0.0 };
    // Uncompressed, the images may be more than the file.
    let copied = if config.output.drop_raw { (input - images).max(0.0) } else { input };
    let added = Clouds::of(session).total_bytes(survey.image_size)
        + frames * PARAMETERS_PER_FRAME
        + ATTACHMENTS;
    (copied + corrected + previews) as u64 + added
}
