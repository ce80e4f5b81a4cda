//! The files of a log: one file, a folder as `ros2 bag` writes it, or the parts of a split
//! recording.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};
use crate::recording::identity::FileIdentity;

/// The files of one log, in the order of recording.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LogFiles {
    /// file, folder, or first part: what errors name
    pub path: PathBuf,
    /// name of the whole, without folder and ending
    pub stem: String,
    /// files; a folder is expanded when it is opened
    pub(super) parts: Vec<PathBuf>,
    /// names of parts that are missing
    pub(super) missing: Vec<String>,
}

/// List of the parts in a folder of `ros2 bag`.
const BAG_METADATA: &str = "metadata.yaml";
/// Corrected logs in the folder are no parts of its recording.
const CORRECTED: &str = ".corrected.mcap";

impl From<&Path> for LogFiles {
    fn from(path: &Path) -> Self {
        let name = name_of(path);
        let stem = name.strip_suffix(".mcap").unwrap_or(&name).to_string();
        Self { path: path.into(), stem, parts: vec![path.into()], missing: Vec::new() }
    }
}

impl From<&PathBuf> for LogFiles {
    fn from(path: &PathBuf) -> Self {
        path.as_path().into()
    }
}

impl From<&Self> for LogFiles {
    fn from(files: &Self) -> Self {
        files.clone()
    }
}

impl LogFiles {
    /// Groups paths by log. Files `NAME_0.mcap`, `NAME_1.mcap`, … of one folder, or those that its
    /// `metadata.yaml` lists, are the parts of one; any other path is a log of its own.
    ///
    /// # Errors
    /// A file is given twice, under whatever name.
    pub fn group(paths: &[PathBuf]) -> Result<Vec<Self>> {
        let mut groups: BTreeMap<(PathBuf, String), Vec<(u64, &PathBuf)>> = BTreeMap::new();
        for path in paths.iter().filter(|path| !path.is_dir()) {
            if let Some((stem, number)) = numbered(&name_of(path)) {
                let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
                groups.entry((folder, stem)).or_default().push((number, path));
            }
        }
        groups.values_mut().for_each(|parts| parts.sort());
        groups.retain(|(folder, _), parts| parts.len() > 1 && is_recording(folder, parts));
        let mut logs: Vec<Self> = Vec::new();
        for path in paths {
            let group = groups.iter().find(|(_, parts)| parts.iter().any(|(_, p)| *p == path));
            let log = match group {
                None => path.into(),
                Some(((_, stem), parts)) => Self {
                    path: parts[0].1.clone(),
                    stem: stem.clone(),
                    parts: parts.iter().map(|(_, path)| (*path).clone()).collect(),
                    missing: Vec::new(),
                },
            };
            let is_known = group.is_some() && logs.contains(&log);
            logs.extend((!is_known).then_some(log));
        }
        ensure_distinct(&logs).map(|()| logs)
    }

    /// The files themselves.
    ///
    /// # Errors
    /// A folder cannot be read, or does not hold exactly one recording.
    pub fn files(&self) -> Result<Vec<PathBuf>> {
        Ok(self.expanded()?.parts)
    }

    /// The same with a folder replaced by its files.
    pub(super) fn expanded(&self) -> Result<Self> {
        match self.parts.as_slice() {
            [folder] if folder.is_dir() => {
                let (parts, missing) = parts_of(folder)?;
                Ok(Self { parts, missing, ..self.clone() })
            }
            _ => Ok(self.clone()),
        }
    }

    /// A file beside the log, named after it: `dive.<suffix>`.
    pub fn beside(&self, suffix: &str) -> PathBuf {
        self.path.with_file_name(format!("{}.{suffix}", self.stem))
    }
}

/// Refuses a file that belongs to two logs, or twice to one.
fn ensure_distinct(logs: &[LogFiles]) -> Result<()> {
    let mut known: BTreeMap<FileIdentity, PathBuf> = BTreeMap::new();
    // What cannot be read is an error of its own log.
    for file in logs.iter().flat_map(|log| log.files().unwrap_or_default()) {
        let Some(identity) = FileIdentity::of(&file) else { continue };
        if let Some(before) = known.insert(identity, file.clone()) {
            let (before, file) = (before.display(), file.display());
            let twice = if before.to_string() == file.to_string() {
                format!("{file} is given twice")
            } else {
                format!("{before} and {file} are the same file")
            };
            return Err(Error::Usage(format!("{twice}; give each log once")));
        }
    }
    Ok(())
}

/// File name; also of `.` and of a folder with a slash at its end.
fn name_of(path: &Path) -> String {
    let whole = std::fs::canonicalize(path);
    let name = path.file_name().or_else(|| whole.as_ref().ok()?.file_name());
    name.map(|n| n.to_string_lossy().into_owned()).unwrap_or_default()
}

/// `dive_12.mcap` → `dive`, 12
fn numbered(name: &str) -> Option<(String, u64)> {
    let (stem, number) = name.strip_suffix(".mcap")?.rsplit_once('_')?;
    let is_number = number.bytes().all(|b| b.is_ascii_digit()) && !stem.is_empty();
    Some((stem.into(), number.parse().ok().filter(|_| is_number)?))
}

/// Whether files of one name are parts of one recording: numbered from 0 on, or listed.
fn is_recording(folder: &Path, parts: &[(u64, &PathBuf)]) -> bool {
    let listed = listed(folder);
    (0..).zip(parts).all(|(n, (number, _))| n == *number)
        || parts.iter().all(|(_, path)| listed.contains(&name_of(path)))
}

/// The parts that the folder's `metadata.yaml` lists.
fn listed(folder: &Path) -> Vec<String> {
    let text = std::fs::read_to_string(folder.join(BAG_METADATA)).unwrap_or_default();
    let mut lines = text.lines().map(str::trim);
    let first = lines.find_map(|line| line.strip_prefix("relative_file_paths:"));
    let inline = first.unwrap_or_default().trim().trim_matches(['[', ']']).split(',');
    let inline = inline.filter(|_| first.is_some_and(|f| f.contains('[')));
    let below = lines.map_while(|line| line.strip_prefix("- "));
    let name = |entry: &str| name_of(Path::new(entry.trim().trim_matches(['"', '\''])));
    inline.chain(below).map(name).filter(|name| !name.is_empty()).collect()
}

/// The parts of the one recording in a folder, and the names of those that are missing.
fn parts_of(folder: &Path) -> Result<(Vec<PathBuf>, Vec<String>)> {
    let read = |source| Error::Read { path: folder.into(), source };
    let entries = std::fs::read_dir(folder).map_err(read)?;
    let mut names: Vec<String> =
        entries.flatten().map(|e| e.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    let is_log = |n: &&String| n.ends_with(".mcap") && !n.ends_with(CORRECTED) && !is_hidden(n);
    let logs: Vec<&String> = names.iter().filter(is_log).collect();
    let listed = listed(folder);
    let series = series(&logs);
    let (parts, missing) = if listed.iter().any(|name| logs.contains(&name)) {
        // A recorder that was killed has not listed its last parts.
        let stems: Vec<&String> = series
            .iter()
            .filter(|(_, parts)| parts.values().any(|n| listed.contains(n)))
            .map(|(stem, _)| stem)
            .collect();
        let is_unlisted = |n: &&&String| {
            !listed.contains(n) && numbered(n).is_some_and(|(stem, _)| stems.contains(&&stem))
        };
        let present = listed.iter().filter(|name| logs.contains(name));
        let later = logs.iter().filter(is_unlisted).copied();
        let parts = present.chain(later).cloned().collect();
        let is_missing = |name: &&String| !logs.contains(name);
        (parts, listed.iter().filter(is_missing).cloned().collect())
    } else {
        match (logs.as_slice(), series.first_key_value()) {
            ([one], _) => (vec![(*one).clone()], Vec::new()),
            (several, Some((stem, parts))) if parts.len() == several.len() => {
                let numbers = parts.keys().min().copied().unwrap_or_default()..;
                let last = parts.keys().max().copied().unwrap_or_default();
                let gaps = numbers.take_while(|n| *n <= last).filter(|n| !parts.contains_key(n));
                let gaps = gaps.take(MAX_GAPS).map(|n| format!("{stem}_{n}.mcap")).collect();
                (parts.values().cloned().collect(), gaps)
            }
            (logs, _) => return Err(not_one_recording(folder, logs, &names)),
        }
    };
    let path = |name: &String| folder.join(name);
    Ok((parts.iter().map(path).collect(), missing))
}

/// Gaps in the numbers that are listed at most.
const MAX_GAPS: usize = 20;

fn is_hidden(name: &str) -> bool {
    name.starts_with('.')
}

/// Numbered files by name and number.
fn series(logs: &[&String]) -> BTreeMap<String, BTreeMap<u64, String>> {
    let mut series: BTreeMap<String, BTreeMap<u64, String>> = BTreeMap::new();
    for name in logs {
        if let Some((stem, number)) = numbered(name) {
            series.entry(stem).or_default().insert(number, (*name).clone());
        }
    }
    series
}

fn not_one_recording(folder: &Path, logs: &[&String], names: &[String]) -> Error {
    let has = |ending: &str| names.iter().any(|n| n.ends_with(ending));
    let reason = match logs {
        [] if has(".mcap.zstd") || has(".mcap.zst") => {
            "its files are compressed as a whole; decompress them first: `zstd -d *.mcap.zstd`"
        }
        [] if has(".db3") => "it is a ROS 2 SQLite bag; convert it first: `ros2 bag convert`",
        [] => "it holds no .mcap file",
        _ => {
            "it holds several logs that are not the parts NAME_0.mcap, NAME_1.mcap, … of one \
             recording; name the logs instead of the folder"
        }
    };
    Error::BadFile { path: folder.into(), what: "no recording", reason: reason.into() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_told_from_dives_by_their_names() {
        let paths =
            ["a/x_1.mcap", "b/x_0.mcap", "a/x_0.mcap", "a/y_1.mcap", "a/y_2.mcap", "z.mcap"]
                .map(PathBuf::from);
        let logs = LogFiles::group(&paths).expect("distinct files");
        let found: Vec<(&str, usize)> =
            logs.iter().map(|log| (log.stem.as_str(), log.parts.len())).collect();
        assert_eq!(found, [("x", 2), ("x_0", 1), ("y_1", 1), ("y_2", 1), ("z", 1)]);
        assert_eq!(logs[0].parts[0], Path::new("a/x_0.mcap"));
        assert_eq!(logs[0].beside("corrected.mcap"), Path::new("a/x.corrected.mcap"));
    }

    #[test]
    fn a_list_of_parts_is_read_in_both_styles() {
        let folder = tempfile::tempdir().expect("a folder");
        let list =
            "  relative_file_paths:\n    - bag/x_0.mcap\n    - \"x_1.mcap\"\n  duration: 3\n";
        for text in [list, "a: 1\nrelative_file_paths: [x_0.mcap, 'x_1.mcap']\n- other\n"] {
            std::fs::write(folder.path().join(BAG_METADATA), text).expect("written");
            let names = listed(folder.path());
            assert!(names.starts_with(&["x_0.mcap".into(), "x_1.mcap".into()]), "{names:?}");
        }
    }
}
