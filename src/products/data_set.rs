//! A data set for archives: the corrected stills, a table of them with the columns of BIIGLE, and
//! an iFDO record (image FAIR digital object, version 2.1) of the whole. Stills that are files in
//! the log are copied byte for byte.
//!
//! What no log contains (creator, licence, project) is left out unless a file of facts supplies it.
//! The lists are written last: a folder without `ifdo.json` is incomplete.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::Path;
use std::time::{Duration, UNIX_EPOCH};

use serde_json::{Map, Value as Json, json};

use super::dive::{CameraLog, CorrectedLog, FrameRecord, Images};
use super::messages::messages_by_id;
use super::places::{Fix, Places, fix_at};
use super::write_whole;
use crate::error::{Error, Result};
use crate::image::{EncodedImage, ImageShape, encode};
use crate::messages::Kind;
use crate::recording::{Damage, FrameId, Message, Window};
use crate::session::{Progress, Step, sha256};
use crate::units::Stamp;

/// Fields of the header that iFDO requires.
const REQUIRED: &[&str] = &[
    "image-set-name",
    "image-set-uuid",
    "image-set-handle",
    "image-set-ifdo-version",
    "image-datetime",
    "image-latitude",
    "image-longitude",
    "image-altitude-meters",
    "image-coordinate-reference-system",
    "image-coordinate-uncertainty-meters",
    "image-context",
    "image-project",
    "image-event",
    "image-platform",
    "image-sensor",
    "image-pi",
    "image-creators",
    "image-license",
    "image-copyright",
    "image-abstract",
];

/// What was written.
pub struct DataSet {
    /// stills
    pub stills: usize,
    /// required fields of the iFDO header that neither log nor facts give
    pub missing: Vec<&'static str>,
}

/// A still before it is written.
struct Still<'l> {
    name: String,
    record: &'l FrameRecord,
    fix: Option<Fix>,
    hash: String,
}

/// Writes the corrected frames of a camera into `folder`; `facts` are fields of the iFDO header.
///
/// # Errors
/// The folder cannot be written, an image cannot be read, or no frame was corrected.
pub fn export(
    log: &CorrectedLog,
    camera: &CameraLog,
    facts: &Map<String, Json>,
    folder: &Path,
    progress: &dyn Progress,
) -> Result<DataSet> {
    let records = log.records(camera, Images::Corrected);
    if camera.corrected().next().is_none() {
        let reason = "no frame of it was corrected; see its report";
        return Err(bad(log, "nothing to export", reason.into()));
    }
    ensure_complete(log, camera, &records)?;
    let stills_folder = folder.join("images");
    std::fs::create_dir_all(&stills_folder)
        .map_err(|source| Error::Write { path: stills_folder.clone(), source })?;
    let places = Places::read(&log.scanned.recording, log.window)?;
    let fixes = places.best_fixes().map(|(_, fixes)| fixes.as_slice()).unwrap_or_default();
    let sensor = camera
        .fact("camera_topic")
        .trim_matches('/')
        .split('/')
        .next()
        .unwrap_or_default()
        .to_string();

    progress.begin(Step::Correct, records.len());
    let (mut stills, mut names) = (Vec::new(), BTreeSet::new());
    let ids = records.keys().copied().collect();
    for message in messages_by_id(&log.scanned.recording, &ids) {
        let message = message?;
        let Some(record) = records.get(&message.id).and_then(|i| camera.frames.get(*i)) else {
            continue;
        };
        let (bytes, ending) = still(log, &message).map_err(|e| bad(log, "a corrected image", e))?;
        let name = file_name(&sensor, record, ending, &mut names);
        write_whole(&stills_folder.join(&name), &bytes)?;
        stills.push(Still { name, record, fix: fix_at(fixes, record.stamp), hash: sha256(&bytes) });
        progress.advance(1);
    }
    progress.end();
    let header = header(log, camera, facts, &stills, &sensor)?;
    let missing = REQUIRED.iter().filter(|key| !header.contains_key(**key)).copied().collect();
    let items: Map<String, Json> =
        stills.iter().map(|still| (still.name.clone(), item(camera, still))).collect();
    let ifdo = json!({ "image-set-header": header, "image-set-items": items });
    write_json(&folder.join("model.json"), camera.model.to_json())?;
    write_json(&folder.join("report.json"), camera.report.to_json())?;
    write_whole(&folder.join("images.csv"), table(&stills).as_bytes())?;
    write_json(&folder.join("ifdo.json"), serde_json::to_string_pretty(&ifdo).map(|t| t + "\n"))?;
    Ok(DataSet { stills: stills.len(), missing })
}

fn bad(log: &CorrectedLog, what: &'static str, reason: String) -> Error {
    Error::BadFile { path: log.scanned.recording.path().into(), what, reason }
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
    Err(bad(log, "corrected images are missing", reason))
}

/// An unused file name for a frame.
fn file_name(
    sensor: &str,
    record: &FrameRecord,
    ending: &str,
    names: &mut BTreeSet<String>,
) -> String {
    let taken = utc(record.stamp).replace(['-', ':'], "").replace(' ', "_");
    // Two in one millisecond are distinguished by their nanoseconds, two of one stamp by a number.
    let plain = format!("{sensor}_{taken}.{ending}");
    let precise = format!("{sensor}_{taken}_{}.{ending}", record.stamp.0);
    let numbered = |n: usize| format!("{sensor}_{taken}_{}_{n}.{ending}", record.stamp.0);
    let mut candidates = [plain, precise].into_iter().chain((2..).map(numbered));
    candidates.find(|name| names.insert(name.clone())).unwrap_or_default()
}

fn write_json(path: &Path, text: serde_json::Result<String>) -> Result<()> {
    let failed =
        |e: serde_json::Error| Error::WriteRecord { path: path.into(), reason: e.to_string() };
    write_whole(path, text.map_err(failed)?.as_bytes())
}

/// An image as a file, and the ending of its name.
fn still(
    log: &CorrectedLog,
    message: &Message,
) -> std::result::Result<(Vec<u8>, &'static str), String> {
    let decoder =
        log.scanned.index.decoders.get(&message.channel).ok_or("its type is not known")?;
    let value = decoder.read(message.data())?;
    let Kind::Image(read) = decoder.message_type.kind else {
        return Err("its channel holds no images".into());
    };
    match read(&value)? {
        EncodedImage::Compressed { data, .. } if data.starts_with(b"\xff\xd8") => {
            Ok((data.to_vec(), "jpg"))
        }
        EncodedImage::Compressed { data, .. } if data.starts_with(b"\x89PNG") => {
            Ok((data.to_vec(), "png"))
        }
        EncodedImage::Raw { width, height, encoding, big_endian, step, data } => {
            let (bands, bits) = match encoding {
                "mono8" => (1, 8),
                "rgb8" => (3, 8),
                "mono16" => (1, 16),
                "rgb16" => (3, 16),
                other => {
                    return Err(format!("images of encoding {other} are not written as files"));
                }
            };
            let row = width * bands * usize::from(bits) / 8;
            let rows = data
                .chunks(step.max(1))
                .take(height)
                .map(|r| r.get(..row).ok_or("it is shorter than its header states"));
            let mut samples = rows.collect::<std::result::Result<Vec<_>, _>>()?.concat();
            if bits == 16 && big_endian != cfg!(target_endian = "big") {
                samples.chunks_exact_mut(2).for_each(|pair| pair.swap(0, 1));
            }
            Ok((encode::png(&samples, ImageShape { width, height, bands }, bits)?, "png"))
        }
        _ => Err("it is neither JPEG, PNG nor pixels".into()),
    }
}

/// `2026-05-01 10:00:00.123`, as iFDO writes moments.
fn utc(stamp: Stamp) -> String {
    let at = UNIX_EPOCH + Duration::from_nanos(u64::try_from(stamp.0).unwrap_or(0));
    humantime::format_rfc3339_millis(at).to_string().replace('T', " ").trim_end_matches('Z').into()
}

/// The same input gives the same name for a thing: a UUID of version 8 from a fingerprint.
fn uuid(of: &str) -> String {
    let mut hex: Vec<char> = sha256(of.as_bytes()).chars().take(32).collect();
    (hex[12], hex[16]) = ('8', 'a');
    [0..8, 8..12, 12..16, 16..20, 20..32].map(|part| hex[part].iter().collect::<String>()).join("-")
}

fn header(
    log: &CorrectedLog,
    camera: &CameraLog,
    facts: &Map<String, Json>,
    stills: &[Still<'_>],
    sensor: &str,
) -> Result<Map<String, Json>> {
    let source = camera.fact("source_sha256");
    let source = if source.is_empty() { log.scanned.recording.sha256()? } else { source };
    let model = &camera.model;
    let water = format!(
        "{} attenuation coefficients in 1/m (red, green, blue): {}; {}; see model.json",
        model.attenuation_kind.word(),
        model.attenuation_text(),
        if model.identified {
            "identified from this log"
        } else {
            "not identified: of this dive alone"
        }
    );
    let mut header = Map::new();
    let mut set = |key: &str, value: Json| header.insert(key.into(), value);
    set(
        "image-set-name",
        json!(log.scanned.recording.path().file_stem().map(|s| s.to_string_lossy())),
    );
    set("image-set-uuid", json!(uuid(&format!("{source} {}", camera.fact("camera_topic")))));
    set("image-set-ifdo-version", json!("v2.1.0"));
    set("image-sensor", json!({ "name": sensor }));
    set("image-acquisition", json!("photo"));
    set("image-quality", json!("product"));
    set("image-illumination", json!("artificial light"));
    set(
        "image-photometric-calibration",
        json!({ "photometric-water-properties-description": water }),
    );
    let protocol = format!(
        "unwater {}: method {}, from {}",
        camera.report.version, camera.report.method, camera.report.source
    );
    set("image-curation-protocol", json!(protocol));
    if let Some(first) = stills.first() {
        set("image-datetime", json!(utc(first.record.stamp)));
    }
    if let Some(fix) = stills.iter().find_map(|s| s.fix) {
        set("image-latitude", json!(fix.latitude));
        set("image-longitude", json!(fix.longitude));
        set("image-coordinate-reference-system", json!("EPSG:4326"));
    }
    header.extend(facts.clone());
    Ok(header)
}

fn item(camera: &CameraLog, still: &Still<'_>) -> Json {
    let mut item = json!({
        "image-datetime": utc(still.record.stamp),
        "image-uuid": uuid(&format!("{} {}", camera.fact("camera_topic"), still.hash)),
        "image-hash-sha256": still.hash,
    });
    if still.record.altitude_m.is_finite() {
        item["image-meters-above-ground"] = json!(millimetres(still.record.altitude_m));
    }
    if let Some(fix) = still.fix {
        item["image-latitude"] = json!(fix.latitude);
        item["image-longitude"] = json!(fix.longitude);
    }
    item
}

fn millimetres(metres: f64) -> f64 {
    (metres * 1000.0).round() / 1000.0
}

/// Columns by BIIGLE's names, then our own; what is not known is empty.
fn table(stills: &[Still<'_>]) -> String {
    let mut text = String::from(
        "filename,taken_at,lng,lat,distance_to_ground,stamp_ns,seafloor_support,\
         seafloor_residual_m\n",
    );
    for Still { name, record, fix, .. } in stills {
        let number = |value: f64| {
            if value.is_finite() { millimetres(value).to_string() } else { String::new() }
        };
        let (lng, lat) = fix
            .map_or_else(Default::default, |f| (f.longitude.to_string(), f.latitude.to_string()));
        let (support, residual) = record
            .seafloor
            .as_ref()
            .map_or_else(Default::default, |f| (f.support.clone(), number(f.residual_m)));
        let line = writeln!(
            text,
            "{name},{},{lng},{lat},{},{},{support},{residual}",
            utc(record.stamp),
            number(record.altitude_m),
            record.stamp.0
        );
        debug_assert!(line.is_ok(), "text grows");
    }
    text
}
