//! The camera: its frames, its calibration, and how its pixel values relate to light.

use super::super::index::FrameRef;
use super::super::log::Log;
use super::super::options::Options;
use super::calibration::{Images, calibration_in_log};
use super::choose::choose_camera;
use super::{checks, clocks};
use crate::diagnostics::{CameraFact, Diagnostic};
use crate::error::{Error, Result};
use crate::image::decode::{CameraResponse, decode};
use crate::image::flat_field::FlatField;
use crate::image::response::ResponseTable;
use crate::image::{Container, EncodedImage};
use crate::units::Stamp;
use crate::vehicle::{BlackLevel, Camera, ResponseFacts};

/// The chosen camera.
pub struct CameraSurvey {
    pub topic: String,
    pub channels: Vec<u16>,
    /// in the order of the file, their clock offset added
    pub frames: Vec<FrameRef>,
    /// that offset (s)
    pub offset_s: f64,
    /// frame id of its images
    pub frame_id: String,
    pub container: Container,
    pub image_pixels: usize,
    pub image_size: (usize, usize),
    pub image_bytes: usize,
    pub all_image_bytes: u64,
    pub jpeg_quality: Option<u8>,
    /// full scale of 16-bit images (DN)
    pub white_level: Option<u16>,
    /// median of header time − log time (s)
    pub clock_offset_s: Option<f64>,
    pub calibration: Camera,
    /// topic of the camera_info in use; `None` where the rig file has the calibration
    pub camera_info: Option<String>,
    pub response: Option<ResponseTable>,
    pub flat_field: Option<FlatField>,
}

impl CameraSurvey {
    pub fn new(log: &Log, options: &Options, diagnostics: &mut Vec<Diagnostic>) -> Result<Self> {
        let topic = choose_camera(log, &options.selection, diagnostics)?;
        let channels = log.image_channels(&topic);
        let of_camera = log.channels(&channels);
        if let Some(reason) = of_camera.iter().find_map(|c| c.undecodable.clone())
            && of_camera.iter().all(|c| c.container.is_none())
        {
            return Err(Error::Data(format!("the images of {topic} cannot be decoded: {reason}")));
        }
        let size = of_camera.iter().find_map(|c| c.image_size);
        let frame_id = of_camera.iter().map(|c| c.frame_id.clone()).find(|f| !f.is_empty());
        let mut frame_id = frame_id.unwrap_or_default();
        let named_info = options.rig.camera.camera_info.as_deref();
        let images = Images { topic: &topic, frame: &frame_id, size, named_info };
        let (calibration, camera_info) = calibration(log, options, images, diagnostics)?;
        if let (true, Some(info)) = (frame_id.is_empty(), &camera_info) {
            frame_id = frame_of(log, info);
            let fact = CameraFact::FrameOfInfo { frame: frame_id.clone() };
            diagnostics.extend((!frame_id.is_empty()).then(|| Diagnostic::on(&topic, fact)));
        }
        let response = response(options)?;
        let flat_field = flat_field(options, &calibration, size, response.as_ref())?;
        let own_white_level = || of_camera.iter().find_map(|c| c.white_level());
        let mut frames: Vec<FrameRef> =
            of_camera.iter().flat_map(|c| c.frames.iter().copied()).collect();
        frames.sort_by_key(|frame| frame.id);
        let offset_s = clocks::offset_s(&options.rig, &topic);
        frames.iter_mut().for_each(|f| f.stamp = f.stamp.plus_seconds(offset_s));
        Ok(Self {
            frames,
            offset_s,
            frame_id,
            container: of_camera.iter().find_map(|c| c.container).unwrap_or(Container::Raw),
            image_pixels: size
                .map_or(calibration.width * calibration.height, |(w, h)| w.saturating_mul(h)),
            image_size: size.unwrap_or((calibration.width, calibration.height)),
            image_bytes: of_camera.iter().map(|c| c.largest_image_bytes).max().unwrap_or(0),
            all_image_bytes: of_camera.iter().map(|c| c.image_bytes).sum(),
            jpeg_quality: of_camera.iter().filter_map(|c| c.jpeg_quality).max(),
            white_level: options.config.light.white_level.or_else(own_white_level),
            clock_offset_s: of_camera.iter().find_map(|c| c.clock_offset_s),
            topic,
            channels,
            calibration,
            camera_info,
            response,
            flat_field,
        })
    }

    /// Checks its clock.
    pub fn check(&self, log: &Log, diagnostics: &mut Vec<Diagnostic>) {
        let stamps: Vec<Stamp> = self.frames.iter().map(|f| f.stamp).collect();
        if let Some(channel) = log.channels(&self.channels).first() {
            let facts = checks::clock(channel, &stamps).into_iter();
            diagnostics.extend(facts.map(|fact| Diagnostic::on(&self.topic, fact)));
        }
        diagnostics.extend(self.processed_before());
    }

    /// A warning where the topic's name shows that the images have been processed.
    fn processed_before(&self) -> Option<Diagnostic> {
        let name = self.topic.to_lowercase();
        let is_processed = ["dehaz", "enhanc", "clahe", "correct"].iter().any(|w| name.contains(w));
        is_processed.then(|| Diagnostic::on(&self.topic, CameraFact::AlreadyProcessed))
    }
}

/// The frame id of a topic's messages.
fn frame_of(log: &Log, topic: &str) -> String {
    let channels = log.index.channels.iter().filter(|(id, _)| log.topic(**id) == topic);
    let frame = channels.map(|(_, c)| &c.frame_id).find(|frame| !frame.is_empty());
    frame.cloned().unwrap_or_default()
}

/// The calibration, and the topic of its camera_info where it is of the log.
fn calibration(
    log: &Log,
    options: &Options,
    images: Images<'_>,
    diagnostics: &mut Vec<Diagnostic>,
) -> Result<(Camera, Option<String>)> {
    let Images { topic, size, .. } = images;
    let facts = &options.rig.camera;
    let from_rig = facts.calibration(size).map_err(|e| Error::Rig(format!("rig file: {e}")))?;
    if facts.horizontal_field_of_view_deg.is_some() && facts.fx.is_none() && from_rig.is_some() {
        diagnostics.push(Diagnostic::on(topic, CameraFact::FieldOfViewOnly));
    }
    let (camera, info) = match from_rig {
        Some(camera) => (camera, None),
        None => {
            let found = calibration_in_log(log, images);
            let camera = found.camera.ok_or_else(|| Error::NoCalibration {
                topic: topic.into(),
                found: found.facts.iter().map(|d| format!("; {d}")).collect(),
                file: log.recording.path().into(),
            })?;
            diagnostics.extend(found.facts);
            (camera, found.topic)
        }
    };
    let mut add = |fact| diagnostics.push(Diagnostic::on(topic, fact));
    if let Some((w, h)) = size.filter(|(w, h)| (*w, *h) != (camera.width, camera.height)) {
        let calibrated_px = [camera.width, camera.height];
        add(CameraFact::CalibrationScaled { calibrated_px, image_px: [w, h] });
    }
    let in_water = facts.in_water(camera);
    if in_water != camera {
        add(CameraFact::CalibratedInAir { focal_px: in_water.fx });
    }
    Ok((in_water, info))
}

/// The camera's response by the rig file: a table, or the file that holds it.
fn response(options: &Options) -> Result<Option<ResponseTable>> {
    let of = |reason: String| Error::Rig(format!("camera.response: {reason}"));
    match &options.rig.camera.response {
        None => Ok(None),
        Some(ResponseFacts::Points(points)) => {
            ResponseTable::new(points.clone()).map(Some).map_err(of)
        }
        Some(ResponseFacts::File(path)) => {
            let text = std::fs::read_to_string(path)
                .map_err(|source| Error::Read { path: path.clone(), source })?;
            ResponseTable::from_csv(&text).map(Some).map_err(of)
        }
    }
}

/// Black level and vignetting by the rig file: an image of an evenly lit surface, or a formula.
fn flat_field(
    options: &Options,
    calibration: &Camera,
    size: Option<(usize, usize)>,
    response: Option<&ResponseTable>,
) -> Result<Option<FlatField>> {
    let facts = &options.rig.camera;
    let (width, height) = size.unwrap_or((calibration.width, calibration.height));
    let dark = facts.black_level.map(BlackLevel::bands);
    if let Some(path) = &facts.flat_field {
        let data =
            std::fs::read(path).map_err(|source| Error::Read { path: path.clone(), source })?;
        let transfer = options.config.light.transfer;
        let light = CameraResponse { transfer, white_level: None, response };
        let decoded = decode(&EncodedImage::Compressed { format: "", data: &data }, light);
        let flat = decoded
            .map_err(|e| Error::Rig(format!("camera.flat_field {}: {e}", path.display())))?
            .image
            .into_demosaiced();
        if (flat.width, flat.height) != (width, height) {
            return Err(Error::Rig(format!(
                "camera.flat_field {} is {}×{}, the log's images are {width}×{height}",
                path.display(),
                flat.width,
                flat.height
            )));
        }
        return Ok(Some(FlatField::from_image(flat, dark.unwrap_or_default())));
    }
    let by_formula = facts.vignetting.zip(calibration.scaled_to(width, height));
    let field = by_formula.map(|(vignetting, camera)| {
        FlatField::from_fn(width, height, |u, v| {
            camera.image_plane(u, v).map_or(1.0, |(x, y)| vignetting.share(x, y))
        })
    });
    Ok(match dark {
        Some(dark) => Some(field.unwrap_or_else(|| FlatField::even(width, height)).with_dark(dark)),
        None => field,
    })
}
