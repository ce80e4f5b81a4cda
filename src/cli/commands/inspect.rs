//! `inspect`: what a log holds, what is missing, and what would be done.

use std::path::PathBuf;

use serde_json::{Value, json};

use super::super::args::LogArgs;
use super::super::output::{Outcome, print, print_json};
use super::inspect_text::text;
use crate::error::{Error, Result};
use crate::image::Container;
use crate::recording::{Block, Channel, Recording};
use crate::run::clock_offsets::clock_offsets;
use crate::run::memory::Load;
use crate::run::{self, corrected_topic, output_container, output_size};
use crate::session::{CameraSession, Log, Options, Silent, Threads};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The log
    #[arg(value_name = "IN.mcap")]
    input: PathBuf,
    /// One JSON document instead of text
    #[arg(long)]
    json: bool,
    /// Estimate offsets between the clocks from images and ranges; takes as long as `estimate`
    #[arg(long)]
    clocks: bool,
    #[command(flatten)]
    log: LogArgs,
}

pub fn run(args: &Args) -> Result<Outcome> {
    let options = args.log.options(&[])?;
    let threads = Threads::new(options.threads);
    let log = Log::scan(Recording::open(&args.input)?, &options, &threads)?;
    // An empty log is described, an empty window is an error.
    let log = if options.window.is_some() { log.with_messages(&options)? } else { log };
    let (recording, index) = (&log.recording, &log.index);
    let (plans, missing) = plans(&log, &options, args.clocks);
    let document = json!({
        "file": args.input.display().to_string(),
        "bytes": recording.length(),
        "profile": recording.profile,
        "complete": recording.is_complete,
        "messages": index.messages,
        "start_ns": index.span.map(|s| s.0),
        "end_ns": index.span.map(|s| s.1),
        "chunks": recording.chunk_count(),
        "compression": recording.compressions,
        "attachments": recording.attachments().count(),
        "metadata": recording.metadata.iter().map(|m| m.name.clone()).collect::<Vec<_>>(),
        "damage": index.damage,
        "diagnostics": recording.diagnostics(),
        "channels": channels(&log),
        "plan": plans.first(),
        "plans": &plans,
        "missing": (!missing.is_empty()).then(|| texts(&missing).join("; ")),
        "missing_message_type": missing.iter().any(|(_, e)| is_of_type(e)),
    });
    if args.json {
        print_json(serde_json::to_string_pretty(&document).map(|text| text + "\n"))?;
    } else {
        print(&text(&document));
    }
    Ok(match (plans.is_empty(), index.damage.is_empty()) {
        (true, _) => Outcome::CannotCorrect,
        (false, true) => Outcome::Done,
        (false, false) => Outcome::DoneWithLosses,
    })
}

/// The channels of a log.
fn channels(log: &Log) -> Vec<Value> {
    let describe = |(id, c): (&u16, &Channel)| {
        let indexed = log.index.channels.get(id);
        let decoder = log.index.decoders.get(id);
        let schema = log.recording.schemas.get(&c.schema_id);
        json!({
            "topic": c.topic,
            "messages": indexed.map_or(0, |s| s.count),
            "schema": schema.map_or("", |s| s.name.as_str()),
            "message_encoding": c.message_encoding,
            "read_as": decoder.map(|d| d.message_type.kind.label()),
            "shape_of": decoder.map(|d| d.message_type.name),
            "frame_id": indexed.map_or("", |s| s.frame_id.as_str()),
            "description": indexed.map_or("", |s| s.description.as_str()),
            "clock_offset_s": indexed.and_then(|s| s.clock_offset_s),
            "unreadable": indexed.map_or(0, |s| s.unreadable.0),
            "complaint": indexed.and_then(|s| s.unreadable.1.clone()),
        })
    };
    log.recording.channels.iter().map(describe).collect()
}

/// Of so few frames with a seafloor a model is estimated, to see whether that is possible.
const FEW_FRAMES: usize = 12;

/// Plan of each camera, and what is missing for others, with their topics.
type Plans = (Vec<Value>, Vec<(Option<String>, Error)>);

fn texts(missing: &[(Option<String>, Error)]) -> Vec<String> {
    let text = |(topic, error): &(Option<String>, Error)| match topic {
        Some(topic) => format!("{topic}: {error}"),
        None => error.to_string(),
    };
    missing.iter().map(text).collect()
}

/// Whether messages of a type that is read would help.
fn is_of_type(error: &Error) -> bool {
    matches!(error, Error::NoCamera { .. } | Error::NoRanges { .. })
}

fn plans(log: &Log, options: &Options, with_clocks: bool) -> Plans {
    let survey = |options: &Options| {
        let session = CameraSession::new(log, options)?;
        run::ensure_not_corrected(&session, None)?;
        // Few frames may not suffice; only the estimate shows it, and it is quick.
        if session.frames_with_seafloor()? <= FEW_FRAMES {
            run::estimate(&[&session], options, &Silent)?;
        }
        Ok(session)
    };
    match survey(options) {
        Ok(session) => (vec![plan(&session, options, with_clocks)], Vec::new()),
        Err(Error::SeveralCameras { topics }) => {
            let (mut plans, mut missing) = (Vec::new(), Vec::new());
            for topic in topics {
                let options = options.for_camera(&topic);
                match survey(&options) {
                    Ok(session) => plans.push(plan(&session, &options, with_clocks)),
                    Err(e) => missing.push((Some(topic), e)),
                }
            }
            (plans, missing)
        }
        Err(e) => (Vec::new(), vec![(None, e)]),
    }
}

/// What a run would do with one camera.
fn plan(session: &CameraSession, options: &Options, with_clocks: bool) -> Value {
    let s = &session.survey;
    let planes = s.frames.iter().filter_map(|f| session.seafloor(f.stamp).ok());
    let altitudes: Vec<f64> = planes.map(|p| p.camera_altitude_m(&s.rig)).collect();
    let lowest = altitudes.iter().copied().fold(f64::INFINITY, f64::min);
    let highest = altitudes.iter().copied().fold(0.0, f64::max);
    let clocks = with_clocks.then(|| clock_offsets(session, options).ok()).flatten();
    let container = output_container(s.container, &options.config);
    let (pixels, source_bytes) = (s.image_pixels, s.image_bytes);
    let threads = Threads::new(options.threads).count();
    let pass_one_frames = s.frames.len().min(options.config.estimate.max_frames);
    let blocks = session.recording.blocks().iter();
    let chunk_bytes: Vec<usize> = blocks.map(Block::memory_bytes).collect();
    let load = Load {
        threads,
        pixels,
        source_bytes,
        largest_chunk: chunk_bytes.iter().copied().max().unwrap_or(0),
        all_chunks: chunk_bytes.iter().fold(0, |sum, bytes| sum.saturating_add(*bytes)),
        pass_one_frames,
    };
    let memory = load.bound(&options.config).total();
    let mut plan = json!({
        "camera": s.camera_topic,
        "frames": s.frames.len(),
        "frames_with_seafloor": altitudes.len(),
        "camera_altitude_m": (!altitudes.is_empty()).then_some([lowest, highest]),
        "camera_info": s.camera_info,
        "dvl": s.dvl_topic,
        "pings": s.pings.count(),
        "attitude": s.attitude_topic,
        "strobe": s.rig.strobe.source,
        "white_level": s.white_level,
        "corrected_topic": corrected_topic(&s.camera_topic, container != Container::Raw),
        "threads": threads,
        "memory_at_most_bytes": memory,
        "output_about_bytes": output_size::forecast(session),
        "diagnostics": s.diagnostics,
    });
    if let Some(found) = clocks {
        plan["clocks"] = json!(found.diagnostics(s, &options.rig));
    }
    plan
}
