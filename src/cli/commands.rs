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
use crate::recording::Recording;
use crate::report::Report;
use crate::run::clock_offsets::clock_offsets;
use crate::run::memory::Load;
use crate::run::{self, corrected_topic, output_container};
use crate::session::{self, Options, survey};

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
        [(report, _)] if args.json => say(&report.to_json()),
        several if args.json => {
            let reports: Vec<&Report> = several.iter().map(|(report, _)| report).collect();
            say(&(serde_json::to_string_pretty(&reports).unwrap_or_default() + "\n"));
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
    if to_stdout {
        say(&model.to_json());
        return Ok(Ended::Done);
    }
    write_text(&output, &model.to_json())?;
    if !args.shared.quiet {
        say(&format!(
            "attenuation  {}\nwritten      {}\n",
            summary::attenuation(&model, Paint::of_stdout()),
            output.display()
        ));
    }
    Ok(Ended::Done)
}

/// Writes a small file under a temporary name first.
pub(super) fn write_text(path: &Path, text: &str) -> Result<()> {
    crate::products::write_whole(path, text.as_bytes())
}

fn config(args: &ConfigArgs) -> Result<Ended> {
    let options = args.shared.options(&args.estimate, &args.render)?;
    say(&(options.config.to_commented_toml()
        + &run::memory::table(&options.config, session::Threads::new(options.threads).count())));
    Ok(Ended::Done)
}

fn inspect(args: &Inspect) -> Result<Ended> {
    let options = args.shared.options(&EstimateOptions::default(), &RenderOptions::default())?;
    let (recording, mut scan) = match session::open(&args.input, &options) {
        Err(Error::Empty { .. }) if options.window.is_none() => {
            let recording = Recording::open(&args.input)?;
            let threads = session::Threads::new(options.threads);
            let scan = session::index::scan(
                &recording,
                crate::recording::Window::ALL,
                &options.rig.dvl,
                &threads,
            )?;
            (recording, scan)
        }
        other => other?,
    };
    let channels: Vec<_> = recording
        .channels
        .iter()
        .map(|(id, c)| {
            let scanned = scan.channels.get(id);
            let decoder = scan.decoders.get(id);
            json!({
                "topic": c.topic,
                "messages": scanned.map_or(0, |s| s.count),
                "schema": recording.schemas.get(&c.schema_id).map_or("", |s| s.name.as_str()),
                "message_encoding": c.message_encoding,
                "read_as": decoder.map(|d| d.message_type.kind.label()),
                "shape_of": decoder.map(|d| d.message_type.name),
                "frame_id": scanned.map_or("", |s| s.frame_id.as_str()),
                "description": scanned.map_or("", |s| s.description.as_str()),
                "clock_offset_s": scanned.and_then(|s| s.clock_offset_s),
                "unreadable": scanned.map_or(0, |s| s.unreadable.0),
                "complaint": scanned.and_then(|s| s.unreadable.1.clone()),
            })
        })
        .collect();
    let damage = scan.damage.clone();
    let (messages, span) = (scan.messages, scan.span);
    let survey =
        survey::survey(&recording, &mut scan, &options.selection, &options.rig, &options.config);
    let survey = survey
        .and_then(|s| run::ensure_not_corrected(&recording, &s, &options.config, None).map(|()| s));
    let (plans, missing) = match survey {
        Ok(survey) if args.clocks => {
            each_plan(&args.input, &options, vec![survey.camera_topic], true)
        }
        Ok(survey) => (vec![plan(&survey, &options)], Vec::new()),
        Err(Error::SeveralCameras { topics }) => {
            each_plan(&args.input, &options, topics, args.clocks)
        }
        Err(e) => (Vec::new(), vec![e.to_string()]),
    };
    let document = json!({
        "file": args.input.display().to_string(),
        "bytes": recording.length(),
        "profile": recording.profile,
        "complete": recording.is_complete,
        "messages": messages,
        "start_ns": span.map(|s| s.0),
        "end_ns": span.map(|s| s.1),
        "chunks": recording.chunk_count(),
        "compression": recording.compressions,
        "attachments": recording.attachments().count(),
        "metadata": recording.metadata.iter().map(|m| m.name.clone()).collect::<Vec<_>>(),
        "damage": damage,
        "diagnostics": recording.diagnostics(),
        "channels": channels,
        "plan": plans.first(),
        "plans": plans,
        "missing": if missing.is_empty() { None } else { Some(missing.join("; ")) },
    });
    if args.json {
        say(&(serde_json::to_string_pretty(&document).unwrap_or_default() + "\n"));
    } else {
        say(&inspect_text(&document));
    }
    Ok(if damage.is_empty() { Ended::Done } else { Ended::DoneWithLosses })
}

/// What would be done with each camera of a log that has several, and what keeps others from it.
fn each_plan(
    input: &Path,
    options: &Options,
    topics: Vec<String>,
    with_clocks: bool,
) -> (Vec<serde_json::Value>, Vec<String>) {
    let (mut plans, mut missing) = (Vec::new(), Vec::new());
    for topic in topics {
        let mut chosen = options.clone();
        chosen.selection.camera = Some(topic.clone());
        match session::prepare(input, &chosen) {
            Ok(prepared) => {
                let mut plan = plan(&prepared.survey, &chosen);
                if with_clocks && let Ok(found) = clock_offsets(&prepared, &chosen) {
                    plan["clocks"] = json!(found.diagnostics(&prepared.survey, &chosen.rig));
                }
                plans.push(plan);
            }
            Err(e) => missing.push(format!("{topic}: {e}")),
        }
    }
    (plans, missing)
}

/// What would be done with a camera.
fn plan(s: &survey::Survey, options: &Options) -> serde_json::Value {
    let planes: Vec<_> = s
        .frames
        .iter()
        .map(|f| s.pings.seafloor(f.stamp, &s.rig, &options.config.seafloor))
        .collect();
    let altitudes: Vec<f64> = planes
        .iter()
        .flatten()
        .map(|p| p.distance_m - p.normal.vector().dot(&s.rig.body_from_optical.origin().vector()))
        .collect();
    let container = output_container(s.container, &options.config);
    let (pixels, source_bytes) = s.picture;
    let threads = session::Threads::new(options.threads).count();
    let pass_one_frames = s.frames.len().min(options.config.estimate.max_frames);
    let memory =
        Load { threads, pixels, source_bytes, pass_one_frames }.bound(&options.config).total();
    json!({
        "camera": s.camera_topic,
        "frames": s.frames.len(),
        "frames_with_seafloor": altitudes.len(),
        "camera_altitude_m": if altitudes.is_empty() { None } else { Some([altitudes.iter().copied().fold(f64::INFINITY, f64::min), altitudes.iter().copied().fold(0.0, f64::max)]) },
        "dvl": s.dvl_topic,
        "pings": s.pings.count(),
        "attitude": s.attitude_topic,
        "strobe": s.rig.strobe.source,
        "white_level": s.white_level,
        "corrected_topic": corrected_topic(&s.camera_topic, container != Container::Raw),
        "threads": threads,
        "memory_at_most_bytes": memory,
        "diagnostics": s.diagnostics,
    })
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
