//! `correct`: one log, or several one after another.

use super::super::output::Outcome;
pub use super::correct_log::Args;
use super::correct_log::Run;
use super::correct_many;
use crate::error::Result;
use crate::recording::LogFiles;

pub fn run(args: &Args) -> Result<Outcome> {
    let run = Run::new(args)?;
    let outcome = match LogFiles::group(&args.inputs)?.as_slice() {
        [log] => run.one(log)?,
        logs => correct_many::run(&run, logs, args.output.as_deref())?,
    };
    Ok(args.losses.outcome(outcome))
}
