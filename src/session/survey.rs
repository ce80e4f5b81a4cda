//! Scan → survey: which camera, which range instrument, where all of it sits. Every refusal names
//! what was found, what is needed, and the key or option that supplies it.

mod checks;
mod choose;
mod facts;
mod lights;
mod mounts;

use nalgebra::Isometry3;

use crate::config::Config;
use crate::coordinates::{Body, Optical, Transform};
use crate::diagnostics::{CameraFact, ClockFact, Diagnostic, LogFact, MountFact, RangeFact};
use crate::error::{Error, Result};
use crate::geometry::SeafloorEstimator;
use crate::image::decode::{CameraResponse, decode};
use crate::image::flat_field::FlatField;
use crate::image::noise::Electrons;
use crate::image::response::ResponseTable;
use crate::image::{Container, EncodedImage};
use crate::messages::Kind;
use crate::model::{LightSettingFile, ModelFile};
use crate::recording::Recording;
use crate::units::Stamp;
use crate::vehicle::{AttitudeTrack, Camera, ResponseFacts, Rig, RigFile, SettingSeries};

use super::index::{ChannelScan, FrameRef, Scan};
use choose::{choose_camera, choose_ranges};
pub use facts::{facts_without_ranges, rig_facts};
use lights::strobe_mount;
use mounts::Mounts;

/// What the user said about the log, beyond choices and rig.
#[derive(Clone, Debug, Default)]
pub struct Selection {
    /// `--camera`
    pub camera: Option<String>,
    /// `--dvl`
    pub dvl: Option<String>,
    /// `--strobe-frame`
    pub strobe_frame: Option<String>,
}

/// A log, ready to be worked on.
pub struct Survey {
    /// the camera's topic
    pub camera_topic: String,
    /// its channel ids (a topic may have several after a merge)
    pub camera_channels: Vec<u16>,
    /// its pictures in the order of the file
    pub frames: Vec<FrameRef>,
    /// the frame id of its pictures
    pub camera_frame: String,
    /// how its pictures are coded
    pub container: Container,
    /// a picture's pixels, and the bytes of its largest message
    pub picture: (usize, usize),
    /// full scale of 16-bit pictures
    pub white_level: Option<u16>,
    /// the range instrument's topic
    pub dvl_topic: String,
    /// the attitude's topic
    pub attitude_topic: Option<String>,
    /// pings and attitude
    pub pings: SeafloorEstimator,
    /// what the lens takes, where the rig file says
    pub flat_field: Option<FlatField>,
    /// the camera's response as a table, where the rig file has one
    pub response: Option<ResponseTable>,
    /// the sensor's electrons, as far as the rig file tells
    pub electrons: Electrons,
    /// settings of camera and strobe along the log
    pub settings: Vec<SettingSeries>,
    /// mounts and calibration
    pub rig: Rig,
    /// what was assumed or mended, and what may make the result worse
    pub diagnostics: Vec<Diagnostic>,
}

impl Survey {
    /// What a setting that a model names was along this log, where it is told.
    fn setting(&self, of: &LightSettingFile) -> Option<&SettingSeries> {
        self.settings.iter().find(|series| (&series.topic, &series.name) == (&of.topic, &of.name))
    }

    /// Light of a frame over others: by its settings, and where pass one saw it stand out from its
    /// neighbours.
    pub fn frame_gain(&self, file: &ModelFile, stamp: Stamp) -> f64 {
        let by_setting = |s: &LightSettingFile| Some(s.log_gain(self.setting(s)?.at(stamp)?));
        let set: f64 = file.light_settings.iter().filter_map(by_setting).sum::<f64>().exp();
        set * file.frame_gains.iter().find(|g| g.stamp_ns == stamp.0).map_or(1.0, |g| g.gain)
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

/// A channel whose clock is this far from the camera's is not on the same clock [s].
const CLOCK_TOLERANCE_S: f64 = 2.0;

/// One line per channel: topic, type, count.
pub fn channel_list(recording: &Recording) -> String {
    let list: Vec<String> = recording
        .channels
        .values()
        .map(|c| {
            format!(
                "{} ({})",
                c.topic,
                recording.schemas.get(&c.schema_id).map_or("no schema", |s| s.name.as_str())
            )
        })
        .collect();
    if list.is_empty() { "no channels at all".into() } else { list.join(", ") }
}

/// Chooses and joins; see the module.
///
/// # Errors
/// No camera, several cameras, no ranges, no calibration, no mount.
pub fn survey(
    recording: &Recording,
    scan: &mut Scan,
    selection: &Selection,
    rig_file: &RigFile,
    config: &Config,
) -> Result<Survey> {
    let mut diagnostics = Vec::new();
    let camera_topic = choose_camera(recording, scan, selection, &mut diagnostics)?;
    let camera_channels =
        channels_of(recording, scan, &camera_topic, |k| matches!(k, Kind::Image(_)));
    let of_camera: Vec<&ChannelScan> =
        camera_channels.iter().filter_map(|id| scan.channels.get(id)).collect();
    let picture = of_camera.iter().find_map(|c| c.picture);
    let camera_frame =
        of_camera.iter().map(|c| c.frame_id.clone()).find(|f| !f.is_empty()).unwrap_or_default();
    let container = of_camera.iter().find_map(|c| c.container).unwrap_or(Container::Raw);
    let picture_bytes = of_camera.iter().map(|c| c.largest_picture).max().unwrap_or(0);
    let white_level =
        config.light.white_level.or_else(|| of_camera.iter().find_map(|c| c.white_level()));
    let clock = of_camera.iter().find_map(|c| c.clock_offset_s);

    let camera = calibration(recording, scan, rig_file, &camera_topic, picture, &mut diagnostics)?;
    let pixels = picture.map_or(camera.width * camera.height, |(w, h)| w.saturating_mul(h));
    let response = response(rig_file)?;
    let flat_field = flat_field(rig_file, &camera, picture, response.as_ref(), config)?;
    checks::depths_to_beams(recording, scan, &mut diagnostics);
    let dvl_id = choose_ranges(
        recording,
        scan,
        selection.dvl.as_ref().or(rig_file.dvl.topic.as_ref()),
        rig_file,
    )?;
    let dvl_topic = topic(recording, dvl_id);

    // Frames come in the order of the file: that is how both passes meet them.
    let frames = if let [only] = camera_channels[..] {
        scan.channels.get_mut(&only).map(|c| std::mem::take(&mut c.frames)).unwrap_or_default()
    } else {
        frames_in_file_order(scan, &camera_channels)
    };

    let offset_s = checks::offset_s(rig_file, &camera_topic);
    let mut frames = frames;
    frames.iter_mut().for_each(|f| f.stamp = f.stamp.plus_seconds(offset_s));
    let stamps: Vec<Stamp> = frames.iter().map(|f| f.stamp).collect();
    if let Some(channel) = camera_channels.first().and_then(|id| scan.channels.get(id)) {
        let facts = checks::clock(channel, &stamps).into_iter();
        diagnostics.extend(facts.map(|fact| Diagnostic::on(&camera_topic, fact)));
    }
    if let Some(channel) = scan.channels.get(&dvl_id) {
        let stamps: Vec<Stamp> = channel.pings.iter().map(|(p, _)| p.stamp).collect();
        let ranges = checks::ranges(&channel.pings).into_iter();
        diagnostics.extend(ranges.map(|fact| Diagnostic::on(&dvl_topic, fact)));
        let clock = checks::clock(channel, &stamps).into_iter();
        diagnostics.extend(clock.map(|fact| Diagnostic::on(&dvl_topic, fact)));
    }
    for unknown in rig_file
        .time_offset_s
        .keys()
        .filter(|t| recording.channels.values().all(|c| c.topic != **t))
    {
        diagnostics.push(Diagnostic::on(unknown, ClockFact::OffsetOfUnknownTopic));
    }

    let mounts = Mounts::new(recording, scan);
    let body_from_optical: Transform<Body, Optical>;
    let body_frame;
    match &rig_file.camera.mount {
        Some(mount) => {
            body_from_optical = mount.transform().map_err(Error::Rig)?;
            body_frame = mounts.root(&camera_frame).0;
        }
        None => {
            let (root, pose) = mounts.root(&camera_frame);
            body_from_optical = Transform::from_isometry(pose);
            body_frame = root;
        }
    }

    let dvl = scan.channels.get(&dvl_id);
    let dvl_frame = dvl.map(|c| c.frame_id.clone()).unwrap_or_default();
    let body_from_dvl = match &rig_file.dvl.mount {
        Some(mount) => mount.transform().map_err(Error::Rig)?,
        None => {
            let found = dvl_mount(&mounts, &body_frame, &dvl_frame, &dvl_topic, &mut diagnostics);
            Transform::from_isometry(found.ok_or_else(|| Error::NoMount {
                what: "DVL or altimeter",
                frame: dvl_frame.clone(),
                camera_frame: camera_frame.clone(),
                section: "dvl",
            })?)
        }
    };
    let strobe = strobe_mount(
        &mounts,
        &body_frame,
        selection,
        rig_file,
        body_from_optical,
        &mut diagnostics,
    )?;
    let (attitude_topic, attitude) = attitude(
        recording,
        scan,
        &mounts,
        &body_frame,
        (clock, rig_file),
        config,
        &mut diagnostics,
    );

    let mut pings = Vec::new();
    if let Some(channel) = scan.channels.get_mut(&dvl_id) {
        let notes = std::mem::take(&mut channel.notes).into_iter();
        let facts = notes.chain(checks::slant_or_vertical(&channel.heights));
        diagnostics.extend(facts.map(|fact| Diagnostic::on(&dvl_topic, fact)));
        let trusted = on_camera_clock(channel.clock_offset_s, clock);
        if !trusted {
            diagnostics.push(Diagnostic::on(&dvl_topic, ClockFact::NotOnCameraClock));
        }
        let offset_s = checks::offset_s(rig_file, &dvl_topic);
        pings = std::mem::take(&mut channel.pings)
            .into_iter()
            .map(|(mut ping, logged)| {
                if !trusted {
                    ping.stamp = shifted(logged, clock);
                }
                ping.stamp = ping.stamp.plus_seconds(offset_s);
                ping
            })
            .collect();
    }
    let rig = Rig { camera, body_from_optical, body_from_dvl, strobe };
    for (id, channel) in &scan.channels {
        if let (messages, Some(reason)) = channel.unreadable.clone() {
            let fact = match messages {
                0 => LogFact::SchemaUnreadable { reason },
                _ => LogFact::MessagesUnreadable { messages, reason },
            };
            diagnostics.push(Diagnostic::on(&topic(recording, *id), fact));
        }
    }
    if camera_topic.contains("rect")
        || ["dehaz", "enhanc", "clahe", "correct"]
            .iter()
            .any(|w| camera_topic.to_lowercase().contains(w))
    {
        diagnostics.push(Diagnostic::on(&camera_topic, CameraFact::AlreadyProcessed));
    }
    let mut pings = SeafloorEstimator::new(pings, attitude);
    if let Some(residual_ratio) = pings.estimate_trajectory(&stamps, &rig, &config.seafloor) {
        diagnostics.push(RangeFact::NotFlat { residual_ratio }.into());
    }
    Ok(Survey {
        camera_topic,
        camera_channels,
        frames,
        camera_frame,
        container,
        picture: (pixels, picture_bytes),
        white_level,
        dvl_topic,
        attitude_topic,
        pings,
        flat_field,
        response,
        electrons: Electrons {
            full_well: rig_file.camera.full_well_e,
            read_noise: rig_file.camera.read_noise_e.unwrap_or(0.0),
        },
        settings: settings(recording, scan),
        rig,
        diagnostics,
    })
}

/// The camera's response, by the rig file: a table, or the file it stands in.
fn response(rig_file: &RigFile) -> Result<Option<ResponseTable>> {
    let of = |reason: String| Error::Rig(format!("camera.response: {reason}"));
    match &rig_file.camera.response {
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

/// What the lens takes, by the rig file: a picture of an evenly lit surface, or a formula.
fn flat_field(
    rig_file: &RigFile,
    camera: &Camera,
    picture: Option<(usize, usize)>,
    response: Option<&ResponseTable>,
    config: &Config,
) -> Result<Option<FlatField>> {
    let (width, height) = picture.unwrap_or((camera.width, camera.height));
    if let Some(path) = &rig_file.camera.flat_field {
        let data =
            std::fs::read(path).map_err(|source| Error::Read { path: path.clone(), source })?;
        let light = CameraResponse { transfer: config.light.transfer, white_level: None, response };
        let decoded = decode(&EncodedImage::Compressed { format: "", data: &data }, light);
        let flat = decoded
            .map_err(|e| Error::Rig(format!("camera.flat_field {}: {e}", path.display())))?
            .image
            .into_demosaiced();
        if (flat.width, flat.height) != (width, height) {
            let sizes =
                format!("{}×{}, the log's pictures are {width}×{height}", flat.width, flat.height);
            return Err(Error::Rig(format!("camera.flat_field {} is {sizes}", path.display())));
        }
        return Ok(Some(FlatField::from_image(flat)));
    }
    let Some((vignetting, camera)) =
        rig_file.camera.vignetting.zip(camera.scaled_to(width, height))
    else {
        return Ok(None);
    };
    Ok(Some(FlatField::from_fn(width, height, |u, v| {
        camera.image_plane(u, v).map_or(1.0, |(x, y)| vignetting.share(x, y))
    })))
}

/// What camera and strobe were set to.
fn settings(recording: &Recording, scan: &Scan) -> Vec<SettingSeries> {
    let mut found = Vec::new();
    for (id, channel) in &scan.channels {
        let mut names: Vec<&'static str> =
            channel.settings.iter().flat_map(|(_, s)| s.iter().map(|(name, _)| *name)).collect();
        names.sort_unstable();
        names.dedup();
        for name in names {
            let values = channel
                .settings
                .iter()
                .filter_map(|(stamp, s)| Some((*stamp, s.iter().find(|(n, _)| *n == name)?.1)))
                .collect();
            found.push(SettingSeries::new(topic(recording, *id), name.into(), values));
        }
    }
    found
}

fn topic(recording: &Recording, id: u16) -> String {
    recording.channels.get(&id).map(|c| c.topic.clone()).unwrap_or_default()
}

fn channels_of(
    recording: &Recording,
    scan: &Scan,
    topic: &str,
    wanted: impl Fn(&Kind) -> bool,
) -> Vec<u16> {
    let ids = scan.decoders.iter().filter(|(_, d)| wanted(&d.message_type.kind)).map(|(id, _)| *id);
    ids.filter(|id| recording.channels.get(id).is_some_and(|c| c.topic == topic)).collect()
}

fn frames_in_file_order(scan: &Scan, channels: &[u16]) -> Vec<FrameRef> {
    let mut frames: Vec<FrameRef> = channels
        .iter()
        .filter_map(|id| scan.channels.get(id))
        .flat_map(|c| c.frames.iter().copied())
        .collect();
    frames.sort_by_key(|frame| frame.place);
    frames
}

fn calibration(
    recording: &Recording,
    scan: &Scan,
    rig_file: &RigFile,
    camera_topic: &str,
    picture: Option<(usize, usize)>,
    diagnostics: &mut Vec<Diagnostic>,
) -> Result<Camera> {
    let from_rig =
        rig_file.camera.calibration(picture).map_err(|e| Error::Rig(format!("rig file: {e}")))?;
    let from_log = checks::nearest_calibration(recording, scan, camera_topic, picture);
    if rig_file.camera.horizontal_field_of_view_deg.is_some()
        && rig_file.camera.fx.is_none()
        && from_rig.is_some()
    {
        diagnostics.push(Diagnostic::on(camera_topic, CameraFact::FieldOfViewOnly));
    }
    let camera =
        from_rig.or(from_log).ok_or_else(|| Error::NoCalibration { topic: camera_topic.into() })?;
    if let Some((w, h)) = picture.filter(|(w, h)| (*w, *h) != (camera.width, camera.height)) {
        let calibrated_px = [camera.width, camera.height];
        let fact = CameraFact::CalibrationScaled { calibrated_px, image_px: [w, h] };
        diagnostics.push(Diagnostic::on(camera_topic, fact));
    }
    let in_water = rig_file.camera.in_water(camera);
    if in_water != camera {
        let fact = CameraFact::CalibratedInAir { focal_px: in_water.fx };
        diagnostics.push(Diagnostic::on(camera_topic, fact));
    }
    Ok(in_water)
}

fn dvl_mount(
    mounts: &Mounts<'_>,
    body_frame: &str,
    dvl_frame: &str,
    dvl_topic: &str,
    diagnostics: &mut Vec<Diagnostic>,
) -> Option<Isometry3<f64>> {
    if !dvl_frame.is_empty()
        && let Some(pose) = mounts.pose_below(body_frame, dvl_frame)
    {
        return Some(pose);
    }
    // The frame is not in the tree (`dvl_A50_report_link`, `dvl_altitude`): a frame that begins
    // alike, or that the topic is named after, stands in for it.
    let word = |name: &str| {
        name.split(['_', '/']).find(|w| !w.is_empty()).unwrap_or("").to_ascii_lowercase()
    };
    let wanted = [word(dvl_frame), word(dvl_topic)];
    let stand_in = mounts.frames().into_iter().find(|f| {
        wanted.iter().any(|w| !w.is_empty() && word(f) == *w)
            && mounts.pose_below(body_frame, f).is_some()
    })?;
    let fact = MountFact::FrameReplaced { frame: dvl_frame.into(), used: stand_in.into() };
    diagnostics.push(Diagnostic::on(dvl_topic, fact));
    mounts.pose_below(body_frame, stand_in)
}

fn on_camera_clock(offset: Option<f64>, camera: Option<f64>) -> bool {
    match (offset, camera) {
        (Some(a), Some(b)) => (a - b).abs() < CLOCK_TOLERANCE_S,
        (Some(a), None) => a.abs() < CLOCK_TOLERANCE_S,
        (None, Some(b)) => b.abs() < CLOCK_TOLERANCE_S,
        (None, None) => true,
    }
}

/// A log time moved to the camera's clock.
fn shifted(logged: Stamp, camera: Option<f64>) -> Stamp {
    logged.plus_seconds(camera.unwrap_or(0.0))
}

/// The attitude channel with most samples; its sensor's mount is taken out.
fn attitude(
    recording: &Recording,
    scan: &Scan,
    mounts: &Mounts<'_>,
    body_frame: &str,
    (clock, rig_file): (Option<f64>, &RigFile),
    config: &Config,
    diagnostics: &mut Vec<Diagnostic>,
) -> (Option<String>, AttitudeTrack) {
    let best = scan
        .channels
        .iter()
        .filter(|(_, c)| !c.attitudes.is_empty())
        .max_by_key(|(id, c)| (c.count.saturating_sub(c.without_attitude), std::cmp::Reverse(**id)))
        .map(|(id, _)| *id);
    let Some((id, channel)) = best.and_then(|id| Some((id, scan.channels.get(&id)?))) else {
        diagnostics.push(MountFact::NoAttitude.into());
        return (None, AttitudeTrack::default());
    };
    let name = topic(recording, id);
    let sensor_from_body = match mounts.pose_below(body_frame, &channel.frame_id) {
        Some(pose) => pose.rotation.inverse(),
        None => {
            if channel.frame_id != body_frame {
                let frame = channel.frame_id.clone();
                let fact = MountFact::AttitudeFrameUnknown { frame };
                diagnostics.push(Diagnostic::on(&name, fact));
            }
            nalgebra::UnitQuaternion::identity()
        }
    };
    let trusted = on_camera_clock(channel.clock_offset_s, clock);
    let offset_s = checks::offset_s(rig_file, &name);
    let at = |stamp: &Stamp, logged: &Stamp| {
        if trusted { *stamp } else { shifted(*logged, clock) }.plus_seconds(offset_s)
    };
    let samples = channel
        .attitudes
        .iter()
        .map(|(stamp, logged, q)| (at(stamp, logged), q * sensor_from_body));
    (Some(name), AttitudeTrack::new(samples.collect(), config.seafloor.max_attitude_gap_s))
}
