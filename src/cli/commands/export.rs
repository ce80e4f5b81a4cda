//! `export`: a data set for archives.

use std::path::{Path, PathBuf};

use super::super::args::{CorrectedLogArgs, OutputArgs, read};
use super::super::output::{Outcome, print, print_written};
use super::super::progress::Bar;
use crate::error::{Error, Result};
use crate::products::data_set;
use crate::products::dive::{CameraLog, CorrectedLog};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// A log that `unwater correct` wrote
    #[arg(value_name = "OUT.mcap")]
    input: PathBuf,
    /// The folder to write into
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Fields of the iFDO header that no log contains (TOML): image-pi, image-license, …
    #[arg(long, value_name = "FACTS.toml")]
    facts: Option<PathBuf>,
    #[command(flatten)]
    log: CorrectedLogArgs,
    #[command(flatten)]
    out: OutputArgs,
}

pub fn run(args: &Args) -> Result<Outcome> {
    let options = args.log.options()?;
    ensure_empty(&args.output, args.out.force)?;
    let facts = args.facts.as_deref().map_or_else(|| Ok(serde_json::Map::new()), read_facts)?;
    let log = CorrectedLog::open(&args.input, &options)?;
    let camera = selected(&log, args.log.camera.as_deref())?;
    let bar = Bar::new(args.out.quiet);
    let written = data_set::export(&log, camera, &facts, &args.output, &bar)?;
    if args.out.quiet {
        return Ok(Outcome::Done);
    }
    if !written.missing.is_empty() {
        let missing = written.missing.join(", ");
        eprintln!("note: ifdo.json lacks what neither log nor --facts contains: {missing}");
    }
    print(&format!("stills       {}\n", written.stills));
    print_written(&args.output);
    Ok(Outcome::Done)
}

fn ensure_empty(folder: &Path, force: bool) -> Result<()> {
    let is_used = std::fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_some());
    if folder.is_file() || (is_used && !force) {
        return Err(Error::OutputExists { path: folder.into() });
    }
    Ok(())
}

fn read_facts(path: &Path) -> Result<serde_json::Map<String, serde_json::Value>> {
    toml::from_str(&read(path)?).map_err(|e| Error::BadFile {
        path: path.into(),
        what: "invalid fact",
        reason: e.to_string().trim().into(),
    })
}

/// The one corrected camera, or the one of the topic given.
fn selected<'l>(log: &'l CorrectedLog, topic: Option<&str>) -> Result<&'l CameraLog> {
    let topic_of = |camera: &CameraLog| camera.fact("camera_topic").to_string();
    let topics: Vec<String> = log.cameras.iter().map(topic_of).collect();
    match (topic, log.cameras.as_slice()) {
        (None, [one]) => Ok(one),
        (None, several) if several.len() > 1 => Err(Error::SeveralCameras { topics }),
        (topic, cameras) => {
            let found = cameras.iter().find(|c| Some(c.fact("camera_topic")) == topic);
            found.ok_or_else(|| Error::NoSuchTopic {
                what: "corrected camera",
                topic: topic.unwrap_or_default().into(),
                seen: topics.join(", "),
            })
        }
    }
}
