//! Logs of several cameras: each is corrected with a model of its own, as if it were the only one.
use std::collections::BTreeMap;
use std::path::Path;

use crate::support::judge::assert_within;
use crate::support::render::{Dive, Sensor};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion};
use unwater::diagnostics::{Diagnostic, Fact, LogFact};
use unwater::error::Error;
use unwater::messages::Decoder;
use unwater::messages::writer::{WireFormat, Writer};
use unwater::products::dive::CorrectedLog;
use unwater::products::page::page;
use unwater::recording::{Entry, Message, Recording, Window};
use unwater::run::{correct, correct_all};
use unwater::session::{CameraSession, Options, Selection, Silent};

const TWO: &str = "camera_two_optical_frame";

/// The same dive with a second camera at the first one's place, turned by half a circle about its
/// axis: the same images upside down, under other names, with a mount of their own.
fn add_turned_camera(source: &Path, target: &Path, with_mount: bool) {
    let recording = Recording::open(source).unwrap();
    let id_of = |topic: &str| {
        recording.channels.iter().find(|(_, c)| c.topic == topic).map(|(id, _)| *id).unwrap()
    };
    let (image, info, tf) =
        (id_of("/camera/image_raw"), id_of("/camera/camera_info"), id_of("/tf_static"));
    let file = std::io::BufWriter::new(std::fs::File::create(target).unwrap());
    let mut writer = mcap::WriteOptions::new().profile("ros2").create(file).unwrap();
    for (id, s) in &recording.schemas {
        writer.add_schema_with_id(*id, &s.name, &s.encoding, &s.data).unwrap();
    }
    for (id, c) in &recording.channels {
        writer
            .add_channel_with_id(*id, c.schema_id, &c.topic, &c.message_encoding, &c.metadata)
            .unwrap();
        if *id == image || *id == info {
            let topic = c.topic.replace("/camera/", "/two/");
            writer
                .add_channel_with_id(
                    500 + id,
                    c.schema_id,
                    &topic,
                    &c.message_encoding,
                    &c.metadata,
                )
                .unwrap();
        }
    }
    let decoder = |id: u16| {
        let c = &recording.channels[&id];
        let s = &recording.schemas[&c.schema_id];
        Decoder::for_channel(&c.topic, &c.message_encoding, &s.name, &s.encoding, &s.data)
            .unwrap()
            .unwrap()
    };
    let images = decoder(image);
    for entry in recording.messages(Window::ALL) {
        let Entry::Message(m) = entry else { continue };
        let mut header = mcap::records::MessageHeader {
            channel_id: m.channel,
            sequence: 0,
            log_time: m.log_time,
            publish_time: m.publish_time,
        };
        writer.write_to_known_channel(&header, m.data()).unwrap();
        let new = || Writer::new(WireFormat::Cdr);
        if m.channel == image {
            let value = images.read(m.data()).unwrap();
            let number = |path: &str| value.integer(path).unwrap();
            let pixels: Vec<u8> =
                value.bytes("data").unwrap().chunks_exact(3).rev().flatten().copied().collect();
            let begun = new().header(
                number("header.stamp.sec") as i32,
                number("header.stamp.nanosec") as u32,
                TWO,
            );
            let sized = begun
                .u32(number("height") as u32)
                .u32(number("width") as u32)
                .text("rgb8")
                .u8(0)
                .u32(number("step") as u32);
            header.channel_id = 500 + image;
            writer.write_to_known_channel(&header, &sized.bytes(&pixels).finish()).unwrap();
        } else if m.channel == info {
            header.channel_id = 500 + info;
            writer.write_to_known_channel(&header, m.data()).unwrap();
        } else if m.channel == tf && with_mount {
            let axes = Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0);
            let q = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
            let mount = new()
                .u32(1)
                .header(0, 0, "base_link")
                .text(TWO)
                .f64s(&[0.34, -0.10, -0.12])
                .f64s(&[q.i, q.j, q.k, q.w]);
            writer.write_to_known_channel(&header, &mount.finish()).unwrap();
        }
    }
    writer.finish().unwrap();
}

fn by_topic(path: &Path) -> BTreeMap<String, Vec<Message>> {
    let recording = Recording::open(path).unwrap();
    let mut topics: BTreeMap<String, Vec<Message>> = BTreeMap::new();
    for entry in recording.messages(Window::ALL) {
        let Entry::Message(m) = entry else { panic!("damage") };
        topics.entry(recording.channels[&m.channel].topic.clone()).or_default().push(m);
    }
    topics
}

fn same(a: &[Message], b: &[Message]) -> bool {
    a.len() == b.len()
        && !a.is_empty()
        && a.iter().zip(b).all(|(a, b)| a.data() == b.data() && a.log_time == b.log_time)
}

/// The report of such a log tells of both, with names of its own for all that has one.
#[test]
fn the_page_shows_both_cameras() {
    let folder = tempfile::tempdir().unwrap();
    let (plain, path, out) = (
        folder.path().join("dive.mcap"),
        folder.path().join("two.mcap"),
        folder.path().join("out.mcap"),
    );
    Dive {
        frames: 12,
        width: 240,
        height: 180,
        focal_px: 280.0,
        sensor: Sensor::Rgb8,
        ..Dive::default()
    }
    .write(&plain);
    add_turned_camera(&plain, &path, true);
    correct_all(&path, &out, None, &Options::default(), &Silent).unwrap();
    let html =
        page(&CorrectedLog::open(&out, &Options::default()).unwrap(), &Options::default()).unwrap();
    assert!(html.contains("Camera /camera/image_raw") && html.contains("Camera /two/image_raw"));
    let mut ids: Vec<&str> =
        html.split(" id=\"").skip(1).filter_map(|rest| rest.split('"').next()).collect();
    let all = ids.len();
    ids.sort_unstable();
    ids.dedup();
    assert!(all > 20 && ids.len() == all, "two things have one id: {ids:?}");
    assert_eq!(html.matches("data-figure=\"stages\"").count(), 2);
}

#[test]
fn each_camera_is_corrected_as_if_alone() {
    let folder = tempfile::tempdir().unwrap();
    let (plain, path, out) = (
        folder.path().join("dive.mcap"),
        folder.path().join("two.mcap"),
        folder.path().join("out.mcap"),
    );
    Dive {
        frames: 16,
        width: 288,
        height: 216,
        focal_px: 340.0,
        sensor: Sensor::Rgb8,
        ..Dive::default()
    }
    .write(&plain);
    add_turned_camera(&plain, &path, true);
    let Err(Error::SeveralCameras { topics }) = CameraSession::open(&path, &Options::default())
    else {
        panic!("two cameras")
    };
    assert_eq!(topics, ["/camera/image_raw", "/two/image_raw"]);

    let done = correct_all(&path, &out, None, &Options::default(), &Silent).unwrap();
    assert_eq!(done.len(), 2);
    let all = by_topic(&out);
    for ((report, model), topic) in done.iter().zip(&topics) {
        assert_eq!((&report.camera_topic, report.corrected, report.frames), (topic, 16, 16));
        for (band, expected) in [0.45, 0.14, 0.10].into_iter().enumerate() {
            let what = format!("{topic}: attenuation, band {band} [1/m]");
            assert_within(
                &what,
                model.attenuation_per_m[band] - expected,
                [0.0079, 0.0072, 0.0064][band],
            );
        }
        let alone = folder.path().join("alone.mcap");
        let selection = Selection { camera: Some(topic.clone()), ..Selection::default() };
        let options = Options { selection, force: true, ..Options::default() };
        let (_, of_alone) = correct(&path, &alone, None, &options, &Silent).unwrap();
        assert_eq!(of_alone.to_json().unwrap(), model.to_json().unwrap());
        let corrected = topic.replace("image_raw", "image_corrected/compressed");
        let alone = by_topic(&alone);
        assert!(same(&all[&corrected], &alone[&corrected]), "{topic}: other images than alone");
        let place = if topic.starts_with("/two") { "/unwater/two" } else { "/unwater" };
        for name in ["attenuation", "seafloor", "frame", "beam_pattern", "log"] {
            assert!(
                same(&all[&format!("{place}/{name}")], &alone[&format!("/unwater/{name}")]),
                "{topic}: {name}"
            );
        }
    }
    // Upside down, the second camera's images hold the same light as the first one's, so the models
    // of it.
    let (a, b) = (&done[0].1.attenuation_per_m, &done[1].1.attenuation_per_m);
    for (a, b) in a.iter().zip(b) {
        assert_within("the two cameras: attenuation [1/m]", a - b, 0.0004);
    }

    let recording = Recording::open(&out).unwrap();
    let names: Vec<String> = recording.attachments().map(|a| a.unwrap().name).collect();
    assert_eq!(
        names,
        [
            "model.json",
            "report.json",
            "unwater.toml",
            "rig.toml",
            "two/model.json",
            "two/report.json",
            "two/rig.toml"
        ]
    );
    let records: Vec<(&str, &str)> = recording
        .metadata
        .iter()
        .map(|m| (m.name.as_str(), m.metadata["camera_topic"].as_str()))
        .collect();
    assert_eq!(records, [("unwater", "/camera/image_raw"), ("unwater/two", "/two/image_raw")]);
    // Each has a tab in the layouts, with its own topics.
    let views = unwater::viewers::cameras(&recording);
    let corrected: Vec<&str> = views.iter().filter_map(|v| v.corrected.as_deref()).collect();
    assert_eq!(
        corrected,
        ["/camera/image_corrected/compressed", "/two/image_corrected/compressed"]
    );
    assert_eq!(views[1].seafloor_frame.as_deref(), Some("unwater/two/seafloor"));
    assert_eq!(
        (views[1].raw.as_deref(), views[1].camera_info.as_deref()),
        (Some("/two/image_raw"), Some("/two/camera_info"))
    );
    let layout: serde_json::Value =
        serde_json::from_str(&unwater::viewers::foxglove(&views)).unwrap();
    let tabs = layout["configById"][layout["layout"].as_str().unwrap()]["tabs"].as_array().unwrap();
    assert_eq!(
        tabs.iter().map(|t| t["title"].as_str().unwrap()).collect::<Vec<_>>(),
        ["/camera/image_raw", "/two/image_raw"]
    );
    // Everything of the input is there, once.
    for (topic, messages) in by_topic(&path) {
        assert!(same(&messages, &all[&topic]), "{topic}");
    }
}

#[test]
fn a_camera_that_cannot_be_corrected_is_copied_and_listed() {
    let folder = tempfile::tempdir().unwrap();
    let (plain, path, out) = (
        folder.path().join("dive.mcap"),
        folder.path().join("two.mcap"),
        folder.path().join("out.mcap"),
    );
    Dive {
        frames: 14,
        width: 192,
        height: 144,
        focal_px: 230.0,
        sensor: Sensor::Rgb8,
        ..Dive::default()
    }
    .write(&plain);
    add_turned_camera(&plain, &path, false);
    let done = correct_all(&path, &out, None, &Options::default(), &Silent).unwrap();
    let (report, _) = &done[0];
    assert!(
        done.len() == 1 && report.camera_topic == "/camera/image_raw" && report.corrected == 14
    );
    let is_left_out = |d: &Diagnostic| match &d.fact {
        Fact::LogFact(LogFact::CameraLeftOut { reason }) => reason.contains(TWO),
        _ => false,
    };
    let left_out = report.diagnostics.iter().find(|d| is_left_out(d)).expect("a loss");
    assert_eq!(left_out.topic.as_deref(), Some("/two/image_raw"));
    assert!(report.has_losses());
    assert_eq!(by_topic(&out)["/two/image_raw"].len(), 14);

    // A rig file and a model speak of one camera: it must be named.
    let mut options = Options { force: true, ..Options::default() };
    options.rig.camera.horizontal_field_of_view_deg = Some(45.0);
    assert!(matches!(
        correct_all(&path, &out, None, &options, &Silent),
        Err(Error::SeveralCameras { .. })
    ));
    let model = Some(done[0].1.clone());
    assert!(matches!(
        correct_all(&path, &out, model, &Options { force: true, ..Options::default() }, &Silent),
        Err(Error::SeveralCameras { .. })
    ));
}
