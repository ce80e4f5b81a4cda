//! `layout`: ready-made views of a corrected log.

use std::path::PathBuf;

use clap::Args;

use super::Ended;
use super::commands::{beside, say, write_text};
use crate::error::{Error, Result};
use crate::recording::{Recording, check_output_path};
use crate::viewers::{cameras, foxglove, rerun};

/// `layout`
#[derive(Debug, Args)]
pub struct LayoutArgs {
    /// A corrected log
    #[arg(value_name = "OUT.mcap")]
    pub input: PathBuf,
    /// A layout (JSON) for Foxglove and Lichtblick: Layouts, Import from file
    #[arg(long, required_unless_present = "rerun", conflicts_with = "rerun")]
    pub foxglove: bool,
    /// A Python script that opens the log in rerun; it needs `pip install rerun-sdk`
    #[arg(long)]
    pub rerun: bool,
    /// Where it goes [default: OUT.foxglove.json or OUT.rerun.py beside OUT; - for stdout]
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Overwrite the output
    #[arg(long)]
    pub force: bool,
    /// Say nothing but errors
    #[arg(short, long)]
    pub quiet: bool,
}

pub fn run(args: &LayoutArgs) -> Result<Ended> {
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
        // Also from another folder the script finds the log.
        let log = std::path::absolute(&args.input).unwrap_or_else(|_no_folder| args.input.clone());
        rerun(&cameras, &log.to_string_lossy())
    };
    let suffix = if args.foxglove { "foxglove.json" } else { "rerun.py" };
    let output = args.output.clone().unwrap_or_else(|| beside(&args.input, suffix));
    if output.as_os_str() == "-" {
        say(&text);
        return Ok(Ended::Done);
    }
    check_output_path(&args.input, &output, args.force)?;
    write_text(&output, &text)?;
    if !args.quiet {
        let next = if args.foxglove {
            format!("open {} in Foxglove, then Layouts, Import from file", args.input.display())
        } else {
            format!("python {}", output.display())
        };
        say(&format!("written      {}\nlook at it   {next}\n", output.display()));
    }
    Ok(Ended::Done)
}
