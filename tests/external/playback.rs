//! What is written plays back: the corrected sample log, read by rerun's importer and by the
//! libraries that Foxglove decodes with, and the layouts for both. `tests/playback/setup.sh`
//! installs the two; without them these tests are reported as ignored, or, where the variable
//! `UNWATER_PLAYBACK` is set, as CI does, as failed.
use std::path::{Path, PathBuf};
use std::process::Command;

use libtest_mimic::{Failed, Trial};

/// The points that a viewer must show, by kind in rerun and in Foxglove; `CDR` and `PROTOBUF`
/// differ in what rerun plots by itself.
const SHOWN: [(&str, &str, &str, &str); 12] = [
    ("/unwater/raw/compressed", "image", "image", "image"),
    ("/camera/image_corrected/compressed", "image", "image", "image"),
    ("/unwater/beam_pattern/picture/compressed", "image", "image", "image"),
    (
        "/unwater/attenuation",
        "numbers:.attenuation_per_m[]",
        "numbers:.attenuation_per_m[]",
        "plot:.attenuation_per_m[2]",
    ),
    ("/unwater/seafloor", "numbers:.residual_m", "numbers:.residual_m", "plot:.residual_m"),
    ("/unwater/plot/attenuation_per_m", "plot", "numbers:.data[]", "plot:.data[0]"),
    ("/unwater/plot/camera_altitude_m", "plot", "numbers:.data[]", "plot:.data[0]"),
    ("/unwater/plot/seafloor_residual_m", "plot", "numbers:.data[]", "plot:.data[0]"),
    ("/unwater/seafloor/cloud", "colours", "colours", "3d"),
    ("/unwater/strobe", "3d", "3d", "3d"),
    ("/unwater/strobe/beam", "colours", "colours", "3d"),
    ("/unwater/log", "text", "text", "log"),
];

/// Claims that are not so: a check that passes these checks nothing.
const NOT_SO: [(&str, &str, &str); 4] = [
    ("/camera/image_raw", "image", "image"), // 16 bits
    ("/unwater/log", "plot", "plot:.msg"),
    ("/unwater/strobe", "colours", "image"),
    ("/nowhere", "3d", "3d"),
];

fn tools() -> PathBuf {
    let target = std::env::var_os("CARGO_TARGET_DIR")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("target"), PathBuf::from);
    target.join("playback")
}

fn run(command: &mut Command) -> Result<(), Failed> {
    let ran = command.output()?;
    let said =
        format!("{}{}", String::from_utf8_lossy(&ran.stdout), String::from_utf8_lossy(&ran.stderr));
    if ran.status.success() { Ok(()) } else { Err(format!("{command:?}:\n{said}").into()) }
}

fn unwater(args: &[&str]) -> Result<(), Failed> {
    run(Command::new(env!("CARGO_BIN_EXE_unwater")).args(args))
}

fn rerun(args: &[String]) -> Result<(), Failed> {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/playback/rerun_check.py");
    run(Command::new(tools().join("venv/bin/python")).arg(script).args(args))
}

fn foxglove(args: &[String]) -> Result<(), Failed> {
    // Node looks for libraries beside the script.
    let script = tools().join("foxglove_check.mjs");
    std::fs::copy(
        concat!(env!("CARGO_MANIFEST_DIR"), "/tests/playback/foxglove_check.mjs"),
        &script,
    )?;
    run(Command::new("node").arg(script).args(args))
}

/// The sample log in one encoding, in both viewers, with both layouts.
fn plays_back(encoding: &str, log: &str) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let at = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    let (out, script, layout) = (at("out.mcap"), at("out.rerun.py"), at("out.foxglove.json"));
    unwater(&["correct", log, "-q", "-o", &out, "--output-encoding", encoding])?;
    unwater(&["layout", &out, "--rerun", "-q"])?;
    unwater(&["layout", &out, "--foxglove", "-q"])?;
    let kind = |shown: &(&str, &str, &str, &str)| {
        format!("{}={}", shown.0, if encoding == "protobuf" { shown.2 } else { shown.1 })
    };
    rerun(
        &[out.clone(), "--layout".into(), script]
            .into_iter()
            .chain(SHOWN.iter().map(kind))
            .collect::<Vec<_>>(),
    )?;
    let claims = SHOWN.iter().map(|(topic, _, _, kind)| format!("{topic}={kind}"));
    foxglove(
        &[out.clone(), "--layout".into(), layout].into_iter().chain(claims).collect::<Vec<_>>(),
    )?;
    for (topic, in_rerun, in_foxglove) in NOT_SO {
        if rerun(&[out.clone(), format!("{topic}={in_rerun}")]).is_ok()
            || foxglove(&[out.clone(), format!("{topic}={in_foxglove}")]).is_ok()
        {
            return Err(format!("{topic} passes for {in_rerun} or {in_foxglove}").into());
        }
    }
    Ok(())
}

pub fn trials() -> Vec<Trial> {
    let installed =
        tools().join("venv/bin/python").exists() && tools().join("node_modules").is_dir();
    let wanted = std::env::var_os("UNWATER_PLAYBACK").is_some();
    if !installed {
        eprintln!(
            "playback: tests/playback/setup.sh has not been run: the viewers' libraries are not \
             there"
        );
    }
    const SAMPLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/sample_logs/rendered_clear.mcap");
    ["cdr", "protobuf"]
        .map(|encoding| {
            Trial::test(
                format!("playback: the corrected sample log in {encoding}, in rerun and Foxglove"),
                move || plays_back(encoding, SAMPLE),
            )
            .with_ignored_flag(!installed && !wanted)
        })
        .into_iter()
        .collect()
}
