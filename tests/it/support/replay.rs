//! Logs of real instruments as their usual message types. None of their data is in the tree;
//! `UNWATER_DATA` has it.

use std::path::Path;

use libtest_mimic::Failed;
use unwater::config::{Config, SeafloorConfig};
use unwater::coordinates::Transform;
use unwater::geometry::SeafloorEstimator;
use unwater::messages::{Decoder, Kind};
use unwater::vehicle::{AttitudeTrack, Camera, DvlFacts, Ping, Rig, StrobeMount};

use super::ensure;

/// One ping of a schemaless JSON message, as its channel would be read.
fn ping(topic: &str, line: &str, facts: &DvlFacts) -> Result<Option<Ping>, Failed> {
    let decoder = Decoder::for_json(topic, line.as_bytes())?.ok_or("nothing that is read")?;
    let Kind::Ping(_, read) = decoder.message_type.kind else { return Err("no ranges".into()) };
    Ok(read(&decoder.read(line.as_bytes())?, facts)?.ping)
}

/// The plane of one ping alone, its distance along the instrument's axis and along its own normal
/// (m).
fn plane(ping: Ping) -> Option<(f64, f64)> {
    let rig = Rig {
        camera: Camera::from_field_of_view(640, 480, 60.0),
        body_from_optical: Transform::identity(),
        body_from_dvl: Transform::identity(),
        strobe: StrobeMount {
            lamps: unwater::vehicle::Lamps::one(Transform::identity()),
            source: None,
        },
        camera_motion: None,
    };
    let stamp = ping.stamp;
    let config = Config {
        seafloor: SeafloorConfig { least_altitude_m: 0.0, ..SeafloorConfig::default() },
        ..Config::default()
    };
    let plane = SeafloorEstimator::new(vec![ping], AttitudeTrack::default())
        .seafloor(stamp, &rig, &config.seafloor)
        .ok()?;
    Some((plane.distance_m / plane.normal.vector().z, plane.distance_m))
}

/// Median and 95 % of |a / b − 1|.
fn deviations(pairs: &[(f64, f64)]) -> (f64, f64) {
    let mut off: Vec<f64> = pairs.iter().map(|(a, b)| (a / b - 1.0).abs()).collect();
    off.sort_by(f64::total_cmp);
    (off[off.len() / 2], off[off.len() * 95 / 100])
}

/// A Water Linked A50's own stream: planes agree with its altitude, and every lost beam is one.
pub fn a50(data: &Path) -> Result<(), Failed> {
    let (mut pairs, mut lost) = (Vec::new(), 0);
    for file in
        ["out20210528.txt", "out20210528_circle.txt", "out20210528_straight+turn360.txt", "out.txt"]
    {
        let text = std::fs::read_to_string(data.join("dvl/dvl_waterlinked_a50").join(file))?;
        for line in text.lines().filter(|l| l.contains("transducers")) {
            let report: serde_json::Value = serde_json::from_str(line)?;
            let said = report["transducers"].as_array().ok_or("no transducers")?;
            let valid = |t: &serde_json::Value| {
                t["beam_valid"] == true && t["distance"].as_f64().is_some_and(|d| d > 0.0)
            };
            let ping = ping("/dvl", line, &DvlFacts::default())?.ok_or("no ping")?;
            for (beam, said) in ping.beams.iter().zip(said) {
                ensure(
                    beam.range.is_some() == valid(said),
                    format!("{file}: a beam {said} is read as {beam:?}"),
                )?;
                lost += usize::from(beam.range.is_none());
            }
            let altitude = report["altitude"]
                .as_f64()
                .filter(|a| *a > 0.5 && report["velocity_valid"] == true && said.iter().all(valid));
            pairs.extend(altitude.and_then(|a| Some((plane(ping)?.0, a))));
        }
    }
    let (median, most) = deviations(&pairs);
    println!(
        "A50: {} pings, median {:.2} %, 95 % within {:.2} %, {lost} beams lost",
        pairs.len(),
        100.0 * median,
        100.0 * most
    );
    ensure(
        pairs.len() > 1000 && lost > 1000 && median < 0.01 && most < 0.02,
        format!("{} pings: {median}, {most}", pairs.len()),
    )
}

/// A Teledyne's vertical ranges as `RdiPD0`, against the altitude that the vehicle logged beside
/// them.
///
/// The vehicle's altitude is the mean of the four ranges times the true speed of sound over the
/// 1500 m/s that the instrument was set to (according to its record; the CTD in the same log
/// measured 1469.3 m/s). Without that factor, which `dvl.sound_speed_ratio` is for, every altitude
/// is 2.1 % off. Tilt is not in it, nor in a plane's distance along the axis.
pub fn pd0(data: &Path) -> Result<(), Failed> {
    let bytes = std::fs::read(data.join("dvl/dvl_pd0/remus_vehicle_log_subset_reduced.csv"))?;
    let text = String::from_utf8_lossy(&bytes);
    let number = |cell: &str| cell.parse::<f64>().unwrap_or(f64::NAN);
    let mut speeds: Vec<f64> = text
        .lines()
        .filter(|l| l.starts_with("1181,"))
        .filter_map(|l| l.split(',').nth(9).map(number))
        .collect();
    speeds.sort_by(f64::total_cmp);
    let facts = DvlFacts {
        sound_speed_ratio: Some(speeds[speeds.len() / 2] / 1500.0),
        ..DvlFacts::default()
    };
    let (mut pairs, mut as_it_is) = (Vec::new(), Vec::new());
    for line in text.lines().filter(|l| l.starts_with("1141,")) {
        let cells: Vec<f64> = line.split(',').map(number).collect();
        let message = serde_json::json!({
            "range": cells[10..14],
            "config_beamangle": 30.0,
            "altitude": cells[9],
        })
        .to_string();
        let ping_with =
            |facts: &DvlFacts| ping("/dvl/pd0", &message, facts)?.ok_or(Failed::from("no ping"));
        for (beam, sent) in ping_with(&facts)?.beams.iter().zip(&cells[10..14]) {
            ensure(beam.range.is_some() == (*sent > 0.0), format!("{line}: {beam:?}"))?;
        }
        if ping_with(&facts)?.returns() == 4 && cells[9] > 0.5 {
            pairs.extend(plane(ping_with(&facts)?).map(|p| (p.0, cells[9])));
            as_it_is.extend(plane(ping_with(&DvlFacts::default())?).map(|p| (p.0, cells[9])));
        }
    }
    let ((median, most), (before, _)) = (deviations(&pairs), deviations(&as_it_is));
    println!(
        "PD0: {} pings, median {:.2} %, 95 % within {:.2} % ({:.2} % without the speed of sound)",
        pairs.len(),
        100.0 * median,
        100.0 * most,
        100.0 * before
    );
    ensure(
        pairs.len() > 10 && median < 0.005 && most < 0.02,
        format!("{} pings: {median}, {most}", pairs.len()),
    )?;
    whole_pd0(data)
}

/// All of the instrument's own record, 4132 ensembles: what is 0 in it is a lost beam, and nothing
/// else is.
fn whole_pd0(data: &Path) -> Result<(), Failed> {
    let text =
        std::fs::read_to_string(data.join("dvl/dvl_pd0/remus_adcp_bottom_track_derived.csv"))?;
    let (mut whole, mut lost) = (0, 0);
    for line in text.lines().skip(1) {
        let ranges: Vec<f64> =
            line.split(',').skip(2).take(4).map(|c| c.parse().unwrap_or(0.0)).collect();
        let message = serde_json::json!({ "range": ranges, "config_beamangle": 30.0 }).to_string();
        let ping = ping("/dvl/pd0", &message, &DvlFacts::default())?.ok_or("no ping")?;
        let seen: Vec<bool> = ping.beams.iter().map(|b| b.range.is_some()).collect();
        ensure(
            seen == ranges.iter().map(|r| *r > 0.0).collect::<Vec<_>>(),
            format!("{line}: {seen:?}"),
        )?;
        lost += ranges.iter().filter(|r| **r == 0.0).count();
        whole += usize::from(ping.returns() == 4);
    }
    println!("PD0: {whole} pings with four ranges, {lost} beams lost");
    ensure(whole == 3539, format!("{whole} pings have four ranges, not 3539"))
}

/// A Nortek DVL333's own record as `BottomTrack`. It has no altitude, so its planes are held
/// against its own beams: where ranges are vertical, the two pairs of opposite beams meet the axis
/// at one height, however the instrument is tilted.
pub fn dvl333(data: &Path) -> Result<(), Failed> {
    let bytes = std::fs::read(data.join("dvl/dvl_nortek_dvl333/dvl.bin"))?;
    let u16_at = |at: usize| u16::from_le_bytes([bytes[at], bytes[at + 1]]);
    let sum = |range: std::ops::Range<usize>| {
        range.step_by(2).fold(0xb58c_u16, |s, at| s.wrapping_add(u16_at(at)))
    };
    let (mut at, mut records, mut dropped, mut pairs, mut heights) =
        (0, 0, 0, Vec::new(), Vec::new());
    while at + 10 + 212 <= bytes.len() {
        if bytes[at] != 0xa5
            || sum(at..at + 8) != u16_at(at + 8)
            || sum(at + 10..at + 222) != u16_at(at + 6)
        {
            at += 1;
            continue;
        }
        let numbers = at + 10 + usize::from(bytes[at + 11]);
        let value = |n: usize| f32::from_le_bytes([0, 1, 2, 3].map(|k| bytes[numbers + 4 * n + k]));
        let beams = (0..4).flat_map(|n| {
            [("vel", 0), ("dist", 4), ("fom", 8)]
                .map(|(word, of)| (format!("{word}_beam{n}"), value(of + n).into()))
        });
        let message = serde_json::Value::Object(beams.collect()).to_string();
        let ping = ping("/dvl/bottom_track", &message, &DvlFacts::default())?.ok_or("no ping")?;
        records += 1;
        let sent: Vec<f64> = (4..8).map(|n| f64::from(value(n))).collect();
        for (beam, sent) in ping.beams.iter().zip(&sent) {
            ensure(beam.range.is_some() == (*sent > 0.0), format!("{message}: {beam:?}"))?;
        }
        if ping.returns() == 4 {
            let on_axis = |a: f64, b: f64| 2.0 * a * b / (a + b);
            heights.push((on_axis(sent[0], sent[2]), on_axis(sent[1], sent[3])));
            pairs.extend(plane(ping).map(|p| (p.0, sent.iter().sum::<f64>() / 4.0)));
        } else {
            dropped += 1;
        }
        at += 222;
    }
    let ((median, most), (between, _)) = (deviations(&pairs), deviations(&heights));
    println!(
        "DVL333: {} planes of {records}, {dropped} drop-outs, median {:.2} %, 95 % within {:.2} % \
         of the mean range; pairs of beams {:.2} % apart",
        pairs.len(),
        100.0 * median,
        100.0 * most,
        100.0 * between
    );
    ensure(records == 11966 && dropped == 19, format!("{records} records, {dropped} drop-outs"))?;
    ensure(
        pairs.len() == records - dropped && median < 0.01 && most < 0.02,
        format!("{median}, {most}"),
    )
}

/// A Ping altimeter's own record: millimetres, and below 60 % of confidence nothing.
pub fn ping1d(data: &Path) -> Result<(), Failed> {
    let text = std::fs::read_to_string(
        data.join("dvl/altimeter_ping/bluerov2_ping_20220815-113029403.csv"),
    )?;
    let (mut good, mut lost) = (0, 0);
    for line in text.lines().skip(1) {
        let cells: Vec<f64> =
            line.split(',').skip(1).map(|c| c.parse().unwrap_or(f64::NAN)).collect();
        let [distance, confidence] = cells[..] else {
            return Err(format!("{line:?} has no two numbers").into());
        };
        let message =
            serde_json::json!({ "distance": distance, "confidence": confidence }).to_string();
        let ping = ping("/ping", &message, &DvlFacts::default())?.ok_or("no ping")?;
        let expected = (confidence >= 60.0 && distance > 0.0).then_some(distance / 1000.0);
        let seen = ping.altitude.map(|a| a.0);
        ensure(
            seen.zip(expected).is_none_or(|(s, e)| (s - e).abs() < 1e-9)
                && seen.is_some() == expected.is_some(),
            format!("{line}: {seen:?}"),
        )?;
        if let Some(expected) = expected {
            good += 1;
            let height = plane(ping).ok_or("no plane")?.1;
            ensure(
                (height / expected - 1.0).abs() < 1e-9,
                format!("{line}: a plane at {height} m"),
            )?;
        } else {
            lost += 1;
        }
    }
    println!("Ping: {good} altitudes, {lost} drop-outs");
    ensure(good + lost == 19_358 && good > 1000 && lost > 1000, format!("{good}, {lost}"))
}
