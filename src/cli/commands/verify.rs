//! `verify`: whether a corrected log is what it must be.

use std::path::PathBuf;

use serde_json::json;

use super::super::args::ThreadArgs;
use super::super::color::Paint;
use super::super::output::{Outcome, print, print_json};
use super::super::progress::Bar;
use crate::diagnostics::Severity;
use crate::error::{Error, Result};
use crate::products::verify::{Verification, verify};
use crate::recording::LogFiles;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// A log that `unwater correct` wrote
    #[arg(value_name = "OUT.mcap")]
    output: PathBuf,
    /// Its input, a file, a folder or the parts of one recording: nothing of it may be missing
    #[arg(long, value_name = "IN.mcap", num_args = 1..)]
    against: Vec<PathBuf>,
    /// One JSON document instead of text
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    threads: ThreadArgs,
    /// Print what is wrong only
    #[arg(short, long)]
    quiet: bool,
}

pub fn run(args: &Args) -> Result<Outcome> {
    let inputs = LogFiles::group(&args.against)?;
    let input = match inputs.as_slice() {
        [] => None,
        [one] => Some(one),
        _ => return Err(Error::Usage("--against takes one log".into())),
    };
    let bar = Bar::new(args.quiet || args.json);
    let found = verify(&args.output, input, args.threads.threads, &bar)?;
    if args.json {
        let document = json!({
            "file": args.output.display().to_string(),
            "verified": !found.has_failed(),
            "frames_compared": found.is_complete(),
            "input_messages": found.copied,
            "repeated_messages": found.repeated,
            "diagnostics": found.diagnostics,
        });
        print_json(serde_json::to_string_pretty(&document).map(|text| text + "\n"))?;
    } else {
        print(&text(&found, args, input.is_some()));
    }
    Ok(match (found.has_failed(), found.is_complete()) {
        (true, _) => Outcome::CannotCorrect,
        (false, false) => Outcome::DoneWithLosses,
        (false, true) => Outcome::Done,
    })
}

fn text(found: &Verification, args: &Args, has_input: bool) -> String {
    let paint = Paint::of_stdout();
    let mut text = String::new();
    for diagnostic in &found.diagnostics {
        let is_wrong = diagnostic.severity() == Severity::Loss;
        let word = paint.warning(if is_wrong { "wrong:" } else { "note:" });
        text += &format!("{word} {}\n", diagnostic.with_remedy());
    }
    if args.quiet {
        return text;
    }
    if has_input {
        text += &format!("input        {} messages compared\n", found.copied);
    }
    text += &format!("repeated     {} messages made again and compared\n", found.repeated);
    let verdict = match (found.has_failed(), found.is_complete()) {
        (true, _) => paint.warning("not what it must be"),
        (false, false) => paint.warning("nothing wrong found; corrected frames not compared"),
        (false, true) => paint.good("as it must be"),
    };
    text + &format!("verified     {}: {verdict}\n", args.output.display())
}
