//! `completions`: a completion script for a shell.

use super::super::output::{Outcome, print};
use crate::error::Result;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The shell
    #[arg(value_enum)]
    shell: clap_complete::Shell,
}

pub fn run(args: &Args, mut program: clap::Command) -> Result<Outcome> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut program, "unwater", &mut script);
    print(&String::from_utf8_lossy(&script));
    Ok(Outcome::Done)
}
