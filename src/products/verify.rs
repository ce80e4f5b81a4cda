//! Whether a corrected log is what it must be: undamaged, with the records that were written, with
//! every message of the input, and with corrected frames that follow from raw frames and model.

use std::collections::{BTreeMap, VecDeque};
use std::path::Path;

use super::dive::{CameraLog, Images, cameras, read_frames, settings_of, texts};
use crate::config::Config;
use crate::diagnostics::{Diagnostic, Severity, VerifyFact};
use crate::error::{Error, Result};
use crate::recording::{
    ChannelDigest, Damage, Entry, Fingerprinted, LogFiles, LogIdentity, Message, Recording, Window,
};
use crate::run::{repeat, shard_of};
use crate::session::{Options, Progress, Shard, sha256};

/// Messages of the input are compared so many at a time.
const GROUP: u64 = 64;

/// Result of a verification.
#[derive(Debug, Default)]
pub struct Verification {
    /// what is not as it must be, and what could not be checked
    pub diagnostics: Vec<Diagnostic>,
    /// messages of the input that were compared
    pub copied: u64,
    /// messages that were made again and compared
    pub repeated: u64,
}

impl Verification {
    /// Whether something is wrong.
    pub fn has_failed(&self) -> bool {
        self.diagnostics.iter().any(|d| d.severity() == Severity::Loss)
    }

    /// Whether the corrected frames were compared.
    pub fn is_complete(&self) -> bool {
        let is_not_repeated = |d: &Diagnostic| d.code() == "verify-not-repeated";
        !self.diagnostics.iter().any(is_not_repeated)
    }

    fn add(&mut self, fact: VerifyFact) {
        self.diagnostics.push(fact.into());
    }
}

/// Verifies a corrected log, with its input where that is given.
///
/// # Errors
/// A file cannot be read, or is no corrected log.
pub fn verify(
    path: &Path,
    input: Option<&LogFiles>,
    threads: usize,
    progress: &dyn Progress,
) -> Result<Verification> {
    let output = Recording::open(path)?;
    if let Some(Shard { index, count }) = shard_of(&output) {
        let reason = format!("it is part {index} of {count}: join all parts first");
        return Err(Error::BadFile { path: path.into(), what: "no whole log", reason });
    }
    let texts = texts(&output)?;
    let mut cameras = cameras(&output, &texts)?;
    let config = texts.get("unwater.toml").map_or_else(Config::default, |text| settings_of(text));
    let mut found = Verification::default();
    check_records(&cameras, &texts, &mut found);
    let first = cameras.first();
    let window = first.map_or(Window::ALL, CameraLog::run_window);
    let input = input.map(Recording::open_files).transpose()?;
    let is_other = match (&input, first) {
        (Some(input), Some(first)) => is_other_input(input, &first.source(), &mut found)?,
        _ => false,
    };
    let log = RawFrames { path, output: &output, is_whole: !config.output.drop_raw };
    let added = repeated(&log, input.as_ref(), &cameras, (is_other, threads), progress)?;
    let added = added.unwrap_or_else(|reason| {
        found.add(VerifyFact::NotRepeated { reason });
        BTreeMap::new()
    });
    let is_added = |topic: &str| added.contains_key(topic);
    let group = |topic: &str| u64::from(!is_added(topic)) * GROUP;
    let (own, damage) = digests(&output, Window::ALL, group, |_, _| true);
    let damage = output.damage.iter().chain(&damage).map(|d| d.reason.clone());
    damage.for_each(|reason| found.add(VerifyFact::Damaged { reason }));
    let version = first.map_or("", |camera| camera.fact("version"));
    let is_reproduced = check_added(&output, &own, &added, &mut found);
    if !is_reproduced && version != env!("CARGO_PKG_VERSION") {
        let own = env!("CARGO_PKG_VERSION").into();
        found.add(VerifyFact::OtherVersion { version: version.into(), own });
    }
    if let Some(input) = &input {
        if config.output.drop_raw {
            read_frames(&output, Window::ALL, &mut cameras)?;
        }
        check_input((input, &output), window, &own, Copied::new(&config, &cameras), &mut found);
    }
    Ok(found)
}

/// Whether the input is another log than the one that is recorded.
fn is_other_input(
    input: &Recording,
    recorded: &LogIdentity,
    found: &mut Verification,
) -> Result<bool> {
    if input.equals(recorded)? {
        return Ok(false);
    }
    let (recorded, given) = (recorded.clone(), input.identity());
    found.add(if recorded.is_whole() {
        VerifyFact::OtherInput { recorded: recorded.sha256, given: given.sha256 }
    } else {
        VerifyFact::OtherInput { recorded: recorded.index_sha256, given: given.index_sha256 }
    });
    Ok(true)
}

/// Attachments against the fingerprints of the metadata record.
fn check_records(
    cameras: &[CameraLog],
    texts: &BTreeMap<String, String>,
    found: &mut Verification,
) {
    for camera in cameras {
        let named = |name: &str| format!("{}/{name}", camera.place).trim_start_matches('/').into();
        for (key, file) in [
            ("model_sha256", "model.json"),
            ("report_sha256", "report.json"),
            ("rig_sha256", "rig.toml"),
        ] {
            let name: String = named(file);
            let hash = texts.get(&name).map(|text| sha256(text.as_bytes()));
            // Earlier versions have not all of them.
            if camera.facts.contains_key(key) && hash.as_deref() != Some(camera.fact(key)) {
                found.add(VerifyFact::AttachmentChanged { name });
            }
        }
    }
    // The attachment has the settings of the first camera.
    let first = cameras.iter().filter(|camera| camera.place.is_empty());
    let recorded = first.map(|camera| camera.fact("configuration"));
    let text = texts.get("unwater.toml").map_or("", String::as_str);
    if recorded.into_iter().any(|recorded| recorded != text) {
        found.add(VerifyFact::AttachmentChanged { name: "unwater.toml".into() });
    }
}

/// A corrected log, as far as the frames in it can be corrected again.
struct RawFrames<'o> {
    path: &'o Path,
    output: &'o Recording,
    /// `--drop-raw` keeps the frames alone that were not corrected
    is_whole: bool,
}

/// The messages that the run would add, made again from the input where it is given, else from the
/// raw frames of the output itself; or why they cannot be.
fn repeated(
    log: &RawFrames<'_>,
    input: Option<&Recording>,
    cameras: &[CameraLog],
    (is_other, threads): (bool, usize),
    progress: &dyn Progress,
) -> Result<std::result::Result<BTreeMap<String, ChannelDigest>, String>> {
    if is_other {
        return Ok(Err("the input given is another one".into()));
    }
    let has_means = |c: &CameraLog| c.model.rendering.method.needs_mean_frames();
    if cameras.iter().any(has_means) {
        return Ok(Err("a baseline of mean frames depends on all frames of pass one".into()));
    }
    let files = input.map_or_else(|| LogFiles::from(log.path), |input| input.files().clone());
    let has_raw = |camera: &CameraLog| {
        let topic = camera.topic(Images::Raw);
        log.is_whole && log.output.channels.values().any(|c| c.topic == topic)
    };
    if input.is_none() && !cameras.iter().all(has_raw) {
        let reason = "the log does not hold all raw images; give its input with --against";
        return Ok(Err(reason.into()));
    }
    let of_camera = |camera: &CameraLog| {
        let options = camera.run_options(input.is_none())?;
        Ok((Options { threads, ..options }, camera.model.clone()))
    };
    let cameras: std::result::Result<Vec<_>, String> = cameras.iter().map(of_camera).collect();
    let again = |cameras| repeat(&files, cameras, progress).map_err(|error| error.to_string());
    Ok(cameras.and_then(again))
}

/// Fingerprints of the messages of each channel that are taken, by topic and log time, and damage.
/// `group` of a topic is the number of messages in each; 0 for one by one.
fn digests(
    recording: &Recording,
    window: Window,
    group: impl Fn(&str) -> u64,
    mut is_taken: impl FnMut(&str, u64) -> bool,
) -> (BTreeMap<u16, ChannelDigest>, Vec<Damage>) {
    let (mut digests, mut damage) = (BTreeMap::new(), Vec::new());
    for entry in recording.messages(window) {
        match entry {
            Entry::Damaged(found) => damage.push(found),
            Entry::Message(message) => {
                let Message { sequence, log_time, publish_time, channel, .. } = message;
                let topic = recording.channels.get(&channel).map_or("", |c| c.topic.as_str());
                if !is_taken(topic, log_time) {
                    continue;
                }
                let digest: &mut ChannelDigest = digests
                    .entry(channel)
                    .or_insert_with(|| ChannelDigest::of_groups(group(topic)));
                let data = message.data();
                digest.add(Fingerprinted { sequence, log_time, publish_time, data });
            }
        }
    }
    digests.values_mut().for_each(ChannelDigest::close);
    (digests, damage)
}

/// Messages that were added against those that were made again; whether they are equal.
fn check_added(
    output: &Recording,
    own: &BTreeMap<u16, ChannelDigest>,
    added: &BTreeMap<String, ChannelDigest>,
    found: &mut Verification,
) -> bool {
    let mut is_equal = true;
    for (topic, again) in added.iter().filter(|(topic, _)| !is_log(topic)) {
        let none = ChannelDigest::default();
        let channel = output.channels.iter().find(|(_, c)| c.topic == *topic);
        let own = channel.and_then(|(id, _)| own.get(id)).unwrap_or(&none);
        found.repeated += again.count;
        if let Some(difference) = again.difference(own) {
            let (messages, first_ns) = (difference.groups, difference.first_ns);
            let fact = VerifyFact::NotReproduced { messages, of: again.count, first_ns };
            found.diagnostics.push(Diagnostic::on(topic, fact));
            is_equal = false;
        }
    }
    is_equal
}

/// The notes of a run say whether its model was given or estimated.
fn is_log(topic: &str) -> bool {
    topic.starts_with("/unwater") && topic.ends_with("/log")
}

/// Which messages of the input a run copied.
struct Copied {
    only: Option<regex::Regex>,
    /// with `--drop-raw`, the frames by topic and log time: whether each was corrected
    frames: BTreeMap<String, BTreeMap<u64, VecDeque<bool>>>,
}

impl Copied {
    fn new(config: &Config, cameras: &[CameraLog]) -> Self {
        let only = config.output.only.as_ref().and_then(|only| regex::Regex::new(only).ok());
        let mut copied = Self { only, frames: BTreeMap::new() };
        for camera in cameras.iter().filter(|_| config.output.drop_raw) {
            let topic = camera.topic(Images::Raw).to_string();
            let of_topic = copied.frames.entry(topic).or_default();
            for frame in &camera.frames {
                of_topic.entry(frame.log_time).or_default().push_back(frame.corrected);
            }
        }
        copied
    }

    fn is_wanted(&self, topic: &str) -> bool {
        self.only.as_ref().is_none_or(|only| only.is_match(topic))
    }

    /// Whether the next message of a topic was copied.
    fn takes(&mut self, topic: &str, log_time: u64) -> bool {
        let frames = self.frames.get_mut(topic).and_then(|frames| frames.get_mut(&log_time));
        match frames.and_then(VecDeque::pop_front) {
            Some(is_corrected) => !is_corrected,
            None => self.is_wanted(topic),
        }
    }

    /// Whether the output must have a channel, by the number of messages that were copied.
    fn has_channel(&self, topic: &str, messages: u64) -> bool {
        messages > 0 || (self.is_wanted(topic) && !self.frames.contains_key(topic))
    }
}

/// Every channel, message, attachment and metadata record of the input is in the output.
fn check_input(
    (input, output): (&Recording, &Recording),
    window: Window,
    own: &BTreeMap<u16, ChannelDigest>,
    mut copied: Copied,
    found: &mut Verification,
) {
    let takes = |topic: &str, log_time| copied.takes(topic, log_time);
    let (expected, _) = digests(input, window, |_| GROUP, takes);
    let messages = |id: &u16| [&expected, own].map(|of| of.get(id).map_or(0, |d| d.count));
    let must_be = |id: &u16, topic: &str| copied.has_channel(topic, messages(id).iter().sum());
    for (id, channel) in input.channels.iter().filter(|(id, c)| must_be(id, &c.topic)) {
        let is_same = output.channels.get(id).is_some_and(|own| {
            (&own.topic, &own.message_encoding, &own.metadata)
                == (&channel.topic, &channel.message_encoding, &channel.metadata)
        });
        let schema = |log: &Recording| log.schemas.get(&channel.schema_id).cloned();
        if !is_same || schema(input) != schema(output) {
            let fact = VerifyFact::ChannelMissing { id: *id };
            found.diagnostics.push(Diagnostic::on(&channel.topic, fact));
            continue;
        }
        let none = ChannelDigest::default();
        let (expected, own) = (expected.get(id).unwrap_or(&none), own.get(id).unwrap_or(&none));
        found.copied += expected.count;
        if let Some(difference) = expected.difference(own) {
            let first_ns = difference.first_ns;
            let (messages, expected) = (own.count, expected.count);
            let fact = VerifyFact::MessagesDiffer { found: messages, expected, first_ns };
            found.diagnostics.push(Diagnostic::on(&channel.topic, fact));
        }
    }
    let attachments = |log: &Recording| -> Vec<(String, u64, u64, String)> {
        let hash = |a: &crate::recording::Attachment| {
            log.attachment_data(a).map(|data| sha256(&data)).unwrap_or_default()
        };
        log.attachments()
            .flatten()
            .map(|a| (a.name.clone(), a.log_time, a.create_time, hash(&a)))
            .collect()
    };
    let own = attachments(output);
    for attachment in attachments(input).into_iter().filter(|a| !own.contains(a)) {
        found.add(VerifyFact::RecordMissing { name: attachment.0 });
    }
    for record in input.metadata.iter().filter(|record| !output.metadata.contains(record)) {
        found.add(VerifyFact::RecordMissing { name: record.name.clone() });
    }
}
