//! Topics of images: corrected image, mask, camera calibration, raw image for viewers.

use std::borrow::Cow;

use super::super::camera_output::{CameraOutput, ImageMessages};
use super::super::corrector::CorrectedFrame;
use super::super::output_names::corrected_topic;
use super::seafloor::cloud;
use super::topic::OutputTopic;
use crate::geometry::View;
use crate::image::decode::PixelValues;
use crate::image::reduce::downscale;
use crate::image::{Container, ImageShape, encode};
use crate::messages::Header;
use crate::messages::output::{self, RawImage};
use crate::recording::FrameId;

pub const CORRECTED: OutputTopic = OutputTopic {
    rank: 0,
    name: |camera| Some(camera.corrected_topic()),
    message_type: |camera| match camera.container() {
        Container::Raw => output::IMAGE,
        _ => output::COMPRESSED_IMAGE,
    },
    write: |frame, put| frame.output.result.iter().for_each(|r| put(&r.image)),
};

pub const CAMERA_INFO: OutputTopic = OutputTopic {
    rank: 1,
    name: |camera| {
        let topic = corrected_topic(&camera.session.survey.camera_topic, false) + "/camera_info";
        camera.session.config.render.rectify.then_some(topic)
    },
    message_type: |_| output::CAMERA_INFO,
    write: |frame, put| {
        if frame.output.result.is_ok() {
            let rectified = frame.camera.session.survey.rig.camera.rectified();
            put(&output::camera_info(frame.camera.wire, &frame.output.header, &rectified));
        }
    },
};

pub const MASK: OutputTopic = OutputTopic {
    rank: 2,
    name: |camera| camera.session.config.render.mask.then(|| camera.own_topic("mask/compressed")),
    message_type: |_| output::COMPRESSED_IMAGE,
    write: |frame, put| {
        frame.output.result.iter().filter_map(|r| r.mask.as_deref()).for_each(put);
    },
};

pub const RAW_PREVIEW: OutputTopic = OutputTopic {
    rank: 9,
    name: |camera| needs_preview(camera).then(|| camera.own_topic("raw/compressed")),
    message_type: |_| output::COMPRESSED_IMAGE,
    write: |frame, put| frame.output.preview.iter().for_each(|preview| put(preview)),
};

/// Image encodings that all viewers show in their colours.
const SHOWN_ENCODINGS: [&str; 10] = [
    "jpeg",
    "png",
    "rgb8",
    "bgr8",
    "8UC3",
    "yuyv",
    "bayer_rggb8",
    "bayer_bggr8",
    "bayer_gbrg8",
    "bayer_grbg8",
];

/// Maximum JPEG quality of raw images for viewers: their noise costs more than it is worth.
const MAX_PREVIEW_QUALITY: u8 = 80;

/// Whether viewers need another version of the raw images.
pub fn needs_preview(camera: &CameraOutput<'_>) -> bool {
    let survey = &camera.session.survey;
    let config = &camera.session.config.output;
    let mut channels =
        survey.camera_channels.iter().filter_map(|id| camera.session.index.channels.get(id));
    let is_shown = channels.all(|c| {
        let encoding = c.description.split(' ').next().unwrap_or("");
        SHOWN_ENCODINGS.contains(&encoding)
    });
    let is_wanted = config.raw_preview_side_px > 0 && !config.drop_raw;
    is_wanted && (!is_shown || survey.white_level.is_some())
}

/// The raw image as an 8-bit JPEG, with one exposure for all bands and the whole log: the one that
/// brings the least attenuated band to its level in the corrected images.
pub fn preview(
    camera: &CameraOutput<'_>,
    header: &Header,
    raw: &PixelValues<'_>,
) -> Result<Vec<u8>, String> {
    let config = &camera.session.config;
    let small = downscale(raw, config.output.raw_preview_side_px);
    let rendering = &camera.model.file.rendering;
    let factors = rendering.gain.iter().zip(&rendering.median_correction).map(|(g, c)| g * c);
    let exposure = factors.fold(f64::INFINITY, f64::min);
    let exposure = if exposure.is_finite() { exposure as f32 } else { 1.0 };
    let srgb = &camera.corrector.srgb;
    let samples: Vec<u8> = small.pixels.iter().map(|v| srgb.encode(v * exposure)).collect();
    let quality = camera.jpeg_quality().min(MAX_PREVIEW_QUALITY);
    let jpeg = encode::jpeg(&samples, small.shape(), quality, true)?;
    Ok(output::compressed_image(camera.wire, header, "jpeg", &jpeg))
}

/// Encodes a corrected frame, given its identity. `view` is that of its image; `is_subsampled`
/// tells whether the source has chroma at half resolution.
///
/// # Errors
/// The encoder's message.
pub fn encoded_images(
    camera: &CameraOutput<'_>,
    (id, header): (FrameId, &Header),
    corrected: &CorrectedFrame,
    view: &View<'_>,
    is_subsampled: bool,
) -> Result<ImageMessages, String> {
    let compressed =
        |format, data: &[u8]| output::compressed_image(camera.wire, header, format, data);
    let CorrectedFrame { samples, shape, depth, mask, facts, .. } = corrected;
    let mask_png = |mask: &Vec<u8>| encode::png(mask, ImageShape { bands: 1, ..*shape }, 8);
    let mask = mask.as_ref().map(mask_png).transpose()?.map(|png| compressed("png", &png));
    let cloud = camera.clouds.has(id).then(|| cloud(camera, header, corrected, view));
    let image = match camera.container() {
        Container::Jpeg { .. } => {
            let quality = camera.jpeg_quality();
            compressed("jpeg", &encode::jpeg(samples, *shape, quality, is_subsampled)?)
        }
        Container::Png => compressed("png", &encode::png(samples, *shape, *depth)?),
        Container::Raw => raw_image(camera, header, corrected),
    };
    Ok(ImageMessages { image, mask, cloud, facts: *facts })
}

fn raw_image(camera: &CameraOutput<'_>, header: &Header, corrected: &CorrectedFrame) -> Vec<u8> {
    let CorrectedFrame { samples, shape: ImageShape { width, height, bands }, depth, .. } =
        corrected;
    let encoding = match (bands, depth) {
        (1, 16) => "mono16",
        (1, _) => "mono8",
        (_, 16) => "rgb16",
        _ => "rgb8",
    };
    let data: Cow<'_, [u8]> = if *depth == 16 && cfg!(target_endian = "big") {
        samples.chunks_exact(2).flat_map(|c| [c[1], c[0]]).collect()
    } else {
        Cow::Borrowed(samples)
    };
    let step = data.len() / (*height).max(1);
    let raw = RawImage { width: *width, height: *height, encoding, step, data: &data };
    output::image(camera.wire, header, &raw)
}
