//! A data set for archives: the corrected stills, lists of them for other programs, and an iFDO
//! record (image FAIR digital object) of the whole. Stills that are files in the log keep their
//! bytes, but for the EXIF that is added.
//!
//! What no log contains (creator, licence, project) comes from a file of facts; a record that lacks
//! what iFDO requires is not written. The lists are written last: a folder without `images.csv` is
//! incomplete.
//!
//! The files depend on each other in this order: `facts`, `still`, `poses`, `exposures`, `ifdo`,
//! `tables`, `colmap`, `masks`.

mod colmap;
mod exposures;
mod facts;
mod ifdo;
mod masks;
mod poses;
mod still;
mod tables;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use super::dive::{CameraLog, CorrectedLog, FrameRecord, Images};
use super::messages::messages_by_id;
use super::places::{Places, depth_at, fix_at};
use super::write_whole;
use crate::error::{Error, Result};
use crate::image::exif;
use crate::recording::{Damage, FrameId, Window};
use crate::session::{Progress, Step, sha256};
use exposures::Exposures;
pub use facts::{Facts, Named};
use ifdo::Record;
use poses::{CameraPoses, camera_poses};
use still::{Still, file_name, file_of, utc, uuid};

/// What an archive knows beyond the log.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Archive {
    /// fields of the iFDO header
    pub facts: Facts,
    /// where the files will be found: `PREFIX/UUID`
    pub handle_prefix: Option<String>,
    /// whether a data set without an iFDO record is an error
    pub must_have_record: bool,
}

/// What was written.
pub struct DataSet {
    /// stills
    pub stills: usize,
    /// required fields of iFDO that neither log nor facts give: there is no record then
    pub missing: Vec<&'static str>,
    /// what the poses of the stills are from; empty without a trajectory
    pub poses_from: String,
}

/// Writes the corrected frames of a camera into `folder`.
///
/// # Errors
/// The folder cannot be written, an image cannot be read, no frame was corrected, or the record
/// lacks required fields where it must be there.
pub fn export(
    log: &CorrectedLog,
    camera: &CameraLog,
    archive: &Archive,
    folder: &Path,
    progress: &dyn Progress,
) -> Result<DataSet> {
    let records = log.records(camera, Images::Corrected);
    if camera.corrected().next().is_none() {
        let reason = "no frame of it was corrected; see its report";
        return Err(log.bad("nothing to export", reason.into()));
    }
    ensure_complete(log, camera, &records)?;
    let places = Places::read(&log.scanned.recording, log.window)?;
    let poses = camera_poses(log, camera, &places);
    let known = Known { places, poses, exposures: Exposures::of(log, camera) };
    let sensor = camera.fact("camera_topic").trim_matches('/').split('/').next();
    let source = camera.source();
    let record = Record {
        camera,
        name: log.scanned.recording.name().trim_end_matches(".mcap").into(),
        source: match (source.is_whole(), source.index_sha256.is_empty()) {
            (true, _) => source.sha256,
            (false, false) => source.index_sha256,
            (false, true) => log.scanned.recording.sha256()?.into(),
        },
        sensor: sensor.unwrap_or_default(),
        facts: &archive.facts,
        handle_prefix: archive.handle_prefix.as_deref(),
        poses: known.poses.as_ref(),
    };
    // What is missing is known before a file is written.
    let frames = records.values().filter_map(|index| Some((*index, camera.frames.get(*index)?)));
    let expected: Vec<Still<'_>> = frames.map(|frame| known.still(frame)).collect();
    let missing = record.missing(&record.header(&expected));
    if archive.must_have_record && !missing.is_empty() {
        return Err(Error::Usage(format!(
            "the iFDO record lacks what iFDO requires and neither log nor facts give: {}; add them \
             to the file of --facts, and give --handle-prefix for image-handle",
            missing.join(", ")
        )));
    }
    remove_lists(folder)?;
    let stills = write_stills(&record, log, &known, folder, progress)?;
    write_lists(&record, &stills, folder)?;
    masks::write(log, camera, &stills, folder)?;
    if missing.is_empty() {
        let document = record.document(record.header(&stills), &stills);
        let text = serde_json::to_string_pretty(&document).map(|text| text + "\n");
        write_json(&folder.join("ifdo.json"), text)?;
    }
    write_whole(&folder.join("images.csv"), tables::biigle(&stills).as_bytes())?;
    let poses_from = record.poses.map(|poses| poses.source.clone()).unwrap_or_default();
    Ok(DataSet { stills: stills.len(), missing, poses_from })
}

/// What the log knows of its stills.
struct Known {
    places: Places,
    poses: Option<CameraPoses>,
    exposures: Option<Exposures>,
}

impl Known {
    /// A still without its file.
    fn still<'l>(&self, (index, record): (usize, &'l FrameRecord)) -> Still<'l> {
        let Self { places, poses, exposures } = self;
        let fixes = places.best_fixes().map(|(_, fixes)| fixes.as_slice()).unwrap_or_default();
        Still {
            name: String::new(),
            record,
            index,
            fix: fix_at(fixes, record.stamp),
            depth_m: depth_at(places.best_depths(), record.stamp),
            exposure_s: exposures.as_ref().and_then(|exposures| exposures.at(record.stamp)),
            pose: poses.as_ref().and_then(|poses| poses.poses.get(&index).copied()),
            hash: String::new(),
            uuid: String::new(),
        }
    }
}

/// Writes the stills, in the order of the log.
fn write_stills<'l>(
    record: &Record<'l>,
    log: &CorrectedLog,
    known: &Known,
    folder: &Path,
    progress: &dyn Progress,
) -> Result<Vec<Still<'l>>> {
    let camera = record.camera;
    let records = log.records(camera, Images::Corrected);
    let stills_folder = folder.join("images");
    std::fs::create_dir_all(&stills_folder)
        .map_err(|source| Error::Write { path: stills_folder.clone(), source })?;
    progress.begin(Step::Correct, records.len());
    let (mut stills, mut names) = (Vec::new(), BTreeSet::new());
    let ids = records.keys().copied().collect();
    for message in messages_by_id(&log.scanned.recording, &ids) {
        let message = message?;
        let Some(index) = records.get(&message.id) else { continue };
        let Some(frame) = camera.frames.get(*index) else { continue };
        let (bytes, ending) =
            file_of(log, &message).map_err(|e| log.bad("a corrected image", e))?;
        let mut still = known.still((*index, frame));
        still.name = file_name(record.sensor, frame, ending, &mut names);
        still.uuid = uuid(&format!("{} {}", camera.fact("camera_topic"), sha256(&bytes)));
        let bytes =
            exif::with_facts(bytes, &still.exif()).map_err(|e| log.bad("a corrected image", e))?;
        still.hash = sha256(&bytes);
        write_whole(&stills_folder.join(&still.name), &bytes)?;
        stills.push(still);
        progress.advance(1);
    }
    progress.end();
    Ok(stills)
}

/// Lists that an export may or may not have: those of an earlier one in the same folder would stay.
const LISTS: [&str; 9] = [
    "ifdo.json",
    "images.csv",
    "squidle.csv",
    "reference.csv",
    "geo.txt",
    "track.geojson",
    "colmap/cameras.txt",
    "colmap/images.txt",
    "colmap/points3D.txt",
];

fn remove_lists(folder: &Path) -> Result<()> {
    let done = |removed: std::io::Result<()>, path: PathBuf| match removed {
        Err(source) if source.kind() != std::io::ErrorKind::NotFound => {
            Err(Error::Write { path, source })
        }
        _ => Ok(()),
    };
    for path in LISTS.map(|name| folder.join(name)) {
        done(std::fs::remove_file(&path), path)?;
    }
    let masks = folder.join(masks::FOLDER);
    done(std::fs::remove_dir_all(&masks), masks)
}

/// Writes model, report and the lists for other programs.
fn write_lists(record: &Record<'_>, stills: &[Still<'_>], folder: &Path) -> Result<()> {
    let camera = record.camera;
    write_json(&folder.join("model.json"), camera.model.to_json())?;
    write_json(&folder.join("report.json"), camera.report.to_json())?;
    let mut texts = vec![("squidle.csv", tables::squidle(stills))];
    texts.extend(tables::metashape(stills).map(|text| ("reference.csv", text)));
    texts.extend(tables::open_drone_map(stills).map(|text| ("geo.txt", text)));
    texts.extend(tables::track(stills).map(|track| ("track.geojson", track.to_string() + "\n")));
    for (name, text) in texts {
        write_whole(&folder.join(name), text.as_bytes())?;
    }
    let colmap = record.poses.and_then(|poses| colmap::model(poses, stills));
    if let Some(files) = colmap {
        let sparse = folder.join("colmap");
        std::fs::create_dir_all(&sparse)
            .map_err(|source| Error::Write { path: sparse.clone(), source })?;
        for (name, text) in files {
            write_whole(&sparse.join(name), text.as_bytes())?;
        }
    }
    Ok(())
}

/// Every frame that was corrected must have its image: an export with gaps looks complete.
fn ensure_complete(
    log: &CorrectedLog,
    camera: &CameraLog,
    records: &BTreeMap<FrameId, usize>,
) -> Result<()> {
    let found: BTreeSet<usize> = records.values().copied().collect();
    let without_image: Vec<&FrameRecord> =
        camera.corrected().filter(|(i, _)| !found.contains(i)).map(|(_, f)| f).collect();
    let recorded = found.len() + without_image.len();
    // Damage takes records as well as images. The report has the number of all.
    let is_whole = log.window == Window::ALL;
    let expected = if is_whole { camera.report.corrected.max(recorded) } else { recorded };
    let may_hit = |d: &&Damage| d.end_ns == 0 || log.window.overlaps((d.start_ns, d.end_ns));
    let damage = log.scanned.index.damage.iter().find(may_hit);
    let missing = match (expected - found.len(), damage) {
        (0, Some(_)) if !is_whole => "an unknown number".to_string(),
        (0, _) => return Ok(()),
        (missing, _) => missing.to_string(),
    };
    let first = without_image.first();
    let first = first.map_or_else(String::new, |f| format!(", the first of {} UTC", utc(f.stamp)));
    let cause = damage.map_or_else(String::new, |d| format!("; the log is damaged: {}", d.reason));
    let topic = camera.topic(Images::Corrected);
    let reason = format!(
        "{missing} of {expected} on {topic}{first}{cause}; use an undamaged copy, or export \
         the segments around them with -S and -E"
    );
    Err(log.bad("corrected images are missing", reason))
}

fn write_json(path: &Path, text: serde_json::Result<String>) -> Result<()> {
    let failed =
        |e: serde_json::Error| Error::WriteRecord { path: path.into(), reason: e.to_string() };
    write_whole(path, text.map_err(failed)?.as_bytes())
}
