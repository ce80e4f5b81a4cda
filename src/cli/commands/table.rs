//! `table`: one row per corrected dive.

use std::path::{Path, PathBuf};

use super::super::output::{Outcome, print};
use crate::error::Result;
use crate::products::dive::{CameraLog, read_cameras};
use crate::products::dive_table::{Row, as_csv, as_text};
use crate::recording::{LogFiles, Recording};
use crate::run::shard_of;
use crate::session::Shard;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Logs that `unwater correct` wrote
    #[arg(value_name = "OUT.mcap", required = true)]
    inputs: Vec<PathBuf>,
    /// CSV with every column, instead of text
    #[arg(long)]
    csv: bool,
}

/// Reads the records of each log, not its messages. A log that cannot be read is a row too.
pub fn run(args: &Args) -> Result<Outcome> {
    let (mut rows, mut outcome) = (Vec::new(), Outcome::Done);
    for input in &args.inputs {
        let log = LogFiles::from(input).stem;
        match read(input) {
            Ok((cameras, shard)) => {
                let facts = |camera: CameraLog| (camera.report, camera.model);
                let has_losses = cameras.iter().any(|camera| camera.report.has_losses());
                let result = match (shard, has_losses) {
                    // Its numbers are those of its own frames.
                    (Some(Shard { index, count }), _) => format!("shard {index}/{count}"),
                    (None, true) => "with losses".into(),
                    (None, false) => "done".into(),
                };
                rows.extend(Row::of_cameras(&log, &result, cameras.into_iter().map(facts)));
            }
            Err(error) => {
                eprintln!("unwater: {error}");
                rows.push(Row::without_facts(&log, "not readable"));
                outcome = Outcome::CannotCorrect;
            }
        }
    }
    print(&if args.csv { as_csv(&rows) } else { as_text(&rows) });
    Ok(outcome)
}

/// The cameras of a corrected log, and which part of one it is where it is not whole.
fn read(input: &Path) -> Result<(Vec<CameraLog>, Option<Shard>)> {
    let recording = Recording::open(input)?;
    Ok((read_cameras(&recording)?, shard_of(&recording)))
}
