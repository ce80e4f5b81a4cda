//! Runs on dives that are too large or not free to be in the tree: named by the variable `UNWATER_DATA`. Without it
//! they are reported as ignored, never as passed.
#![allow(clippy::unwrap_used)]

mod support;

use std::path::{Path, PathBuf};

use libtest_mimic::{Arguments, Failed, Trial};
use unwater::config::{Config, SeafloorConfig};
use unwater::geometry::Pings;
use unwater::messages::{Decoder, Kind};
use unwater::model::ModelFile;
use unwater::pipeline::{Options, Silent, correct};
use unwater::recording::{Entry, Recording, Window};
use unwater::report::Report;
use unwater::spaces::Transform;
use unwater::vehicle::{AttitudeTrack, Camera, DvlFacts, Ping, Rig, StrobeMount};

fn run(input: &Path, options: &Options) -> Result<(tempfile::TempDir, PathBuf, Report, ModelFile), Failed> {
    let folder = tempfile::tempdir()?;
    let out = folder.path().join("out.mcap");
    let (report, model) = correct(input, &out, None, options, &Silent)?;
    Ok((folder, out, report, model))
}

fn ensure(holds: bool, sentence: impl Into<String>) -> Result<(), Failed> {
    if holds { Ok(()) } else { Err(Failed::from(sentence.into())) }
}

fn rendered_a(data: &Path) -> Result<(), Failed> {
    let (_folder, _, report, model) = run(&data.join("rendered/A/A_clear_flat_raw16.mcap"), &Options::default())?;
    ensure(report.corrected == 48, format!("{} of 48 corrected", report.corrected))?;
    let a = &model.attenuation_per_m;
    for (is, ought) in a.iter().zip([0.45, 0.14, 0.10]) {
        ensure((is - ought).abs() < 0.01, format!("attenuation {a:?}"))?;
    }
    ensure((a[0] - a[1] - 0.31).abs() < 0.005 && (a[1] - a[2] - 0.04).abs() < 0.005, format!("differences of {a:?}"))
}

fn finishes(data: &Path, log: &str, frames: usize) -> Result<(), Failed> {
    let (_folder, out, report, model) = run(&data.join(log), &Options::default())?;
    ensure(report.frames == frames && report.corrected + report.uncorrected.values().sum::<usize>() == frames, format!("{report:?}"))?;
    let physical = model.attenuation_per_m.iter().all(|a| *a > 0.0);
    ensure(physical || !model.identified, "an attenuation below 0 is not to be called identified")?;
    let recording = Recording::open(&out)?;
    ensure(recording.is_complete, "the output is whole")
}

/// Every file of the corpus opens without a panic, and what is read is what a second reader counts.
fn corpus(data: &Path) -> Result<(), Failed> {
    let page = std::fs::read_to_string(data.join("mcap_corpus/SOURCE.md"))?;
    let mut checked = 0;
    for line in page.lines().filter(|l| l.contains(".mcap |")) {
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        let path = data.join("mcap_corpus").join(cells[1]);
        let counted: Option<u64> = cells[6].parse().ok();
        let recording = Recording::open(&path).map_err(|e| Failed::from(format!("{}: {e}", cells[1])))?;
        let messages = recording.messages(Window::ALL).filter(|e| matches!(e, Entry::Message(_))).count() as u64;
        if let Some(counted) = counted {
            ensure(messages == counted && recording.is_complete, format!("{}: {messages} messages, not {counted}", cells[1]))?;
        }
        checked += 1;
    }
    ensure(checked >= 25, format!("{checked} files"))
}

/// One ping of a schemaless JSON message, as its channel would be read.
fn ping(topic: &str, line: &str) -> Result<Option<Ping>, Failed> {
    let decoder = Decoder::for_json(topic, line.as_bytes())?.ok_or("nothing that is read")?;
    let Kind::Ping(_, read) = decoder.message_type.kind else { return Err("no ranges".into()) };
    Ok(read(&decoder.read(line.as_bytes())?, &DvlFacts::default())?.ping)
}

/// The plane of one ping alone, its distance along the instrument's axis and along its own normal [m].
fn plane(ping: Ping) -> Option<(f64, f64)> {
    let rig = Rig {
        camera: Camera::from_field_of_view(640, 480, 60.0),
        body_from_optical: Transform::identity(),
        body_from_dvl: Transform::identity(),
        strobe: StrobeMount { body_from_strobe: Transform::identity(), source: None },
    };
    let stamp = ping.stamp;
    let config = Config { seafloor: SeafloorConfig { least_altitude_m: 0.0, ..SeafloorConfig::default() }, ..Config::default() };
    let plane = Pings::new(vec![ping], AttitudeTrack::default()).seafloor(stamp, &rig, &config.seafloor).ok()?;
    Some((plane.distance_m / plane.normal.vector().z, plane.distance_m))
}

/// Median and 95 % of |a / b − 1|.
fn deviations(pairs: &[(f64, f64)]) -> (f64, f64) {
    let mut off: Vec<f64> = pairs.iter().map(|(a, b)| (a / b - 1.0).abs()).collect();
    off.sort_by(f64::total_cmp);
    (off[off.len() / 2], off[off.len() * 95 / 100])
}

/// A Water Linked A50's own stream: planes agree with its altitude, and every lost beam is one.
fn a50(data: &Path) -> Result<(), Failed> {
    let (mut pairs, mut lost) = (Vec::new(), 0);
    for file in ["out20210528.txt", "out20210528_circle.txt", "out20210528_straight+turn360.txt", "out.txt"] {
        let text = std::fs::read_to_string(data.join("dvl/dvl_waterlinked_a50").join(file))?;
        for line in text.lines().filter(|l| l.contains("transducers")) {
            let report: serde_json::Value = serde_json::from_str(line)?;
            let said = report["transducers"].as_array().ok_or("no transducers")?;
            let valid = |t: &serde_json::Value| t["beam_valid"] == true && t["distance"].as_f64().is_some_and(|d| d > 0.0);
            let ping = ping("/dvl", line)?.ok_or("no ping")?;
            for (beam, said) in ping.beams.iter().zip(said) {
                ensure(beam.range.is_some() == valid(said), format!("{file}: a beam {said} is read as {beam:?}"))?;
                lost += usize::from(beam.range.is_none());
            }
            let altitude = report["altitude"].as_f64().filter(|a| *a > 0.5 && report["velocity_valid"] == true && said.iter().all(valid));
            pairs.extend(altitude.and_then(|a| Some((plane(ping)?.0, a))));
        }
    }
    let (median, most) = deviations(&pairs);
    println!("A50: {} pings, median {:.2} %, 95 % within {:.2} %, {lost} beams lost", pairs.len(), 100.0 * median, 100.0 * most);
    ensure(pairs.len() > 1000 && lost > 1000 && median < 0.01 && most < 0.02, format!("{} pings: {median}, {most}", pairs.len()))
}

/// A Teledyne's vertical ranges as `RdiPD0`, against the altitude that the vehicle logged beside them.
fn pd0(data: &Path) -> Result<(), Failed> {
    let bytes = std::fs::read(data.join("dvl/dvl_pd0/remus_vehicle_log_subset_reduced.csv"))?;
    let mut pairs = Vec::new();
    for line in String::from_utf8_lossy(&bytes).lines().filter(|l| l.starts_with("1141,")) {
        let cells: Vec<f64> = line.split(',').map(|c| c.parse().unwrap_or(f64::NAN)).collect();
        let message = serde_json::json!({ "range": cells[10..14], "config_beamangle": 30.0, "altitude": cells[9] }).to_string();
        let ping = ping("/dvl/pd0", &message)?.ok_or("no ping")?;
        for (beam, sent) in ping.beams.iter().zip(&cells[10..14]) {
            ensure(beam.range.is_some() == (*sent > 0.0), format!("{line}: {beam:?}"))?;
        }
        if ping.returns() == 4 && cells[9] > 0.5 {
            pairs.extend(plane(ping).map(|p| (p.1, cells[9])));
        }
    }
    let (median, most) = deviations(&pairs);
    println!("PD0: {} pings, median {:.2} %, 95 % within {:.2} %", pairs.len(), 100.0 * median, 100.0 * most);
    ensure(pairs.len() > 10 && median < 0.02, format!("{} pings: {median}, {most}", pairs.len()))
}

fn main() {
    let data = std::env::var_os("UNWATER_DATA").map(PathBuf::from).filter(|d| d.is_dir());
    let missing = data.is_none();
    let data = data.unwrap_or_default();
    type Check = Box<dyn Fn(&Path) -> Result<(), Failed> + Send>;
    let checks: Vec<(&str, Check)> = vec![
        ("rendered A: attenuation", Box::new(rendered_a)),
        ("stonefish finishes", Box::new(|d| finishes(d, "stonefish/sf_w020_square_srgb.mcap", 25))),
        ("auv_set02 finishes", Box::new(|d| finishes(d, "real/auv_set02.mcap", 8))),
        ("auv_set07 finishes", Box::new(|d| finishes(d, "real/auv_set07.mcap", 8))),
        ("towed_port finishes", Box::new(|d| finishes(d, "real/towed_port.mcap", 50))),
        ("MCAP corpus is read", Box::new(corpus)),
        ("a Water Linked A50 agrees with itself", Box::new(a50)),
        ("a Teledyne PD0 agrees with its vehicle", Box::new(pd0)),
    ];
    let trials = checks
        .into_iter()
        .map(|(name, check)| {
            let data = data.clone();
            Trial::test(name, move || check(&data)).with_ignored_flag(missing)
        })
        .collect();
    if missing {
        eprintln!("UNWATER_DATA names no folder: the tests on dives are skipped");
    }
    libtest_mimic::run(&Arguments::from_args(), trials).exit();
}
