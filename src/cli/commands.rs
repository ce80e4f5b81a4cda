//! One function per command: run it, say what came of it. Results go to stdout, everything else to
//! stderr.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use serde_json::json;

use super::paint::Paint;
use super::progress::Bar;
use super::summary;
use super::{
    Cli, Command, ConfigArgs, Correct, Ended, EstimateArgs, EstimateOptions, Inspect,
    RenderOptions, init, layout, papers, products,
};
use crate::diagnostics::{Diagnostic, EstimateFact, Severity};
use crate::error::{Error, Result};
use crate::image::Container;
use crate::messages::TYPES;
use crate::model::ModelFile;
use crate::recording::{Channel, Recording};
use crate::report::Report;
use crate::run::clock_offsets::clock_offsets;
use crate::run::memory::Load;
use crate::run::{self, corrected_topic, output_container};
use crate::session::{CameraSession, Log, Options, Threads};

/// Carries out what was said.
///
/// # Errors
/// What went wrong, with the remedy.
pub fn run(cli: Cli) -> Result<Ended> {
    match cli.command {
        Command::Correct(args) => correct(&args),
        Command::Estimate(args) => estimate(&args),
        Command::Inspect(args) => inspect(&args),
        Command::Init(args) => init::run(&args),
        Command::Report(args) => products::report(&args),
        Command::Compare(args) => products::compare(&args),
        Command::Mosaic(args) => products::mosaic(&args),
        Command::Export(args) => products::export(&args),
        Command::Config(args) => config(&args),
        Command::Layout(args) => layout::run(&args),
        Command::Completions(args) => papers::completions(&args),
        Command::Man(args) => papers::man(&args),
    }
}

/// `dive.mcap` → `dive.<suffix>` beside it.
pub(super) fn beside(input: &Path, suffix: &str) -> PathBuf {
    let name = input.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let stem = name.strip_suffix(".mcap").unwrap_or(&name);
    input.with_file_name(format!("{stem}.{suffix}"))
}

/// Results: a closed pipe (`| head`) is no error.
pub(super) fn say(text: &str) {
    let _closed_pipe = std::io::stdout().write_all(text.as_bytes());
}

fn correct(args: &Correct) -> Result<Ended> {
    let options = args.shared.options(&args.estimate, &args.render)?;
    let output = args.output.clone().unwrap_or_else(|| beside(&args.input, "corrected.mcap"));
    if output.as_os_str() == "-" {
        return Err(Error::Usage(
            "a corrected log is written under another name first, and so not to stdout: name a \
             file with -o"
                .into(),
        ));
    }
    for read in [&args.model, &args.shared.rig, &args.shared.config].into_iter().flatten() {
        crate::recording::check_output_path(read, &output, true)?;
    }
    let model = model_file(args.model.as_deref())?;
    if model.is_some() && args.estimate != EstimateOptions::default() && !args.shared.quiet {
        complain(&[EstimateFact::OptionsIgnored.into()], 0);
    }
    let (given, begun) = (model.is_some(), std::time::Instant::now());
    let cameras =
        run::correct_all(&args.input, &output, model, &options, &Bar::new(args.shared.quiet))?;
    for (report, _) in &cameras {
        if !args.shared.quiet {
            complain(&report.diagnostics, args.shared.verbose);
        }
        // Losses are reported in any case: they are why the exit status is 3. The summary has the
        // frames that were not corrected.
        let is_shown = |d: &&Diagnostic| args.shared.quiet || !d.is_uncorrected();
        for loss in report.of(Severity::Loss).filter(is_shown) {
            eprintln!("lost: {}", loss.with_remedy());
        }
        for damage in &report.damage {
            let when = if damage.end_ns == 0 {
                "time unknown".into()
            } else {
                format!("log time {} to {}", damage.start_ns, damage.end_ns)
            };
            eprintln!("  {} (byte {}, {when})", damage.reason, damage.offset);
        }
    }
    match &cameras[..] {
        [(report, _)] if args.json => write_json(report.to_json())?,
        several if args.json => {
            let reports: Vec<&Report> = several.iter().map(|(report, _)| report).collect();
            write_json(serde_json::to_string_pretty(&reports).map(|text| text + "\n"))?;
        }
        _ if args.shared.quiet => {}
        cameras => {
            let paint = Paint::of_stdout();
            let took = (cameras.len() == 1).then(|| begun.elapsed());
            for (report, model) in cameras {
                if cameras.len() > 1 {
                    say(&format!("{} {}\n", paint.name("camera      "), report.camera_topic));
                }
                say(&summary::summary(report, model, given, took, paint));
            }
            let sum =
                |count: fn(&Report) -> u64| cameras.iter().map(|(report, _)| count(report)).sum();
            say(&summary::written(
                sum(|r| r.messages_copied),
                sum(|r| r.messages_added),
                &output,
                paint,
            ));
        }
    }
    Ok(if cameras.iter().any(|(report, _)| report.has_losses()) {
        Ended::DoneWithLosses
    } else {
        Ended::Done
    })
}

/// The model of `--model`.
pub(super) fn model_file(path: Option<&Path>) -> Result<Option<ModelFile>> {
    let Some(path) = path else { return Ok(None) };
    let text = std::fs::read_to_string(path)
        .map_err(|source| Error::Read { path: path.into(), source })?;
    ModelFile::from_json(&text).map(Some).map_err(|reason| Error::BadFile {
        path: path.into(),
        what: "not a model",
        reason,
    })
}

/// Warnings, and infos where they are asked for.
fn complain(diagnostics: &[Diagnostic], verbose: u8) {
    let paint = Paint::of_stderr();
    let of = |severity| diagnostics.iter().filter(move |d| d.severity() == severity);
    for warning in of(Severity::Warning) {
        eprintln!("{} {warning}", paint.warning("warning:"));
        if let Some(remedy) = warning.remedy() {
            eprintln!("  help: {remedy}");
        }
    }
    of(Severity::Info).filter(|_| verbose > 0).for_each(|info| eprintln!("note: {info}"));
}

fn estimate(args: &EstimateArgs) -> Result<Ended> {
    let options = args.shared.options(&args.estimate, &RenderOptions::default())?;
    let first = args.inputs.first().cloned().unwrap_or_default();
    let output = args.output.clone().unwrap_or_else(|| beside(&first, "model.json"));
    let to_stdout = output.as_os_str() == "-";
    if !to_stdout {
        for input in &args.inputs {
            crate::recording::check_output_path(input, &output, options.force)?;
        }
    }
    let inputs: Vec<&Path> = args.inputs.iter().map(PathBuf::as_path).collect();
    let (model, diagnostics) = run::estimate_logs(&inputs, &options, &Bar::new(args.shared.quiet))?;
    if !args.shared.quiet {
        complain(&diagnostics, args.shared.verbose);
        complain(&model.diagnostics, args.shared.verbose);
    }
    let json = model
        .to_json()
        .map_err(|e| Error::WriteRecord { path: output.clone(), reason: e.to_string() })?;
    write_text(&output, &json)?;
    if !args.shared.quiet && !to_stdout {
        say(&format!(
            "attenuation  {}\nwritten      {}\n",
            summary::attenuation(&model, Paint::of_stdout()),
            output.display()
        ));
    }
    Ok(Ended::Done)
}

/// Writes a file, complete or not at all; `-` is stdout, where a closed pipe is no error.
pub(super) fn write_text(path: &Path, text: &str) -> Result<()> {
    if path.as_os_str() != "-" {
        return crate::products::write_whole(path, text.as_bytes());
    }
    let mut stdout = std::io::stdout().lock();
    match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
        Err(source) if source.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Error::Write { path: "stdout".into(), source })
        }
        _ => Ok(()),
    }
}

/// JSON on stdout.
fn write_json(text: serde_json::Result<String>) -> Result<()> {
    let failed =
        |e: serde_json::Error| Error::WriteRecord { path: "stdout".into(), reason: e.to_string() };
    write_text(Path::new("-"), &text.map_err(failed)?)
}

fn config(args: &ConfigArgs) -> Result<Ended> {
    let options = args.shared.options(&args.estimate, &args.render)?;
    say(&(options.config.to_commented_toml()
        + &run::memory::table(&options.config, Threads::new(options.threads).count())));
    Ok(Ended::Done)
}

fn inspect(args: &Inspect) -> Result<Ended> {
    let options = args.shared.options(&EstimateOptions::default(), &RenderOptions::default())?;
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
        "plans": plans,
        "missing": if missing.is_empty() { None } else { Some(missing.join("; ")) },
    });
    if args.json {
        write_json(serde_json::to_string_pretty(&document).map(|text| text + "\n"))?;
    } else {
        say(&inspect_text(&document));
    }
    Ok(if index.damage.is_empty() { Ended::Done } else { Ended::DoneWithLosses })
}

/// What the log has on each channel.
fn channels(log: &Log) -> Vec<serde_json::Value> {
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

/// What a run would do with each camera, and what prevents it.
fn plans(log: &Log, options: &Options, with_clocks: bool) -> (Vec<serde_json::Value>, Vec<String>) {
    let session = CameraSession::new(log, options)
        .and_then(|session| run::ensure_not_corrected(&session, None).map(|()| session));
    match session {
        Ok(session) => (vec![plan(&session, options, with_clocks)], Vec::new()),
        Err(Error::SeveralCameras { topics }) => {
            let (mut plans, mut missing) = (Vec::new(), Vec::new());
            for topic in topics {
                let options = options.for_camera(&topic);
                match CameraSession::new(log, &options) {
                    Ok(session) => plans.push(plan(&session, &options, with_clocks)),
                    Err(e) => missing.push(format!("{topic}: {e}")),
                }
            }
            (plans, missing)
        }
        Err(e) => (Vec::new(), vec![e.to_string()]),
    }
}

/// What a run would do with a camera.
fn plan(session: &CameraSession, options: &Options, with_clocks: bool) -> serde_json::Value {
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
    let memory =
        Load { threads, pixels, source_bytes, pass_one_frames }.bound(&options.config).total();
    let mut plan = json!({
        "camera": s.camera_topic,
        "frames": s.frames.len(),
        "frames_with_seafloor": altitudes.len(),
        "camera_altitude_m": (!altitudes.is_empty()).then_some([lowest, highest]),
        "dvl": s.dvl_topic,
        "pings": s.pings.count(),
        "attitude": s.attitude_topic,
        "strobe": s.rig.strobe.source,
        "white_level": s.white_level,
        "corrected_topic": corrected_topic(&s.camera_topic, container != Container::Raw),
        "threads": threads,
        "memory_at_most_bytes": memory,
        "diagnostics": s.diagnostics,
    });
    if let Some(found) = clocks {
        plan["clocks"] = json!(found.diagnostics(s, &options.rig));
    }
    plan
}

/// A diagnostic in JSON as text, with its remedy below.
fn put_diagnostic(kind: &str, diagnostic: &serde_json::Value, line: &mut dyn FnMut(String)) {
    line(format!("  {kind}: {}", diagnostic["text"].as_str().unwrap_or("")));
    diagnostic["remedy"].as_str().into_iter().for_each(|r| line(format!("    help: {r}")));
}

fn inspect_text(d: &serde_json::Value) -> String {
    let mut text = String::new();
    let mut line = |l: String| text += &(l + "\n");
    let word = |v: &serde_json::Value| v.as_str().unwrap_or("").to_string();
    let seconds =
        d["end_ns"].as_u64().unwrap_or(0).saturating_sub(d["start_ns"].as_u64().unwrap_or(0))
            as f64
            * 1e-9;
    line(format!(
        "{}: {} messages over {seconds:.1} s, {} chunks, profile {:?}",
        word(&d["file"]),
        d["messages"],
        d["chunks"],
        word(&d["profile"])
    ));
    let list = |v: &serde_json::Value| v.as_array().cloned().unwrap_or_default();
    let width = list(&d["channels"]).iter().map(|c| word(&c["topic"]).len()).max().unwrap_or(0);
    for c in list(&d["channels"]) {
        let read =
            c["read_as"].as_str().map_or_else(|| "copied".into(), |r| format!("read as {r}"));
        let description = word(&c["description"]);
        let more = if description.is_empty() { String::new() } else { format!(", {description}") };
        line(format!(
            "  {:<width$}  {:>8}  {:<42} {read}{more}",
            word(&c["topic"]),
            c["messages"].as_u64().unwrap_or(0),
            word(&c["schema"])
        ));
        if let Some(complaint) = c["complaint"].as_str() {
            line(format!(
                "  {:<width$}            {} unreadable: {complaint}",
                "", c["unreadable"]
            ));
        }
    }
    for diagnostic in list(&d["diagnostics"]) {
        line(format!("note: {}", word(&diagnostic["text"])));
    }
    for damage in list(&d["damage"]) {
        let when = if damage["end_ns"] == 0 {
            "time unknown".into()
        } else {
            format!("log time {} to {}", damage["start_ns"], damage["end_ns"])
        };
        line(format!("damage: {} (byte {}, {when})", word(&damage["reason"]), damage["offset"]));
    }
    for plan in list(&d["plans"]) {
        let range = plan["camera_altitude_m"].as_array().map_or_else(String::new, |r| {
            format!(
                ", camera {:.2} to {:.2} m above it",
                r[0].as_f64().unwrap_or(f64::NAN),
                r[1].as_f64().unwrap_or(f64::NAN)
            )
        });
        line(format!(
            "would correct {} ({} frames) into {}",
            word(&plan["camera"]),
            plan["frames"],
            word(&plan["corrected_topic"])
        ));
        line(format!(
            "  seafloor from {} ({} pings): below {} frames{range}",
            word(&plan["dvl"]),
            plan["pings"],
            plan["frames_with_seafloor"]
        ));
        line(format!("  attitude from {}", plan["attitude"].as_str().unwrap_or("nothing")));
        line(format!(
            "  strobe from {}",
            plan["strobe"].as_str().unwrap_or("nothing: taken to sit at the camera")
        ));
        let memory = plan["memory_at_most_bytes"].as_f64().unwrap_or(f64::NAN) / 1e6;
        line(format!("  memory at most {memory:.0} MB with {} threads", plan["threads"]));
        for clock in list(&plan["clocks"]) {
            put_diagnostic("clock", &clock, &mut line);
        }
        for diagnostic in list(&plan["diagnostics"]) {
            let is_info = diagnostic["severity"] == json!(Severity::Info);
            put_diagnostic(if is_info { "note" } else { "warning" }, &diagnostic, &mut line);
        }
    }
    if let Some(missing) = d["missing"].as_str() {
        line(format!("cannot be corrected as it is: {missing}"));
        line(format!(
            "types that are read: {}",
            TYPES.iter().map(|t| t.name).collect::<Vec<_>>().join(", ")
        ));
    }
    text
}
