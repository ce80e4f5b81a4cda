//! `man`: man pages, one for each command.

use std::path::{Path, PathBuf};

use super::super::output::{Outcome, print};
use crate::error::{Error, Result};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The folder they are written to; created where it does not exist
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Overwrite existing pages
    #[arg(long)]
    force: bool,
}

pub fn run(args: &Args, program: clap::Command) -> Result<Outcome> {
    let failed = |path: &Path| {
        let path = path.to_path_buf();
        move |source| Error::Write { path, source }
    };
    std::fs::create_dir_all(&args.folder).map_err(failed(&args.folder))?;
    let mut program = program.disable_help_subcommand(true);
    program.build();
    let commands = std::iter::once(&program).chain(program.get_subcommands());
    let pages: Vec<(PathBuf, Vec<u8>)> = commands
        .map(|command| {
            // A subcommand is called `unwater correct`, its page unwater-correct(1).
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
    print(&format!("written      {} pages in {}\n", pages.len(), args.folder.display()));
    Ok(Outcome::Done)
}
