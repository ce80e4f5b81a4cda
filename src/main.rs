//! Parses arguments and maps the outcome to an exit status.

use std::process::ExitCode;

use clap::Parser;
use unwater::cli::{Cli, Outcome};
use unwater::error::Error;

fn main() -> ExitCode {
    let cli = Cli::parse(); // exits with 2 on bad usage
    // An interrupted run leaves no unfinished file.
    let handler = ctrlc::set_handler(|| {
        unwater::recording::remove_unfinished();
        std::process::exit(1);
    });
    if let Err(e) = handler {
        eprintln!("warning: an interruption will leave an unfinished file behind ({e})");
    }
    match cli.run() {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::DoneWithLosses) => ExitCode::from(3),
        Ok(Outcome::CannotCorrect) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("unwater: {error}");
            ExitCode::from(if matches!(error, Error::Usage(_)) { 2 } else { 1 })
        }
    }
}
