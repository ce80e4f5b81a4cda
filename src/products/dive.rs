//! A corrected log, read back: whose cameras were corrected, with what model, and what became of
//! each frame.
//!
//! Everything stands in the log itself: the metadata records `unwater…`, the attachments beside
//! them and the channels under `/unwater`. See docs/formats.md.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use crate::config::{Config, SETTINGS};
use crate::error::{Error, Result};
use crate::messages::value::Value;
use crate::messages::{Decoder, header};
use crate::model::ModelFile;
use crate::recording::{Block, Entry, Message, Recording, Window};
use crate::report::Report;
use crate::run::bench::Bench;
use crate::session::index::Scan;
use crate::session::survey::Selection;
use crate::session::{self, Options};
use crate::units::Stamp;
use crate::vehicle::RigFile;

/// The floor below a frame, as `/unwater/seafloor` has it.
#[derive(Clone, Debug, PartialEq)]
pub struct FloorFacts {
    /// root mean square of the hits' heights over it [m]; NaN where nothing was left over
    pub residual_m: f64,
    /// what held it
    pub support: String,
}

/// What became of one frame, as `/unwater/frame` has it.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameRecord {
    /// log time [ns]
    pub log_time: u64,
    /// its own time
    pub stamp: Stamp,
    /// whether it was corrected
    pub corrected: bool,
    /// why not
    pub reason: String,
    /// height of the camera over the floor [m]; NaN where there is none
    pub altitude_m: f64,
    /// the floor
    pub floor: Option<FloorFacts>,
}

/// One camera of a corrected log.
pub struct CameraLog {
    /// what stands behind `/unwater` in its names; empty for the first
    pub place: String,
    /// the metadata record
    pub facts: BTreeMap<String, String>,
    /// the model
    pub model: ModelFile,
    /// the account of the run
    pub report: Report,
    /// frames in the order of the file
    pub frames: Vec<FrameRecord>,
    rig: RigFile,
}

/// A corrected log.
pub struct CorrectedLog {
    /// the file
    pub recording: Recording,
    /// what it holds
    pub scan: Scan,
    /// the settings of the run
    pub config: Config,
    /// the cameras that were corrected
    pub cameras: Vec<CameraLog>,
}

impl CorrectedLog {
    /// Reads a corrected log's own account.
    ///
    /// # Errors
    /// It cannot be read, or holds no correction.
    pub fn open(path: &Path, options: &Options) -> Result<Self> {
        let (recording, scan) = session::open(path, options)?;
        let bad =
            |what: &'static str, reason: String| Error::BadFile { path: path.into(), what, reason };
        let mut texts: BTreeMap<String, String> = BTreeMap::new();
        for attachment in recording.attachments().flatten() {
            // A log that was corrected twice has two of a name; the later one is that of the last
            // run.
            let data = recording.attachment_data(&attachment)?;
            texts.insert(attachment.name, String::from_utf8_lossy(&data).into_owned());
        }
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
        let config =
            texts.get("unwater.toml").map_or_else(Config::default, |text| settings_of(text));
        let mut cameras = Vec::new();
        for (place, facts) in records {
            let named = |name: &str| texts.get(format!("{place}/{name}").trim_start_matches('/'));
            let model = named("model.json").ok_or_else(|| {
                bad(
                    "no model",
                    "its attachment model.json is missing; correct the dive anew".into(),
                )
            })?;
            let model =
                ModelFile::from_json(model).map_err(|e| bad("the attachment model.json", e))?;
            let report = named("report.json")
                .and_then(|text| Report::from_json(text).ok())
                .unwrap_or_default();
            let mut rig: RigFile =
                named("rig.toml").and_then(|text| toml::from_str(text).ok()).unwrap_or_default();
            // Files that the rig file pointed to may lie on another machine.
            if rig.camera.flat_field.as_ref().is_some_and(|f| !f.is_file()) {
                rig.camera.flat_field = None;
            }
            cameras.push(CameraLog { place, facts, model, report, frames: Vec::new(), rig });
        }
        let mut log = Self { recording, scan, config, cameras };
        log.read_frames(options.window.unwrap_or(Window::ALL));
        Ok(log)
    }

    fn read_frames(&mut self, window: Window) {
        let mut sinks: BTreeMap<u16, (usize, bool, Decoder)> = BTreeMap::new();
        for (index, camera) in self.cameras.iter().enumerate() {
            for (id, channel) in &self.recording.channels {
                let is_frame = channel.topic == format!("/unwater{}/frame", camera.place);
                let is_floor = channel.topic == format!("/unwater{}/seafloor", camera.place);
                let Some(schema) =
                    self.recording.schemas.get(&channel.schema_id).filter(|_| is_frame || is_floor)
                else {
                    continue;
                };
                if let Ok(decoder) = Decoder::by_path(
                    &channel.message_encoding,
                    &schema.name,
                    &schema.encoding,
                    &schema.data,
                ) {
                    sinks.insert(*id, (index, is_frame, decoder));
                }
            }
        }
        let mut floors: Vec<Option<(u64, FloorFacts)>> =
            self.cameras.iter().map(|_| None).collect();
        let wanted: BTreeSet<u16> = sinks.keys().copied().collect();
        for message in messages_of(&self.recording, &wanted, window) {
            let Some((index, is_frame, decoder)) = sinks.get(&message.channel) else { continue };
            let Ok(value) = decoder.read(message.data()) else { continue };
            if *is_frame {
                let floor = floors[*index]
                    .take()
                    .filter(|(time, _)| *time == message.log_time)
                    .map(|(_, floor)| floor);
                let record = frame_record(&value, message.log_time, message.log_stamp(), floor);
                self.cameras[*index].frames.push(record);
            } else {
                let number = |key: &str| value.number(key).unwrap_or(f64::NAN);
                let floor = FloorFacts {
                    residual_m: number("residual_m"),
                    support: value.text("support").unwrap_or("").into(),
                };
                floors[*index] = Some((message.log_time, floor));
            }
        }
    }

    /// A camera's frames on the bench: its raw pictures, or the corrected ones where those alone
    /// are there.
    ///
    /// # Errors
    /// What is missing in the log.
    pub fn bench(&self, camera: &CameraLog, of: Pictures, options: &Options) -> Result<Bench> {
        let topic = match of {
            Pictures::Raw => camera.fact("camera_topic"),
            Pictures::Corrected => camera.fact("corrected_topic"),
        };
        if !self.recording.channels.values().any(|c| c.topic == topic) {
            return Err(Error::NoSuchTopic {
                what: "camera",
                topic: topic.into(),
                seen: session::survey::channel_list(&self.recording),
            });
        }
        let mut options =
            Options { config: self.config.clone(), rig: camera.rig.clone(), ..options.clone() };
        options.selection = Selection {
            camera: Some(topic.into()),
            dvl: Some(camera.fact("dvl_topic").into()),
            strobe_frame: None,
        };
        if of == Pictures::Corrected {
            // Its stamps are the raw pictures'; its light needs no lens and no response any more.
            let offset = options.rig.time_offset_s.remove(camera.fact("camera_topic"));
            options.rig.time_offset_s.extend(offset.map(|s| (topic.to_string(), s)));
            (
                options.rig.camera.flat_field,
                options.rig.camera.vignetting,
                options.rig.camera.response,
            ) = (None, None, None);
            options.config.light = Default::default();
        }
        let prepared = session::prepare(self.recording.path(), &options)?;
        let mut file = camera.model.clone();
        if of == Pictures::Corrected {
            file.rendering.white_level = None;
        }
        Bench::new(prepared, file, options.config, options.threads)
    }
}

/// Messages of some channels in the order of the file; blocks that hold none of them are not read.
pub fn messages_of<'r>(
    recording: &'r Recording,
    channels: &'r BTreeSet<u16>,
    window: Window,
) -> impl Iterator<Item = Message> + 'r {
    let may_hold = move |block: &&Block| {
        block.may_overlap(window)
            && block.channels().is_none_or(|c| c.iter().any(|id| channels.contains(id)))
    };
    let read = move |block: &Block| {
        recording.read(block, window).map(|contents| contents.entries).unwrap_or_default()
    };
    recording.blocks().iter().filter(may_hold).flat_map(read).filter_map(move |entry| match entry {
        Entry::Message(message) => channels.contains(&message.channel).then_some(message),
        Entry::Damaged(_) => None,
    })
}

/// The settings of a run, also of another version: keys that this one does not know are left out.
fn settings_of(text: &str) -> Config {
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

/// Which of a camera's pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pictures {
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

    /// Frames that were corrected: their place in the log's order, and what is known of them.
    pub fn corrected(&self) -> impl Iterator<Item = (usize, &FrameRecord)> {
        self.frames.iter().enumerate().filter(|(_, f)| f.corrected)
    }
}

fn frame_record(
    value: &Value<'_>,
    log_time: u64,
    logged: Stamp,
    floor: Option<FloorFacts>,
) -> FrameRecord {
    FrameRecord {
        log_time,
        stamp: header(value).stamp.unwrap_or(logged),
        corrected: value.flag("corrected").unwrap_or(false),
        reason: value.text("reason").unwrap_or("").into(),
        altitude_m: value.number("camera_altitude_m").unwrap_or(f64::NAN),
        floor,
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
