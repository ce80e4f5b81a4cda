//! `estimate`: pass one over one log or several, or over samples of logs, a model out.

use std::path::PathBuf;
use std::sync::Arc;

use super::super::args::{EstimateOptions, LogArgs, OutputArgs, read_model};
use super::super::color::Paint;
use super::super::output::{
    Outcome, is_stdout, path_beside, print, print_diagnostics, print_written, write_text,
};
use super::super::progress::Bar;
use super::super::summary;
use crate::diagnostics::Diagnostic;
use crate::error::{Error, Result};
use crate::model::ModelFile;
use crate::products::write_whole;
use crate::recording::{LogFiles, check_output_path};
use crate::run;
use crate::session::Options;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The dive logs, files or folders: one, or several of the same dive, camera and strobe
    #[arg(value_name = "IN.mcap", required_unless_present = "from")]
    inputs: Vec<PathBuf>,
    /// Where the model is written [default: IN.model.json beside the first IN; - for stdout]
    #[arg(short, long, value_name = "MODEL.json")]
    output: Option<PathBuf>,
    /// Estimate attenuation alone; beam pattern, strobe position, transfer curve and vignetting are
    /// those of this model, of another dive with the same strobe
    #[arg(long, value_name = "MODEL.json")]
    beam_from: Option<PathBuf>,
    /// Write the samples that the model is estimated from, for --from
    #[arg(long, value_name = "FILE", conflicts_with = "beam_from")]
    save_samples: Option<PathBuf>,
    /// Estimate from samples of one dive or several instead of logs
    #[arg(
        long,
        value_name = "FILE",
        num_args = 1..,
        conflicts_with_all = [
            "inputs", "beam_from", "save_samples", "rig", "camera", "dvl", "strobe_frame", "start",
            "end", "transfer",
        ]
    )]
    from: Vec<PathBuf>,
    #[command(flatten)]
    log: LogArgs,
    #[command(flatten)]
    out: OutputArgs,
    /// Print notes too
    #[arg(short, long, action = clap::ArgAction::Count)]
    verbose: u8,
    #[command(flatten)]
    estimate: EstimateOptions,
}

pub fn run(args: &Args) -> Result<Outcome> {
    let beam_from = read_model(args.beam_from.as_deref())?.map(Arc::new);
    let options = Options { beam_from, ..args.log.options(&[&args.estimate])? };
    let logs = LogFiles::group(&args.inputs)?;
    let samples = args.from.first().map(|samples| path_beside(samples, "model.json"));
    let default = || logs.first().map(|log| log.beside("model.json")).or(samples);
    let output = args.output.clone().or_else(default).unwrap_or_default();
    if args.save_samples.as_ref().is_some_and(|samples| *samples == output || is_stdout(samples)) {
        return Err(Error::Usage("--save-samples: give the samples a file of their own".into()));
    }
    let files = logs.iter().map(LogFiles::files).collect::<Result<Vec<_>>>()?.concat();
    for output in args.save_samples.iter().chain([&output]).filter(|o| !is_stdout(o)) {
        for file in files.iter().chain(&args.from) {
            check_output_path(file, output, args.out.force)?;
        }
    }
    let (model, diagnostics) = estimated(args, &logs, &options)?;
    if !args.out.quiet {
        print_diagnostics(&diagnostics, args.verbose);
        print_diagnostics(&model.diagnostics, args.verbose);
    }
    let failed =
        |e: serde_json::Error| Error::WriteRecord { path: output.clone(), reason: e.to_string() };
    write_text(&output, &model.to_json().map_err(failed)?)?;
    if !args.out.quiet && !is_stdout(&output) {
        let attenuation = summary::attenuation(&model, Paint::of_stdout());
        print(&format!("attenuation  {attenuation}\n"));
        for input in &model.inputs {
            if let Some(own) = input.attenuation_text() {
                print(&format!("             {own} per metre in {}\n", input.name));
            }
        }
        print_written(&output);
    }
    Ok(Outcome::Done)
}

/// The model, and what is to be said of the logs.
fn estimated(
    args: &Args,
    logs: &[LogFiles],
    options: &Options,
) -> Result<(ModelFile, Vec<Diagnostic>)> {
    let bar = Bar::new(args.out.quiet);
    let Some(path) = &args.save_samples else {
        return match args.from.is_empty() {
            true => run::estimate_logs(logs, options, &bar),
            false => Ok((run::estimate_samples(&args.from, options)?, Vec::new())),
        };
    };
    let [log] = logs else {
        return Err(Error::Usage(
            "--save-samples: a file has the samples of one log; run `estimate` once for each"
                .into(),
        ));
    };
    let (model, diagnostics, samples) = run::estimate_and_sample(log, options, &bar)?;
    write_whole(path, &samples)?;
    if !args.out.quiet {
        print_written(path);
    }
    Ok((model, diagnostics))
}
