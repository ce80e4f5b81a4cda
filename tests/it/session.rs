//! One index, one frame identity: gains belong to frames, not to stamps; what is missing or cannot
//! be written is an error.

use std::path::{Path, PathBuf};

use unwater::diagnostics::{ClockFact, Diagnostic, Fact};
use unwater::error::Error;
use unwater::model::{
    CameraFile, FrameGainFile, GeometryFile, InputFile, ModelFile, VignettingFile,
};
use unwater::products::data_set::{Archive, export};
use unwater::products::dive::{CorrectedLog, Images};
use unwater::recording::{Channel, Entry, FrameId, Recording, Window};
use unwater::run::{correct, estimate_logs};
use unwater::session::{CameraSession, FrameGains, FrameRef, Log, Options, Silent};
use unwater::units::Stamp;

use super::support::render::Dive;

/// Frames of the sample, all of them corrected.
const FRAMES: usize = 20;

fn sample() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("sample_logs/rendered_clear.mcap")
}

fn offset(topic: &str, offset_s: f64) -> Options {
    let mut options = Options { force: true, ..Options::default() };
    options.rig.time_offset_s.insert(topic.into(), offset_s);
    options
}

/// The corrected images, encoded, in the order of the file.
fn corrected_images(path: &Path) -> Vec<Vec<u8>> {
    let recording = Recording::open(path).unwrap();
    let is_image = |(_, c): &(&u16, &Channel)| c.topic.contains("image_corrected");
    let (id, _) = recording.channels.iter().find(is_image).unwrap();
    let image = |entry| match entry {
        Entry::Message(m) if m.channel == *id => Some(m.data().to_vec()),
        _ => None,
    };
    recording.messages(Window::ALL).filter_map(image).collect()
}

#[test]
fn a_frame_keeps_its_gain_under_another_clock_offset() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("out.mcap");
    let (mut model, _) = estimate_logs(&[&sample()], &Options::default(), &Silent).unwrap();
    let session = CameraSession::open(&sample(), &Options::default()).unwrap();
    let frame = session.survey.frames[3];
    let of_frame = FrameGainFile {
        frame: Some(frame.id),
        input: 0,
        stamp_ns: frame.stamp.0,
        gain: 0.5,
        balance: None,
        range_factor: 1.0,
        range_tilt: [0.0; 2],
        is_unexplained: false,
    };
    let options = offset(&session.survey.camera_topic, 0.02);
    correct(&sample(), &output, Some(model.clone()), &options, &Silent).unwrap();
    let plain = corrected_images(&output);
    model.frame_gains = vec![of_frame];
    correct(&sample(), &output, Some(model), &options, &Silent).unwrap();
    let with_gain = corrected_images(&output);
    assert_eq!((plain.len(), with_gain.len()), (FRAMES, FRAMES));
    let changed: Vec<usize> = (0..FRAMES).filter(|f| with_gain[*f] != plain[*f]).collect();
    assert_eq!(changed, [3]);
}

#[test]
fn a_clock_that_a_model_found_applies_once_and_to_its_own_logs() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("out.mcap");
    let (plain, _) = estimate_logs(&[&sample()], &Options::default(), &Silent).unwrap();
    let topic = CameraSession::open(&sample(), &Options::default()).unwrap().survey.camera_topic;
    let images = |model: &ModelFile, options: &Options| {
        let options = Options { force: true, ..options.clone() };
        let (report, _) =
            correct(&sample(), &output, Some(model.clone()), &options, &Silent).unwrap();
        let is_unused =
            |d: &Diagnostic| matches!(d.fact, Fact::ClockFact(ClockFact::OfOtherLogs { .. }));
        (corrected_images(&output), report.diagnostics.iter().any(is_unused))
    };
    let late = offset(&topic, 0.3);
    let clock = GeometryFile { clock_offset_s: Some(0.3), ..GeometryFile::default() };
    let found = ModelFile { geometry: Some(clock), ..plain.clone() };
    let expected = images(&plain, &late);
    assert_ne!(expected, images(&plain, &Options::default()));
    assert_eq!(images(&found, &Options::default()), expected);
    assert_eq!(images(&found, &late), expected);
    let mut of_another = found;
    of_another.inputs[0].sha256 = "0".repeat(64);
    assert_eq!(images(&of_another, &late), (expected.0, true));
}

#[test]
fn vignetting_of_the_rig_file_takes_precedence_over_a_models() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("out.mcap");
    let (plain, _) = estimate_logs(&[&sample()], &Options::default(), &Silent).unwrap();
    let found = VignettingFile { coefficients: [-1.0, 0.0, 0.0], corner_loss: 0.3 };
    let camera = CameraFile { vignetting: Some(found), ..CameraFile::default() };
    let with_lens = ModelFile { camera: Some(camera), ..plain.clone() };
    let images = |model: &ModelFile, options: &Options| {
        let options = Options { force: true, ..options.clone() };
        correct(&sample(), &output, Some(model.clone()), &options, &Silent).unwrap();
        corrected_images(&output)
    };
    let given = toml::from_str("[camera]\nvignetting = \"cos4\"\n").unwrap();
    let given = Options { rig: given, ..Options::default() };
    assert_eq!(images(&with_lens, &given), images(&plain, &given));
    assert_ne!(images(&with_lens, &Options::default()), images(&plain, &Options::default()));
}

#[test]
fn gains_belong_to_frames_of_their_log() {
    let recording = Recording::open(&sample()).unwrap();
    let (mut model, _) = estimate_logs(&[&sample()], &Options::default(), &Silent).unwrap();
    let own = model.inputs[0].clone();
    let (sha256, index_sha256) = ("0".repeat(64), "1".repeat(64));
    model.inputs.push(InputFile { sha256, index_sha256, ..own });
    let source = model.inputs[1].identity();
    let frame = |entry, stamp| {
        let (stamp, id) = (Stamp(stamp), FrameId { block: 1, entry });
        FrameRef { id, stamp, logged: stamp }
    };
    let gain = |f: &FrameRef, input, gain| FrameGainFile {
        frame: Some(f.id),
        input,
        stamp_ns: f.stamp.0,
        gain,
        balance: None,
        range_factor: 1.0,
        range_tilt: [0.0; 2],
        is_unexplained: false,
    };
    // Two frames of one stamp; a frame of another log with the identity of one of this.
    let (first, second, third) = (frame(1, 5), frame(2, 5), frame(3, 9));
    model.frame_gains = vec![gain(&first, 0, 0.5), gain(&third, 1, 0.25)];
    let gains = FrameGains::new(&model, &recording, None).unwrap();
    assert_eq!([first, second, third].map(|f| gains.of(&f)), [Some([0.5; 3]), None, None]);
    assert_eq!(gains.of_other_logs, 1);
    // A corrected log has other identities than its source, and the same stamps.
    let gains = FrameGains::new(&model, &recording, Some(&source)).unwrap();
    assert_eq!((gains.of(&frame(7, 9)), gains.of_other_logs), (Some([0.25; 3]), 0));
    // Identities survive the file; files of earlier versions have stamps alone.
    let json = model.to_json().unwrap();
    let again = ModelFile::from_json(&json).unwrap();
    assert_eq!(again.frame_gains, model.frame_gains);
    let mut old: serde_json::Value = serde_json::from_str(&json).unwrap();
    for gain in old["frame_gains"].as_array_mut().unwrap() {
        gain.as_object_mut().unwrap().retain(|key, _| key == "stamp_ns" || key == "gain");
    }
    let old = ModelFile::from_json(&old.to_string()).unwrap();
    let gains = FrameGains::new(&old, &recording, None).unwrap();
    assert_eq!([second, third].map(|f| gains.of(&f)), [Some([0.5; 3]), Some([0.25; 3])]);
}

#[test]
fn gains_of_several_logs_name_their_log() {
    let folder = tempfile::tempdir().unwrap();
    let paths = [folder.path().join("a.mcap"), folder.path().join("b.mcap")];
    for (path, half_power_frames) in paths.iter().zip([0.0, 0.05]) {
        let small = Dive { width: 240, height: 180, focal_px: 280.0, ..Dive::default() };
        Dive { seed: 91, frames: 40, half_power_frames, ..small }.write(path);
    }
    let logs = [paths[0].as_path(), paths[1].as_path()];
    let (model, _) = estimate_logs(&logs, &Options::default(), &Silent).unwrap();
    assert!(!model.frame_gains.is_empty());
    assert!(model.frame_gains.iter().all(|g| g.input == 1), "{:?}", model.frame_gains);
    let session = CameraSession::open(&paths[1], &Options::default()).unwrap();
    for gain in &model.frame_gains {
        let frame = session.survey.frame(gain.frame.unwrap()).unwrap();
        assert_eq!(frame.stamp.0, gain.stamp_ns);
    }
}

#[test]
fn a_log_is_scanned_once() {
    let log = Log::open(&sample(), &Options::default()).unwrap();
    let scanned = log.recording.bytes_read();
    let frames = |_| CameraSession::new(&log, &Options::default()).unwrap().survey.frames.len();
    assert_eq!([1, 2].map(frames), [FRAMES; 2]);
    assert_eq!(log.recording.bytes_read(), scanned);

    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("out.mcap");
    correct(&sample(), &output, None, &Options::default(), &Silent).unwrap();
    let corrected = CorrectedLog::open(&output, &Options::default()).unwrap();
    let scanned = corrected.scanned.recording.bytes_read();
    for images in [Images::Raw, Images::Corrected] {
        let bench = corrected.bench(&corrected.cameras[0], images, &Options::default()).unwrap();
        assert_eq!(bench.session.survey.frames.len(), FRAMES);
    }
    assert_eq!(corrected.scanned.recording.bytes_read(), scanned);
}

/// Exports the first camera of a log.
fn exported(log: &CorrectedLog, folder: &Path) -> Result<usize, Error> {
    let archive = Archive::default();
    let written = export(log, &log.cameras[0], &archive, folder, &Silent)?;
    Ok(written.stills)
}

#[test]
fn an_export_with_images_missing_fails() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("out.mcap");
    correct(&sample(), &output, None, &Options::default(), &Silent).unwrap();
    let open = |path: &Path| CorrectedLog::open(path, &Options::default()).unwrap();
    assert_eq!(exported(&open(&output), &folder.path().join("whole")).unwrap(), FRAMES);

    // Without the images, and without some of them.
    let bytes = std::fs::read(&output).unwrap();
    let topic = open(&output).cameras[0].topic(Images::Corrected).to_string();
    for dropped in [FRAMES, 3] {
        let partial = folder.path().join(format!("without_{dropped}.mcap"));
        without(&output, &partial, &topic, dropped);
        let error = exported(&open(&partial), &folder.path().join("partial")).unwrap_err();
        let expected = format!("{dropped} of {FRAMES} on {topic}");
        assert!(error.to_string().contains(&expected), "{error}");
    }

    // Damage takes images and their records: all are exported, or the loss is an error.
    let (damaged, mut losses) = (folder.path().join("damaged.mcap"), 0);
    for tenth in 1..10 {
        let mut flipped = bytes.clone();
        flipped[bytes.len() * tenth / 10] ^= 0xff;
        std::fs::write(&damaged, flipped).unwrap();
        let Ok(log) = CorrectedLog::open(&damaged, &Options::default()) else { continue };
        match exported(&log, &folder.path().join(format!("damaged_{tenth}"))) {
            Ok(stills) => assert_eq!(stills, FRAMES, "{tenth}"),
            Err(error) => {
                assert!(error.to_string().contains("damage"), "{error}");
                losses += 1;
            }
        }
    }
    assert!(losses > 0);

    // A file that becomes unreadable after it was opened.
    let log = open(&output);
    let file = std::fs::OpenOptions::new().write(true).open(&output).unwrap();
    file.set_len(bytes.len() as u64 / 3).unwrap();
    assert!(matches!(exported(&log, &folder.path().join("short")), Err(Error::Read { .. })));
}

/// Copies a log without the last images of a topic.
fn without(source: &Path, target: &Path, topic: &str, dropped: usize) {
    let recording = Recording::open(source).unwrap();
    let file = std::io::BufWriter::new(std::fs::File::create(target).unwrap());
    let mut writer = mcap::WriteOptions::new().profile("ros2").create(file).unwrap();
    for (id, s) in &recording.schemas {
        writer.add_schema_with_id(*id, &s.name, &s.encoding, &s.data).unwrap();
    }
    for (id, c) in &recording.channels {
        writer
            .add_channel_with_id(*id, c.schema_id, &c.topic, &c.message_encoding, &c.metadata)
            .unwrap();
    }
    let is_image = |channel| recording.channels[&channel].topic == topic;
    let mut images = 0;
    for entry in recording.messages(Window::ALL) {
        let Entry::Message(m) = entry else { continue };
        images += usize::from(is_image(m.channel));
        if is_image(m.channel) && images > FRAMES - dropped {
            continue;
        }
        let header = mcap::records::MessageHeader {
            channel_id: m.channel,
            sequence: m.sequence,
            log_time: m.log_time,
            publish_time: m.publish_time,
        };
        writer.write_to_known_channel(&header, m.data()).unwrap();
    }
    for attachment in recording.attachments().flatten() {
        let data = recording.attachment_data(&attachment).unwrap();
        let attachment = mcap::Attachment {
            log_time: 0,
            create_time: 0,
            name: attachment.name,
            media_type: String::new(),
            data: data.into(),
        };
        writer.attach(&attachment).unwrap();
    }
    recording.metadata.iter().for_each(|m| writer.write_metadata(m).unwrap());
    writer.finish().unwrap();
}

#[cfg(unix)]
#[test]
fn a_rig_that_cannot_be_written_is_an_error() {
    use std::os::unix::ffi::OsStrExt as _;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(std::ffi::OsStr::from_bytes(b"flat\xff.png"));
    let session = CameraSession::open(&sample(), &Options::default()).unwrap();
    let camera = session.survey.rig.camera;
    let even = vec![255; camera.width * camera.height];
    let shape = unwater::image::ImageShape { width: camera.width, height: camera.height, bands: 1 };
    std::fs::write(&path, unwater::image::encode::png(&even, shape, 8).unwrap()).unwrap();
    let mut options = Options::default();
    options.rig.camera.flat_field = Some(path);
    let output = folder.path().join("out.mcap");
    let error = correct(&sample(), &output, None, &options, &Silent).unwrap_err();
    assert!(error.to_string().contains("rig.toml"), "{error}");
    assert!(!output.exists());
}

#[cfg(target_os = "linux")]
#[test]
fn a_model_that_cannot_be_written_to_stdout_is_an_error() {
    let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let status = std::process::Command::new(env!("CARGO_BIN_EXE_unwater"))
        .args(["estimate", "-q", "-o", "-"])
        .arg(sample())
        .stdout(full)
        .output()
        .unwrap();
    assert!(!status.status.success());
    assert!(String::from_utf8_lossy(&status.stderr).contains("cannot write stdout"));
}
