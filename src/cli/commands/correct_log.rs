//! `correct` of one log: both passes, or pass two alone with a given model.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::super::args::{
    EstimateOptions, LogArgs, LossArgs, OutputArgs, OutputOptions, RenderOptions, read_model,
};
use super::super::color::Paint;
use super::super::output::{Outcome, damage_time, is_stdout, print, print_diagnostics, print_json};
use super::super::progress::Bar;
use super::super::summary;
use crate::diagnostics::{Diagnostic, EstimateFact, Severity};
use crate::error::{Error, Result};
use crate::model::ModelFile;
use crate::products::dive::finished;
use crate::recording::{LogFiles, Recording, check_output_path};
use crate::report::Report;
use crate::run;
use crate::session::{Options, Shard};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The dive logs: files, folders as `ros2 bag` writes them, or NAME_0.mcap, NAME_1.mcap, … of
    /// one folder, which are the parts of one recording
    #[arg(value_name = "IN.mcap", required = true)]
    pub inputs: Vec<PathBuf>,
    /// Where the corrected log is written [default: IN.corrected.mcap beside IN]; of several logs,
    /// the folder for all
    #[arg(short, long, value_name = "OUT.mcap")]
    pub output: Option<PathBuf>,
    /// Use a model estimated before, from this dive or another (pass two alone)
    #[arg(long, value_name = "MODEL.json")]
    model: Option<PathBuf>,
    /// Correct the frames of part I of N only (I from 1 to N); `unwater join` makes one log of all
    /// parts
    #[arg(long, value_name = "I/N", requires = "model")]
    shard: Option<Shard>,
    /// Skip logs whose output exists and was made from the same input with the same options
    #[arg(long)]
    resume: bool,
    #[command(flatten)]
    pub losses: LossArgs,
    /// Print the report as JSON
    #[arg(long)]
    pub json: bool,
    /// Estimate attenuation alone; beam pattern, strobe position, transfer curve and vignetting are
    /// those of this model, of another dive with the same strobe
    #[arg(long, value_name = "MODEL.json", conflicts_with = "model")]
    beam_from: Option<PathBuf>,
    #[command(flatten)]
    log: LogArgs,
    #[command(flatten)]
    pub out: OutputArgs,
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

/// Reports and models of the cameras of one log.
pub type Cameras = Vec<(Report, ModelFile)>;

/// What is the same for all logs.
pub struct Run<'a> {
    pub args: &'a Args,
    options: Options,
    model: Option<ModelFile>,
}

/// A log that is finished.
pub struct Finished {
    pub cameras: Cameras,
    /// whether it was before
    pub is_skipped: bool,
}

impl<'a> Run<'a> {
    /// What the arguments ask for.
    pub fn new(args: &'a Args) -> Result<Self> {
        let options = args.log.options(&[&args.estimate, &args.render, &args.output_options])?;
        let beam_from = read_model(args.beam_from.as_deref())?.map(Arc::new);
        let (force, shard) = (args.out.force, args.shard);
        let options = Options { force, beam_from, shard, ..options };
        if args.output.as_deref().is_some_and(is_stdout) {
            return Err(Error::Usage("cannot write a corrected log to stdout; use -o FILE".into()));
        }
        let model = read_model(args.model.as_deref())?;
        if model.is_some() && args.estimate != EstimateOptions::default() && !args.out.quiet {
            print_diagnostics(&[EstimateFact::OptionsIgnored.into()], 0);
        }
        Ok(Self { args, options, model })
    }
}

impl Run<'_> {
    /// The only log of a run.
    pub fn one(&self, log: &LogFiles) -> Result<Outcome> {
        let default = || self.beside(log);
        let output = self.args.output.clone().unwrap_or_else(default);
        let Finished { cameras, .. } = self.correct(log, &output)?;
        if self.args.json {
            print_json(reports_json(&cameras))?;
        }
        Ok(outcome(&cameras))
    }

    /// Where a log is written by default.
    pub fn beside(&self, log: &LogFiles) -> PathBuf {
        match self.args.shard {
            None => log.beside("corrected.mcap"),
            Some(Shard { index, count }) => log.beside(&format!("shard-{index}-of-{count}.mcap")),
        }
    }

    /// Corrects one log, and prints what came of it.
    pub fn correct(&self, log: &LogFiles, output: &Path) -> Result<Finished> {
        let Self { args, options, model } = self;
        if let Some(cameras) = self.finished(log, output)? {
            if !args.json && !args.out.quiet {
                print(&format!("finished     {}\n", output.display()));
            }
            return Ok(Finished { cameras, is_skipped: true });
        }
        for read in [&args.model, &args.beam_from, &args.log.rig, &args.log.settings.config]
            .into_iter()
            .flatten()
        {
            check_output_path(read, output, true)?;
        }
        let start = Instant::now();
        let cameras =
            run::correct_all(log, output, model.clone(), options, &Bar::new(args.out.quiet))?;
        cameras.iter().for_each(|(report, _)| print_losses(report, args));
        if !args.json && !args.out.quiet {
            print_summary(&cameras, model.is_some(), start.elapsed(), output);
        }
        Ok(Finished { cameras, is_skipped: false })
    }

    /// What an earlier run of the same work has left, with `--resume`.
    fn finished(&self, log: &LogFiles, output: &Path) -> Result<Option<Cameras>> {
        if !self.args.resume || !output.is_file() {
            return Ok(None);
        }
        let request = run::request_sha256(&self.options, self.model.as_ref())?;
        let recording = Recording::open_files(log)?;
        let shard = self.options.shard;
        Ok(finished(output, (&recording, &request), shard))
    }
}

/// How the run of a log ended.
pub fn outcome(cameras: &Cameras) -> Outcome {
    let has_losses = cameras.iter().any(|(report, _)| report.has_losses());
    if has_losses { Outcome::DoneWithLosses } else { Outcome::Done }
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
fn reports_json(cameras: &Cameras) -> serde_json::Result<String> {
    match cameras.as_slice() {
        [(report, _)] => report.to_json(),
        several => {
            let reports: Vec<&Report> = several.iter().map(|(report, _)| report).collect();
            serde_json::to_string_pretty(&reports).map(|text| text + "\n")
        }
    }
}

fn print_summary(cameras: &Cameras, is_model_given: bool, elapsed: Duration, output: &Path) {
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
