//! `completions` and `man`: what a shell and a reader want to know of the commands, from the same
//! words as `--help`.

use std::path::PathBuf;

use clap::{Args, CommandFactory};

use super::commands::say;
use super::{Cli, Ended};
use crate::error::{Error, Result};

/// `completions`
#[derive(Debug, Args)]
pub struct CompletionsArgs {
    /// The shell
    #[arg(value_enum)]
    pub shell: clap_complete::Shell,
}

/// `man`
#[derive(Debug, Args)]
pub struct ManArgs {
    /// The folder they go to; it is made where it is not there
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    /// Overwrite pages that are there
    #[arg(long)]
    pub force: bool,
}

pub fn completions(args: &CompletionsArgs) -> Result<Ended> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "unwater", &mut script);
    say(&String::from_utf8_lossy(&script));
    Ok(Ended::Done)
}

pub fn man(args: &ManArgs) -> Result<Ended> {
    let failed = |path: &PathBuf| {
        let path = path.clone();
        move |source| Error::Write { path, source }
    };
    std::fs::create_dir_all(&args.folder).map_err(failed(&args.folder))?;
    let mut program = Cli::command().disable_help_subcommand(true);
    program.build();
    let commands = std::iter::once(&program).chain(program.get_subcommands());
    let pages: Vec<(PathBuf, Vec<u8>)> = commands
        .map(|command| {
            // A sub-command is called `unwater correct`, its page unwater-correct(1).
            let name = command.get_display_name().unwrap_or("unwater").to_string();
            let page = clap_mangen::Man::new(command.clone())
                .title(name.to_uppercase())
                .source(concat!("unwater ", env!("CARGO_PKG_VERSION")))
                .manual("unwater");
            let mut text = Vec::new();
            page.render(&mut text).map_err(failed(&args.folder))?;
            Ok((args.folder.join(format!("{name}.1")), text))
        })
        .collect::<Result<_>>()?;
    if let Some((path, _)) = pages.iter().find(|(path, _)| path.exists() && !args.force) {
        return Err(Error::OutputExists { path: path.clone() });
    }
    for (path, text) in &pages {
        std::fs::write(path, text).map_err(failed(path))?;
    }
    say(&format!("written      {} pages in {}\n", pages.len(), args.folder.display()));
    Ok(Ended::Done)
}
