//! Runs the program as a user does, and a corrected dive for the tests of what is made from one.
#![allow(dead_code)]
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use libtest_mimic::Failed;

use crate::support::ensure;
use crate::support::render::{Dive, Sensor, Truth};

pub fn unwater(args: &[&str]) -> std::process::Output {
    Command::new(env!("CARGO_BIN_EXE_unwater")).args(args).output().expect("the program runs")
}

pub fn ran(args: &[&str]) -> Result<(), Failed> {
    let output = unwater(args);
    ensure(
        output.status.success(),
        format!("{args:?}: {}", String::from_utf8_lossy(&output.stderr)),
    )
}

pub fn text(path: &Path) -> &str {
    path.to_str().expect("a plain path")
}

/// A dive of 22 frames with its truth, and corrected: once for all tests.
pub struct CorrectedDive {
    folder: tempfile::TempDir,
    pub dive: Dive,
    pub truth: Truth,
}

impl CorrectedDive {
    pub fn get() -> &'static Self {
        static MADE: OnceLock<CorrectedDive> = OnceLock::new();
        MADE.get_or_init(|| {
            let folder = tempfile::tempdir().expect("a folder");
            // The strip is laid by the velocity: without its noise, so that what is off is off by
            // the laying.
            let dive = Dive {
                frames: 22,
                width: 320,
                height: 240,
                focal_px: 380.0,
                velocity_noise_m_per_s: 0.0,
                ..Dive::default()
            };
            let truth = dive.write(&folder.path().join("dive.mcap"));
            ran(&[
                "correct",
                text(&folder.path().join("dive.mcap")),
                "-o",
                text(&folder.path().join("out.mcap")),
                "-q",
            ])
            .expect("a corrected log");
            CorrectedDive { folder, dive, truth }
        })
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }
}

/// Outputs that lack data: each figure that cannot be drawn gives the reason.
pub fn pages_of_poorer_logs() -> Result<Vec<(PathBuf, tempfile::TempDir)>, Failed> {
    let mut pages = Vec::new();
    let mono = Dive {
        frames: 14,
        width: 288,
        height: 216,
        focal_px: 340.0,
        sensor: Sensor::Mono16,
        ..Dive::default()
    };
    let level =
        Dive { altitude_m: (2.0, 2.05), with_imu: false, sensor: Sensor::Jpeg(90), ..mono.clone() };
    let cases: [(&str, &Dive, &[&str], &[&str]); 3] = [
        ("mono", &mono, &[], &["grey"]),
        (
            "dropped",
            &mono,
            &["--drop-raw", "--depth", "16"],
            &["--drop-raw", "Corrected frames alone"],
        ),
        ("level", &level, &[], &["Not identified", "Along the dive: altitude"]),
    ];
    for (name, dive, options, words) in cases {
        let folder = tempfile::tempdir()?;
        let (log, out) =
            (folder.path().join(format!("{name}.mcap")), folder.path().join("out.mcap"));
        dive.write(&log);
        ran(&[&["correct", text(&log), "-o", text(&out), "-q"], options].concat())?;
        let page = folder.path().join(format!("{name}.html"));
        ran(&["report", text(&out), "-o", text(&page)])?;
        let html = std::fs::read_to_string(&page)?;
        for word in words {
            ensure(html.contains(word), format!("{name}: {word:?} is not in the page"))?;
        }
        pages.push((page, folder));
    }
    Ok(pages)
}
