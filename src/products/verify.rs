//! Whether a corrected log is what it must be: undamaged, with the records that were written, with
//! every message of the input, and with corrected frames that follow from raw frames and model.

use std::collections::BTreeMap;
use std::path::Path;

use super::dive::{CameraLog, Images, cameras, texts};
use crate::config::Config;
use crate::diagnostics::{Diagnostic, Severity, VerifyFact};
use crate::error::{Error, Result};
use crate::recording::{
    ChannelDigest, Damage, Entry, Fingerprinted, LogFiles, Message, Recording, Window,
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
    let cameras = cameras(&output, &texts)?;
    let config = texts.get("unwater.toml").and_then(|text| Config::from_toml(text).ok());
    let mut found = Verification::default();
    check_records(&cameras, &texts, &mut found);
    let first = cameras.first();
    let window = first.map_or(Window::ALL, CameraLog::run_window);
    let input = input.map(Recording::open_files).transpose()?;
    let is_other = match (&input, first) {
        (Some(input), Some(first)) => {
            let (recorded, given) = (first.fact("source_sha256"), input.sha256()?);
            let is_other = recorded != given;
            if is_other {
                found
                    .add(VerifyFact::OtherInput { recorded: recorded.into(), given: given.into() });
            }
            is_other
        }
        _ => false,
    };
    let added = repeated(path, input.as_ref(), &cameras, (is_other, threads), progress)?;
    let added = added.unwrap_or_else(|reason| {
        found.add(VerifyFact::NotRepeated { reason });
        BTreeMap::new()
    });
    let is_added = |topic: &str| added.contains_key(topic);
    let (own, damage) = digests(&output, Window::ALL, |topic| u64::from(!is_added(topic)) * GROUP);
    let damage = output.damage.iter().chain(&damage).map(|d| d.reason.clone());
    damage.for_each(|reason| found.add(VerifyFact::Damaged { reason }));
    let version = first.map_or("", |camera| camera.fact("version"));
    let is_reproduced = check_added(&output, &own, &added, &mut found);
    if !is_reproduced && version != env!("CARGO_PKG_VERSION") {
        let own = env!("CARGO_PKG_VERSION").into();
        found.add(VerifyFact::OtherVersion { version: version.into(), own });
    }
    if let Some(input) = &input {
        let config = config.unwrap_or_default();
        let is_kept = |id: u16| is_kept(input, id, &config, &cameras);
        check_input((input, &output), window, &own, is_kept, &mut found);
    }
    Ok(found)
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
    let recorded = cameras.iter().map(|camera| camera.fact("configuration"));
    let text = texts.get("unwater.toml").map_or("", String::as_str);
    if recorded.into_iter().any(|recorded| recorded != text) {
        found.add(VerifyFact::AttachmentChanged { name: "unwater.toml".into() });
    }
}

/// The messages that the run would add, made again from the input where it is given, else from the
/// raw frames of the output itself; or why they cannot be.
fn repeated(
    path: &Path,
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
    let files = input.map_or_else(|| LogFiles::from(path), |input| input.files().clone());
    let log = match input {
        Some(_) => None,
        None => Some(Recording::open(path)?),
    };
    let has_raw = |camera: &CameraLog| {
        let topic = camera.topic(Images::Raw);
        log.as_ref().is_none_or(|log| log.channels.values().any(|c| c.topic == topic))
    };
    if !cameras.iter().all(has_raw) {
        return Ok(Err("the log has no raw images; give its input with --against".into()));
    }
    let of_camera = |camera: &CameraLog| {
        let options = camera.run_options(input.is_none())?;
        Ok((Options { threads, ..options }, camera.model.clone()))
    };
    let cameras: std::result::Result<Vec<_>, String> = cameras.iter().map(of_camera).collect();
    let again = |cameras| repeat(&files, cameras, progress).map_err(|error| error.to_string());
    Ok(cameras.and_then(again))
}

/// Fingerprints of the messages of each channel, and damage. `group` of a topic is the number of
/// messages in each; 0 for one by one.
fn digests(
    recording: &Recording,
    window: Window,
    group: impl Fn(&str) -> u64,
) -> (BTreeMap<u16, ChannelDigest>, Vec<Damage>) {
    let (mut digests, mut damage) = (BTreeMap::new(), Vec::new());
    for entry in recording.messages(window) {
        match entry {
            Entry::Damaged(found) => damage.push(found),
            Entry::Message(message) => {
                let Message { sequence, log_time, publish_time, channel, .. } = message;
                let topic = recording.channels.get(&channel).map_or("", |c| c.topic.as_str());
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

/// Messages that were added against those that were made anew; whether they are equal.
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

/// Whether the run copied all messages of a channel.
fn is_kept(input: &Recording, id: u16, config: &Config, cameras: &[CameraLog]) -> bool {
    let Some(channel) = input.channels.get(&id) else { return false };
    let only = config.output.only.as_ref().and_then(|only| regex::Regex::new(only).ok());
    let is_raw = cameras.iter().any(|camera| camera.topic(Images::Raw) == channel.topic);
    only.is_none_or(|only| only.is_match(&channel.topic)) && !(is_raw && config.output.drop_raw)
}

/// Every channel, message, attachment and metadata record of the input is in the output.
fn check_input(
    (input, output): (&Recording, &Recording),
    window: Window,
    own: &BTreeMap<u16, ChannelDigest>,
    is_kept: impl Fn(u16) -> bool,
    found: &mut Verification,
) {
    let (expected, _) = digests(input, window, |_| GROUP);
    for (id, channel) in input.channels.iter().filter(|(id, _)| is_kept(**id)) {
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
