//! `export`: a data set for archives.

use std::path::{Path, PathBuf};

use super::super::args::{CorrectedLogArgs, OutputArgs, read};
use super::super::output::{Outcome, print, print_written};
use super::super::progress::Bar;
use crate::error::{Error, Result};
use crate::products::data_set::{self, Archive, Facts};
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
    /// Where the files will be found: image-handle is PREFIX/UUID, with a prefix such as
    /// `https://hdl.handle.net/20.500.12085`
    #[arg(long, value_name = "PREFIX", value_parser = uri)]
    handle_prefix: Option<String>,
    #[command(flatten)]
    log: CorrectedLogArgs,
    #[command(flatten)]
    out: OutputArgs,
}

pub fn run(args: &Args) -> Result<Outcome> {
    let options = args.log.options()?;
    ensure_empty(&args.output, args.out.force)?;
    let facts = args.facts.as_deref().map(read_facts).transpose()?;
    let archive = Archive {
        must_have_record: facts.is_some() || args.handle_prefix.is_some(),
        facts: facts.unwrap_or_default(),
        handle_prefix: args.handle_prefix.clone(),
    };
    let log = CorrectedLog::open(&args.input, &options)?;
    let camera = selected(&log, args.log.camera.as_deref())?;
    let bar = Bar::new(args.out.quiet);
    let written = data_set::export(&log, camera, &archive, &args.output, &bar)?;
    if args.out.quiet {
        return Ok(Outcome::Done);
    }
    if !written.missing.is_empty() {
        let missing = written.missing.join(", ");
        eprintln!(
            "note: no ifdo.json: give --facts and --handle-prefix, as the log does not contain \
             {missing}"
        );
    }
    print(&format!("stills       {}\n", written.stills));
    if !written.poses_from.is_empty() {
        print(&format!("poses        {}\n", written.poses_from));
    }
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

fn read_facts(path: &Path) -> Result<Facts> {
    Facts::from_toml(&read(path)?).map_err(|reason| Error::BadFile {
        path: path.into(),
        what: "invalid fact",
        reason,
    })
}

fn uri(text: &str) -> std::result::Result<String, String> {
    let is_uri = text.split_once(':').is_some_and(|(scheme, rest)| {
        !scheme.is_empty() && !rest.is_empty() && scheme.chars().all(|c| c.is_ascii_alphanumeric())
    });
    let is_plain = !text.chars().any(|c| c.is_whitespace() || "<>\"{}|\\^`".contains(c));
    if is_uri && is_plain { Ok(text.into()) } else { Err("a URI is expected, https://…".into()) }
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
