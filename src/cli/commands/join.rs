//! `join`: shards of one corrected log into one.

use std::path::{Path, PathBuf};

use super::super::args::{LossArgs, OutputArgs};
use super::super::output::{Outcome, print, print_written};
use crate::error::Result;
use crate::report::Report;
use crate::run;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// What `unwater correct --shard I/N` wrote, all N of them
    #[arg(value_name = "PART.mcap", required = true)]
    parts: Vec<PathBuf>,
    /// Where the corrected log is written
    #[arg(short, long, value_name = "OUT.mcap")]
    output: PathBuf,
    #[command(flatten)]
    losses: LossArgs,
    #[command(flatten)]
    out: OutputArgs,
}

pub fn run(args: &Args) -> Result<Outcome> {
    let parts: Vec<&Path> = args.parts.iter().map(PathBuf::as_path).collect();
    let reports = run::join(&parts, &args.output, args.out.force)?;
    if !args.out.quiet {
        for report in &reports {
            let Report { corrected, frames, camera_topic, .. } = report;
            print(&format!("frames       {corrected} of {frames} corrected of {camera_topic}\n"));
        }
        print_written(&args.output);
    }
    let has_losses = reports.iter().any(Report::has_losses);
    let outcome = if has_losses { Outcome::DoneWithLosses } else { Outcome::Done };
    Ok(args.losses.outcome(outcome))
}
