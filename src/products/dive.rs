//! A corrected log, read back: which cameras were corrected, with what model, and the result for
//! each frame.
//!
//! Everything is in the log itself: the metadata records `unwater…`, the attachments beside them
//! and the channels under `/unwater`. See docs/formats.md.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::path::Path;

use super::messages::messages_of;
use crate::config::{Config, SETTINGS};
use crate::error::{Error, Result};
use crate::messages::value::Value;
use crate::messages::{Decoder, header};
use crate::model::ModelFile;
use crate::recording::{FrameId, LogIdentity, Message, Recording, Window};
use crate::report::Report;
use crate::run::bench::Bench;
use crate::run::shard_of;
use crate::session::{CameraSession, FrameRef, Log, Options, Selection, Shard, Threads};
use crate::units::Stamp;
use crate::vehicle::RigFile;

/// The seafloor below a frame, as `/unwater/seafloor` has it.
#[derive(Clone, Debug, PartialEq)]
pub struct SeafloorFacts {
    /// root mean square distance of the returns from it (m); NaN without redundant returns
    pub residual_m: f64,
    /// what the plane rests on
    pub support: String,
}

/// The result for one frame, as `/unwater/frame` has it.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameRecord {
    /// log time (ns)
    pub log_time: u64,
    /// time of its header
    pub stamp: Stamp,
    /// whether it was corrected
    pub corrected: bool,
    /// why not
    pub reason: String,
    /// altitude of the camera (m); NaN where no seafloor is known
    pub altitude_m: f64,
    /// seafloor below it
    pub seafloor: Option<SeafloorFacts>,
}

/// One camera of a corrected log.
pub struct CameraLog {
    /// follows `/unwater` in its names; empty for the first
    pub place: String,
    /// the metadata record
    pub facts: BTreeMap<String, String>,
    /// the model
    pub model: ModelFile,
    /// the report of the run
    pub report: Report,
    /// frames in the order of the file
    pub frames: Vec<FrameRecord>,
    rig: RigFile,
}

/// A corrected log.
pub struct CorrectedLog {
    /// the file and what it holds
    pub scanned: Log,
    /// the segment that is read
    pub window: Window,
    /// the settings of the run
    pub config: Config,
    /// the cameras that were corrected
    pub cameras: Vec<CameraLog>,
}

impl CorrectedLog {
    /// Reads the records of a correction.
    ///
    /// # Errors
    /// The log cannot be read, or holds no correction.
    pub fn open(path: &Path, options: &Options) -> Result<Self> {
        let recording = Recording::open(path)?;
        let texts = texts(&recording)?;
        let mut cameras = cameras(&recording, &texts)?;
        // Ranges are read as they were for the correction.
        let rig = cameras.first().map(|c| c.rig.clone()).unwrap_or_default();
        let reading = Options { rig, ..options.clone() };
        let scanned = Log::scan(recording, &reading, &Threads::new(options.threads))?;
        let scanned = scanned.with_messages(&reading)?;
        let config =
            texts.get("unwater.toml").map_or_else(Config::default, |text| settings_of(text));
        read_frames(&scanned.recording, options.window(), &mut cameras)?;
        Ok(Self { scanned, window: options.window(), config, cameras })
    }

    /// An error of this file.
    pub fn bad(&self, what: &'static str, reason: String) -> Error {
        Error::BadFile { path: self.scanned.recording.path().into(), what, reason }
    }

    /// A camera with its raw images, or with the corrected ones where only those are in the log.
    ///
    /// # Errors
    /// What is missing in the log.
    pub fn bench(&self, camera: &CameraLog, images: Images, options: &Options) -> Result<Bench> {
        let topic = camera.topic(images);
        if !self.scanned.recording.channels.values().any(|c| c.topic == topic) {
            return Err(Error::NoSuchTopic {
                what: "camera",
                topic: topic.into(),
                seen: self.scanned.channel_list(),
            });
        }
        let mut options = Options {
            config: self.config.clone(),
            rig: camera.rig.clone(),
            selection: camera.selection(images),
            ..options.clone()
        };
        let mut file = camera.model.clone();
        if images == Images::Corrected {
            // Their stamps are those of the raw images; vignetting and response are removed.
            let offset = options.rig.time_offset_s.remove(camera.fact("camera_topic"));
            options.rig.time_offset_s.extend(offset.map(|s| (topic.to_string(), s)));
            let facts = &mut options.rig.camera;
            (facts.flat_field, facts.vignetting, facts.response) = (None, None, None);
            (facts.black_level, file.camera) = (None, None);
            options.config.light = Default::default();
            file.rendering.white_level = None;
        }
        // Only where cameras were corrected in several runs, their ranges may be read differently.
        let session = if self.scanned.is_read_by(&options.rig.dvl) {
            CameraSession::new(&self.scanned, &options)?
        } else {
            CameraSession::open(self.scanned.recording.path(), &options)?
        };
        Bench::new(session, file, Some(&camera.source()), options.threads)
    }

    /// A camera with these images, and the records of its frames.
    ///
    /// # Errors
    /// What is missing in the log.
    pub fn source(
        &self,
        camera: &CameraLog,
        images: Images,
        options: &Options,
    ) -> Result<ImageSource> {
        let bench = self.bench(camera, images, options)?;
        Ok(ImageSource { bench, records: self.records(camera, images) })
    }

    /// Frames of a camera's images in this log: index of their record in [`CameraLog::frames`].
    pub fn records(&self, camera: &CameraLog, images: Images) -> BTreeMap<FrameId, usize> {
        self.records_on(camera.topic(images), camera, images)
    }

    /// The same of the masks of a camera's corrected images.
    pub fn mask_records(&self, camera: &CameraLog) -> BTreeMap<FrameId, usize> {
        let topic = format!("/unwater{}/mask/compressed", camera.place);
        self.records_on(&topic, camera, Images::Corrected)
    }

    fn records_on(
        &self,
        topic: &str,
        camera: &CameraLog,
        images: Images,
    ) -> BTreeMap<FrameId, usize> {
        let channels = self.scanned.image_channels(topic);
        let mut frames: Vec<&FrameRef> =
            self.scanned.channels(&channels).into_iter().flat_map(|c| &c.frames).collect();
        frames.sort_by_key(|frame| frame.id);
        // Records and images have the log time of the raw frame, and its order.
        let mut by_time: BTreeMap<u64, VecDeque<usize>> = BTreeMap::new();
        let is_of = |f: &FrameRecord| images == Images::Raw || f.corrected;
        for (index, record) in camera.frames.iter().enumerate().filter(|(_, f)| is_of(f)) {
            by_time.entry(record.log_time).or_default().push_back(index);
        }
        let record = |frame: &FrameRef| {
            let log_time = u64::try_from(frame.logged.0).ok()?;
            Some((frame.id, by_time.get_mut(&log_time)?.pop_front()?))
        };
        frames.into_iter().filter_map(record).collect()
    }
}

/// Images of a camera, raw or corrected.
pub struct ImageSource {
    /// the camera
    pub bench: Bench,
    /// its frames: index of their record in [`CameraLog::frames`]
    pub records: BTreeMap<FrameId, usize>,
}

/// Report and model of each camera of a complete output of `correct`, if it was made from this
/// input with the request of this fingerprint. `None` for any other file.
pub fn finished(
    output: &Path,
    (source, request_sha256): (&Recording, &str),
    shard: Option<Shard>,
) -> Option<Vec<(Report, ModelFile)>> {
    let recording = Recording::open(output).ok().filter(|r| r.is_complete)?;
    let cameras = read_cameras(&recording).ok()?;
    let is_of_source = |c: &CameraLog| source.equals(&c.source()).unwrap_or(false);
    let is_same = cameras.iter().all(|c| c.fact("request_sha256") == request_sha256)
        && shard_of(&recording) == shard
        && cameras.iter().all(is_of_source);
    is_same.then(|| cameras.into_iter().map(|c| (c.report, c.model)).collect())
}

/// The cameras that were corrected in a log, without their frames.
///
/// # Errors
/// The log cannot be read, or holds no correction.
pub fn read_cameras(recording: &Recording) -> Result<Vec<CameraLog>> {
    cameras(recording, &texts(recording)?)
}

/// Attachments by name, as text.
pub fn texts(recording: &Recording) -> Result<BTreeMap<String, String>> {
    let mut texts = BTreeMap::new();
    for attachment in recording.attachments().flatten() {
        // A log that was corrected twice has two of a name; the later one is of the last run.
        let data = recording.attachment_data(&attachment)?;
        texts.insert(attachment.name, String::from_utf8_lossy(&data).into_owned());
    }
    Ok(texts)
}

/// The cameras of the metadata records, without their frames.
pub fn cameras(recording: &Recording, texts: &BTreeMap<String, String>) -> Result<Vec<CameraLog>> {
    let bad = |what: &'static str, reason: String| Error::BadFile {
        path: recording.path().into(),
        what,
        reason,
    };
    let mut records: BTreeMap<String, BTreeMap<String, String>> = BTreeMap::new();
    for record in &recording.metadata {
        let place =
            record.name.strip_prefix("unwater").filter(|p| p.is_empty() || p.starts_with('/'));
        if let Some(place) = place.filter(|_| record.metadata.contains_key("corrected_topic")) {
            records.insert(place.into(), record.metadata.clone());
        }
    }
    if records.is_empty() {
        let remedy =
            "it holds no record of a correction; give the output of `unwater correct`".into();
        return Err(bad("no corrected log", remedy));
    }
    let camera = |(place, facts): (String, BTreeMap<String, String>)| {
        let named = |name: &str| texts.get(format!("{place}/{name}").trim_start_matches('/'));
        let missing = "its attachment model.json is missing; correct the dive again";
        let model = named("model.json").ok_or_else(|| bad("no model", missing.into()))?;
        let model = ModelFile::from_json(model).map_err(|e| bad("the attachment model.json", e))?;
        let report = named("report.json").and_then(|text| Report::from_json(text).ok());
        let rig = named("rig.toml").and_then(|text| toml::from_str(text).ok());
        let mut rig: RigFile = rig.unwrap_or_default();
        // Files that the rig file names may be on another machine.
        if rig.camera.flat_field.as_ref().is_some_and(|f| !f.is_file()) {
            rig.camera.flat_field = None;
        }
        let report = report.unwrap_or_default();
        Ok(CameraLog { place, facts, model, report, frames: Vec::new(), rig })
    };
    records.into_iter().map(camera).collect()
}

/// Reads the records of the frames of every camera, in the order of the file.
///
/// # Errors
/// The log cannot be read, or one of the records not.
pub fn read_frames(recording: &Recording, window: Window, cameras: &mut [CameraLog]) -> Result<()> {
    let mut sinks: BTreeMap<u16, (usize, bool, Decoder)> = BTreeMap::new();
    for (index, camera) in cameras.iter().enumerate() {
        for (id, channel) in &recording.channels {
            let is_frame = channel.topic == format!("/unwater{}/frame", camera.place);
            let is_seafloor = channel.topic == format!("/unwater{}/seafloor", camera.place);
            let schema = recording.schemas.get(&channel.schema_id);
            let Some(schema) = schema.filter(|_| is_frame || is_seafloor) else { continue };
            let (encoding, data) = (&schema.encoding, &schema.data);
            let decoder = Decoder::by_path(&channel.message_encoding, &schema.name, encoding, data);
            if let Ok(decoder) = decoder {
                sinks.insert(*id, (index, is_frame, decoder));
            }
        }
    }
    let mut seafloors: Vec<Option<(u64, SeafloorFacts)>> = cameras.iter().map(|_| None).collect();
    let wanted: BTreeSet<u16> = sinks.keys().copied().collect();
    for message in messages_of(recording, &wanted, window) {
        let message = message?;
        let Some((index, is_frame, decoder)) = sinks.get(&message.channel) else { continue };
        let value = decoder.read(message.data()).map_err(|reason| Error::BadFile {
            path: recording.path().into(),
            what: "a record of the correction",
            reason,
        })?;
        if *is_frame {
            let seafloor = seafloors[*index].take();
            let seafloor = seafloor.filter(|(time, _)| *time == message.log_time);
            let record = frame_record(&value, &message, seafloor.map(|(_, facts)| facts));
            cameras[*index].frames.push(record);
        } else {
            let facts = SeafloorFacts {
                residual_m: value.number("residual_m").unwrap_or(f64::NAN),
                support: value.text("support").unwrap_or("").into(),
            };
            seafloors[*index] = Some((message.log_time, facts));
        }
    }
    Ok(())
}

/// Settings of a run, also of another version: unknown keys are left out.
pub fn settings_of(text: &str) -> Config {
    let known = |section: &str, key: &str| {
        SETTINGS.iter().any(|s| s.key.split_once('.') == Some((section, key)))
    };
    Config::from_toml(text).unwrap_or_else(|_other_version| {
        let mut table: toml::Table = toml::from_str(text).unwrap_or_default();
        for (section, values) in &mut table {
            if let Some(values) = values.as_table_mut() {
                values.retain(|key, _| known(section, key));
            }
        }
        Config::from_toml(&toml::to_string(&table).unwrap_or_default()).unwrap_or_default()
    })
}

/// Raw or corrected images of a camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Images {
    /// as recorded
    Raw,
    /// as corrected
    Corrected,
}

impl CameraLog {
    /// A value of the metadata record; empty where it is missing.
    pub fn fact(&self, key: &str) -> &str {
        self.facts.get(key).map_or("", String::as_str)
    }

    /// The log that it was made from.
    pub fn source(&self) -> LogIdentity {
        LogIdentity {
            sha256: self.fact("source_sha256").into(),
            index_sha256: self.fact("source_index_sha256").into(),
        }
    }

    /// Topic of its images.
    pub fn topic(&self, images: Images) -> &str {
        self.fact(match images {
            Images::Raw => "camera_topic",
            Images::Corrected => "corrected_topic",
        })
    }

    /// Its channels.
    fn selection(&self, images: Images) -> Selection {
        Selection {
            camera: Some(self.topic(images).into()),
            dvl: Some(self.fact("dvl_topic").into()),
            strobe_frame: None,
        }
    }

    /// The segment of the input that was written.
    pub fn run_window(&self) -> Window {
        let bound = |key: &str, none| self.fact(key).parse().unwrap_or(none);
        Window { start: bound("window_start_ns", 0), end: bound("window_end_ns", u64::MAX) }
    }

    /// Options of the run that corrected the camera; with `is_own`, for the corrected log itself
    /// instead of its input.
    ///
    /// # Errors
    /// The settings are of another version.
    pub fn run_options(&self, is_own: bool) -> std::result::Result<Options, String> {
        Ok(Options {
            config: Config::from_toml(self.fact("configuration"))?,
            rig: self.rig.clone(),
            selection: self.selection(Images::Raw),
            window: Some(self.run_window()).filter(|window| !is_own && *window != Window::ALL),
            source: is_own.then(|| self.source()),
            ..Options::default()
        })
    }

    /// Frames that were corrected, with their index in [`CameraLog::frames`].
    pub fn corrected(&self) -> impl Iterator<Item = (usize, &FrameRecord)> {
        self.frames.iter().enumerate().filter(|(_, f)| f.corrected)
    }
}

fn frame_record(
    value: &Value<'_>,
    message: &Message,
    seafloor: Option<SeafloorFacts>,
) -> FrameRecord {
    FrameRecord {
        log_time: message.log_time,
        stamp: header(value).stamp.unwrap_or(message.log_stamp()),
        corrected: value.flag("corrected").unwrap_or(false),
        reason: value.text("reason").unwrap_or("").into(),
        altitude_m: value.number("camera_altitude_m").unwrap_or(f64::NAN),
        seafloor,
    }
}

#[cfg(test)]
mod tests {
    use super::settings_of;

    #[test]
    fn settings_of_another_version_are_read_as_far_as_they_are_known() {
        let config =
            settings_of("[render]\ndepth = 16\nglitter = true\n[seafloor]\nmax_ping_gap_s = 2.5\n");
        assert_eq!((config.render.depth, config.seafloor.max_ping_gap_s), (16, 2.5));
        assert_eq!(settings_of("no settings"), Default::default());
    }
}
