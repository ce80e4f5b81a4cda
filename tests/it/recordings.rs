//! The recordings that people have: one dive in every encoding, video, clocks, and bytes that make
//! no sense.
use std::path::{Path, PathBuf};

use crate::support::dice::{Dice, factor, with_bounded_memory};
use crate::support::foreign_bytes::exercise;
use crate::support::render::Dive;
use crate::support::transcode::{Encoding, transcode};
use unwater::config::Config;
use unwater::diagnostics::{ClockFact, Diagnostic};
use unwater::messages::Decoder;
use unwater::messages::writer::{WireFormat, Writer};
use unwater::recording::{Entry, Message, Recording, Window};
use unwater::run::{correct, estimate_logs};
use unwater::session::{CameraSession, Options, Selection, Silent, Threads, index::scan};
use unwater::vehicle::{DvlFacts, RigFile};

const SAMPLES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/sample_logs/messages");

#[test]
fn the_same_dive_in_every_encoding_gives_the_same_model() {
    let folder = tempfile::tempdir().unwrap();
    let cdr = folder.path().join("cdr.mcap");
    Dive { frames: 14, width: 288, height: 216, focal_px: 340.0, ..Dive::default() }.write(&cdr);
    let model = |path: &Path| {
        let (mut model, _) = estimate_logs(&[path], &Options::default(), &Silent).unwrap();
        model.inputs.clear();
        serde_json::to_string(&model).unwrap()
    };
    let corrected = |path: &Path| {
        let out = path.with_extension("corrected.mcap");
        correct(path, &out, None, &Options::default(), &Silent).unwrap();
        let recording = Recording::open(&out).unwrap();
        assert!(
            recording.is_complete && (recording.profile == "ros2" || recording.profile.is_empty()),
            "{}",
            recording.profile
        );
        let of_ours =
            |m: &Message| recording.channels[&m.channel].topic.contains("image_corrected");
        let messages = recording
            .messages(Window::ALL)
            .filter_map(|e| if let Entry::Message(m) = e { Some(m) } else { None });
        let decoder = |m: &Message| {
            let channel = &recording.channels[&m.channel];
            let schema = &recording.schemas[&channel.schema_id];
            let is_protobuf = path.file_stem().is_some_and(|s| s == "Protobuf");
            assert_eq!(
                channel.message_encoding,
                if is_protobuf { "protobuf" } else { "cdr" },
                "the encoding of what is added"
            );
            Decoder::for_channel(
                &channel.topic,
                &channel.message_encoding,
                &schema.name,
                &schema.encoding,
                &schema.data,
            )
            .unwrap()
            .unwrap()
        };
        messages
            .filter(of_ours)
            .map(|m| decoder(&m).read(m.data()).unwrap().bytes("data").unwrap().to_vec())
            .collect::<Vec<_>>()
    };
    let truth = model(&cdr);
    let images = corrected(&cdr);
    assert_eq!(images.len(), 14);
    for encoding in [Encoding::Ros1, Encoding::Protobuf, Encoding::Json] {
        let path = folder.path().join(format!("{encoding:?}.mcap"));
        transcode(&cdr, &path, encoding);
        assert!(model(&path) == truth, "{encoding:?}: another model");
        assert!(corrected(&path) == images, "{encoding:?}: other images");
    }
}

#[test]
fn video_is_rejected_with_a_remedy() {
    for log in ["foxglove_compressed_video", "ffmpeg_packet"] {
        let path = Path::new(SAMPLES).join(format!("{log}.mcap"));
        let error =
            CameraSession::open(&path, &Options::default()).err().expect("refused").to_string();
        assert!(
            error.contains("video") && error.contains("video_to_pictures.py"),
            "{log}: {error}"
        );
    }
}

#[test]
fn the_rig_file_overrides_the_poses_of_beams() {
    let recording = Recording::open(&Path::new(SAMPLES).join("dvl_uuv_simulator.mcap")).unwrap();
    let of_rig = DvlFacts { beams: Some("nortek-25".into()), ..DvlFacts::default() };
    for (facts, janus_deg) in [(DvlFacts::default(), 22.5f64), (of_rig, 25.0)] {
        let (_, readings) = scan(&recording, Window::ALL, &facts, &Threads::new(1)).unwrap();
        let (ping, _) = &readings.0.values().next().unwrap().pings[0];
        assert!(
            ping.beams
                .iter()
                .all(|b| (b.direction.vector().z - janus_deg.to_radians().cos()).abs() < 1e-6),
            "{janus_deg}"
        );
    }
}

#[test]
fn a_time_offset_shifts_pings_and_frames() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("dive.mcap");
    Dive { frames: 3, width: 96, height: 72, focal_px: 110.0, ..Dive::default() }.write(&path);
    let plain = CameraSession::open(&path, &Options::default()).unwrap().survey;
    let mut rig = RigFile::default();
    rig.time_offset_s.insert(plain.dvl_topic.clone(), 0.25);
    rig.time_offset_s.insert(plain.camera_topic.clone(), -0.5);
    rig.time_offset_s.insert("/nowhere".into(), 1.0);
    let moved = CameraSession::open(&path, &Options { rig, ..Options::default() }).unwrap().survey;
    for (a, b) in plain.pings.all().zip(moved.pings.all()) {
        assert_eq!(b.stamp.0 - a.stamp.0, 250_000_000);
    }
    for (a, b) in plain.frames.iter().zip(&moved.frames) {
        assert_eq!(b.stamp.0 - a.stamp.0, -500_000_000);
    }
    let unknown = Diagnostic::on("/nowhere", ClockFact::OffsetOfUnknownTopic);
    assert!(moved.diagnostics.contains(&unknown), "{:?}", moved.diagnostics);
}

#[test]
fn a_calibration_in_air_is_refracted_and_kept_by_its_rig_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("dive.mcap");
    Dive { frames: 3, width: 96, height: 72, focal_px: 110.0, ..Dive::default() }.write(&path);
    let plain = CameraSession::open(&path, &Options::default()).unwrap().survey.rig.camera;
    let rig: RigFile = toml::from_str("[camera]\nmedium = \"air\"").unwrap();
    let options = Options { rig: rig.clone(), config: Config::default(), ..Options::default() };
    let survey = CameraSession::open(&path, &options).unwrap().survey;
    assert!(
        (survey.rig.camera.fx / plain.fx - 1.33).abs() < 1e-9
            && survey.diagnostics.iter().any(|d| d.code() == "calibration-in-air")
    );
    let written = unwater::session::survey::rig_facts(&survey.rig, &rig);
    let again: RigFile = toml::from_str(&toml::to_string(&written).unwrap()).unwrap();
    let again = CameraSession::open(&path, &Options { rig: again, ..Options::default() })
        .unwrap()
        .survey
        .rig
        .camera;
    assert!(
        (again.fx - survey.rig.camera.fx).abs() < 1e-9
            && again.distortion == survey.rig.camera.distortion
    );
}

const IMAGE: &str = "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 \
                     is_bigendian\nuint32 step\nuint8[] data\n";

/// Adds a depth image before each frame of a dive: a seafloor so far from the camera (m), square to
/// its axis.
fn add_depth(source: &Path, target: &Path, depth_m: f64) {
    let recording = Recording::open(source).unwrap();
    let camera = CameraSession::open(source, &Options::default()).unwrap().survey;
    let mut writer = mcap::WriteOptions::new()
        .profile("ros2")
        .create(std::io::BufWriter::new(std::fs::File::create(target).unwrap()))
        .unwrap();
    for (id, s) in &recording.schemas {
        writer.add_schema_with_id(*id, &s.name, &s.encoding, &s.data).unwrap();
    }
    writer.add_schema_with_id(900, "sensor_msgs/msg/Image", "ros2msg", IMAGE.as_bytes()).unwrap();
    for (id, c) in &recording.channels {
        writer
            .add_channel_with_id(*id, c.schema_id, &c.topic, &c.message_encoding, &c.metadata)
            .unwrap();
    }
    writer
        .add_channel_with_id(900, 900, "/camera/depth/image_rect", "cdr", &Default::default())
        .unwrap();
    let (width, height) = (camera.rig.camera.width, camera.rig.camera.height);
    let code = ((depth_m * 1000.0) as u16).to_le_bytes().repeat(width * height);
    for entry in recording.messages(Window::ALL) {
        let Entry::Message(m) = entry else { continue };
        let mut header = mcap::records::MessageHeader {
            channel_id: m.channel,
            sequence: m.sequence,
            log_time: m.log_time,
            publish_time: m.publish_time,
        };
        if camera.camera_channels.contains(&m.channel) {
            let stamp = camera.frames[0].stamp.0
                + (m.log_time - recording_start(&recording, m.channel)) as i64;
            let (sec, nanosec) = ((stamp / 1_000_000_000) as i32, (stamp % 1_000_000_000) as u32);
            let body = Writer::new(WireFormat::Cdr)
                .header(sec, nanosec, &camera.camera_frame)
                .u32(height as u32)
                .u32(width as u32)
                .text("16UC1")
                .u8(0);
            let body = body.u32(2 * width as u32).bytes(&code).finish();
            header.channel_id = 900;
            writer.write_to_known_channel(&header, &body).unwrap();
            header.channel_id = m.channel;
        }
        writer.write_to_known_channel(&header, m.data()).unwrap();
    }
    writer.finish().unwrap();
}

/// Log time of a channel's first message.
fn recording_start(recording: &Recording, channel: u16) -> u64 {
    let of_channel = |e| {
        if let Entry::Message(m) = e { (m.channel == channel).then_some(m.log_time) } else { None }
    };
    recording.messages(Window::ALL).find_map(of_channel).unwrap()
}

#[test]
fn depth_images_are_used_as_ranges() {
    let folder = tempfile::tempdir().unwrap();
    let (plain, path) = (folder.path().join("dive.mcap"), folder.path().join("depth.mcap"));
    Dive { frames: 1, width: 96, height: 72, focal_px: 110.0, ..Dive::default() }.write(&plain);
    add_depth(&plain, &path, 1.75);
    let with_dvl = CameraSession::open(&path, &Options::default()).unwrap().survey;
    assert!(!with_dvl.dvl_topic.contains("depth"), "a DVL comes first");
    let selection =
        Selection { dvl: Some("/camera/depth/image_rect".into()), ..Selection::default() };
    let survey =
        CameraSession::open(&path, &Options { selection, ..Options::default() }).unwrap().survey;
    // One frame: the vehicle sways between frames, and this seafloor would sway with it.
    for frame in &survey.frames {
        let plane =
            survey.pings.seafloor(frame.stamp, &survey.rig, &Config::default().seafloor).unwrap();
        let above = plane.camera_altitude_m(&survey.rig);
        let along = (survey.rig.body_from_optical * unwater::coordinates::Direction::boresight())
            .vector()
            .dot(&plane.normal.vector());
        assert!(
            (above - 1.75).abs() < 1e-3 && along > 0.9999 && plane.returns >= 20,
            "{above} m, {along}, {} returns",
            plane.returns
        );
    }
}

// ---- bytes that make no sense

fn samples() -> Vec<PathBuf> {
    let mut logs: Vec<PathBuf> = std::fs::read_dir(SAMPLES)
        .unwrap()
        .map(|f| f.unwrap().path())
        .filter(|p| p.extension().is_some_and(|e| e == "mcap"))
        .collect();
    logs.sort();
    logs
}

#[test]
fn damaged_messages_and_schemas_are_errors_and_never_panics() {
    let name = "recordings::damaged_messages_and_schemas_are_errors_and_never_panics";
    with_bounded_memory(name, damage_messages_and_schemas);
}

fn damage_messages_and_schemas() {
    let mut dice = Dice(0x9e37_79b9_7f4a_7c15);
    let mut places = 0;
    for log in samples() {
        let recording = Recording::open(&log).unwrap();
        let messages: Vec<Message> = recording
            .messages(Window::ALL)
            .filter_map(|e| if let Entry::Message(m) = e { Some(m) } else { None })
            .collect();
        let channel = &recording.channels[&messages[0].channel];
        let of_schema =
            |data: Option<&[u8]>| match (recording.schemas.get(&channel.schema_id), data) {
                (Some(s), data) => Decoder::for_channel(
                    &channel.topic,
                    &channel.message_encoding,
                    &s.name,
                    &s.encoding,
                    data.unwrap_or(&s.data),
                ),
                (None, data) => {
                    Decoder::for_json(&channel.topic, data.unwrap_or(messages[0].data()))
                }
            };
        let decoder = of_schema(None).unwrap();
        for round in 0..80 * factor() {
            let message = &messages[round % messages.len()];
            if let Some(decoder) = &decoder {
                exercise(decoder, &dice.damage(message.data()));
            }
            let schema =
                recording.schemas.get(&channel.schema_id).map_or(message.data(), |s| &s.data);
            if let Ok(Some(mut decoder)) = of_schema(Some(&dice.damage(schema))) {
                decoder.refine(&channel.topic, message.data());
                exercise(&decoder, message.data());
            }
            places += 2;
        }
    }
    assert!(places >= 5000, "{places} places");
}

#[test]
fn damaged_logs_are_read_as_far_as_possible_without_false_messages() {
    let name = "recordings::damaged_logs_are_read_as_far_as_possible_without_false_messages";
    with_bounded_memory(name, damage_logs);
}

fn damage_logs() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("damaged.mcap");
    let mut dice = Dice(0x2545_f491_4f6c_dd1d);
    let mut places = 0;
    for log in samples() {
        let bytes = std::fs::read(&log).unwrap();
        let whole = Recording::open(&log).unwrap();
        let payloads: Vec<Vec<u8>> = whole
            .messages(Window::ALL)
            .filter_map(|e| if let Entry::Message(m) = e { Some(m.data().to_vec()) } else { None })
            .collect();
        for _ in 0..60 * factor() {
            let damaged = dice.damage(&bytes);
            std::fs::write(&path, &damaged).unwrap();
            places += 1;
            let Ok(recording) = Recording::open(&path) else { continue };
            let _scan =
                scan(&recording, Window::ALL, &DvlFacts::default(), &Threads::new(1)).unwrap();
            for entry in recording.messages(Window::ALL) {
                if let Entry::Message(m) = entry {
                    // A flipped opcode can make a message of another record. Outside of a chunk
                    // there is no checksum to tell; all that was written here lies in compressed
                    // chunks.
                    let outside = || {
                        m.data().is_empty()
                            || damaged.windows(m.data().len()).any(|w| w == m.data())
                    };
                    let written = payloads.iter().any(|p| p == m.data());
                    assert!(
                        written || outside(),
                        "{}: a message that was never written",
                        log.display()
                    );
                }
            }
        }
    }
    assert!(places >= 5000, "{places} places");
}
