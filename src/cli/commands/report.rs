//! `report`: one page about a corrected log.

use std::path::PathBuf;

use super::super::args::{OutputArgs, ThreadArgs};
use super::super::output::{Outcome, path_beside, print_written, write_text};
use crate::error::Result;
use crate::products::dive::CorrectedLog;
use crate::products::page::page;
use crate::recording::check_output_path;
use crate::session::Options;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// A log that `unwater correct` wrote
    #[arg(value_name = "OUT.mcap")]
    input: PathBuf,
    /// Where the page is written [default: OUT.html beside OUT]
    #[arg(short, long, value_name = "REPORT.html")]
    output: Option<PathBuf>,
    #[command(flatten)]
    threads: ThreadArgs,
    #[command(flatten)]
    out: OutputArgs,
}

pub fn run(args: &Args) -> Result<Outcome> {
    let options = Options { threads: args.threads.threads, ..Options::default() };
    let output = args.output.clone().unwrap_or_else(|| path_beside(&args.input, "html"));
    check_output_path(&args.input, &output, args.out.force)?;
    let log = CorrectedLog::open(&args.input, &options)?;
    write_text(&output, &page(&log, &options)?)?;
    if !args.out.quiet {
        print_written(&output);
    }
    Ok(Outcome::Done)
}
