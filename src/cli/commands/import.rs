//! `import`: a folder of stills and a navigation table become a log.

use std::path::PathBuf;

use super::super::args::{LossArgs, OutputArgs};
use super::super::output::{Outcome, print, print_written};
use crate::error::Result;
use crate::import::{Import, import, offset_s};
use crate::recording::check_output_path;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The folder of the images (JPEG, PNG, TIFF, WebP), which are kept as they are
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// The navigation table: CSV with a header, or an iFDO record in JSON
    #[arg(long, value_name = "NAV.csv")]
    table: PathBuf,
    /// Where the log is written
    #[arg(short, long, value_name = "OUT.mcap")]
    output: PathBuf,
    /// Horizontal field of view of the camera in water [deg]; without it a rig file has the
    /// calibration
    #[arg(long, value_name = "DEG", value_parser = field_of_view)]
    horizontal_fov: Option<f64>,
    /// Offset from UTC of times that have no zone, as +10:00
    #[arg(
        long,
        value_name = "OFFSET",
        default_value = "+00:00",
        value_parser = offset,
        allow_hyphen_values = true
    )]
    utc_offset: i64,
    #[command(flatten)]
    losses: LossArgs,
    #[command(flatten)]
    out: OutputArgs,
}

pub fn run(args: &Args) -> Result<Outcome> {
    check_output_path(&args.table, &args.output, args.out.force)?;
    let wanted = Import {
        folder: args.folder.clone(),
        table: args.table.clone(),
        utc_offset_s: args.utc_offset,
        horizontal_fov_deg: args.horizontal_fov,
    };
    let imported = import(&wanted, &args.output)?;
    if !imported.missing.is_empty() {
        eprintln!(
            "lost: {} files of the table are no images in the folder:",
            imported.missing.len()
        );
        imported.missing.iter().take(SHOWN).for_each(|name| eprintln!("  {name}"));
    }
    if !args.out.quiet {
        let (images, with) = (imported.images, imported.with_altitude);
        print(&format!("images       {images}, {with} with an altitude\n"));
        let mut name = "columns";
        for column in &imported.columns {
            print(&format!("{name:<12} {column}\n"));
            name = "";
        }
        print_written(&args.output);
        if args.horizontal_fov.is_none() {
            let log = args.output.display();
            print(&format!(
                "next         unwater init {log} -o rig.toml, and fill in the camera\n"
            ));
        }
    }
    let is_whole = imported.missing.is_empty();
    let outcome = if is_whole { Outcome::Done } else { Outcome::DoneWithLosses };
    Ok(args.losses.outcome(outcome))
}

/// Missing files that are listed.
const SHOWN: usize = 20;

fn field_of_view(text: &str) -> std::result::Result<f64, String> {
    let angle = text.parse::<f64>().ok().filter(|angle| (1.0..179.0).contains(angle));
    angle.ok_or_else(|| "an angle from 1 to 179 degrees is expected".into())
}

fn offset(text: &str) -> std::result::Result<i64, String> {
    offset_s(text).ok_or_else(|| "an offset like +10:00 is expected".into())
}
