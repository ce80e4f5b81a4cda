//! `compare`: one frame under every correction method.

use std::path::PathBuf;

use super::super::args::{EstimateOptions, LogArgs, OutputArgs, moment, read_model};
use super::super::output::{Outcome, ensure_extension, print_written};
use super::super::progress::Bar;
use crate::error::Result;
use crate::products::sheet::{FrameSelector, sheet};
use crate::products::write_whole;
use crate::recording::check_output_path;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The dive log
    #[arg(value_name = "IN.mcap")]
    input: PathBuf,
    /// Where the sheet is written
    #[arg(short, long, value_name = "SHEET.png")]
    output: PathBuf,
    /// Use a model estimated before
    #[arg(long, value_name = "MODEL.json")]
    model: Option<PathBuf>,
    /// The frame nearest to this time: nanoseconds or RFC 3339
    #[arg(long, value_name = "TIME", value_parser = moment, required_unless_present = "frame",
        conflicts_with = "frame")]
    at: Option<u64>,
    /// The frame by its number; the first is 0
    #[arg(long, value_name = "N")]
    frame: Option<usize>,
    #[command(flatten)]
    log: LogArgs,
    #[command(flatten)]
    out: OutputArgs,
    #[command(flatten)]
    estimate: EstimateOptions,
}

pub fn run(args: &Args) -> Result<Outcome> {
    let options = args.log.options(&[&args.estimate])?;
    check_output_path(&args.input, &args.output, args.out.force)?;
    ensure_extension(&args.output, &["png"])?;
    let frame = match (args.frame, args.at) {
        (Some(number), _) => FrameSelector::Number(number),
        (None, time) => FrameSelector::LogTime(time.unwrap_or_default()),
    };
    let model = read_model(args.model.as_deref())?;
    let png = sheet(&args.input, model, frame, &options, &Bar::new(args.out.quiet))?;
    write_whole(&args.output, &png)?;
    if !args.out.quiet {
        print_written(&args.output);
    }
    Ok(Outcome::Done)
}
