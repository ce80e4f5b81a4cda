//! One camera in pass two: its channels, and a frame of it from message to message.

use std::borrow::Cow;
use std::cell::RefCell;

use crate::config::Config;
use crate::correct::{Corrected, Correction, Frame};
use crate::diagnostics::{Diagnostic, Reason};
use crate::error::Result;
use crate::geometry::{NoSeafloor, View};
use crate::image::decode::{self, CameraResponse};
use crate::image::noise::Noise;
use crate::image::transfer::SrgbTable;
use crate::image::{Container, ImageShape, encode};
use crate::messages::output::{self, OutputSchema, OutputType, RawImage};
use crate::messages::writer::WireFormat;
use crate::messages::{Header, Kind, header};
use crate::model::{ImagingModel, ModelFile};
use crate::recording::{Message, Output, Recording, Schema};
use crate::report::Report;
use crate::session::index::Scan;
use crate::session::survey::Survey;

use super::scene::Shown8;
use super::{Added, Done, Shown, corrected_topic, method_name, output_container};

/// What frames of one core take of memory, one after the other.
#[derive(Default)]
struct Memory {
    /// of the codes that come in
    codes: Vec<u8>,
    /// of the samples that go out
    samples: Vec<u8>,
}

thread_local! {
    static MEMORY: RefCell<Memory> = RefCell::default();
}

fn undecodable(reason: String) -> Reason {
    Reason::Undecodable { reason }
}

fn unencodable(reason: String) -> Reason {
    Reason::Unencodable { reason }
}

/// A camera that is corrected, and all that pass two needs for it.
pub struct OfCamera<'p> {
    /// the log's scan
    pub scan: &'p Scan,
    /// the camera's survey
    pub survey: &'p Survey,
    /// the choices
    pub config: &'p Config,
    /// how added messages are encoded
    pub wire: WireFormat,
    /// the model as a file
    pub file: &'p ModelFile,
    /// the model
    pub model: &'p ImagingModel,
    /// how frames are corrected
    pub correction: Correction<'p>,
    /// the rig, as a rig file's text
    pub rig_toml: &'p str,
    /// those of the model
    pub model_diagnostics: &'p [Diagnostic],
    /// what stands behind `/unwater` in the names of all but the first camera
    pub place: String,
}

impl OfCamera<'_> {
    fn container(&self) -> Container {
        output_container(self.survey.container, self.config)
    }

    pub(super) fn empty_report(&self, recording: &Recording) -> Report {
        Report {
            version: env!("CARGO_PKG_VERSION").into(),
            source: recording
                .path()
                .file_name()
                .map(|n| n.to_string_lossy().into_owned())
                .unwrap_or_default(),
            camera_topic: self.survey.camera_topic.clone(),
            corrected_topic: corrected_topic(
                &self.survey.camera_topic,
                self.container() != Container::Raw,
            ),
            dvl_topic: self.survey.dvl_topic.clone(),
            method: method_name(self.config.render.method).into(),
            diagnostics: [&self.survey.diagnostics, self.model_diagnostics].concat(),
            ..Report::default()
        }
    }

    pub(super) fn add_channels(&self, out: &mut Output) -> Result<Added> {
        let mut add = |topic: &str, kind: OutputType| {
            let OutputSchema { name, encoding, data, message_encoding } = kind.schema_in(self.wire);
            out.add_channel(
                topic,
                message_encoding,
                &Schema { name, encoding: encoding.into(), data },
            )
        };
        let ours = |name: &str| format!("/unwater{}/{name}", self.place);
        let compressed = self.container() != Container::Raw;
        let corrected = corrected_topic(&self.survey.camera_topic, compressed);
        Ok(Added {
            corrected: add(
                &corrected,
                if compressed { output::COMPRESSED_IMAGE } else { output::IMAGE },
            )?,
            camera_info: if self.config.render.rectify {
                Some(add(
                    &(corrected_topic(&self.survey.camera_topic, false) + "/camera_info"),
                    output::CAMERA_INFO,
                )?)
            } else {
                None
            },
            mask: if self.config.render.mask {
                Some(add(&ours("mask/compressed"), output::COMPRESSED_IMAGE)?)
            } else {
                None
            },
            attenuation: add(&ours("attenuation"), output::ATTENUATION)?,
            seafloor: add(&ours("seafloor"), output::SEAFLOOR)?,
            cloud: if self.config.output.seafloor_points_across > 0 {
                Some(add(&ours("seafloor/cloud"), output::POINT_CLOUD)?)
            } else {
                None
            },
            transform: add(&ours("seafloor/transform"), output::TRANSFORM)?,
            strobe: add(&ours("strobe"), output::POSE)?,
            strobe_beam: add(&ours("strobe/beam"), output::POINT_CLOUD)?,
            raw_preview: if self.needs_preview() {
                Some(add(&ours("raw/compressed"), output::COMPRESSED_IMAGE)?)
            } else {
                None
            },
            beam_pattern: add(&ours("beam_pattern"), output::BEAM_PATTERN)?,
            beam_picture: add(&ours("beam_pattern/picture/compressed"), output::COMPRESSED_IMAGE)?,
            frame: add(&ours("frame"), output::FRAME)?,
            log: add(&ours("log"), output::LOG)?,
            plot_attenuation: add(&ours("plot/attenuation_per_m"), output::MULTI_ARRAY)?,
            plot_altitude: add(&ours("plot/camera_altitude_m"), output::MULTI_ARRAY)?,
            plot_residual: add(&ours("plot/seafloor_residual_m"), output::MULTI_ARRAY)?,
        })
    }

    /// One frame, on whichever core: decode, find its plane, correct, encode.
    pub(super) fn frame(&self, index: usize, message: Message, srgb: &SrgbTable) -> Done {
        let mut memory = MEMORY.take();
        let container = self.container();
        let mut said = Header::default();
        let (mut plane, mut preview) = (None, None);
        let result = (|| {
            let decoder = self
                .scan
                .decoders
                .get(&message.channel)
                .ok_or_else(|| undecodable("its channel is not read".into()))?;
            let value = decoder.read(message.data()).map_err(undecodable)?;
            said = header(&value);
            let Kind::Image(read) = decoder.message_type.kind else {
                return Err(undecodable("no image".into()));
            };
            let Survey { white_level, response, .. } = self.survey;
            let light = CameraResponse {
                transfer: self.config.light.transfer,
                white_level: *white_level,
                response: response.as_ref(),
            };
            let picture = read(&value).map_err(undecodable)?;
            let codes =
                decode::read_pixels_with(&picture, light, std::mem::take(&mut memory.codes))
                    .map_err(undecodable)?;
            let (width, height, bands) = (codes.width, codes.height, codes.bands());
            let flat_field = self.survey.flat_field.as_ref();
            flat_field
                .map_or(Ok(()), |flat| flat.check_size(width, height))
                .map_err(|_sizes| Reason::WrongSize)?;
            if self.needs_preview() {
                preview = Some(self.preview(&said, &codes, srgb).map_err(unencodable)?);
            }
            let stamp = self.survey.frames.get(index).map_or(message.log_stamp(), |f| f.stamp);
            let found = self
                .survey
                .pings
                .seafloor(stamp, &self.survey.rig, &self.config.seafloor)
                .map_err(|e| match e {
                    NoSeafloor::NoPing { .. } => Reason::NoPing,
                    NoSeafloor::NoReturn => Reason::NoReturn,
                    NoSeafloor::Implausible => Reason::ImpossiblePlane,
                })?;
            plane = Some(found);
            let camera =
                self.survey.rig.camera.scaled_to(width, height).ok_or(Reason::WrongSize)?;
            if bands != self.model.bands {
                return Err(undecodable(format!(
                    "it has {bands} bands, the model {}",
                    self.model.bands
                )));
            }
            let terrain = self.survey.pings.terrain(stamp, &found, &self.survey.rig);
            let rectified = self.config.render.rectify.then(|| camera.rectified());
            let view = View {
                camera: &camera,
                rig: &self.survey.rig,
                plane: &found,
                terrain: terrain.as_ref(),
            };
            let now = self.correction.model.at(stamp);
            let noise = Noise::of(&codes.coding, light, self.correction.electrons);
            let frame = Frame {
                codes: &codes,
                flat_field,
                view: &view,
                gain: self.survey.frame_gain(self.file, stamp),
                noise: &noise,
                rectified: rectified.as_ref(),
            };
            let mut samples = std::mem::take(&mut memory.samples);
            samples.clear();
            samples.reserve(width * height * bands * usize::from(self.config.render.depth / 8));
            let take = |row: &mut [f32]| match self.config.render.depth {
                16 => samples
                    .extend(row.iter().flat_map(|v| {
                        ((v.clamp(0.0, 1.0) * 65535.0).round() as u16).to_ne_bytes()
                    })),
                _ => srgb.encode_row(row, &mut samples),
            };
            let Corrected { mask, facts } =
                Correction { model: &now, ..self.correction }.apply(&frame, take);
            if facts.off_surface_share >= 1.0 {
                return Err(Reason::OffSeafloor);
            }
            let subsampled = codes.coding.container == Container::Jpeg { subsampled: true };
            memory.codes = codes.into_buffer();
            let (width, height) = rectified.map_or((width, height), |c| (c.width, c.height));
            let shown = || -> std::result::Result<Shown, String> {
                let png =
                    |mask: Vec<u8>| encode::png(&mask, ImageShape { width, height, bands: 1 }, 8);
                let mask = mask
                    .map(png)
                    .transpose()?
                    .map(|png| output::compressed_image(self.wire, &said, "png", &png));
                let view = View { camera: rectified.as_ref().unwrap_or(&camera), ..view };
                let shown = Shown8 {
                    samples: &samples,
                    width,
                    height,
                    bands,
                    depth: self.config.render.depth,
                    srgb,
                };
                let cloud = (self.config.output.seafloor_points_across > 0)
                    .then(|| self.seafloor_cloud(&said, &shown, &view));
                Ok(Shown {
                    picture: self.encoded(
                        &said,
                        &samples,
                        (width, height, bands),
                        container,
                        subsampled,
                    )?,
                    mask,
                    cloud,
                    facts,
                })
            };
            let shown = shown().map_err(unencodable);
            memory.samples = samples;
            shown
        })();
        MEMORY.set(memory);
        Done { message, header: said, plane, preview, result }
    }

    fn encoded(
        &self,
        header: &Header,
        samples: &[u8],
        (width, height, bands): (usize, usize, usize),
        container: Container,
        subsampled: bool,
    ) -> std::result::Result<Vec<u8>, String> {
        let deep = self.config.render.depth == 16;
        let shape = ImageShape { width, height, bands };
        Ok(match container {
            Container::Jpeg { .. } => output::compressed_image(
                self.wire,
                header,
                "jpeg",
                &encode::jpeg(samples, shape, self.config.render.jpeg_quality, subsampled)?,
            ),
            Container::Png => output::compressed_image(
                self.wire,
                header,
                "png",
                &encode::png(samples, shape, self.config.render.depth)?,
            ),
            Container::Raw => {
                let encoding = match (bands, deep) {
                    (1, false) => "mono8",
                    (1, true) => "mono16",
                    (_, false) => "rgb8",
                    (_, true) => "rgb16",
                };
                let is_swapped = deep && cfg!(target_endian = "big");
                let samples = if is_swapped {
                    samples.chunks_exact(2).flat_map(|c| [c[1], c[0]]).collect()
                } else {
                    Cow::Borrowed(samples)
                };
                let step = samples.len() / height.max(1);
                let raw = RawImage { width, height, encoding, step, data: &samples };
                output::image(self.wire, header, &raw)
            }
        })
    }
}
