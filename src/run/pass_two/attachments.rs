//! The end of the output: attachments and metadata.

use std::path::Path;

use super::super::camera_output::CameraOutput;
use super::input::Input;
use super::record::{SHARD_RECORD, ShardRecord};
use crate::error::{Error, Result};
use crate::recording::{NewAttachment, Output, OutputFile, Window};
use crate::report::Report;
use crate::session::sha256;

/// Writes attachments and metadata, the input's first, and completes the file.
pub fn finish(
    input: &Input<'_>,
    (out, shard): (&Output, Option<ShardRecord>),
    mut file: OutputFile,
    reports: &mut [Report],
) -> Result<()> {
    for attachment in input.recording.attachments() {
        match attachment {
            Ok(attachment) => file.copy_attachment(input.recording, &attachment)?,
            Err(damage) => {
                reports.iter_mut().take(1).for_each(|r| r.damage.push(damage.clone()));
            }
        }
    }
    reports.iter_mut().for_each(Report::count_damage);
    for record in &input.recording.metadata {
        file.metadata(&record.name, &record.metadata)?;
    }
    for (camera, report) in input.cameras.iter().zip(reports) {
        describe(camera, input.window, report, &mut file)?;
    }
    if let Some(shard) = shard {
        let record = serde_json::to_string(&shard).map_err(|e| failed(SHARD_RECORD, &e))?;
        file.metadata(SHARD_RECORD, &[("record".into(), record)].into())?;
    }
    file.finish(out.declarations())
}

fn failed(name: &str, e: &serde_json::Error) -> Error {
    Error::WriteRecord { path: Path::new(name).into(), reason: e.to_string() }
}

/// Attachments and metadata of a camera. Those of all but the first have its name before theirs.
fn describe(
    camera: &CameraOutput<'_>,
    window: Window,
    report: &Report,
    file: &mut OutputFile,
) -> Result<()> {
    let (first, last) = camera.session.index.span.unwrap_or_default();
    let model = camera.model.file.to_json().map_err(|e| failed("model.json", &e))?;
    let report_json = report.to_json().map_err(|e| failed("report.json", &e))?;
    let config = camera.session.config.to_commented_toml();
    let mut texts = vec![
        ("model.json", "application/json", model.as_str()),
        ("report.json", "application/json", &report_json),
        ("unwater.toml", "application/toml", &config),
        ("rig.toml", "application/toml", camera.rig_toml),
    ];
    // The settings are those of the whole run.
    texts.retain(|(name, ..)| camera.name.is_empty() || *name != "unwater.toml");
    for (name, media_type, text) in texts {
        let name = format!("{}/{name}", camera.name);
        file.attach(&NewAttachment {
            log_time: last,
            create_time: first,
            name: name.trim_start_matches('/'),
            media_type,
            data: text.as_bytes(),
        })?;
    }
    let identity = camera.session.recording.identity();
    let mut facts = vec![
        ("version", report.version.clone()),
        ("camera_topic", report.camera_topic.clone()),
        ("corrected_topic", report.corrected_topic.clone()),
        ("dvl_topic", report.dvl_topic.clone()),
        ("method", report.method.clone()),
        ("model_sha256", sha256(model.as_bytes())),
        ("report_sha256", sha256(report_json.as_bytes())),
        ("rig_sha256", sha256(camera.rig_toml.as_bytes())),
        ("source", report.source.clone()),
        ("source_sha256", identity.sha256),
        ("source_index_sha256", identity.index_sha256),
        ("request_sha256", camera.request.into()),
        ("configuration", config.clone()),
    ];
    if window != Window::ALL {
        facts.push(("window_start_ns", window.start.to_string()));
        facts.push(("window_end_ns", window.end.to_string()));
    }
    let pairs = facts.into_iter().map(|(k, v)| (k.into(), v)).collect();
    file.metadata(&format!("unwater{}", camera.name), &pairs)
}
