//! Shards of one corrected log → the log, byte for byte as an undivided run writes it.
//!
//! The messages of the shards pass through the same output in the same order; chunks of the input
//! are copied, the others are cut again.

use std::collections::BTreeSet;
use std::path::Path;

use super::pass_two::{CameraRecord, SHARD_RECORD, ShardRecord};
use crate::config::Config;
use crate::error::{Error, Result};
use crate::recording::{
    Attachment, Block, Entry, NewAttachment, Output, OutputFile, Recording, Window,
    check_output_path,
};
use crate::report::Report;
use crate::session::{Shard, sha256};

/// A shard that is open.
struct Part {
    recording: Recording,
    record: ShardRecord,
}

/// Joins all shards of a log, in any order.
///
/// # Errors
/// A file is no shard, shards are of different runs or missing, or the log cannot be written.
pub fn join(paths: &[&Path], output: &Path, force: bool) -> Result<Vec<Report>> {
    for path in paths {
        check_output_path(path, output, force)?;
    }
    let mut parts = paths.iter().map(|path| open(path)).collect::<Result<Vec<_>>>()?;
    parts.sort_by_key(|part| part.record.shard.index);
    ensure_whole(&parts)?;
    let Some(first) = parts.first() else { return Err(Error::Usage("no shard".into())) };
    let config = fact(&first.recording, "configuration")
        .and_then(|text| Config::from_toml(text).ok())
        .ok_or_else(|| bad(&first.recording, "its settings are of another version"))?;
    let (mut out, mut file) = Output::create(output, &first.recording.profile, &config.output)?;
    declare(first, &mut out)?;
    put(&mut out, &mut file)?;
    let mut cameras: Vec<CameraRecord> = first.record.cameras.clone();
    for (number, part) in parts.iter().enumerate() {
        let append = |(all, next): (&mut CameraRecord, &CameraRecord)| {
            let repeated = if number == 0 { Vec::new() } else { all.append(next) };
            repeated.into_iter().map(|sequence| (next.log_channel, sequence)).collect::<Vec<_>>()
        };
        let repeated = cameras.iter_mut().zip(&part.record.cameras).flat_map(append).collect();
        replay(part, &repeated, (&mut out, &mut file))?;
    }
    out.flush();
    put(&mut out, &mut file)?;
    let copied: u64 = parts.iter().map(|part| part.record.copied).sum();
    finish(first, cameras, copied, (out, file))
}

fn bad(recording: &Recording, reason: &str) -> Error {
    let path = recording.path().into();
    Error::BadFile { path, what: "no shard that can be joined", reason: reason.into() }
}

fn fact<'r>(recording: &'r Recording, key: &str) -> Option<&'r String> {
    let own = recording.metadata.iter().rev().find(|m| m.name == "unwater");
    own?.metadata.get(key)
}

/// Which part of a log a file is; `None` for whole ones.
pub fn shard_of(recording: &Recording) -> Option<Shard> {
    record_of(recording).map(|record| record.shard)
}

fn record_of(recording: &Recording) -> Option<ShardRecord> {
    let text = recording.metadata.iter().rev().find(|m| m.name == SHARD_RECORD)?;
    serde_json::from_str(text.metadata.get("record")?).ok()
}

fn open(path: &Path) -> Result<Part> {
    let recording = Recording::open(path)?;
    let record = record_of(&recording);
    match record {
        _ if !recording.is_complete || !recording.damage.is_empty() => {
            Err(bad(&recording, "it is damaged; correct this shard again"))
        }
        Some(record) => Ok(Part { recording, record }),
        None => Err(bad(&recording, "give what `unwater correct --shard I/N` has written")),
    }
}

/// All shards of one run, each once.
fn ensure_whole(parts: &[Part]) -> Result<()> {
    let Some(first) = parts.first() else { return Ok(()) };
    let count = first.record.shard.count;
    for part in parts {
        let is_of_run =
            ["source_sha256", "source_index_sha256", "request_sha256", "model_sha256", "version"]
                .iter()
                .all(|key| fact(&part.recording, key) == fact(&first.recording, key));
        if part.record.shard.count != count || !is_of_run {
            return Err(bad(&part.recording, "it is of another run than the first shard"));
        }
    }
    let found: Vec<usize> = parts.iter().map(|part| part.record.shard.index).collect();
    let missing: Vec<String> =
        (1..=count).filter(|n| !found.contains(n)).map(|n| format!("{n}/{count}")).collect();
    if !missing.is_empty() {
        return Err(Error::Usage(format!("shards are missing: {}", missing.join(", "))));
    }
    let is_same = |pair: &&[Part]| pair[0].record.shard.index == pair[1].record.shard.index;
    if let Some([a, b]) = parts.windows(2).find(is_same) {
        let [first, second] = [a, b].map(|part| part.recording.path().display().to_string());
        let Shard { index, count } = a.record.shard;
        return Err(Error::Usage(format!(
            "shard {index}/{count} is given twice: {first} and {second}"
        )));
    }
    Ok(())
}

/// The declarations, in their order.
fn declare(first: &Part, out: &mut Output) -> Result<()> {
    let Recording { schemas, channels, .. } = &first.recording;
    for (is_schema, id) in &first.record.declared {
        let missing = || bad(&first.recording, "a declaration is missing");
        if *is_schema {
            out.copy_schema(*id, schemas.get(id).ok_or_else(missing)?);
        } else {
            out.copy_channel(*id, channels.get(id).ok_or_else(missing)?);
        }
    }
    Ok(())
}

fn put(out: &mut Output, file: &mut OutputFile) -> Result<()> {
    while let Some(piece) = out.next_piece() {
        file.put(piece.into_bytes())?;
    }
    Ok(())
}

/// Passes the messages of a shard on; `repeated` are notes that earlier shards have (channel,
/// sequence number).
fn replay(
    part: &Part,
    repeated: &BTreeSet<(u16, u32)>,
    (out, file): (&mut Output, &mut OutputFile),
) -> Result<()> {
    let Part { recording, record } = part;
    let added: BTreeSet<u16> = record.cameras.iter().flat_map(|c| c.channels.clone()).collect();
    let changed = || bad(recording, "its chunks are not those that were written");
    if recording.blocks().len() != record.copied_chunks.len() {
        return Err(changed());
    }
    let blocks = || recording.blocks().iter().zip(&record.copied_chunks);
    let mut copied = blocks().filter_map(|(block, before)| Some((block, (*before)?))).peekable();
    let mut written = 0;
    for (block, _) in blocks().filter(|(_, before)| before.is_none()) {
        for entry in recording.read(block, Window::ALL)?.entries {
            let Entry::Message(message) = entry else { return Err(changed()) };
            while let Some((chunk, _)) = copied.next_if(|(_, before)| *before <= written) {
                copy(recording, chunk, (out, file))?;
            }
            written += 1;
            let id = message.channel;
            if !added.contains(&id) {
                // A frame that was spared, of a channel that is dropped else.
                if let Some(channel) = recording.channels.get(&id) {
                    out.copy_channel(id, channel);
                }
                out.copy_message(&message);
            } else if !repeated.contains(&(id, message.sequence)) {
                let channel = out.added_channel(id).ok_or_else(changed)?;
                out.write(channel, message.log_time, message.publish_time, message.data());
            }
            put(out, file)?;
        }
    }
    copied.try_for_each(|(chunk, _)| copy(recording, chunk, (out, file)))
}

/// Copies a chunk of the input.
fn copy(
    recording: &Recording,
    chunk: &Block,
    (out, file): (&mut Output, &mut OutputFile),
) -> Result<()> {
    let contents = recording.read(chunk, Window::ALL)?;
    let chunk = contents.chunk;
    out.copy_chunk(chunk.ok_or_else(|| bad(recording, "a chunk is not the one of the input"))?);
    put(out, file)
}

/// Attachments and metadata, with the report of all.
fn finish(
    first: &Part,
    cameras: Vec<CameraRecord>,
    copied: u64,
    (out, mut file): (Output, OutputFile),
) -> Result<Vec<Report>> {
    let recording = &first.recording;
    let found: Vec<Attachment> =
        recording.attachments().filter_map(std::result::Result::ok).collect();
    let own_names: Vec<Vec<String>> = cameras.iter().map(own_attachments).collect();
    let own: usize = own_names.iter().map(Vec::len).sum();
    let of_input = found.len().saturating_sub(own);
    for attachment in &found[..of_input] {
        file.copy_attachment(recording, attachment)?;
    }
    let records: Vec<_> = recording.metadata.iter().filter(|m| m.name != SHARD_RECORD).collect();
    let input_records = records.len().saturating_sub(cameras.len());
    for record in &records[..input_records] {
        file.metadata(&record.name, &record.metadata)?;
    }
    let mut own_found = found[of_input..].iter();
    let mut reports = Vec::new();
    for (number, camera) in cameras.into_iter().enumerate() {
        let name = camera.name.clone();
        let mut report = camera.into_report((number == 0).then_some(copied));
        report.count_damage();
        let text = report.to_json().map_err(|e| Error::WriteRecord {
            path: "report.json".into(),
            reason: e.to_string(),
        })?;
        for attachment in own_found.by_ref().take(own_names[number].len()) {
            if attachment.name.ends_with("report.json") {
                file.attach(&NewAttachment {
                    log_time: attachment.log_time,
                    create_time: attachment.create_time,
                    name: &attachment.name,
                    media_type: &attachment.media_type,
                    data: text.as_bytes(),
                })?;
            } else {
                file.copy_attachment(recording, attachment)?;
            }
        }
        let own = records[input_records..].iter().find(|m| m.name == format!("unwater{name}"));
        let own = own.ok_or_else(|| bad(recording, "its record is missing"))?;
        let mut facts = own.metadata.clone();
        facts.insert("report_sha256".into(), sha256(text.as_bytes()));
        file.metadata(&own.name, &facts)?;
        reports.push(report);
    }
    file.finish(out.declarations())?;
    Ok(reports)
}

/// Names of the attachments of a camera.
fn own_attachments(camera: &CameraRecord) -> Vec<String> {
    let names = ["model.json", "report.json", "unwater.toml", "rig.toml"];
    let is_own = |name: &&str| camera.name.is_empty() || *name != "unwater.toml";
    names.iter().filter(|name| is_own(name)).map(ToString::to_string).collect()
}
