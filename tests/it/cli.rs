//! The program as a user runs it: exit statuses, nothing lost, nothing half written, the same bytes
//! every time.
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

use crate::support::render::Dive;
use unwater::recording::{Entry, Message, Recording, Window};

fn unwater(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_unwater")).args(args).output().expect("the program runs")
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A small dive, rendered once for all tests.
fn dive() -> &'static Path {
    static DIVE: OnceLock<(tempfile::TempDir, PathBuf)> = OnceLock::new();
    &DIVE
        .get_or_init(|| {
            let folder = tempfile::tempdir().expect("a folder");
            let path = folder.path().join("dive.mcap");
            Dive { frames: 14, width: 288, height: 216, focal_px: 340.0, ..Dive::default() }
                .write(&path);
            (folder, path)
        })
        .1
}

fn text(path: &Path) -> &str {
    path.to_str().expect("a plain path")
}

/// Messages of a log by topic, in order.
fn by_topic(path: &Path) -> BTreeMap<String, Vec<Message>> {
    let recording = Recording::open(path).expect("a log");
    let mut topics: BTreeMap<String, Vec<Message>> =
        recording.channels.values().map(|c| (c.topic.clone(), Vec::new())).collect();
    for entry in recording.messages(Window::ALL) {
        if let Entry::Message(m) = entry {
            topics.entry(recording.channels[&m.channel].topic.clone()).or_default().push(m);
        }
    }
    topics
}

fn assert_same(topic: &str, a: &[Message], b: &[Message]) {
    assert_eq!(a.len(), b.len(), "{topic}");
    for (a, b) in a.iter().zip(b) {
        assert_eq!(
            (a.sequence, a.log_time, a.publish_time),
            (b.sequence, b.log_time, b.publish_time),
            "{topic}"
        );
        assert!(a.data() == b.data(), "{topic}: bytes differ");
    }
}

#[test]
fn output_holds_the_whole_input_and_does_not_depend_on_threads() {
    let folder = tempfile::tempdir().unwrap();
    // An input with an attachment, a metadata record, an empty channel with QoS, two channels
    // alike, and an unknown encoding.
    let rich = folder.path().join("rich.mcap");
    enrich(dive(), &rich);
    let (one, two) = (folder.path().join("one.mcap"), folder.path().join("two.mcap"));
    for (threads, out) in [("1", &one), ("2", &two)] {
        let ran = unwater(&["correct", text(&rich), "-o", text(out), "-j", threads]);
        assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    }
    assert!(
        std::fs::read(&one).unwrap() == std::fs::read(&two).unwrap(),
        "the bytes depend on the threads"
    );

    let (before, after) = (by_topic(&rich), by_topic(&one));
    for (topic, messages) in &before {
        assert_same(topic, messages, &after[topic]);
    }
    let (input, output) = (Recording::open(&rich).unwrap(), Recording::open(&one).unwrap());
    assert!(output.is_complete && output.damage.is_empty());
    for (id, channel) in &input.channels {
        assert_eq!(output.channels.get(id), Some(channel), "channel {id} with its metadata");
    }
    for (id, schema) in &input.schemas {
        assert_eq!(output.schemas.get(id), Some(schema), "schema {id}");
    }
    let first = output.attachments().next().unwrap().unwrap();
    assert_eq!(
        (first.name.as_str(), &output.attachment_data(&first).unwrap()[..]),
        ("notes.txt", &b"weather: fair"[..])
    );
    let names: Vec<String> = output.attachments().map(|a| a.unwrap().name).collect();
    assert_eq!(names, ["notes.txt", "model.json", "report.json", "unwater.toml", "rig.toml"]);
    assert_eq!(output.metadata[0], input.metadata[0]);
    let ours = output.metadata.iter().find(|m| m.name == "unwater").expect("a metadata record");
    for key in [
        "version",
        "camera_topic",
        "corrected_topic",
        "dvl_topic",
        "method",
        "model_sha256",
        "source",
        "source_sha256",
        "configuration",
    ] {
        assert!(ours.metadata.contains_key(key), "{key}");
    }

    // One corrected image per source image, with its times.
    let (raw, corrected) =
        (&after["/camera/image_raw"], &after["/camera/image_corrected/compressed"]);
    assert_eq!(raw.len(), corrected.len());
    assert!(
        raw.iter()
            .zip(corrected)
            .all(|(a, b)| (a.log_time, a.publish_time) == (b.log_time, b.publish_time))
    );
    for topic in ["/unwater/attenuation", "/unwater/seafloor", "/unwater/frame"] {
        assert_eq!(after[topic].len(), raw.len(), "{topic}");
    }
    assert!(!after["/unwater/beam_pattern"].is_empty() && !after["/unwater/log"].is_empty());
    assert!(
        std::fs::read_dir(folder.path())
            .unwrap()
            .flatten()
            .all(|f| !f.file_name().to_string_lossy().ends_with(".part"))
    );
}

/// Copies a log and adds what a careless rewriter loses.
fn enrich(source: &Path, target: &Path) {
    let recording = Recording::open(source).unwrap();
    let mut writer = mcap::WriteOptions::new()
        .profile("ros2")
        .chunk_size(Some(1 << 18))
        .compression(Some(mcap::Compression::Lz4))
        .create(std::io::BufWriter::new(std::fs::File::create(target).unwrap()))
        .unwrap();
    for (id, s) in &recording.schemas {
        writer.add_schema_with_id(*id, &s.name, &s.encoding, &s.data).unwrap();
    }
    for (id, c) in &recording.channels {
        writer
            .add_channel_with_id(*id, c.schema_id, &c.topic, &c.message_encoding, &c.metadata)
            .unwrap();
    }
    let qos = BTreeMap::from([("offered_qos_profiles".to_string(), "- durability: 1".to_string())]);
    writer.add_channel_with_id(900, 0, "/empty", "json", &qos).unwrap();
    writer.add_channel_with_id(901, 0, "/alike", "json", &BTreeMap::new()).unwrap();
    writer.add_channel_with_id(902, 0, "/alike", "json", &BTreeMap::new()).unwrap();
    for entry in recording.messages(Window::ALL) {
        if let Entry::Message(m) = entry {
            let header = mcap::records::MessageHeader {
                channel_id: m.channel,
                sequence: m.sequence + 7,
                log_time: m.log_time,
                publish_time: m.publish_time - 3,
            };
            writer.write_to_known_channel(&header, m.data()).unwrap();
            let odd = mcap::records::MessageHeader {
                channel_id: 901 + (m.sequence % 2) as u16,
                sequence: 5,
                log_time: m.log_time,
                publish_time: 1,
            };
            writer.write_to_known_channel(&odd, b"{\"not\": \"ours\"}").unwrap();
        }
    }
    writer
        .attach(&mcap::Attachment {
            log_time: 5,
            create_time: 6,
            name: "notes.txt".into(),
            media_type: "text/plain".into(),
            data: b"weather: fair"[..].into(),
        })
        .unwrap();
    writer
        .write_metadata(&mcap::records::Metadata {
            name: "rosbag2".into(),
            metadata: BTreeMap::from([("ROS_DISTRO".into(), "jazzy".into())]),
        })
        .unwrap();
    writer.finish().unwrap();
}

#[test]
fn the_input_is_never_overwritten_and_other_files_only_by_force() {
    let folder = tempfile::tempdir().unwrap();
    let (copy, link) = (folder.path().join("dive.mcap"), folder.path().join("link.mcap"));
    std::fs::copy(dive(), &copy).unwrap();
    std::fs::hard_link(&copy, &link).unwrap();
    for out in [&copy, &link] {
        let ran = unwater(&["correct", text(&copy), "-o", text(out), "--force"]);
        assert_eq!(ran.status.code(), Some(1));
        assert!(stderr(&ran).contains("the input itself"), "{}", stderr(&ran));
    }
    #[cfg(unix)]
    {
        let soft = folder.path().join("soft.mcap");
        std::os::unix::fs::symlink(&copy, &soft).unwrap();
        assert_eq!(
            unwater(&["correct", text(&copy), "-o", text(&soft), "--force"]).status.code(),
            Some(1)
        );
    }
    assert!(std::fs::read(&copy).unwrap() == std::fs::read(dive()).unwrap());
    let taken = folder.path().join("taken.mcap");
    std::fs::write(&taken, "precious").unwrap();
    let ran = unwater(&["correct", text(&copy), "-o", text(&taken)]);
    assert!(ran.status.code() == Some(1) && stderr(&ran).contains("--force"), "{}", stderr(&ran));
    assert_eq!(std::fs::read(&taken).unwrap(), b"precious");
}

#[test]
fn default_output_names_depend_on_model_and_window() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("dive.mcap");
    std::fs::copy(dive(), &input).unwrap();
    assert_eq!(unwater(&["estimate", text(&input), "-q"]).status.code(), Some(0));
    let model = folder.path().join("dive.model.json");
    let json: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(&model).unwrap()).unwrap();
    assert_eq!(
        (json["format"].as_str(), json["version"].as_u64(), json["attenuation_kind"].as_str()),
        (Some("unwater-model"), Some(1), Some("physical"))
    );
    assert_eq!(json["attenuation_per_m"].as_array().unwrap().len(), 3);
    for name in ["joint", "pairs", "altitude"] {
        assert!(json["estimators"].get(name).is_some(), "{name}");
    }
    let ran = unwater(&["correct", text(&input), "--model", text(&model), "--drop-raw", "--json"]);
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    let report: serde_json::Value =
        serde_json::from_slice(&ran.stdout).expect("one JSON document on stdout");
    assert_eq!(report["corrected"], report["frames"]);
    let topics = by_topic(&folder.path().join("dive.corrected.mcap"));
    assert!(
        !topics.contains_key("/camera/image_raw")
            && topics["/camera/image_corrected/compressed"].len() == 14
    );

    // A cut: start inclusive, end exclusive, whatever is outside is not there.
    let times: Vec<u64> =
        by_topic(&input)["/camera/image_raw"].iter().map(|m| m.log_time).collect();
    let cut = folder.path().join("cut.mcap");
    let (start, end) = (times[3].to_string(), times[8].to_string());
    let ran = unwater(&[
        "correct",
        text(&input),
        "--model",
        text(&model),
        "-o",
        text(&cut),
        "-S",
        &start,
        "-E",
        &end,
        "--image-format",
        "raw",
        "--only",
        "^/camera/",
    ]);
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    let topics = by_topic(&cut);
    assert_eq!(
        topics["/camera/image_raw"].iter().map(|m| m.log_time).collect::<Vec<_>>(),
        times[3..8]
    );
    assert_eq!(topics["/camera/image_corrected"].len(), 5);
    assert!(!topics.contains_key("/dvl/data"));
}

#[test]
fn a_truncated_log_gives_every_readable_frame_or_one_error() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("model.json");
    assert_eq!(
        unwater(&["estimate", text(dive()), "-o", text(&model), "-q"]).status.code(),
        Some(0)
    );
    let many_chunks = folder.path().join("many_chunks.mcap");
    enrich(dive(), &many_chunks);
    let whole = std::fs::read(&many_chunks).unwrap();
    let (cut, out) = (folder.path().join("cut.mcap"), folder.path().join("out.mcap"));
    let mut most = 0;
    for k in 0..50 {
        std::fs::write(&cut, &whole[..whole.len() * k / 50]).unwrap();
        let readable = Recording::open(&cut)
            .map_or(0, |_| by_topic(&cut).get("/camera/image_raw").map_or(0, Vec::len));
        let ran = unwater(&[
            "correct",
            text(&cut),
            "--model",
            text(&model),
            "-o",
            text(&out),
            "--force",
            "--json",
        ]);
        match ran.status.code() {
            Some(3) => {
                let report: serde_json::Value = serde_json::from_slice(&ran.stdout).unwrap();
                assert_eq!(report["frames"].as_u64(), Some(readable as u64), "cut {k}");
                assert_eq!(
                    by_topic(&out).get("/camera/image_raw").map_or(0, Vec::len),
                    readable,
                    "cut {k}"
                );
                most = most.max(readable);
                std::fs::remove_file(&out).unwrap();
            }
            Some(1) => {
                assert!(
                    stderr(&ran).starts_with("unwater: ") && stderr(&ran).lines().count() <= 3,
                    "cut {k}: {}",
                    stderr(&ran)
                );
                assert!(!out.exists(), "cut {k}: something stands at OUT");
            }
            other => panic!("cut {k}: exit {other:?}: {}", stderr(&ran)),
        }
    }
    assert!(
        most >= 12,
        "a log without its last fiftieth still holds nearly all frames, not {most}"
    );
}

#[test]
fn a_damaged_chunk_is_left_out_and_listed() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("model.json");
    assert_eq!(
        unwater(&["estimate", text(dive()), "-o", text(&model), "-q"]).status.code(),
        Some(0)
    );
    let many_chunks = folder.path().join("many_chunks.mcap");
    enrich(dive(), &many_chunks);
    let mut bytes = std::fs::read(&many_chunks).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle..middle + 64].iter_mut().for_each(|b| *b ^= 0x5a);
    let (bad, out) = (folder.path().join("bad.mcap"), folder.path().join("out.mcap"));
    std::fs::write(&bad, &bytes).unwrap();
    let ran = unwater(&["correct", text(&bad), "--model", text(&model), "-o", text(&out)]);
    assert_eq!(ran.status.code(), Some(3), "{}", stderr(&ran));
    assert!(stderr(&ran).contains("damaged chunk"), "{}", stderr(&ran));
    let frames = by_topic(&out)["/camera/image_raw"].len();
    assert!((1..14).contains(&frames), "{frames} frames");
    assert_eq!(unwater(&["inspect", text(&bad)]).status.code(), Some(3));
}

#[test]
fn frames_without_a_seafloor_are_copied_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    // The DVL has no returns in the second half.
    let recording = Recording::open(dive()).unwrap();
    let half = folder.path().join("half.mcap");
    let mut writer = mcap::WriteOptions::new()
        .create(std::io::BufWriter::new(std::fs::File::create(&half).unwrap()))
        .unwrap();
    let times: Vec<u64> =
        by_topic(dive())["/camera/image_raw"].iter().map(|m| m.log_time).collect();
    for (id, s) in &recording.schemas {
        writer.add_schema_with_id(*id, &s.name, &s.encoding, &s.data).unwrap();
    }
    for (id, c) in &recording.channels {
        writer
            .add_channel_with_id(*id, c.schema_id, &c.topic, &c.message_encoding, &c.metadata)
            .unwrap();
    }
    for entry in recording.messages(Window::ALL) {
        let Entry::Message(m) = entry else { continue };
        if recording.channels[&m.channel].topic != "/dvl/data" || m.log_time < times[9] {
            let header = mcap::records::MessageHeader {
                channel_id: m.channel,
                sequence: m.sequence,
                log_time: m.log_time,
                publish_time: m.publish_time,
            };
            writer.write_to_known_channel(&header, m.data()).unwrap();
        }
    }
    writer.finish().unwrap();
    let out = folder.path().join("out.mcap");
    let ran = unwater(&["correct", text(&half), "-o", text(&out), "--json"]);
    assert_eq!(ran.status.code(), Some(3), "{}", stderr(&ran));
    let report: serde_json::Value = serde_json::from_slice(&ran.stdout).unwrap();
    let lost = report["uncorrected"]["no range to the seafloor near enough in time"]
        .as_u64()
        .expect("a reason");
    assert_eq!(report["corrected"].as_u64().unwrap() + lost, 14);
    assert!((3..=5).contains(&lost), "{lost}");
    let losses = report["diagnostics"].as_array().unwrap();
    let loss = losses.iter().find(|d| d["code"] == "no-ping").expect("a code");
    assert_eq!((&loss["frames"], &loss["severity"]), (&lost.into(), &"loss".into()));
    assert!(loss["remedy"].as_str().is_some_and(|r| r.contains("--dvl TOPIC")), "{loss}");
    let topics = by_topic(&out);
    assert_eq!((topics["/camera/image_raw"].len(), topics["/unwater/frame"].len()), (14, 14));
    assert_eq!(topics["/camera/image_corrected/compressed"].len() as u64, 14 - lost);
}

#[cfg(unix)]
#[test]
fn an_interrupted_run_leaves_no_output() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.mcap");
    for (signal, millis) in [
        ("-KILL", 20),
        ("-KILL", 150),
        ("-KILL", 400),
        ("-TERM", 300),
        ("-INT", 500),
        ("-TERM", 700),
    ] {
        let mut child = Command::new(env!("CARGO_BIN_EXE_unwater"))
            .args(["correct", text(dive()), "-o", text(&out), "-q"])
            .spawn()
            .unwrap();
        std::thread::sleep(std::time::Duration::from_millis(millis));
        let _sent = Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
        let ended = child.wait().unwrap();
        if ended.success() {
            std::fs::remove_file(&out).unwrap(); // it was quicker than the signal
        } else {
            assert!(!out.exists(), "{signal} after {millis} ms");
        }
        let parts = std::fs::read_dir(folder.path())
            .unwrap()
            .flatten()
            .filter(|f| f.file_name().to_string_lossy().ends_with(".part"))
            .count();
        assert!(signal == "-KILL" || parts == 0, "{signal}: an unfinished file is left");
        std::fs::read_dir(folder.path())
            .unwrap()
            .flatten()
            .for_each(|f| std::fs::remove_file(f.path()).unwrap());
    }
}

#[test]
fn missing_inputs_are_reported_with_a_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let messages = Path::new(env!("CARGO_MANIFEST_DIR")).join("sample_logs/messages");
    let missing = folder.path().join("missing.mcap");
    let empty = folder.path().join("empty.mcap");
    std::fs::write(&empty, b"").unwrap();
    let bag = folder.path().join("old.bag");
    std::fs::write(&bag, b"#ROSBAG V2.0\n").unwrap();
    let cases: [(PathBuf, i32, &str); 6] = [
        (missing, 1, "cannot read"),
        (empty, 1, "empty"),
        (bag, 1, "mcap convert"),
        (messages.join("dvl_waterlinked.mcap"), 1, "no camera images"),
        (messages.join("image_rgb8.mcap"), 1, "no calibration"),
        (messages.join("imu.mcap"), 1, "no camera images"),
    ];
    for (path, code, words) in cases {
        let ran = unwater(&["correct", text(&path), "-o", text(&folder.path().join("out.mcap"))]);
        assert_eq!(ran.status.code(), Some(code), "{path:?}: {}", stderr(&ran));
        assert!(stderr(&ran).contains(words), "{path:?}: {}", stderr(&ran));
        assert!(!stderr(&ran).contains("panicked"));
    }
    for bad in [
        &["correct"][..],
        &["correct", "x.mcap", "--metod", "full"],
        &["inspect", "x.mcap", "-S", "yesterday"],
        &["config", "--depth", "12"],
        &["config", "--depth", "16", "--image-format", "jpeg"],
    ] {
        assert_eq!(unwater(bad).status.code(), Some(2), "{bad:?}");
    }
    let settings = folder.path().join("settings.toml");
    std::fs::write(&settings, "[render]\njpg_quality = 90\n").unwrap();
    let ran = unwater(&["config", "--config", text(&settings)]);
    assert!(
        !ran.status.success() && stderr(&ran).contains("render.jpeg_quality"),
        "{}",
        stderr(&ran)
    );
}

#[test]
fn the_rig_file_of_init_gives_the_same_rig() {
    let folder = tempfile::tempdir().unwrap();
    let rig = folder.path().join("rig.toml");
    assert_eq!(unwater(&["init", text(dive()), "-o", text(&rig)]).status.code(), Some(0));
    let (plain, with_rig) = (folder.path().join("a.json"), folder.path().join("b.json"));
    assert_eq!(
        unwater(&["estimate", text(dive()), "-o", text(&plain), "-q"]).status.code(),
        Some(0)
    );
    assert_eq!(
        unwater(&["estimate", text(dive()), "-o", text(&with_rig), "-q", "--rig", text(&rig)])
            .status
            .code(),
        Some(0)
    );
    let alpha = |p: &Path| {
        serde_json::from_str::<serde_json::Value>(&std::fs::read_to_string(p).unwrap()).unwrap()
            ["attenuation_per_m"]
            .clone()
    };
    for (a, b) in alpha(&plain).as_array().unwrap().iter().zip(alpha(&with_rig).as_array().unwrap())
    {
        assert!((a.as_f64().unwrap() - b.as_f64().unwrap()).abs() < 1e-6);
    }
    // For a log without any of it, the file marks what is to be filled in.
    let bare = Path::new(env!("CARGO_MANIFEST_DIR")).join("sample_logs/messages/image_rgb8.mcap");
    let ran = unwater(&["init", text(&bare), "-o", "-"]);
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    assert!(String::from_utf8_lossy(&ran.stdout).contains("FILL IN"));
}

#[test]
fn rectified_images_have_their_own_calibration() {
    let folder = tempfile::tempdir().unwrap();
    let (input, out) = (folder.path().join("bent.mcap"), folder.path().join("straight.mcap"));
    Dive {
        frames: 12,
        width: 288,
        height: 216,
        focal_px: 340.0,
        distortion: [0.2, 0.05, 0.0, 0.0, 0.0],
        ..Dive::default()
    }
    .write(&input);
    let ran = unwater(&["correct", text(&input), "-o", text(&out), "--rectify"]);
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    let topics = by_topic(&out);
    assert_eq!(topics["/camera/image_corrected/camera_info"].len(), 12);
}

#[test]
fn init_writes_known_values_and_a_field_of_view_completes_them() {
    let folder = tempfile::tempdir().unwrap();
    // Images alone: their size is known, the rest is to be filled in.
    let images = Path::new(env!("CARGO_MANIFEST_DIR")).join("sample_logs/messages/image_rgb8.mcap");
    let ran = unwater(&["init", text(&images), "-o", "-"]);
    let said = String::from_utf8_lossy(&ran.stdout).into_owned();
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    assert!(
        said.contains("\nwidth = ")
            && said.contains("\nheight = ")
            && said.contains("# fx =   # FILL IN")
            && said.contains("no readable DVL"),
        "{said}"
    );
    assert!(toml::from_str::<unwater::vehicle::RigFile>(&said).is_ok(), "{said}");

    // Without ranges: calibration, and the mounts that TF tells.
    let no_ranges = folder.path().join("no_ranges.mcap");
    let only = "^/(camera/(image_raw|camera_info)$|tf_static)";
    assert_eq!(
        unwater(&["correct", text(dive()), "-o", text(&no_ranges), "-q", "--only", only])
            .status
            .code(),
        Some(0)
    );
    let ran = unwater(&["init", text(&no_ranges), "-o", "-"]);
    let said = String::from_utf8_lossy(&ran.stdout).into_owned();
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    let rig: unwater::vehicle::RigFile =
        toml::from_str(&said).unwrap_or_else(|e| panic!("{e}: {said}"));
    let place = |mount: Option<unwater::vehicle::MountFacts>| mount.map(|m| m.translation_m);
    assert_eq!(place(rig.camera.mount), Some([0.34, -0.1, -0.12]), "{said}");
    assert_eq!(place(rig.strobe.mount), Some([-0.53, 0.09, -0.07]), "{said}");
    assert!(
        rig.camera.fx.is_some()
            && rig.dvl.mount.is_none()
            && said.contains("# [dvl.mount]  # FILL IN"),
        "{said}"
    );

    // A field of view alone is enough, and its accuracy is reported.
    let rig = folder.path().join("rig.toml");
    std::fs::write(&rig, "[camera]\nhorizontal_field_of_view_deg = 45.9\n").unwrap();
    let out = folder.path().join("out.mcap");
    let ran = unwater(&["correct", text(dive()), "--rig", text(&rig), "-o", text(&out)]);
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    assert!(
        stderr(&ran).contains("field of view alone") && stderr(&ran).contains("per metre"),
        "{}",
        stderr(&ran)
    );
}

#[test]
fn layouts_list_the_topics_of_corrected_logs_only() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.mcap");
    assert_eq!(unwater(&["correct", text(dive()), "-o", text(&out), "-q"]).status.code(), Some(0));
    let topics = by_topic(&out);
    let layout = folder.path().join("out.foxglove.json");
    assert_eq!(unwater(&["layout", text(&out), "--foxglove"]).status.code(), Some(0));
    let said = std::fs::read_to_string(&layout).unwrap();
    let json: serde_json::Value = serde_json::from_str(&said).unwrap();
    let panels = json["configById"].as_object().unwrap();
    let shown: Vec<&str> =
        panels.values().filter_map(|p| p["imageMode"]["imageTopic"].as_str()).collect();
    assert_eq!(
        shown,
        [
            "/unwater/raw/compressed",
            "/camera/image_corrected/compressed",
            "/unwater/beam_pattern/picture/compressed"
        ]
    );
    for panel in panels.values().filter_map(|p| p["topics"].as_object()) {
        assert!(panel.len() == 4 && panel.keys().all(|t| topics.contains_key(t)), "{panel:?}");
    }
    assert_eq!(topics["/unwater/raw/compressed"].len(), topics["/camera/image_raw"].len());

    // Nothing is overwritten unasked; a log that was not corrected has no views; one viewer has to
    // be named.
    let ran = unwater(&["layout", text(&out), "--foxglove"]);
    assert!(ran.status.code() == Some(1) && stderr(&ran).contains("--force"), "{}", stderr(&ran));
    let ran = unwater(&["layout", text(dive()), "--rerun", "-o", "-"]);
    assert!(
        ran.status.code() == Some(1) && stderr(&ran).contains("unwater correct"),
        "{}",
        stderr(&ran)
    );
    assert_eq!(unwater(&["layout", text(&out)]).status.code(), Some(2));
    let ran = unwater(&["layout", text(&out), "--rerun", "-o", "-"]);
    assert!(
        String::from_utf8_lossy(&ran.stdout).contains("\"seafloor_frame\": \"unwater/seafloor\"")
    );
}
