//! A cruise of twelve dives with one strobe in three waters: two of them split recordings, one
//! damaged, one a folder of stills. By the shell's commands and by the workflow, killed three times
//! on the way, its outputs are the same bytes. Needs snakemake (`tests/playback/setup.sh`).
use std::path::{Path, PathBuf};
use std::process::Command;

use libtest_mimic::{Failed, Trial};

use crate::program::{ran, text, unwater};
use crate::support::edited::{Record, delay, records, write};
use crate::support::ensure;
use crate::support::judge::beam_log_rmse;
use crate::support::render::{Dive, Truth};
use unwater::model::ModelFile;

const DIVES: usize = 12;
const WATERS: [[f64; 3]; 3] = [[0.45, 0.14, 0.10], [0.62, 0.21, 0.14], [0.36, 0.08, 0.07]];
/// Seconds after which the workflow is killed.
const KILLED_AFTER_S: [&str; 3] = ["3", "4", "5"];
/// Of the stills.
const FIELD_OF_VIEW: [&str; 2] = ["--horizontal-fov", "46.4"];

pub fn trials() -> Vec<Trial> {
    let is_missing = snakemake().is_none() && std::env::var_os("UNWATER_PLAYBACK").is_none();
    vec![
        Trial::test("cruise::shell_and_workflow_make_the_same_of_twelve_dives", run)
            .with_ignored_flag(is_missing),
    ]
}

/// Of the tests' own installation, or on the path.
fn snakemake() -> Option<PathBuf> {
    let target = std::env::var_os("CARGO_TARGET_DIR")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("target"), PathBuf::from);
    let path = std::env::var_os("PATH").unwrap_or_default();
    std::iter::once(target.join("playback/venv/bin"))
        .chain(std::env::split_paths(&path))
        .map(|folder| folder.join("snakemake"))
        .find(|program| program.is_file())
}

fn run() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let of = |name: &str| folder.path().join(name);
    let (dives, by_shell, by_workflow) = (of("dives"), of("shell"), of("workflow"));
    std::fs::create_dir(&dives)?;
    std::fs::create_dir(&by_shell)?;
    let truths: Vec<Truth> = (0..DIVES).map(|n| dive(&dives, n)).collect::<Result<_, _>>()?;
    let names: Vec<String> = (0..DIVES).map(name).collect();
    let (stills, together) = names.split_last().expect("dives");
    let model = shell(&dives, &by_shell, (stills, together))?;

    // One strobe: all dives together know its beam better than any of them.
    let read = |path: &Path| -> Result<ModelFile, Failed> {
        Ok(ModelFile::from_json(&std::fs::read_to_string(path)?)?)
    };
    let model = read(&model)?;
    let mut rmse = Vec::new();
    for (name, truth) in together.iter().zip(&truths) {
        let alone = read(&by_shell.join(format!("{name}.json")))?;
        let of = |model, other| beam_log_rmse(model, other, truth);
        rmse.push([of(&model, &alone), of(&alone, &model)]);
    }
    println!("log BP, RMSE of all dives and of one, where both have it: {rmse:.4?}");
    ensure(rmse.iter().all(|[all, one]| all < one), format!("{rmse:?}"))?;
    for (n, input) in model.inputs.iter().enumerate() {
        let own = input.attenuation_per_m.as_ref().zip(input.attenuation_std_per_m.as_ref());
        let (alpha, std) = own.ok_or("the waters differ")?;
        for band in 0..3 {
            let z = (alpha[band] - WATERS[n % 3][band]) / std[band];
            ensure(z.abs() < 4.0, format!("{}, band {band}: {z} standard deviations", input.name))?;
        }
    }

    workflow(&dives, &by_workflow, together)?;
    for name in &names {
        let corrected = format!("{name}.corrected.mcap");
        let of = |folder: &Path| std::fs::read(folder.join(&corrected));
        ensure(of(&by_shell)? == of(&by_workflow)?, format!("{name} differs"))?;
        ensure(by_workflow.join(format!("{name}.html")).is_file(), name.clone())?;
    }
    let table = |folder: &Path| std::fs::read_to_string(folder.join("dives.csv"));
    ensure(table(&by_shell)? == table(&by_workflow)?, "the tables differ")
}

fn name(number: usize) -> String {
    format!("dive_{:02}", number + 1)
}

/// Renders a dive into the folder, in the form that its number has.
fn dive(dives: &Path, number: usize) -> Result<Truth, Failed> {
    let dive = Dive {
        seed: 40 + number as u64,
        frames: 16,
        width: 240,
        height: 180,
        focal_px: 280.0,
        attenuation_per_m: WATERS[number % 3],
        ..Dive::default()
    };
    let (name, temporary) = (name(number), dives.join("temporary"));
    let path = dives.join(format!("{name}.mcap"));
    let truth = dive.write(&path);
    delay(&path, 7200 * number as i32);
    match number {
        3 | 7 => {
            let folder = dives.join(&name);
            std::fs::create_dir(&folder)?;
            split(&records(&path), &folder);
            std::fs::remove_file(&path)?;
        }
        5 => {
            // Its end is lost.
            let bytes = std::fs::read(&path)?;
            std::fs::write(&path, &bytes[..bytes.len() * 9 / 10])?;
        }
        11 => {
            let stills = dives.join(&name);
            ran(&["correct", text(&path), "-o", text(&temporary), "-q"])?;
            ran(&["export", text(&temporary), "-o", text(&stills), "-q"])?;
            std::fs::rename(stills.join("squidle.csv"), stills.join("nav.csv"))?;
            std::fs::remove_file(&path)?;
            std::fs::remove_file(&temporary)?;
        }
        _ => {}
    }
    Ok(truth)
}

/// The parts of a recording: mounts and calibration are in the first alone.
fn split(log: &[Record], folder: &Path) {
    let middle = log.len() / 2;
    let is_latched = |r: &&Record| r.topic == "/tf_static" || r.topic.ends_with("camera_info");
    let first: Vec<Record> = log.iter().filter(is_latched).cloned().collect();
    let other: Vec<Record> = log.iter().filter(|r| !is_latched(r)).cloned().collect();
    write(&folder.join("part_0.mcap"), &[&first[..], &other[..middle]].concat());
    write(&folder.join("part_1.mcap"), &other[middle..]);
}

/// The cruise by single commands; returns the model of the dives that are estimated together.
fn shell(
    dives: &Path,
    out: &Path,
    (stills, together): (&String, &[String]),
) -> Result<PathBuf, Failed> {
    let of = |name: &str, kind: &str| out.join(format!("{name}.{kind}"));
    let log = |name: &str| {
        let file = dives.join(format!("{name}.mcap"));
        if file.is_file() { file } else { dives.join(name) }
    };
    for name in together {
        let (model, samples) = (of(name, "json"), of(name, "samples"));
        let files = ["-o", text(&model), "--save-samples", text(&samples), "-q"];
        ran(&[&["estimate", text(&log(name))], &files[..]].concat())?;
    }
    let samples: Vec<PathBuf> = together.iter().map(|name| of(name, "samples")).collect();
    let samples: Vec<&str> = samples.iter().map(|path| text(path)).collect();
    let model = out.join("together.json");
    ran(&[&["estimate", "-q", "-o", text(&model), "--from"], &samples[..]].concat())?;
    let (folder, imported) = (dives.join(stills), of(stills, "mcap"));
    let (table, own) = (folder.join("nav.csv"), of(stills, "json"));
    let import = ["import", text(&folder), "--table", text(&table), "-o", text(&imported), "-q"];
    ran(&[&import[..], &FIELD_OF_VIEW].concat())?;
    ran(&["estimate", text(&imported), "-o", text(&own), "-q"])?;
    let mut corrected = Vec::new();
    for name in together.iter().chain([stills]) {
        let (log, model) =
            if name == stills { (imported.clone(), &own) } else { (log(name), &model) };
        let output = of(name, "corrected.mcap");
        let files = ["--model", text(model), "-o", text(&output), "-q", "--accept-losses"];
        ran(&[&["correct", text(&log)], &files[..]].concat())?;
        corrected.push(output);
    }
    let outputs: Vec<&str> = corrected.iter().map(|path| text(path)).collect();
    let table = unwater(&[&["table", "--csv"], &outputs[..]].concat());
    std::fs::write(out.join("dives.csv"), table.stdout)?;
    Ok(model)
}

/// The cruise by the workflow, killed on the way.
fn workflow(dives: &Path, out: &Path, together: &[String]) -> Result<(), Failed> {
    let snakemake = snakemake().ok_or("no snakemake")?;
    let config = [
        format!("dives={}", dives.display()),
        format!("out={}", out.display()),
        format!("unwater={}", env!("CARGO_BIN_EXE_unwater")),
        format!("together={}", together.join(" ")),
        format!("import={}", FIELD_OF_VIEW.join(" ")),
        "shards=2".into(),
    ];
    let run = |before: &[&str], options: &[&str]| {
        let program = [before, &[text(&snakemake)]].concat();
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/workflow/Snakefile");
        let mut command = Command::new(program[0]);
        command.args(&program[1..]).args(["-s", script, "--cores", "2"]);
        command.args([
            "--rerun-incomplete",
            "--directory",
            text(dives.parent().expect("a parent")),
        ]);
        command.args(options).arg("--config").args(&config).output()
    };
    for seconds in KILLED_AFTER_S {
        run(&["timeout", "--signal", "KILL", seconds, "setsid", "--wait"], &[])?;
        let _none_left = Command::new("pkill").args(["-KILL", "-f", text(out)]).status()?;
        run(&[], &["--unlock"])?;
    }
    let finished = run(&[], &[])?;
    ensure(finished.status.success(), String::from_utf8_lossy(&finished.stderr))
}
