//! `correct` of several logs: each has its own output, and one that fails does not stop the rest.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::super::output::{Outcome, print, print_json};
use super::correct_log::{Finished, Run, outcome};
use crate::error::{Error, Result};
use crate::products::dive_table::{Row, as_text};
use crate::recording::{FileIdentity, LogFiles};

/// Corrects the logs one after another, and prints a table of them all. The outcome is the worst
/// of them.
pub fn run(run: &Run<'_>, logs: &[LogFiles], folder: Option<&Path>) -> Result<Outcome> {
    let outputs = outputs(run, logs, folder)?;
    let (mut rows, mut documents, mut worst) = (Vec::new(), Vec::new(), Outcome::Done);
    let is_plain = !run.args.json && !run.args.out.quiet;
    for (number, (log, output)) in (1..).zip(logs.iter().zip(&outputs)) {
        let name = log.path.display().to_string();
        if is_plain {
            print(&format!("\n{name} ({number} of {})\n", logs.len()));
        }
        let (ended, reports, error) = match run.correct(log, output) {
            Ok(Finished { cameras, is_skipped }) => {
                let ended = outcome(&cameras);
                let reports: Vec<Value> = cameras.iter().map(|(report, _)| json!(report)).collect();
                let word = match ended {
                    Outcome::DoneWithLosses => "with losses",
                    _ => "done",
                };
                let word = if is_skipped { format!("{word} before") } else { word.into() };
                rows.extend(Row::of_cameras(&log.stem, &word, cameras));
                (ended, reports, None)
            }
            Err(error) => {
                eprintln!("unwater: {name}: {error}");
                rows.push(Row::without_facts(&log.stem, "failed"));
                (Outcome::CannotCorrect, Vec::new(), Some(error.to_string()))
            }
        };
        worst = worst.max(ended);
        documents.push(json!({
            "log": name,
            "output": error.is_none().then(|| output.display().to_string()),
            "error": error,
            "reports": reports,
        }));
    }
    if run.args.json {
        print_json(serde_json::to_string_pretty(&documents).map(|text| text + "\n"))?;
    } else if is_plain {
        print(&format!("\n{}", as_text(&rows)));
    }
    Ok(worst)
}

/// Where each log is written: beside it, or into the folder, which is created.
fn outputs(run: &Run<'_>, logs: &[LogFiles], folder: Option<&Path>) -> Result<Vec<PathBuf>> {
    let outputs: Vec<PathBuf> = logs
        .iter()
        .map(|log| run.beside(log))
        .map(|beside| match (folder, beside.file_name()) {
            (Some(folder), Some(name)) => folder.join(name),
            _ => beside,
        })
        .collect();
    let mut known = BTreeSet::new();
    if let Some(twice) = outputs.iter().find(|output| !known.insert(output.as_path())) {
        return Err(Error::Usage(format!(
            "two logs would be written to {}; correct logs of one name one by one",
            twice.display()
        )));
    }
    ensure_no_input(logs, &outputs)?;
    if let Some(folder) = folder {
        if folder.extension().is_some_and(|e| e == "mcap") || folder.is_file() {
            return Err(Error::Usage(format!(
                "{} logs need a folder, not {}: give it with -o DIR",
                logs.len(),
                folder.display()
            )));
        }
        std::fs::create_dir_all(folder)
            .map_err(|source| Error::Write { path: folder.into(), source })?;
    }
    Ok(outputs)
}

/// An output may not replace the input of another log.
fn ensure_no_input(logs: &[LogFiles], outputs: &[PathBuf]) -> Result<()> {
    let files = logs.iter().flat_map(|log| log.files().unwrap_or_default());
    let inputs: BTreeMap<FileIdentity, PathBuf> =
        files.filter_map(|file| Some((FileIdentity::of(&file)?, file))).collect();
    for (log, output) in logs.iter().zip(outputs) {
        let input = FileIdentity::of(output).and_then(|identity| inputs.get(&identity));
        if let Some(input) = input {
            return Err(Error::Usage(format!(
                "the output of {}, {}, is the input {}; leave that out, or give another folder \
                 with -o DIR",
                log.path.display(),
                output.display(),
                input.display()
            )));
        }
    }
    Ok(())
}
