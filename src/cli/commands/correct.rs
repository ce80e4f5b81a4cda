//! `correct`: both passes over a log, or pass two alone with a given model.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use super::super::args::{
    EstimateOptions, LogArgs, OutputArgs, OutputOptions, RenderOptions, read_model,
};
use super::super::color::Paint;
use super::super::output::{
    Outcome, damage_time, is_stdout, path_beside, print, print_diagnostics, print_json,
};
use super::super::progress::Bar;
use super::super::summary;
use crate::diagnostics::{Diagnostic, EstimateFact, Severity};
use crate::error::{Error, Result};
use crate::model::ModelFile;
use crate::recording::check_output_path;
use crate::report::Report;
use crate::run;
use crate::session::Options;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The dive log
    #[arg(value_name = "IN.mcap")]
    input: PathBuf,
    /// Where the corrected log is written [default: IN.corrected.mcap beside IN]
    #[arg(short, long, value_name = "OUT.mcap")]
    output: Option<PathBuf>,
    /// Use a model estimated before, from this dive or another (pass two alone)
    #[arg(long, value_name = "MODEL.json")]
    model: Option<PathBuf>,
    /// Print the report as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    log: LogArgs,
    #[command(flatten)]
    out: OutputArgs,
    /// Print notes too
    #[arg(short, long, action = clap::ArgAction::Count)]
    verbose: u8,
    #[command(flatten)]
    estimate: EstimateOptions,
    #[command(flatten)]
    render: RenderOptions,
    #[command(flatten)]
    output_options: OutputOptions,
}

pub fn run(args: &Args) -> Result<Outcome> {
    let options = args.log.options(&[&args.estimate, &args.render, &args.output_options])?;
    let options = Options { force: args.out.force, ..options };
    let output = args.output.clone().unwrap_or_else(|| path_beside(&args.input, "corrected.mcap"));
    if is_stdout(&output) {
        return Err(Error::Usage("cannot write a corrected log to stdout; use -o FILE".into()));
    }
    for read in [&args.model, &args.log.rig, &args.log.settings.config].into_iter().flatten() {
        check_output_path(read, &output, true)?;
    }
    let model = read_model(args.model.as_deref())?;
    let is_model_given = model.is_some();
    if is_model_given && args.estimate != EstimateOptions::default() && !args.out.quiet {
        print_diagnostics(&[EstimateFact::OptionsIgnored.into()], 0);
    }
    let start = Instant::now();
    let bar = Bar::new(args.out.quiet);
    let cameras = run::correct_all(&args.input, &output, model, &options, &bar)?;
    cameras.iter().for_each(|(report, _)| print_losses(report, args));
    if args.json {
        print_json(reports_json(&cameras))?;
    } else if !args.out.quiet {
        print_summary(&cameras, is_model_given, start.elapsed(), &output);
    }
    let has_losses = cameras.iter().any(|(report, _)| report.has_losses());
    Ok(if has_losses { Outcome::DoneWithLosses } else { Outcome::Done })
}

/// Diagnostics unless quiet; losses in any case, as they are why the exit status is 3.
fn print_losses(report: &Report, args: &Args) {
    if !args.out.quiet {
        print_diagnostics(&report.diagnostics, args.verbose);
    }
    // The summary has the frames that were not corrected.
    let is_shown = |d: &&Diagnostic| args.out.quiet || !d.is_uncorrected();
    for loss in report.of(Severity::Loss).filter(is_shown) {
        eprintln!("lost: {}", loss.with_remedy());
    }
    for damage in &report.damage {
        let time = damage_time(damage.start_ns, damage.end_ns);
        eprintln!("  {} (byte {}, {time})", damage.reason, damage.offset);
    }
}

/// One report, or a list where several cameras were corrected.
fn reports_json(cameras: &[(Report, ModelFile)]) -> serde_json::Result<String> {
    match cameras {
        [(report, _)] => report.to_json(),
        several => {
            let reports: Vec<&Report> = several.iter().map(|(report, _)| report).collect();
            serde_json::to_string_pretty(&reports).map(|text| text + "\n")
        }
    }
}

fn print_summary(
    cameras: &[(Report, ModelFile)],
    is_model_given: bool,
    elapsed: Duration,
    output: &Path,
) {
    let paint = Paint::of_stdout();
    let elapsed = (cameras.len() == 1).then_some(elapsed);
    for (report, model) in cameras {
        if cameras.len() > 1 {
            print(&format!("{} {}\n", paint.name("camera      "), report.camera_topic));
        }
        print(&summary::summary(report, model, is_model_given, elapsed, paint));
    }
    let sum = |count: fn(&Report) -> u64| cameras.iter().map(|(report, _)| count(report)).sum();
    let (copied, added) = (sum(|r| r.messages_copied), sum(|r| r.messages_added));
    print(&summary::written(copied, added, output, paint));
}
