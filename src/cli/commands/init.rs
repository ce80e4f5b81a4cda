//! `init`: a rig file with the facts of the log; what is missing is marked to be filled in.

use std::path::PathBuf;

use super::super::args::{LogArgs, OutputArgs};
use super::super::output::{Outcome, is_stdout, print_written, write_text};
use super::rig_text::rig_text;
use crate::diagnostics::{Diagnostic, Severity};
use crate::error::{Error, Result};
use crate::recording::check_output_path;
use crate::session::survey::{Survey, facts_without_ranges, rig_facts, survey};
use crate::session::{Log, Options};
use crate::vehicle::{CameraFacts, MountFacts, RigFile};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The log
    #[arg(value_name = "IN.mcap")]
    input: PathBuf,
    /// Where the rig file is written (- for stdout)
    #[arg(short, long, value_name = "RIG.toml", default_value = "rig.toml")]
    output: PathBuf,
    #[command(flatten)]
    log: LogArgs,
    #[command(flatten)]
    out: OutputArgs,
}

pub fn run(args: &Args) -> Result<Outcome> {
    let options = args.log.options(&[])?;
    if !is_stdout(&args.output) {
        check_output_path(&args.input, &args.output, args.out.force)?;
    }
    let (facts, notes) = known_facts(&Log::open(&args.input, &options)?, &options)?;
    let text = rig_text(&facts, &args.input, &notes);
    write_text(&args.output, &text)?;
    if !args.out.quiet && !is_stdout(&args.output) {
        print_written(&args.output);
    }
    Ok(Outcome::Done)
}

/// The facts of the log, and what a person has to know about them.
///
/// A missing calibration or mount is assumed, so that the rest can be found; in the file it stays
/// open.
fn known_facts(log: &Log, options: &Options) -> Result<(RigFile, Vec<String>)> {
    let mut assumed = Assumed { options: options.clone(), calibration: false, dvl_mount: false };
    loop {
        match survey(log, &assumed.options) {
            Ok(survey) => {
                let facts = assumed.left_open(rig_facts(&survey.rig, &options.rig));
                return Ok((facts, warnings(&survey)));
            }
            Err(missing) if assumed.supply(&missing) => {}
            Err(missing) if is_missing_fact(&missing) || assumed.is_any() => {
                return Ok((facts_without_ranges(log, options), vec![missing.to_string()]));
            }
            Err(other) => return Err(other),
        }
    }
}

fn is_missing_fact(error: &Error) -> bool {
    use Error::{NoCalibration, NoMount, NoRanges, Rig};
    matches!(error, NoMount(_) | NoCalibration { .. } | NoRanges { .. } | Rig(_))
}

/// Facts that were assumed because the log lacks them.
struct Assumed {
    options: Options,
    calibration: bool,
    dvl_mount: bool,
}

impl Assumed {
    fn is_any(&self) -> bool {
        self.calibration || self.dvl_mount
    }

    /// Assumes the missing fact, once.
    fn supply(&mut self, missing: &Error) -> bool {
        let RigFile { camera, dvl, .. } = &mut self.options.rig;
        match missing {
            Error::NoCalibration { .. } if camera.horizontal_field_of_view_deg.is_none() => {
                camera.horizontal_field_of_view_deg = Some(60.0);
                self.calibration = true;
                true
            }
            Error::NoMount(_) if !self.dvl_mount => {
                dvl.mount = Some(MountFacts::of(nalgebra::Isometry3::identity()));
                self.dvl_mount = true;
                true
            }
            _ => false,
        }
    }

    /// The facts without those that were assumed.
    fn left_open(&self, mut facts: RigFile) -> RigFile {
        if self.calibration {
            let CameraFacts { width, height, mount, .. } = facts.camera;
            facts.camera = CameraFacts { width, height, mount, ..CameraFacts::default() };
        }
        if self.dvl_mount {
            facts.dvl.mount = None;
        }
        facts
    }
}

fn warnings(survey: &Survey) -> Vec<String> {
    let warnings = survey.diagnostics.iter().filter(|d| d.severity() == Severity::Warning);
    warnings.map(Diagnostic::with_remedy).collect()
}
