//! `estimate`: pass one over one log or several, a model out.

use std::path::{Path, PathBuf};

use super::super::args::{EstimateOptions, LogArgs, OutputArgs};
use super::super::color::Paint;
use super::super::output::{
    Outcome, is_stdout, path_beside, print, print_diagnostics, print_written, write_text,
};
use super::super::progress::Bar;
use super::super::summary;
use crate::error::{Error, Result};
use crate::recording::check_output_path;
use crate::run;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The dive logs: one, or several of the same dive, camera and strobe
    #[arg(value_name = "IN.mcap", required = true)]
    inputs: Vec<PathBuf>,
    /// Where the model is written [default: IN.model.json beside the first IN; - for stdout]
    #[arg(short, long, value_name = "MODEL.json")]
    output: Option<PathBuf>,
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
    let options = args.log.options(&[&args.estimate])?;
    let first = args.inputs.first().cloned().unwrap_or_default();
    let output = args.output.clone().unwrap_or_else(|| path_beside(&first, "model.json"));
    if !is_stdout(&output) {
        for input in &args.inputs {
            check_output_path(input, &output, args.out.force)?;
        }
    }
    let inputs: Vec<&Path> = args.inputs.iter().map(PathBuf::as_path).collect();
    let (model, diagnostics) = run::estimate_logs(&inputs, &options, &Bar::new(args.out.quiet))?;
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
