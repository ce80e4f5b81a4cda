//! Estimates a model from a log, corrects the log, and writes a new one.
//!
//! `cargo run --release --example 01_correct_log`

use std::error::Error;
use std::path::Path;

use unwater::{Method, Options, Progress, Step, correct};

const INPUT: &str = "sample_logs/rendered_clear.mcap";
/// Where the results go.
const FOLDER: &str = "target/examples/01_correct_log";

/// Reports the steps of a run on stderr.
struct Steps;

impl Progress for Steps {
    fn begin(&self, step: Step, total: usize) {
        eprintln!("{step:?}: {total} units");
    }
    fn advance(&self, _units: usize) {}
    fn end(&self) {}
}

/// Corrects the sample log.
pub fn main() -> Result<(), Box<dyn Error>> {
    std::fs::create_dir_all(FOLDER)?;
    let output = Path::new(FOLDER).join("rendered_clear.corrected.mcap");
    // The program's options and settings, with their defaults.
    let mut options = Options { force: true, ..Options::default() };
    options.config.render.method = Method::Full;
    options.config.render.mask = true;

    let (report, model) = correct(Path::new(INPUT), &output, None, &options, &Steps)?;

    println!("wrote {}", output.display());
    println!("corrected {} of {} frames", report.corrected, report.frames);
    println!("attenuation {} per metre", model.attenuation_text());
    for diagnostic in &report.diagnostics {
        println!("{diagnostic}");
    }
    // Corrects other logs of this camera, strobe and water: pass it to `correct`.
    std::fs::write(Path::new(FOLDER).join("model.json"), model.to_json()?)?;
    Ok(())
}
