//! `layout`: ready-made views of a corrected log.

use std::path::PathBuf;

use super::super::args::OutputArgs;
use super::super::output::{Outcome, is_stdout, path_beside, print, print_written, write_text};
use crate::error::{Error, Result};
use crate::recording::{Recording, check_output_path};
use crate::viewers::{cameras, foxglove, rerun};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// A corrected log
    #[arg(value_name = "OUT.mcap")]
    input: PathBuf,
    /// A layout (JSON) for Foxglove and Lichtblick: Layouts, Import from file
    #[arg(long, required_unless_present = "rerun", conflicts_with = "rerun")]
    foxglove: bool,
    /// A Python script that opens the log in rerun; it needs `pip install rerun-sdk`
    #[arg(long)]
    rerun: bool,
    /// Where it is written [default: OUT.foxglove.json or OUT.rerun.py beside OUT; - for stdout]
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    #[command(flatten)]
    out: OutputArgs,
}

pub fn run(args: &Args) -> Result<Outcome> {
    let cameras = cameras(&Recording::open(&args.input)?);
    if cameras.is_empty() {
        return Err(Error::BadFile {
            path: args.input.clone(),
            what: "no corrected camera",
            reason: "it has no metadata record `unwater`; give a log that `unwater correct` has \
                     written"
                .into(),
        });
    }
    let text = if args.foxglove {
        foxglove(&cameras)
    } else {
        // The script must find the log from any folder.
        let log = std::path::absolute(&args.input).unwrap_or_else(|_no_folder| args.input.clone());
        rerun(&cameras, &log.to_string_lossy())
    };
    let suffix = if args.foxglove { "foxglove.json" } else { "rerun.py" };
    let output = args.output.clone().unwrap_or_else(|| path_beside(&args.input, suffix));
    if is_stdout(&output) {
        print(&text);
        return Ok(Outcome::Done);
    }
    check_output_path(&args.input, &output, args.out.force)?;
    write_text(&output, &text)?;
    if !args.out.quiet {
        let next = if args.foxglove {
            format!("open {} in Foxglove, then Layouts, Import from file", args.input.display())
        } else {
            format!("python {}", output.display())
        };
        print_written(&output);
        print(&format!("look at it   {next}\n"));
    }
    Ok(Outcome::Done)
}
