//! `config`: every setting with its effective value, unit and reason.

use super::super::args::{EstimateOptions, OutputOptions, RenderOptions, SettingArgs};
use super::super::output::{Outcome, print};
use crate::error::Result;
use crate::run::memory;
use crate::session::Threads;

#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    settings: SettingArgs,
    #[command(flatten)]
    estimate: EstimateOptions,
    #[command(flatten)]
    render: RenderOptions,
    #[command(flatten)]
    output: OutputOptions,
}

pub fn run(args: &Args) -> Result<Outcome> {
    let config = args.settings.config(&[&args.estimate, &args.render, &args.output])?;
    let threads = Threads::new(args.settings.threads.threads).count();
    print(&(config.to_commented_toml() + &memory::table(&config, threads)));
    Ok(Outcome::Done)
}
