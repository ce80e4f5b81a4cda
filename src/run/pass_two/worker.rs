//! The work on one frame in pass two, on any thread: decode, correct, encode.

use std::cell::RefCell;

use super::super::camera_output::{CameraOutput, FrameOutput, ImageMessages};
use super::super::topics::{encoded_images, needs_preview, preview};
use crate::diagnostics::Reason;
use crate::geometry::{SeafloorPlane, View};
use crate::image::Container;
use crate::image::decode::PixelValues;
use crate::messages::Header;
use crate::recording::Message;
use crate::session::ImageMessage;

/// Memory that the frames of one thread reuse.
#[derive(Default)]
struct Buffers {
    /// raw pixel values
    pixels: Vec<u8>,
    /// corrected samples
    samples: Vec<u8>,
}

thread_local! {
    static BUFFERS: RefCell<Buffers> = RefCell::default();
}

/// Decodes, corrects and encodes a frame.
pub fn work(camera: &CameraOutput<'_>, message: Message) -> FrameOutput {
    let mut buffers = BUFFERS.take();
    let (header, preview, plane, result) = match camera.session.read(&message) {
        Ok(image) => {
            let mut parts = Parts::default();
            let result = images(camera, &image, &mut parts, &mut buffers);
            (image.header, parts.0, parts.1, result)
        }
        Err(reason) => (Header::default(), None, None, Err(reason)),
    };
    BUFFERS.set(buffers);
    FrameOutput { message, header, plane, preview, result }
}

/// What is known of a frame even where it is not corrected.
type Parts = (Option<Vec<u8>>, Option<SeafloorPlane>);

fn images(
    camera: &CameraOutput<'_>,
    image: &ImageMessage<'_>,
    (raw, plane): &mut Parts,
    buffers: &mut Buffers,
) -> Result<ImageMessages, Reason> {
    let unencodable = |reason| Reason::Unencodable { reason };
    let raw_preview = |pixels: &PixelValues<'_>| {
        needs_preview(camera)
            .then(|| preview(camera, &image.header, pixels).map_err(unencodable))
            .transpose()
    };
    let frame = match camera.session.frame(image, std::mem::take(&mut buffers.pixels)) {
        Ok(frame) => frame,
        Err(unusable) => {
            *plane = unusable.plane;
            if let Some(pixels) = &unusable.pixels {
                *raw = raw_preview(pixels)?;
            }
            return Err(unusable.reason);
        }
    };
    *plane = Some(frame.plane);
    *raw = raw_preview(&frame.pixels)?;
    let corrected = camera.corrector.correct(&frame, std::mem::take(&mut buffers.samples))?;
    let is_subsampled = frame.pixels.coding.container == Container::Jpeg { subsampled: true };
    let view = View { camera: &corrected.camera, ..frame.view() };
    let images =
        encoded_images(camera, (frame.at.id, &image.header), &corrected, &view, is_subsampled);
    buffers.samples = corrected.samples;
    buffers.pixels = frame.pixels.into_buffer();
    images.map_err(unencodable)
}
