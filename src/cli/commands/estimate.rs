//! `estimate`: pass one over one log or several, a model out.

use std::path::PathBuf;
use std::sync::Arc;

use super::super::args::{EstimateOptions, LogArgs, OutputArgs, read_model};
use super::super::color::Paint;
use super::super::output::{
    Outcome, is_stdout, print, print_diagnostics, print_written, write_text,
};
use super::super::progress::Bar;
use super::super::summary;
use crate::error::{Error, Result};
use crate::recording::{LogFiles, check_output_path};
use crate::run;
use crate::session::Options;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The dive logs, files or folders: one, or several of the same dive, camera and strobe
    #[arg(value_name = "IN.mcap", required = true)]
    inputs: Vec<PathBuf>,
    /// Where the model is written [default: IN.model.json beside the first IN; - for stdout]
    #[arg(short, long, value_name = "MODEL.json")]
    output: Option<PathBuf>,
    /// Estimate attenuation alone; beam pattern, strobe position, transfer curve and vignetting are
    /// those of this model, of another dive with the same strobe
    #[arg(long, value_name = "MODEL.json")]
    beam_from: Option<PathBuf>,
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
    let default = || logs.first().map(|log| log.beside("model.json")).unwrap_or_default();
    let output = args.output.clone().unwrap_or_else(default);
    if !is_stdout(&output) {
        for file in logs.iter().map(LogFiles::files).collect::<Result<Vec<_>>>()?.concat() {
            check_output_path(&file, &output, args.out.force)?;
        }
    }
    let (model, diagnostics) = run::estimate_logs(&logs, &options, &Bar::new(args.out.quiet))?;
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
        print_written(&output);
    }
    Ok(Outcome::Done)
}
