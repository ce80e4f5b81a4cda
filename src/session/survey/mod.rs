//! Log → survey: the camera, the range instrument, and where all of it is mounted. Every error
//! names what was found, what is needed, and the key or option that supplies it.

mod attitude;
mod calibration;
mod camera;
mod checks;
mod choose;
mod clocks;
mod facts;
mod lights;
mod mounts;
mod ping_faults;
mod range_unit;
mod ranges;
mod view_check;

use crate::config::SeafloorConfig;
use crate::coordinates::Transform;
use crate::diagnostics::{CameraFact, ClockFact, Diagnostic, LogFact, RangeFact};
use crate::error::{Error, Result};
use crate::geometry::SeafloorEstimator;
use crate::image::Bands;
use crate::image::Container;
use crate::image::flat_field::FlatField;
use crate::image::noise::Electrons;
use crate::image::response::{ResponseTable, TransferKnown};
use crate::image::transfer::Transfer;
use crate::model::{CameraFile, GeometryFile, LightSettingFile, ModelFile};
use crate::recording::FrameId;
use crate::units::Stamp;
use crate::vehicle::{Rig, RigFile, SettingSeries};

use super::frame_gains::FrameGains;
use super::index::FrameRef;
use super::log::Log;
use super::options::Options;
use super::tilts::Tilts;
use camera::CameraSurvey;
pub use facts::{facts_without_ranges, rig_facts};
use lights::strobe_mount;
use mounts::Mounts;
use ranges::RangeSurvey;

/// One camera of a log, with all that its frames need.
#[derive(Clone)]
pub struct Survey {
    /// the camera's topic
    pub camera_topic: String,
    /// its channel ids (a topic may have several after a merge)
    pub camera_channels: Vec<u16>,
    /// its frames in the order of time, their clock offset added
    pub frames: Vec<FrameRef>,
    /// that offset, by the rig file or a model (s)
    pub camera_offset_s: f64,
    /// index in `frames` by identity
    numbers: Vec<(FrameId, usize)>,
    /// the frame id of its images
    pub camera_frame: String,
    /// topic of its camera_info; `None` where the rig file has the calibration
    pub camera_info: Option<String>,
    /// file format of its images
    pub container: Container,
    /// pixels of an image
    pub image_pixels: usize,
    /// width and height of an image (px)
    pub image_size: (usize, usize),
    /// bytes of the largest image message
    pub image_bytes: usize,
    /// bytes of all image messages
    pub all_image_bytes: u64,
    /// quality of its images, where they are JPEGs
    pub jpeg_quality: Option<u8>,
    /// full scale of 16-bit images (DN)
    pub white_level: Option<u16>,
    /// the range instrument's topic
    pub dvl_topic: String,
    /// the attitude's topic
    pub attitude_topic: Option<String>,
    /// tilts of planes that are assumed level, by a model
    pub tilts: Option<Tilts>,
    /// mean light below which a frame was taken without the strobe, by a model
    pub unlit_below: Option<f64>,
    /// pings and attitude
    pub pings: SeafloorEstimator,
    /// vignetting and black level, by the rig file and by a model
    pub flat_field: Option<FlatField>,
    /// whether the rig file has the vignetting, and the black level
    pub flat_field_given: [bool; 2],
    /// the camera's response as a table, where the rig file has it
    pub response: Option<ResponseTable>,
    /// how the transfer curve is known
    pub transfer: TransferKnown,
    /// full well and read noise, where the rig file has them
    pub electrons: Electrons,
    /// settings of camera and strobe along the log
    pub settings: Vec<SettingSeries>,
    /// mounts and calibration
    pub rig: Rig,
    /// what was assumed or mended, and what may make the result worse
    pub diagnostics: Vec<Diagnostic>,
}

impl Survey {
    /// A frame by its identity.
    pub fn frame(&self, id: FrameId) -> Option<&FrameRef> {
        self.frames.get(self.frame_number(id)?)
    }

    /// Number of a frame in the order of time, counted from 0.
    pub fn frame_number(&self, id: FrameId) -> Option<usize> {
        let at = self.numbers.binary_search_by_key(&id, |number| number.0).ok()?;
        Some(self.numbers[at].1)
    }

    /// The values in this log of a setting that a model names.
    fn setting(&self, of: &LightSettingFile) -> Option<&SettingSeries> {
        self.settings.iter().find(|series| (&series.topic, &series.name) == (&of.topic, &of.name))
    }

    /// Light of a frame over that of others, per band: by its settings, and as pass one found it.
    /// Frames that pass one did not sample get what the camera's law gives to an image of such
    /// light.
    pub fn frame_gain(
        &self,
        file: &ModelFile,
        gains: &FrameGains,
        frame: &FrameRef,
        mean_light: impl FnOnce() -> Bands,
    ) -> Bands {
        let log_gain = |s: &LightSettingFile| Some(s.log_gain(self.setting(s)?.at(frame.stamp)?));
        let by_settings: f64 = file.light_settings.iter().filter_map(log_gain).sum::<f64>().exp();
        let law = || file.camera.as_ref()?.gain_law.as_ref();
        let by_law = || law().map(|law| law.log_gains(&mean_light()).map(f64::exp));
        let own = gains.of(frame).or_else(by_law).unwrap_or([1.0; 3]);
        own.map(|gain| gain * by_settings)
    }

    /// Takes over transfer curve, vignetting and black level that a model found, unless the rig
    /// file has them.
    ///
    /// # Errors
    /// The curve is no curve.
    pub fn take_camera(&mut self, found: &CameraFile) -> Result<()> {
        self.take_response(found)?;
        let [has_vignetting, has_dark] = self.flat_field_given;
        let (width, height) = self.image_size;
        let camera = self.rig.camera.scaled_to(width, height).filter(|_| !has_vignetting);
        if let Some(lens) = camera.and_then(|camera| found.lens(&camera)) {
            self.flat_field = Some(lens);
        }
        if let Some(dark) = found.dark().filter(|_| !has_dark) {
            let field = self.flat_field.take();
            let field = field.unwrap_or_else(|| FlatField::even(width, height));
            self.flat_field = Some(field.with_dark(dark));
        }
        Ok(())
    }

    /// Takes over a transfer curve that a model found, unless one is given.
    ///
    /// # Errors
    /// It is no curve.
    pub fn take_response(&mut self, found: &CameraFile) -> Result<()> {
        let is_given = self.transfer == TransferKnown::Surely;
        if let Some(response) = found.response.as_ref().filter(|_| !is_given) {
            self.response = found.response_table().map_err(Error::Usage)?;
            let is_fitted = response.transfer == "fitted";
            self.transfer = if is_fitted { TransferKnown::Fitted } else { TransferKnown::Named };
        }
        Ok(())
    }

    /// Takes over clock and mount that a model found.
    pub fn take_geometry(&mut self, found: &GeometryFile, config: &SeafloorConfig) {
        if let Some(offset_s) = found.clock_offset_s {
            let further = offset_s - self.camera_offset_s;
            self.frames.iter_mut().for_each(|f| f.stamp = f.stamp.plus_seconds(further));
            self.camera_offset_s = offset_s;
        }
        if let Some(rotation) = found.dvl_rotation_xyzw {
            let at = self.rig.body_from_dvl.isometry().translation.vector;
            self.rig.body_from_dvl = Transform::from_parts(at.into(), rotation);
        }
        if found.is_camera_held {
            self.rig.camera_motion = None;
        }
        self.pings.estimate_trajectory(&stamps(&self.frames), &self.rig, config);
    }

    /// Settings that a model compensates and this log does not have.
    pub fn missing_settings(&self, file: &ModelFile) -> Vec<Diagnostic> {
        let missing = file
            .light_settings
            .iter()
            .filter(|s| self.setting(s).is_none_or(|series| series.values.is_empty()));
        let fact = |s: &LightSettingFile| CameraFact::SettingMissing { setting: s.name.clone() };
        missing.map(|s| Diagnostic::on(&s.topic, fact(s))).collect()
    }
}

/// Surveys the camera that the options select.
///
/// # Errors
/// No camera, several cameras, no ranges, no calibration, no mount.
pub fn survey(log: &Log, options: &Options) -> Result<Survey> {
    let rig_file = &options.rig;
    let mut diagnostics = log.recording.parts_diagnostics();
    let camera = CameraSurvey::new(log, options, &mut diagnostics)?;
    let ranges = RangeSurvey::new(log, options, &mut diagnostics)?;
    camera.check(log, &mut diagnostics);
    ranges.check(&mut diagnostics);
    diagnostics.extend(offsets_of_unknown(log, options).chain(unreadable_channels(log)));
    let mut mounts = Mounts::followed(log, rig_file, [&camera.frame_id, ranges.frame_id()]);
    let body_frame = mounts.root(&camera.frame_id).0;
    let given = (rig_file, log.recording.path());
    let body_from_dvl = ranges.mount((&mounts, &body_frame), &camera, given, &mut diagnostics)?;
    diagnostics.extend(mounts.doubts(&[camera.frame_id.as_str(), ranges.frame_id()]));
    let clocks = clocks::Clocks { camera_offset_s: camera.clock_offset_s, rig_file };
    let pings = ranges.pings(log, &clocks, &mut diagnostics)?;
    let measured = (pings.as_slice(), body_from_dvl);
    let camera_motion = view_check::motion(&mut mounts, &camera, measured, &clocks);
    let mounted = view_check::Mounted::new(&camera, rig_file, mounts.root(&camera.frame_id).1)?;
    let body_from_optical = view_check::checked_mount(&mounted, measured, &mut diagnostics)?;
    let vehicle = lights::Vehicle { mounts: &mounts, body_frame: &body_frame, body_from_optical };
    let strobe = strobe_mount(&vehicle, options, &mut diagnostics)?;
    let (mounts, motion) = (&mounts, camera_motion.as_ref());
    let attitude = attitude::Search { log, mounts, body_frame: &body_frame, clocks, motion };
    let (attitude_topic, attitude) = attitude.run(&options.config.seafloor, &mut diagnostics);
    let calibration = camera.calibration;
    let rig = Rig { camera: calibration, body_from_optical, body_from_dvl, strobe, camera_motion };
    let (frames, numbers) = in_time_order(camera.frames);
    let mut pings = SeafloorEstimator::new(pings, attitude);
    let ratio = pings.estimate_trajectory(&stamps(&frames), &rig, &options.config.seafloor);
    diagnostics.extend(ratio.map(|residual_ratio| RangeFact::NotFlat { residual_ratio }.into()));
    Ok(Survey {
        camera_topic: camera.topic,
        camera_channels: camera.channels,
        frames,
        numbers,
        tilts: None,
        unlit_below: None,
        camera_offset_s: camera.offset_s,
        camera_frame: camera.frame_id,
        camera_info: camera.camera_info,
        container: camera.container,
        image_pixels: camera.image_pixels,
        image_size: camera.image_size,
        image_bytes: camera.image_bytes,
        all_image_bytes: camera.all_image_bytes,
        jpeg_quality: camera.jpeg_quality,
        white_level: camera.white_level,
        dvl_topic: ranges.topic,
        attitude_topic,
        pings,
        flat_field: camera.flat_field,
        flat_field_given: flat_field_given(rig_file),
        transfer: transfer_known(options, camera.response.is_some()),
        response: camera.response,
        electrons: electrons(rig_file),
        settings: log.settings(),
        rig,
        diagnostics,
    })
}

fn electrons(rig: &RigFile) -> Electrons {
    let (full_well, read_noise) = (rig.camera.full_well_e, rig.camera.read_noise_e.unwrap_or(0.0));
    Electrons { full_well, read_noise }
}

/// Frames in the order of time, and the index of each by its identity.
fn in_time_order(mut frames: Vec<FrameRef>) -> (Vec<FrameRef>, Vec<(FrameId, usize)>) {
    frames.sort_by_key(|frame| (frame.stamp, frame.id));
    let mut numbers: Vec<_> = frames.iter().enumerate().map(|(i, f)| (f.id, i)).collect();
    numbers.sort_unstable();
    (frames, numbers)
}

fn stamps(frames: &[FrameRef]) -> Vec<Stamp> {
    frames.iter().map(|frame| frame.stamp).collect()
}

/// Whether a rig file has the vignetting, and the black level.
fn flat_field_given(RigFile { camera, .. }: &RigFile) -> [bool; 2] {
    let has_vignetting = camera.vignetting.is_some() || camera.flat_field.is_some();
    [has_vignetting, camera.black_level.is_some()]
}

/// A transfer curve by encoding alone is assumed; which images it applies to, they say themselves.
fn transfer_known(options: &Options, has_table: bool) -> TransferKnown {
    match options.config.light.transfer {
        Transfer::Auto if !has_table => TransferKnown::Assumed,
        _ => TransferKnown::Surely,
    }
}

fn offsets_of_unknown(log: &Log, options: &Options) -> impl Iterator<Item = Diagnostic> {
    let is_unknown = |t: &&String| log.recording.channels.values().all(|c| c.topic != **t);
    let unknown = options.rig.time_offset_s.keys().filter(is_unknown);
    unknown.map(|t| Diagnostic::on(t, ClockFact::OffsetOfUnknownTopic))
}

fn unreadable_channels(log: &Log) -> impl Iterator<Item = Diagnostic> {
    log.index.channels.iter().filter_map(|(id, channel)| {
        if let Some(name) = channel.known_schema.clone() {
            return Some(Diagnostic::on(&log.topic(*id), LogFact::SchemaKnown { name }));
        }
        let (messages, reason) = channel.unreadable.clone();
        let reason = reason?;
        let fact = match messages {
            0 => LogFact::SchemaUnreadable { reason },
            _ => LogFact::MessagesUnreadable { messages, reason },
        };
        Some(Diagnostic::on(&log.topic(*id), fact))
    })
}
