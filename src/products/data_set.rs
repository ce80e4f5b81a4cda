//! A data set that an archive takes: the corrected stills, a table of them in the words BIIGLE
//! reads, and an iFDO record (image FAIR digital object, version 2.1) of the whole. The stills are
//! the log's own bytes where they are files already.
//!
//! What no log can know (who, under which licence, for which project) is left out unless a file of
//! facts gives it: a made-up word would be worse than none. The lists are written last, so a folder
//! without `ifdo.json` is not finished.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::Path;
use std::time::{Duration, UNIX_EPOCH};

use serde_json::{Map, Value as Json, json};

use super::dive::{CameraLog, CorrectedLog, FrameRecord, messages_of};
use super::places::{Fix, Places, fix_at};
use super::write_whole;
use crate::error::{Error, Result};
use crate::image::{EncodedImage, ImageShape, encode};
use crate::messages::Kind;
use crate::recording::{Message, Window};
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

/// A still on its way.
struct Still<'l> {
    name: String,
    record: &'l FrameRecord,
    fix: Option<Fix>,
    hash: String,
}

/// Writes the corrected frames of a camera into `folder`; `facts` are fields of the iFDO header.
///
/// # Errors
/// The folder cannot be written, a picture cannot be read, or no frame was corrected.
pub fn export(
    log: &CorrectedLog,
    camera: &CameraLog,
    facts: &Map<String, Json>,
    folder: &Path,
    window: Window,
    progress: &dyn Progress,
) -> Result<DataSet> {
    let topic = camera.fact("corrected_topic");
    let channels: BTreeSet<u16> = log
        .recording
        .channels
        .iter()
        .filter(|(_, c)| c.topic == topic)
        .map(|(id, _)| *id)
        .collect();
    let records: BTreeMap<u64, &FrameRecord> =
        camera.corrected().map(|(_, record)| (record.log_time, record)).collect();
    if records.is_empty() {
        let remedy = "no frame of it was corrected; its report says why".into();
        return Err(Error::BadFile {
            path: log.recording.path().into(),
            what: "nothing to export",
            reason: remedy,
        });
    }
    let stills_folder = folder.join("images");
    std::fs::create_dir_all(&stills_folder)
        .map_err(|source| Error::Write { path: stills_folder.clone(), source })?;
    let places = Places::read(&log.recording, window);
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
    for message in messages_of(&log.recording, &channels, window) {
        let Some(record) = records.get(&message.log_time) else { continue };
        let unreadable = |reason: String| Error::BadFile {
            path: log.recording.path().into(),
            what: "a corrected picture",
            reason,
        };
        let (bytes, ending) = still(log, &message).map_err(unreadable)?;
        let taken = utc(record.stamp).replace(['-', ':'], "").replace(' ', "_");
        // Two in one millisecond are told apart by their nanoseconds.
        let plain = format!("{sensor}_{taken}.{ending}");
        let name = if names.contains(&plain) {
            format!("{sensor}_{taken}_{}.{ending}", record.stamp.0)
        } else {
            plain
        };
        names.insert(name.clone());
        write_whole(&stills_folder.join(&name), &bytes)?;
        stills.push(Still { name, record, fix: fix_at(fixes, record.stamp), hash: sha256(&bytes) });
        progress.advance(1);
    }
    progress.end();
    let header = header(log, camera, facts, &stills, &sensor);
    let missing = REQUIRED.iter().filter(|key| !header.contains_key(**key)).copied().collect();
    let items: Map<String, Json> =
        stills.iter().map(|still| (still.name.clone(), item(camera, still))).collect();
    let ifdo = json!({ "image-set-header": header, "image-set-items": items });
    let text = |value: &Json| serde_json::to_string_pretty(value).unwrap_or_default() + "\n";
    write_whole(&folder.join("model.json"), camera.model.to_json().as_bytes())?;
    write_whole(&folder.join("report.json"), camera.report.to_json().as_bytes())?;
    write_whole(&folder.join("images.csv"), table(&stills).as_bytes())?;
    write_whole(&folder.join("ifdo.json"), text(&ifdo).as_bytes())?;
    Ok(DataSet { stills: stills.len(), missing })
}

/// A picture as a file, and its name's ending.
fn still(
    log: &CorrectedLog,
    message: &Message,
) -> std::result::Result<(Vec<u8>, &'static str), String> {
    let decoder = log.scan.decoders.get(&message.channel).ok_or("its type is not known")?;
    let value = decoder.read(message.data())?;
    let Kind::Image(read) = decoder.message_type.kind else {
        return Err("its channel holds no pictures".into());
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
                other => return Err(format!("pictures coded {other} are not written as files")),
            };
            let row = width * bands * usize::from(bits) / 8;
            let rows = data
                .chunks(step.max(1))
                .take(height)
                .map(|r| r.get(..row).ok_or("it is shorter than it says"));
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
) -> Map<String, Json> {
    let source = camera.fact("source_sha256");
    let source =
        if source.is_empty() { log.recording.sha256().unwrap_or_default() } else { source };
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
    set("image-set-name", json!(log.recording.path().file_stem().map(|s| s.to_string_lossy())));
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
    let said = format!(
        "unwater {}: method {}, from {}",
        camera.report.version, camera.report.method, camera.report.source
    );
    set("image-curation-protocol", json!(said));
    if let Some(first) = stills.first() {
        set("image-datetime", json!(utc(first.record.stamp)));
    }
    if let Some(fix) = stills.iter().find_map(|s| s.fix) {
        set("image-latitude", json!(fix.latitude));
        set("image-longitude", json!(fix.longitude));
        set("image-coordinate-reference-system", json!("EPSG:4326"));
    }
    header.extend(facts.clone());
    header
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
            .floor
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
