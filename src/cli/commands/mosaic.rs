//! `mosaic`: a segment of frames laid over the seafloor.

use std::path::PathBuf;

use super::super::args::{CorrectedLogArgs, OutputArgs};
use super::super::output::{Outcome, ensure_extension, print_written};
use crate::error::{Error, Result};
use crate::products::dive::CorrectedLog;
use crate::products::mosaic::{MosaicOptions, is_geotiff, mosaic};
use crate::products::write_whole;
use crate::recording::check_output_path;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// A log that `unwater correct` wrote
    #[arg(value_name = "OUT.mcap")]
    input: PathBuf,
    /// Where the mosaic is written: .png, or .tif for a GeoTIFF of the corrected strip
    #[arg(short, long, value_name = "MOSAIC.png")]
    output: PathBuf,
    #[command(flatten)]
    log: CorrectedLogArgs,
    #[command(flatten)]
    out: OutputArgs,
}

pub fn run(args: &Args) -> Result<Outcome> {
    let options = args.log.options()?;
    check_output_path(&args.input, &args.output, args.out.force)?;
    ensure_extension(&args.output, &["png", "tif", "tiff"])?;
    let asked = MosaicOptions {
        camera: args.log.camera.clone(),
        is_georeferenced: is_geotiff(&args.output),
    };
    let mosaic = mosaic(&CorrectedLog::open(&args.input, &options)?, &asked, &options)?;
    let encoded = mosaic.tiff().map_or_else(|| mosaic.png(), Ok);
    let bytes =
        encoded.map_err(|reason| Error::WriteRecord { path: args.output.clone(), reason })?;
    write_whole(&args.output, &bytes)?;
    if !args.out.quiet {
        mosaic.diagnostics.iter().for_each(|d| eprintln!("note: {d}"));
        print_written(&args.output);
    }
    Ok(Outcome::Done)
}
