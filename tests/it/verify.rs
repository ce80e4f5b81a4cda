//! `unwater verify` finds what was changed in a corrected log, and nothing in an unchanged one.
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use crate::support::edited::{copy_messages, edited, sample, writer_like};
use unwater::recording::{Entry, Recording, Window};

/// Exit status and document of a verification.
fn verified(output: &Path, more: &[&str]) -> (Option<i32>, serde_json::Value) {
    let path = output.to_str().unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_unwater"));
    let ran = command.args(["verify", path, "--json"]).args(more).output().unwrap();
    let error = String::from_utf8_lossy(&ran.stderr).into_owned();
    let document = serde_json::from_slice(&ran.stdout).unwrap_or_else(|_| error.into());
    (ran.status.code(), document)
}

fn codes(document: &serde_json::Value) -> Vec<&str> {
    let list = document["diagnostics"].as_array().unwrap_or_else(|| panic!("{document}"));
    list.iter().map(|d| d["code"].as_str().unwrap()).collect()
}

fn corrected(input: &Path, output: &Path, more: &[&str]) {
    let [input, output] = [input, output].map(|path| path.to_str().unwrap());
    let mut command = Command::new(env!("CARGO_BIN_EXE_unwater"));
    let ran = command.args(["correct", input, "-o", output, "-q"]).args(more).output().unwrap();
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
}

/// The sample, corrected once for all tests.
fn output() -> &'static Path {
    static MADE: OnceLock<(tempfile::TempDir, PathBuf)> = OnceLock::new();
    &MADE
        .get_or_init(|| {
            let folder = tempfile::tempdir().unwrap();
            let output = folder.path().join("out.mcap");
            corrected(&sample(), &output, &[]);
            (folder, output)
        })
        .1
}

/// What is changed in a copy.
struct Edit<'e> {
    /// topic and payload of a message; whether it is kept
    message: &'e dyn Fn(&str, &mut Vec<u8>) -> bool,
    /// name and data of an attachment
    attachment: &'e dyn Fn(&str, &mut Vec<u8>),
}

/// Copies a log with changes, whose checksums are right.
fn rewritten(source: &Path, target: &Path, edit: &Edit<'_>) {
    let log = Recording::open(source).unwrap();
    let mut writer = writer_like(&log, target, mcap::WriteOptions::new());
    copy_messages(&log, &mut writer, edit.message);
    for attachment in log.attachments().flatten() {
        let mut data = log.attachment_data(&attachment).unwrap();
        (edit.attachment)(&attachment.name, &mut data);
        writer
            .attach(&mcap::Attachment {
                log_time: attachment.log_time,
                create_time: attachment.create_time,
                name: attachment.name.clone(),
                media_type: attachment.media_type.clone(),
                data: data.into(),
            })
            .unwrap();
    }
    for metadata in &log.metadata {
        writer.write_metadata(metadata).unwrap();
    }
    writer.finish().unwrap();
}

const KEEP: Edit<'static> = Edit { message: &|_, _| true, attachment: &|_, _| {} };

/// True for the n-th message of a topic.
fn nth(topic: &'static str, n: usize) -> impl Fn(&str) -> bool {
    let seen = std::cell::Cell::new(0);
    move |of: &str| {
        let is_topic = of == topic;
        seen.set(seen.get() + usize::from(is_topic));
        is_topic && seen.get() == n + 1
    }
}

#[test]
fn nothing_is_found_in_what_was_not_changed() {
    let input = sample();
    let against = ["--against", input.to_str().unwrap()];
    for more in [&[][..], &against] {
        let (status, document) = verified(output(), more);
        assert_eq!((status, codes(&document)), (Some(0), vec![]), "{document}");
        assert!(document["repeated_messages"].as_u64().unwrap() > 150);
        assert_eq!(
            document["input_messages"].as_u64(),
            Some(if more.is_empty() { 0 } else { 1040 })
        );
    }
    // Chunks in another arrangement are the same log.
    let folder = tempfile::tempdir().unwrap();
    let copy = folder.path().join("copy.mcap");
    rewritten(output(), &copy, &KEEP);
    assert_eq!(verified(&copy, &against).0, Some(0));
}

#[test]
fn each_change_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let copy = folder.path().join("copy.mcap");
    let input = sample();
    let against = ["--against", input.to_str().unwrap()];
    let found = |edit: &Edit<'_>, more: &[&str]| {
        rewritten(output(), &copy, edit);
        let (status, document) = verified(&copy, more);
        assert_eq!(status, Some(1), "{document}");
        assert_eq!(document["verified"], false);
        document
    };
    // A pixel of a corrected frame.
    let is_seventh = nth("/camera/image_corrected/compressed", 6);
    let pixel = |topic: &str, data: &mut Vec<u8>| {
        if is_seventh(topic) {
            let middle = data.len() / 2;
            data[middle] ^= 1;
        }
        true
    };
    let document = found(&Edit { message: &pixel, ..KEEP }, &[]);
    assert_eq!(codes(&document), ["verify-not-reproduced"]);
    let difference = &document["diagnostics"][0];
    assert_eq!(difference["topic"], "/camera/image_corrected/compressed");
    assert_eq!((&difference["messages"], &difference["of"]), (&1.into(), &20.into()));

    // A pixel of a raw frame: its corrected frame no longer follows from it.
    let is_third = nth("/camera/image_raw", 2);
    let raw = |topic: &str, data: &mut Vec<u8>| {
        if is_third(topic) {
            let end = data.len();
            data[end / 2..end / 2 + 4000].fill(200);
        }
        true
    };
    let document = found(&Edit { message: &raw, ..KEEP }, &[]);
    assert!(codes(&document).contains(&"verify-not-reproduced"), "{document}");

    // A parameter: of the model, of a message, of the settings.
    let model = |name: &str, data: &mut Vec<u8>| {
        if name == "model.json" {
            let text = String::from_utf8(data.clone()).unwrap();
            *data = text.replacen("\"gain\": [\n", "\"gain\": [ \n", 1).into_bytes();
        }
    };
    let document = found(&Edit { attachment: &model, ..KEEP }, &[]);
    assert_eq!(codes(&document), ["verify-attachment"]);
    let is_second = nth("/unwater/attenuation", 1);
    let parameter = |topic: &str, data: &mut Vec<u8>| {
        if is_second(topic) {
            *data.last_mut().unwrap() ^= 1;
        }
        true
    };
    let document = found(&Edit { message: &parameter, ..KEEP }, &[]);
    assert_eq!(codes(&document), ["verify-not-reproduced"]);
    let settings = |name: &str, data: &mut Vec<u8>| {
        if name == "unwater.toml" {
            data.extend(b"\n");
        }
    };
    let document = found(&Edit { attachment: &settings, ..KEEP }, &[]);
    assert_eq!(codes(&document), ["verify-attachment"]);

    // A message of the input that is missing, and one that is changed.
    let is_dropped = nth("/imu", 100);
    let dropped = |topic: &str, _: &mut Vec<u8>| !is_dropped(topic);
    let document = found(&Edit { message: &dropped, ..KEEP }, &against);
    assert_eq!(codes(&document), ["verify-messages"]);
    let difference = &document["diagnostics"][0];
    assert_eq!((&difference["found"], &difference["expected"]), (&443.into(), &444.into()));
    let is_pressure = nth("/pressure", 50);
    let changed = |topic: &str, data: &mut Vec<u8>| {
        if is_pressure(topic) {
            data[12] ^= 1;
        }
        true
    };
    let document = found(&Edit { message: &changed, ..KEEP }, &against);
    assert_eq!(codes(&document), ["verify-messages"]);

    // Another input.
    let other = folder.path().join("other.mcap");
    edited(&other, |record| {
        if record.topic == "/depth" {
            *record.data.last_mut().unwrap() ^= 1;
        }
    });
    let (status, document) = verified(output(), &["--against", other.to_str().unwrap()]);
    assert_eq!(status, Some(1));
    assert!(codes(&document).contains(&"verify-other-input"), "{document}");

    // Damage: a flipped bit in the middle of the file.
    let mut bytes = std::fs::read(output()).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&copy, bytes).unwrap();
    assert_eq!(verified(&copy, &[]).0, Some(1));
}

#[test]
fn outputs_of_other_options_are_verified_too() {
    let folder = tempfile::tempdir().unwrap();
    let (out, input) = (folder.path().join("out.mcap"), sample());
    let against = ["--against", input.to_str().unwrap()];
    // Without raw images only the input can show whether the frames follow from it.
    corrected(&input, &out, &["--drop-raw"]);
    let (status, document) = verified(&out, &[]);
    assert_eq!((status, codes(&document)), (Some(3), vec!["verify-not-repeated"]));
    assert_eq!(verified(&out, &against).0, Some(0));
    // A window, other formats, a baseline.
    let times: Vec<u64> = Recording::open(&input)
        .unwrap()
        .messages(Window::ALL)
        .filter_map(|entry| if let Entry::Message(m) = entry { Some(m.log_time) } else { None })
        .collect();
    let (first, last) = (times.iter().min().unwrap(), times.iter().max().unwrap());
    let end = (first + (last - first) * 3 / 4).to_string();
    for options in [
        &["-E", end.as_str()][..],
        &["--depth", "16", "--mask", "--only", "^/(camera|dvl|imu|tf_static)"],
        &["--method", "grey-world", "--image-format", "raw"],
    ] {
        corrected(&input, &out, &[options, &["--force"]].concat());
        for more in [&[][..], &against] {
            let (status, document) = verified(&out, more);
            assert_eq!((status, codes(&document)), (Some(0), vec![]), "{options:?} {document}");
        }
    }
}

/// `--drop-raw` keeps the frames that were not corrected; they are compared with the input.
#[test]
fn frames_that_passed_through_are_no_fault() {
    let folder = tempfile::tempdir().unwrap();
    let [input, out, copy] = ["in.mcap", "out.mcap", "copy.mcap"].map(|n| folder.path().join(n));
    let is_cut = [nth("/camera/image_raw", 3), nth("/camera/image_raw", 11)];
    edited(&input, |record| {
        if is_cut.iter().filter(|is_cut| is_cut(&record.topic)).count() > 0 {
            record.data.truncate(200);
        }
    });
    let against = ["--against", input.to_str().unwrap()];
    corrected(&input, &out, &["--drop-raw", "--accept-losses"]);
    let (status, document) = verified(&out, &[]);
    assert_eq!((status, codes(&document)), (Some(3), vec!["verify-not-repeated"]));
    let (status, document) = verified(&out, &against);
    assert_eq!((status, codes(&document)), (Some(0), vec![]), "{document}");
    let kept = document["input_messages"].as_u64().unwrap();
    // One of them is missing: that is a fault.
    let is_second = nth("/camera/image_raw", 1);
    rewritten(&out, &copy, &Edit { message: &|topic, _| !is_second(topic), ..KEEP });
    let (status, document) = verified(&copy, &against);
    assert_eq!((status, codes(&document)), (Some(1), vec!["verify-messages"]), "{document}");
    assert_eq!(document["input_messages"].as_u64(), Some(kept));
    let found = &document["diagnostics"][0];
    assert_eq!((&found["found"], &found["expected"]), (&1.into(), &2.into()));
}
