//! Many dives: several logs in one run, and recordings in several files.
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::support::edited::{Record, delay, records, sample, write};
use crate::support::judge::assert_within;
use crate::support::render::Dive;
use unwater::recording::{Entry, LogFiles, Message, Recording, Window};

fn unwater(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_unwater")).args(args).output().expect("the program runs")
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn text(path: &Path) -> &str {
    path.to_str().expect("a plain path")
}

/// A model of the sample, for runs of pass two alone.
fn model(folder: &Path) -> PathBuf {
    let model = folder.join("model.json");
    let ran = unwater(&["estimate", text(&sample()), "-o", text(&model), "-q"]);
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    model
}

/// Sequence number, log time, publish time and bytes.
type Bytes = (u32, u64, u64, Vec<u8>);

/// Messages by topic, in order, without what the program adds about the run itself.
fn by_topic(path: &Path) -> BTreeMap<String, Vec<Bytes>> {
    let recording = Recording::open(path).expect("a log");
    let mut topics: BTreeMap<_, Vec<_>> = BTreeMap::new();
    for entry in recording.messages(Window::ALL) {
        let Entry::Message(m) = entry else { panic!("{}: damaged", path.display()) };
        let Message { channel, sequence, log_time, publish_time, .. } = m;
        let topic = recording.channels[&channel].topic.clone();
        let message = (sequence, log_time, publish_time, m.data().to_vec());
        topics.entry(topic).or_default().push(message);
    }
    topics
}

#[test]
fn one_failing_log_does_not_stop_the_rest() {
    let folder = tempfile::tempdir().unwrap();
    let model = model(folder.path());
    let of = |name: &str| folder.path().join(name);
    let (a, bad, b, out) = (of("a.mcap"), of("bad.mcap"), of("b.mcap"), of("out"));
    std::fs::copy(sample(), &a).unwrap();
    std::fs::write(&bad, "no log").unwrap();
    // Another dive: the same without its last frames.
    let mut fewer = records(&sample());
    fewer.truncate(fewer.len() * 3 / 4);
    write(&b, &fewer);
    let inputs = [text(&a), text(&bad), text(&b)];
    let common = ["--model", text(&model), "-o", text(&out)];
    let run = |more: &[&str]| unwater(&[&["correct"], &inputs[..], &common, more].concat());
    let ran = run(&[]);
    assert_eq!(ran.status.code(), Some(1), "{}", stderr(&ran));
    assert!(stderr(&ran).contains("bad.mcap is not an MCAP file"), "{}", stderr(&ran));
    let printed = String::from_utf8(ran.stdout).unwrap();
    let table: Vec<&str> = printed.lines().rev().take(4).collect();
    assert!(table[3].starts_with("log") && table[2].starts_with("a "), "{printed}");
    assert!(table[1].starts_with("bad") && table[1].ends_with("failed"), "{printed}");
    assert!(table[0].starts_with("b ") && table[0].ends_with("done"), "{printed}");

    // Each output is that of a run of its own.
    let alone = of("alone.mcap");
    let ran = unwater(&["correct", text(&a), "--model", text(&model), "-o", text(&alone), "-q"]);
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    let output = out.join("a.corrected.mcap");
    assert!(std::fs::read(&alone).unwrap() == std::fs::read(&output).unwrap());
    assert!(!out.join("bad.corrected.mcap").exists() && out.join("b.corrected.mcap").exists());

    // The table of the outputs says the same.
    let ran = unwater(&["table", text(&output), text(&out.join("b.corrected.mcap")), "--csv"]);
    let csv = String::from_utf8_lossy(&ran.stdout).into_owned();
    let value = |row: usize, column: &str| {
        let at = csv.lines().next().unwrap().split(',').position(|name| name == column).unwrap();
        csv.lines().nth(row).unwrap().split(',').nth(at).unwrap().to_string()
    };
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    assert_eq!([value(1, "frames"), value(1, "corrected")], ["20", "20"]);
    assert_eq!(value(2, "log"), "b.corrected");
    let [low, alpha, high] =
        ["_low_95", "", "_high_95"].map(|k| value(1, &format!("attenuation_red{k}_per_m")));
    let number = |text: &str| text.parse::<f64>().unwrap();
    assert!(number(&low) < 0.45 && 0.45 < number(&high) && (number(&alpha) - 0.45).abs() < 0.01);
    assert_eq!(unwater(&["table", text(&bad)]).status.code(), Some(1));

    // Finished work is not repeated, other work under its name is refused.
    let written = || std::fs::metadata(&output).unwrap().modified().unwrap();
    let before = written();
    std::fs::remove_file(out.join("b.corrected.mcap")).unwrap();
    let ran = run(&["--resume"]);
    let printed = String::from_utf8_lossy(&ran.stdout).into_owned();
    assert!(ran.status.code() == Some(1) && printed.contains("done before"), "{printed}");
    assert!(out.join("b.corrected.mcap").exists() && written() == before);
    let ran = run(&["--resume", "--json", "--jpeg-quality", "80"]);
    let documents: serde_json::Value = serde_json::from_slice(&ran.stdout).unwrap();
    let error = documents[0]["error"].as_str().unwrap();
    assert!(ran.status.code() == Some(1) && error.contains("exists already"), "{error}");
    assert_eq!(documents.as_array().unwrap().len(), 3);
    // Another input under the same name is other work.
    std::fs::copy(&b, &a).unwrap();
    let only_a = [&["correct", text(&a), "--resume"], &common[..2], &["-o", text(&output)]];
    assert_eq!(unwater(&only_a.concat()).status.code(), Some(1));
    assert!(written() == before);
}

#[test]
fn outputs_of_one_name_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let nested = folder.path().join("nested");
    std::fs::create_dir(&nested).unwrap();
    let (a, b) = (folder.path().join("a.mcap"), nested.join("a.mcap"));
    for path in [&a, &b] {
        std::fs::copy(sample(), path).unwrap();
    }
    let out = folder.path().join("out");
    let ran = unwater(&["correct", text(&a), text(&b), "-o", text(&out)]);
    assert!(ran.status.code() == Some(2) && stderr(&ran).contains("two logs"), "{}", stderr(&ran));
    assert!(!out.exists());
    let ran =
        unwater(&["correct", text(&a), text(&sample()), "-o", text(&folder.path().join("c.mcap"))]);
    assert!(ran.status.code() == Some(2) && stderr(&ran).contains("folder"), "{}", stderr(&ran));
}

/// Nothing is written where an output would replace another input, or a file is given twice.
#[test]
fn inputs_are_given_once_and_are_no_outputs() {
    let folder = tempfile::tempdir().unwrap();
    let of = |name: &str| folder.path().join(name);
    let names = ["a.mcap", "a.corrected.mcap", "p_0.mcap", "p_1.mcap"];
    for name in names {
        std::fs::copy(sample(), of(name)).unwrap();
    }
    let before = std::fs::read_dir(folder.path()).unwrap().count();
    let refused = |command: &str, paths: &[&Path], words: &str| {
        let paths: Vec<&str> = paths.iter().map(|path| text(path)).collect();
        let ran = unwater(&[&[command, "--force"], &paths[..]].concat());
        let error = stderr(&ran);
        assert!(ran.status.code() == Some(2) && error.contains(words), "{words}: {error}");
    };
    let (a, other) = (of("a.mcap"), of("a.corrected.mcap"));
    let output = format!("{}, is the input {}", text(&other), text(&other));
    refused("correct", &[&a, &other], &output);
    let [p_0, p_1, same] = ["p_0.mcap", "p_1.mcap", "./a.mcap"].map(of);
    for command in ["correct", "estimate"] {
        refused(command, &[&a, &a], "a.mcap is given twice");
        refused(command, &[&a, &same], "are the same file");
        refused(command, &[&p_0, &p_1, &p_1], "p_1.mcap is given twice");
    }
    #[cfg(unix)]
    {
        let nested = of("nested");
        std::fs::create_dir(&nested).unwrap();
        std::os::unix::fs::symlink(&a, nested.join("b.mcap")).unwrap();
        refused("correct", &[&a, &nested.join("b.mcap")], "are the same file");
        refused("correct", &[&nested, &a], "are the same file");
        std::fs::remove_dir_all(&nested).unwrap();
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), before);
}

/// The sample in three parts, which number their channels each in its own way. Mounts and
/// calibration are in the first alone.
fn split(folder: &Path) -> [PathBuf; 3] {
    std::fs::create_dir_all(folder).unwrap();
    let all: Vec<Record> = records(&sample());
    let is_latched = |r: &Record| r.topic == "/tf_static" || r.topic.ends_with("camera_info");
    let (latched, others): (Vec<Record>, Vec<Record>) = all.into_iter().partition(is_latched);
    let mut parts: Vec<Vec<Record>> = others.chunks(others.len() / 3 + 1).map(Vec::from).collect();
    parts[0].splice(0..0, latched);
    let path = |n: usize| folder.join(format!("dive_{n}.mcap"));
    parts.iter().enumerate().for_each(|(n, part)| write(&path(n), part));
    [path(0), path(1), path(2)]
}

/// Quick estimates.
const AS_GIVEN: [&str; 2] = ["--self-calibration", "off"];

#[test]
fn the_parts_of_a_recording_are_one_dive() {
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("bag");
    let parts = split(&bag);
    let whole = folder.path().join("whole.mcap");
    let all: Vec<Record> = parts.iter().flat_map(|part| records(part)).collect();
    write(&whole, &all);
    let run = |inputs: &[&str], out: &Path| {
        let ran = unwater(&[&["correct"], inputs, &AS_GIVEN, &["-o", text(out)]].concat());
        assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
        by_topic(out)
    };
    let undivided = run(&[text(&whole)], &folder.path().join("undivided.mcap"));
    let of = |name: &str| folder.path().join(name);
    let (by_folder, by_parts) = (of("by_folder.mcap"), of("by_parts.mcap"));
    let of_bag = run(&[text(&bag)], &by_folder);
    // In any order; the names have it.
    let of_parts = run(&[text(&parts[2]), text(&parts[0]), text(&parts[1])], &by_parts);
    assert!(of_bag == of_parts, "folder and parts differ");
    assert_eq!(of_bag.keys().collect::<Vec<_>>(), undivided.keys().collect::<Vec<_>>());
    // The notes say how many parts there are.
    for (topic, messages) in undivided.iter().filter(|(topic, _)| *topic != "/unwater/log") {
        assert!(of_bag[topic] == *messages, "{topic} differs");
    }
    // Every frame is corrected, also at the cuts: its pings are in another part.
    let recording = Recording::open(&by_folder).unwrap();
    assert!(recording.is_complete && recording.damage.is_empty());
    assert_eq!(of_bag["/camera/image_corrected/compressed"].len(), 20);
    let facts = &recording.metadata.iter().find(|m| m.name == "unwater").unwrap().metadata;
    assert_eq!(facts["source"], "bag");
    let source = Recording::open(&bag).unwrap();
    assert_eq!(facts["source_sha256"], source.sha256().unwrap());
    let bytes: Vec<u8> = parts.iter().flat_map(|part| std::fs::read(part).unwrap()).collect();
    assert_eq!(facts["source_sha256"], unwater::session::sha256(&bytes));

    // `metadata.yaml` has the order and the names, also of a part that is missing.
    let list = |names: &[&str]| {
        let entries: String = names.iter().map(|name| format!("    - {name}\n")).collect();
        format!("rosbag2_bagfile_information:\n  version: 5\n  relative_file_paths:\n{entries}")
    };
    let listed = of("listed");
    std::fs::create_dir(&listed).unwrap();
    for (from, to) in parts.iter().zip(["first.mcap", "second.mcap", "third.mcap"]) {
        std::fs::copy(from, listed.join(to)).unwrap();
    }
    let names = ["first.mcap", "second.mcap", "third.mcap", "fourth.mcap"];
    std::fs::write(listed.join("metadata.yaml"), list(&names[..3])).unwrap();
    let paths = |files: LogFiles| files.files().unwrap();
    assert_eq!(
        paths((&listed).into()),
        names[..3].iter().map(|n| listed.join(n)).collect::<Vec<_>>()
    );
    std::fs::write(listed.join("metadata.yaml"), list(&names)).unwrap();
    let (listed, lossy) = (text(&listed), of("lossy.mcap"));
    let correct = [&["correct", listed, "-o", text(&lossy)], &AS_GIVEN[..]].concat();
    let ran = unwater(&correct);
    assert_eq!(ran.status.code(), Some(3), "{}", stderr(&ran));
    assert!(stderr(&ran).contains("the part fourth.mcap is missing"), "{}", stderr(&ran));
    let ran = unwater(&[&correct[..], &["--force", "--accept-losses"]].concat());
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    assert_eq!(by_topic(&lossy).len(), of_bag.len());
}

#[test]
fn folders_and_parts_that_are_no_recording_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("bag");
    let parts = split(&bag);
    // A part alone lacks what the first has.
    let ran = unwater(&["correct", text(&parts[1])]);
    assert_eq!(ran.status.code(), Some(1));
    // A part that the recorder left empty, and one in between that is gone.
    std::fs::write(bag.join("dive_4.mcap"), "").unwrap();
    let ran = unwater(&["inspect", text(&bag)]);
    let printed = String::from_utf8_lossy(&ran.stdout).into_owned();
    assert_eq!(ran.status.code(), Some(3), "{printed}");
    for damage in ["dive_3.mcap is missing", "dive_4.mcap is not an MCAP file"] {
        assert!(printed.contains(damage), "{damage}: {printed}");
    }
    // Another log in the folder: which one is meant?
    std::fs::copy(sample(), bag.join("other.mcap")).unwrap();
    let ran = unwater(&["correct", text(&bag)]);
    assert!(
        ran.status.code() == Some(1) && stderr(&ran).contains("several logs"),
        "{}",
        stderr(&ran)
    );
    let empty = folder.path().join("empty");
    std::fs::create_dir(&empty).unwrap();
    let ran = unwater(&["inspect", text(&empty)]);
    assert!(stderr(&ran).contains("no .mcap file"), "{}", stderr(&ran));
}

/// Attenuation of a model file, with its standard deviation.
fn attenuation(path: &Path) -> (Vec<f64>, Vec<f64>, serde_json::Value) {
    let model: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    let of = |key: &str| -> Vec<f64> {
        model[key].as_array().unwrap().iter().map(|v| v.as_f64().unwrap_or(f64::NAN)).collect()
    };
    (of("attenuation_per_m"), of("attenuation_std_per_m"), model)
}

#[test]
fn one_strobe_measures_other_waters() {
    let folder = tempfile::tempdir().unwrap();
    let of = |name: &str| folder.path().join(name);
    let dive = |seed, frames, attenuation_per_m| Dive {
        seed,
        frames,
        attenuation_per_m,
        width: 288,
        height: 216,
        focal_px: 340.0,
        ..Dive::default()
    };
    let truth = [0.62, 0.21, 0.14];
    dive(3, 40, Dive::default().attenuation_per_m).write(&of("long.mcap"));
    dive(8, 12, truth).write(&of("short.mcap"));
    let estimate = |log: &str, model: &str, more: &[&str]| {
        let (log, model) = (of(log), of(model));
        let ran = unwater(&[&["estimate", text(&log), "-o", text(&model), "-q"], more].concat());
        assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
        attenuation(&model)
    };
    let (_, _, long) = estimate("long.mcap", "long.json", &[]);
    let shared = of("long.json");
    let (alpha, std, short) = estimate("short.mcap", "short.json", &["--beam-from", text(&shared)]);
    let (free, free_std, _) = estimate("short.mcap", "free.json", &[]);
    for band in 0..3 {
        let name = ["red", "green", "blue"][band];
        println!("free: {name} {} ± {}", free[band] - truth[band], free_std[band]);
        println!("shared beam: {name} {} ± {}", alpha[band] - truth[band], std[band]);
        assert_within(&format!("shared beam: {name} [1/m]"), alpha[band] - truth[band], 0.003);
        assert!(std[band] > 0.0 && std[band] < free_std[band], "{std:?}");
    }
    assert_eq!(short["beam_pattern"], long["beam_pattern"]);
    assert_eq!(short["strobe"], long["strobe"]);
    assert!(short["diagnostics"].to_string().contains("beam-from"));
    assert_eq!(short["inputs"][0]["name"], "short.mcap");
    // `correct` does the same in one run.
    let (log, out) = (of("short.mcap"), of("out.mcap"));
    let ran = unwater(&["correct", text(&log), "-o", text(&out), "--beam-from", text(&shared)]);
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    let recording = Recording::open(&out).unwrap();
    let model = recording.attachments().flatten().find(|a| a.name == "model.json").unwrap();
    let model: serde_json::Value =
        serde_json::from_slice(&recording.attachment_data(&model).unwrap()).unwrap();
    assert_eq!(model["attenuation_per_m"], short["attenuation_per_m"]);
    let ran = unwater(&["verify", text(&out), "--against", text(&log)]);
    assert_eq!(ran.status.code(), Some(0), "{}", String::from_utf8_lossy(&ran.stdout));
    let both = ["correct", text(&log), "--beam-from", text(&shared), "--model", text(&shared)];
    assert_eq!(unwater(&both).status.code(), Some(2));
}

#[test]
fn samples_of_dives_are_estimated_together() {
    let folder = tempfile::tempdir().unwrap();
    let of = |name: &str| folder.path().join(name);
    let waters = [[0.45, 0.14, 0.10], [0.62, 0.21, 0.14], [0.36, 0.08, 0.07]];
    let dive = |seed, attenuation_per_m| Dive {
        seed,
        frames: 24,
        attenuation_per_m,
        width: 240,
        height: 180,
        focal_px: 280.0,
        ..Dive::default()
    };
    let sampled = |number: usize, hour: i32, water: [f64; 3]| {
        let names = ["mcap", "json", "samples"].map(|kind| of(&format!("{number}.{kind}")));
        dive(number as u64, water).write(&names[0]);
        delay(&names[0], 3600 * hour);
        let [log, model, samples] = names.each_ref().map(|name| text(name));
        let ran = unwater(&["estimate", log, "-o", model, "--save-samples", samples, "-q"]);
        assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
        // Alone, they give the same model.
        let again = of("again.json");
        let ran = unwater(&["estimate", "--from", samples, "-o", text(&again), "-q", "--force"]);
        assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
        assert!(std::fs::read(&again).unwrap() == std::fs::read(model).unwrap());
        names
    };
    let dives: Vec<[PathBuf; 3]> =
        waters.iter().zip(1..).map(|(w, n)| sampled(n, n as i32, *w)).collect();
    // The images are not needed any more.
    dives.iter().for_each(|[log, ..]| std::fs::remove_file(log).unwrap());
    let samples: Vec<&str> = dives.iter().map(|d| text(&d[2])).collect();
    let joint = of("joint.json");
    let options = ["-o", text(&joint), "-q"];
    let ran = unwater(&[&["estimate", "--from"], &samples[..], &options].concat());
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    let (_, _, model) = attenuation(&joint);
    assert_eq!(model["identified"], true, "{}", model["not_identified_because"]);
    for (n, truth) in waters.iter().enumerate() {
        let alone = attenuation(&dives[n][1]);
        let input = &model["inputs"][n];
        for band in 0..3 {
            let value = |key: &str| input[key][band].as_f64().expect("a number");
            let (alpha, std) = (value("attenuation_per_m"), value("attenuation_std_per_m"));
            let (error, error_alone) = (alpha - truth[band], alone.0[band] - truth[band]);
            println!("dive {n} band {band}: {error:.4} ± {std:.4}, alone {error_alone:.4}");
            assert_within(&format!("dive {n}, band {band} [σ]"), error / std, 3.0);
        }
    }

    // At the same time in another water: whose attenuation is meant?
    let [.., other] = sampled(4, 1, waters[1]);
    let ran =
        unwater(&["estimate", "--from", samples[0], text(&other), "-o", text(&joint), "--force"]);
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    let (_, _, model) = attenuation(&joint);
    let reason = model["not_identified_because"].as_str().unwrap_or_default();
    assert!(model["identified"] == false && reason.contains("overlap in time"), "{reason}");

    // What does not belong together is refused, and damage is said.
    let same = unwater(&["estimate", "--from", samples[0], samples[0]]);
    assert!(stderr(&same).contains("are the same log"), "{}", stderr(&same));
    let mut bytes = std::fs::read(samples[0]).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    let damaged = of("damaged.samples");
    std::fs::write(&damaged, &bytes).unwrap();
    let ran = unwater(&["estimate", "--from", text(&damaged)]);
    assert!(ran.status.code() == Some(1) && stderr(&ran).contains("damaged"), "{}", stderr(&ran));
    bytes[middle] ^= 1;
    let header = bytes.iter().position(|b| *b == b'\n').unwrap();
    for cut in [0, 1, header - 1, header, header + 1, header + 9, middle, bytes.len() - 1] {
        std::fs::write(&damaged, &bytes[..cut]).unwrap();
        let ran = unwater(&["estimate", "--from", text(&damaged)]);
        let is_named = stderr(&ran).contains("invalid samples in");
        assert!(ran.status.code() == Some(1) && is_named, "cut at {cut}: {}", stderr(&ran));
    }
    let ran = unwater(&["estimate", "--from", text(&joint)]);
    assert!(
        ran.status.code() == Some(1) && stderr(&ran).contains("first line"),
        "{}",
        stderr(&ran)
    );
    assert_eq!(
        unwater(&["estimate", "--from", samples[0], "--rig", "r.toml"]).status.code(),
        Some(2)
    );
}

#[test]
fn stills_and_a_table_become_a_log() {
    let folder = tempfile::tempdir().unwrap();
    let of = |name: &str| folder.path().join(name);
    let model = model(folder.path());
    let (corrected, stills, log) = (of("corrected.mcap"), of("stills"), of("stills.mcap"));
    let sample = sample();
    for args in [
        &["correct", text(&sample), "--model", text(&model), "-o", text(&corrected), "-q"][..],
        &["export", text(&corrected), "-o", text(&stills), "-q"],
    ] {
        let ran = unwater(args);
        assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    }
    // A table as an archive has it, in local time, and one row too many.
    let table = of("nav.csv");
    let rows = std::fs::read_to_string(stills.join("squidle.csv")).unwrap();
    std::fs::write(
        &table,
        format!("{rows}lost,images/lost.jpg,{},,,,,2,0,0,0\n", "2025-06-15 16:00:00"),
    )
    .unwrap();
    let import_to = |log: &Path, more: &[&str]| {
        let args = ["import", text(&stills), "--table", text(&table), "-o", text(log), "--force"];
        unwater(&[&args[..], more].concat())
    };
    let import = |more: &[&str]| import_to(&log, more);
    // A still is no output, whether the table lists it or not.
    let first = stills.join(rows.lines().nth(1).unwrap().split(',').nth(1).unwrap());
    let unlisted = stills.join("unlisted.jpg");
    std::fs::copy(&first, &unlisted).unwrap();
    for still in [&first, &unlisted] {
        let before = std::fs::read(still).unwrap();
        let ran = import_to(still, &[]);
        assert!(stderr(&ran).contains("the output is the input"), "{}", stderr(&ran));
        assert!(std::fs::read(still).unwrap() == before);
    }
    let ran = import(&["--horizontal-fov", "45"]);
    assert_eq!(ran.status.code(), Some(3), "{}", stderr(&ran));
    assert!(stderr(&ran).contains("images/lost.jpg"), "{}", stderr(&ran));
    let recording = Recording::open(&log).unwrap();
    assert!(recording.is_complete && recording.damage.is_empty());
    let topics = by_topic(&log);
    assert_eq!(topics["/camera/image_raw/compressed"].len(), 20);
    assert_eq!(topics["/altimeter"].len(), 20);
    for (row, (_, log_time, _, message)) in
        rows.lines().skip(1).zip(&topics["/camera/image_raw/compressed"])
    {
        let cells: Vec<&str> = row.split(',').collect();
        let still = std::fs::read(stills.join(cells[1])).unwrap();
        assert!(message.windows(still.len()).any(|w| w == still), "{}", cells[1]);
        let millis = humantime::format_rfc3339_millis(
            std::time::UNIX_EPOCH + std::time::Duration::from_nanos(*log_time),
        );
        assert_eq!(millis.to_string(), cells[2].replace(' ', "T") + "Z");
    }
    // Every other command reads it: the altitudes are those of the table.
    let ran = unwater(&["inspect", text(&log), "--json"]);
    let document: serde_json::Value = serde_json::from_slice(&ran.stdout).unwrap();
    assert_eq!(ran.status.code(), Some(0), "{document}");
    let out = of("again.mcap");
    let as_given = ["--self-calibration", "off", "--json"];
    let ran = unwater(&[&["correct", text(&log), "-o", text(&out)], &as_given[..]].concat());
    let report: serde_json::Value = serde_json::from_slice(&ran.stdout).unwrap();
    assert_eq!(report["corrected"], 20, "{}", stderr(&ran));
    let altitudes: Vec<f64> =
        rows.lines().skip(1).filter_map(|row| row.split(',').nth(7)?.parse().ok()).collect();
    let lowest = altitudes.iter().copied().fold(f64::INFINITY, f64::min);
    let off = report["camera_altitude_m"][0].as_f64().unwrap() - lowest;
    assert_within("import: lowest altitude [m]", off, 0.06);
    // In another zone the times are others; what is no table is named.
    let ran = import(&["--utc-offset", "-10:00", "-q"]);
    assert_eq!(ran.status.code(), Some(3));
    let shifted = by_topic(&log);
    let first = |topics: &BTreeMap<String, Vec<Bytes>>| topics["/altimeter"][0].1;
    assert_eq!(first(&shifted) - first(&topics), 36_000_000_000_000);
    std::fs::write(&table, "filename,lat\na.jpg,3\n").unwrap();
    std::fs::remove_file(&log).unwrap();
    let ran = import(&[]);
    let said = stderr(&ran);
    assert!(ran.status.code() == Some(1) && said.contains("the altitude above"), "{said}");
    assert!(!log.exists());
}
