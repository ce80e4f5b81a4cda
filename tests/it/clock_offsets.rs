//! Known clock offsets: estimated, or reported as not observable.
use std::path::Path;

use crate::support::judge::assert_within;
use crate::support::render::{Dive, Sensor};
use unwater::diagnostics::{ClockFact, Diagnostic, Fact};
use unwater::run::clock_offsets::{ClockOffset, ClockOffsets, clock_offsets};
use unwater::session::{CameraSession, Options};
use unwater::vehicle::RigFile;

const DVL: &str = "/dvl/data";

/// The log looked at with the stamps of some topics moved.
fn look(path: &Path, moved: &[(&str, f64)]) -> (ClockOffsets, Vec<Diagnostic>) {
    let mut rig = RigFile::default();
    rig.time_offset_s.extend(moved.iter().map(|(topic, by)| (topic.to_string(), *by)));
    let options = Options { rig, ..Options::default() };
    let session = CameraSession::open(path, &options).unwrap();
    let found = clock_offsets(&session, &options).unwrap();
    let diagnostics = found.diagnostics(&session.survey, &options.rig);
    (found, diagnostics)
}

#[test]
fn clock_offsets_are_estimated_without_false_positives() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("dive.mcap");
    Dive {
        frames: 48,
        width: 256,
        height: 192,
        focal_px: 310.0,
        sensor: Sensor::Mono16,
        ..Dive::default()
    }
    .write(&path);
    for by in [0.0, 0.3, -0.3, 1.5, -1.5] {
        let (found, diagnostics) = look(&path, &[(DVL, by)]);
        println!("pings {by:+} s: {found:?}");
        let ClockOffset::Estimated { offset_s, .. } = found.ranges else {
            panic!("{by}: {found:?}")
        };
        assert_within(&format!("clock of ranges by {by} [s]"), offset_s + by, 0.005);
        assert_eq!(found.ranges.is_off(), by != 0.0, "{by}: {found:?}");
        // The line to write undoes what was put in.
        let of_ranges = diagnostics.iter().find(|d| d.topic.as_deref() == Some(DVL)).unwrap();
        let line = match of_ranges.fact {
            Fact::ClockFact(ClockFact::OffsetFound { time_offset_s, .. }) => Some(time_offset_s),
            _ => None,
        };
        assert_eq!(line.is_some(), by != 0.0, "{diagnostics:?}");
        assert!(line.is_none_or(|s| s.abs() < 0.1), "{diagnostics:?}");
        // The attitude was left alone, and is not accused.
        assert!(!found.attitude.is_off(), "{by}: {found:?}");
    }
    for by in [0.3, -1.5] {
        let (found, _) = look(&path, &[("/imu", by)]);
        println!("attitude {by:+} s: {found:?}");
        let ClockOffset::Estimated { offset_s, .. } = found.attitude else {
            panic!("{by}: {found:?}")
        };
        assert_within(&format!("clock of attitude by {by} [s]"), offset_s + by, 0.0317);
        assert!(!found.ranges.is_off(), "{by}: {found:?}");
    }
}

#[test]
fn constant_altitude_gives_no_clock_offset() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("level.mcap");
    let dive = Dive {
        frames: 30,
        width: 256,
        height: 192,
        focal_px: 310.0,
        sensor: Sensor::Mono16,
        ..Dive::default()
    };
    Dive { altitude_m: (2.0, 2.0), tilt_deg: 0.0, with_imu: false, ..dive }.write(&path);
    for by in [0.0, 0.3, -1.5] {
        let (found, diagnostics) = look(&path, &[(DVL, by)]);
        assert!(
            matches!(found.ranges, ClockOffset::Unknown(_))
                && matches!(found.attitude, ClockOffset::Unknown(_)),
            "{by}: {found:?}"
        );
        let is_unknown = |d: &Diagnostic| d.code() == "clock-offset-unknown";
        assert!(diagnostics.iter().all(is_unknown), "{diagnostics:?}");
    }
}
