//! Faults of real recordings: never a wrong number without a word, never an error without a way
//! on. The logs are edits of the sample log; whole logs of each kind are in `UNWATER_DATA`.
use std::path::Path;

use unwater::config::SelfCalibration;
use unwater::error::Error;
use unwater::image::EncodedImage;
use unwater::image::decode::{CameraResponse, decode};
use unwater::run::estimate_logs;
use unwater::session::survey::Survey;
use unwater::session::{CameraSession, Options, Silent};

use super::program::{text, unwater};
use super::support::edited::{Record, edited, records, sample, write};

type Edit<'e> = &'e dyn Fn(&mut Record);

/// The survey of the edited sample.
fn survey_of(edit: impl Fn(&mut Record), options: &Options) -> Result<Survey, Error> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("edited.mcap");
    edited(&path, edit);
    CameraSession::open(&path, options).map(|session| session.survey)
}

fn survey(edit: impl Fn(&mut Record)) -> Result<Survey, Error> {
    survey_of(edit, &Options::default())
}

fn has(survey: &Survey, code: &str) -> bool {
    survey.diagnostics.iter().any(|d| d.code() == code)
}

/// Focal length of the sample's camera_info (px).
fn focal_px() -> f64 {
    survey(|_| {}).unwrap().rig.camera.fx
}

#[test]
fn a_calibration_is_taken_by_namespace_or_frame_and_never_by_size() {
    let found = survey(|_| {}).unwrap();
    assert_eq!(found.camera_info.as_deref(), Some("/camera/camera_info"));
    assert!(has(&found, "camera-info-used"));
    // The frame alone, and a namespace above the only camera.
    for topic in ["/calibration/camera_info", "/camera_info"] {
        let moved = |r: &mut Record| {
            if r.topic == "/camera/camera_info" {
                r.topic = topic.into();
            }
        };
        assert_eq!(survey(moved).unwrap().camera_info.as_deref(), Some(topic));
    }
    // Of another camera: another namespace and another frame, and the same size.
    let other = |r: &mut Record| {
        if r.topic == "/camera/camera_info" {
            r.topic = "/left/camera_info".into();
            r.replace(b"camera_optical_frame", b"lefter_optical_frame");
        }
    };
    let error = survey(other).err().expect("no calibration").to_string();
    assert!(error.contains("/left/camera_info") && error.contains("another camera"), "{error}");
    // The rig file may name it.
    let mut options = Options::default();
    options.rig.camera.camera_info = Some("/left/camera_info".into());
    assert_eq!(
        survey_of(other, &options).unwrap().camera_info.as_deref(),
        Some("/left/camera_info")
    );
}

#[test]
fn a_calibration_that_cannot_be_used_is_named_with_the_reason() {
    let focal = focal_px();
    let of_info = |edit: &dyn Fn(&mut Record)| {
        survey(|r| {
            if r.topic == "/camera/camera_info" {
                edit(r);
            }
        })
    };
    let sized = of_info(&|r| {
        r.replace(&[448u32.to_le_bytes(), 576u32.to_le_bytes()].concat(), &[0; 8]);
    });
    let sized = sized.unwrap();
    assert!(has(&sized, "camera-info-without-size"));
    assert_eq!((sized.rig.camera.fx, sized.rig.camera.width), (focal, 576));
    let faults: [(Edit<'_>, &str); 3] = [
        (&|r| r.replace_f64(focal, 0.0), "its K is zero"),
        (&|r| r.replace_f64(focal, 1.2), "no camera has focal lengths"),
        (&|r| r.replace(&448u32.to_le_bytes(), &576u32.to_le_bytes()), "a crop or binned"),
    ];
    for (fault, reason) in faults {
        let error = of_info(fault).err().expect(reason).to_string();
        let is_named = error.contains("/camera/camera_info") && error.contains("edited.mcap");
        assert!(is_named && error.contains(reason), "{error}");
    }
}

#[test]
fn every_channel_of_a_topic_is_used() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("merged.mcap");
    let mut all = records(&sample());
    let half = all.len() / 2;
    all[half..].iter_mut().for_each(|r| r.lane = 1);
    write(&path, &all);
    let [whole, merged] = [sample(), path]
        .map(|path| CameraSession::open(&path, &Options::default()).unwrap().survey);
    assert_eq!(whole.pings.count(), merged.pings.count());
    assert_eq!(whole.pings.attitude().len(), merged.pings.attitude().len());
    assert_eq!(whole.frames.len(), merged.frames.len());
}

#[test]
fn frames_are_in_the_order_of_time_whatever_that_of_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("unsorted.mcap");
    let mut all = records(&sample());
    all.reverse();
    write(&path, &all);
    let survey = CameraSession::open(&path, &Options::default()).unwrap().survey;
    assert!(survey.frames.windows(2).all(|w| w[0].stamp < w[1].stamp));
    for (i, frame) in survey.frames.iter().enumerate() {
        assert_eq!(survey.frame_number(frame.id), Some(i));
    }
}

#[test]
fn messages_are_read_without_their_definition_and_compressed_one_by_one() {
    let of_dvl = |edit: &dyn Fn(&mut Record)| {
        survey(|r| {
            if r.topic == "/dvl/data" {
                edit(r);
            }
        })
    };
    let pings = survey(|_| {}).unwrap().pings.count();
    for blank in ["", "marine_acoustic_msgs/msg/Dvl"] {
        let found = of_dvl(&|r| r.schema.2 = blank.into()).unwrap();
        assert!(has(&found, "schema-known-by-name"), "{:?}", found.diagnostics);
        assert_eq!(found.pings.count(), pings);
    }
    let without_parts = of_dvl(&|r| {
        let text = String::from_utf8(r.schema.2.clone()).unwrap();
        r.schema.2 = text.split("=====").next().unwrap().into();
    });
    assert_eq!(without_parts.unwrap().pings.count(), pings);
    let error = of_dvl(&|r| r.schema = ("a/msg/B".into(), "ros2msg".into(), Vec::new()));
    let error = error.err().expect("no ranges").to_string();
    assert!(error.contains("/dvl/data: it carries no message definition"), "{error}");
    let compressed = survey(|r| r.data = zstd::bulk::compress(&r.data, 3).unwrap()).unwrap();
    assert_eq!((compressed.pings.count(), compressed.frames.len()), (pings, 20));
}

#[test]
fn json_inside_a_text_is_read_as_json() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("text.mcap");
    let mut all = records(&sample());
    for r in all.iter_mut().filter(|r| r.topic == "/depth") {
        r.topic = "/altimeter".into();
        r.schema = ("std_msgs/msg/String".into(), "ros2msg".into(), b"string data\n".to_vec());
        let json = "{\"altitude\": 2.125}\0";
        r.data = [&[0, 1, 0, 0][..], &(json.len() as u32).to_le_bytes(), json.as_bytes()].concat();
    }
    all.retain(|r| r.topic != "/dvl/data");
    write(&path, &all);
    let mut options = Options::default();
    options.rig.dvl.mount = Some(unwater::vehicle::MountFacts {
        translation_m: [0.0; 3],
        rotation_xyzw: Some([1.0, 0.0, 0.0, 0.0]),
        roll_pitch_yaw_deg: None,
    });
    let survey = CameraSession::open(&path, &options).unwrap().survey;
    assert_eq!(survey.dvl_topic, "/altimeter");
    assert_eq!(survey.pings.all().next().unwrap().altitude.map(|a| a.0), Some(2.125));
}

#[test]
fn inspect_keeps_its_word() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("broken.mcap");
    let output = folder.path().join("out.mcap");
    // The encoding of the images is unknown; the ranges are all lost.
    let faults: [(Edit<'_>, &str); 2] = [
        (&|r| r.replace(b"bayer_rggb16", b"bayer_what16"), "bayer_what16"),
        (
            &|r| {
                if r.topic == "/dvl/data" {
                    r.data.truncate(40);
                }
            },
            "/dvl/data",
        ),
    ];
    for (fault, reason) in faults {
        edited(&path, fault);
        let inspected = unwater(&["inspect", text(&path)]);
        let corrected = unwater(&["correct", text(&path), "-o", text(&output)]);
        assert_eq!((inspected.status.code(), corrected.status.code()), (Some(1), Some(1)));
        for said in [&inspected.stdout, &corrected.stderr] {
            let said = String::from_utf8_lossy(said);
            assert!(said.contains(reason), "{said}");
        }
        assert!(!output.exists());
    }
}

#[test]
fn images_without_a_frame_have_that_of_their_calibration() {
    let nameless = |r: &mut Record| {
        if r.topic == "/camera/image_raw" {
            // Length, 21 bytes and padding become the empty string with its padding.
            assert_eq!(r.data[12..37], *b"\x15\0\0\0camera_optical_frame\0");
            r.data.splice(12..40, [1, 0, 0, 0, 0, 0, 0, 0]);
        }
    };
    let found = survey(nameless).unwrap();
    assert_eq!(found.camera_frame, "camera_optical_frame");
    assert!(has(&found, "frame-of-camera-info"));
}

#[test]
fn a_window_without_an_image_is_named() {
    let output = unwater(&["correct", text(&sample()), "-o", "none.mcap", "-S", "1", "-E", "2"]);
    assert_eq!(output.status.code(), Some(1));
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(said.contains("-S and -E"), "{said}");
}

#[test]
fn what_a_killed_run_left_is_removed_by_the_next_run_on_its_output() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    // No process has the first number; this one has the second.
    let own = format!(".out.mcap.{}.part", std::process::id());
    let names = [".out.mcap.4194999.part", own.as_str(), ".other.mcap.4194999.part"];
    names.iter().for_each(|name| std::fs::write(at(name), "left").unwrap());
    let output = at("out.mcap");
    let done = unwater(&["correct", text(&sample()), "-o", text(&output), "-q"]);
    assert!(done.status.success() && output.exists());
    assert_eq!(names.map(|name| at(name).exists()), [false, true, true]);
}

#[test]
fn mounts_that_are_placeholders_or_not_in_metres_are_named() {
    let of_tf = |edit: Edit<'_>| {
        survey(|r| {
            if r.topic == "/tf_static" {
                edit(r);
            }
        })
    };
    let survey = survey(|_| {}).unwrap();
    let at = survey.rig.body_from_dvl.origin().vector();
    assert!(at.norm() > 0.05 && !has(&survey, "mount-without-translation"));
    let zeroed = of_tf(&|r| at.iter().for_each(|v| r.replace_f64(*v, 0.0))).unwrap();
    assert!(has(&zeroed, "mount-without-translation"));
    let far = of_tf(&|r| at.iter().for_each(|v| r.replace_f64(*v, 1000.0 * v)));
    let error = far.err().expect("no mount").to_string();
    assert!(error.contains("more than 50 m away") && error.contains("/dvl/data"), "{error}");
}

/// A gradient with some texture, 48×32.
fn sample_values() -> Vec<u8> {
    let value = |x: usize, y: usize, b: usize| (5 * x + 3 * y + 40 * b + x * y % 7) as u8;
    let pixel = |i: usize| [0, 1, 2].map(|b| value(i % 48, i / 48, b));
    (0..48 * 32).flat_map(pixel).collect()
}

fn pixels(data: &[u8]) -> Vec<f32> {
    let image = EncodedImage::Compressed { format: "", data };
    let decoded = decode(&image, CameraResponse::default()).unwrap();
    decoded.image.into_demosaiced().pixels
}

#[test]
fn motion_jpeg_without_huffman_tables_is_read() {
    let mut whole = Vec::new();
    let encoder = jpeg_encoder::Encoder::new(&mut whole, 90);
    encoder.encode(&sample_values(), 48, 32, jpeg_encoder::ColorType::Rgb).unwrap();
    let (mut bare, mut at) = (whole[..2].to_vec(), 2);
    while whole[at + 1] != 0xda {
        let end = at + 2 + usize::from(u16::from_be_bytes([whole[at + 2], whole[at + 3]]));
        if whole[at + 1] != 0xc4 {
            bare.extend(&whole[at..end]);
        }
        at = end;
    }
    bare.extend(&whole[at..]);
    assert!(bare.len() + 400 < whole.len(), "the tables are left out");
    assert_eq!(pixels(&bare), pixels(&whole));
}

#[test]
fn tiff_is_read() {
    // Uncompressed, little-endian, one strip: header, pixels, directory.
    let sample_values = sample_values();
    let (bits, directory) = (8 + sample_values.len() as u32, 8 + sample_values.len() as u32 + 6);
    let mut file = [b"II\x2a\0", &directory.to_le_bytes()[..], &sample_values].concat();
    file.extend([8u16; 3].iter().flat_map(|v| v.to_le_bytes()));
    let entries: [(u16, u16, u32, u32); 9] = [
        (256, 3, 1, 48),
        (257, 3, 1, 32),
        (258, 3, 3, bits),
        (259, 3, 1, 1),
        (262, 3, 1, 2),
        (273, 4, 1, 8),
        (277, 3, 1, 3),
        (278, 3, 1, 32),
        (279, 4, 1, sample_values.len() as u32),
    ];
    file.extend((entries.len() as u16).to_le_bytes());
    for (tag, kind, count, value) in entries {
        file.extend([tag.to_le_bytes(), kind.to_le_bytes()].concat());
        file.extend([count.to_le_bytes(), value.to_le_bytes()].concat());
    }
    file.extend([0; 4]);
    let raw = EncodedImage::Raw {
        width: 48,
        height: 32,
        encoding: "rgb8",
        big_endian: false,
        step: 144,
        data: &sample_values,
    };
    let raw = decode(&raw, CameraResponse::default()).unwrap().image.into_demosaiced().pixels;
    assert_eq!(pixels(&file), raw);
}

/// Path of a whole log with one fault; `None` without that data.
fn field_log(name: &str) -> Option<std::path::PathBuf> {
    let folder = std::env::var_os("UNWATER_DATA")?;
    Some(Path::new(&folder).join(format!("field/{name}.mcap")))
}

#[test]
fn whole_logs_with_one_fault_are_surveyed_or_refused_by_name() {
    // Code of the diagnostic or words of the error.
    let expected: &[(&str, Result<&str, &str>)] = &[
        ("camera_frame_is_no_optical", Ok("camera-frame-not-optical")),
        ("camera_info_k0_no_frame", Err("its K is zero")),
        ("camera_info_only_other", Err("another camera")),
        ("camera_info_size_zero", Ok("camera-info-without-size")),
        ("camera_on_tilt_servo", Ok("joint-followed")),
        ("dvl_millimetres", Err("unit_m = 0.001")),
        ("dvl_schema_empty", Ok("schema-known-by-name")),
        ("frozen_pings_small", Ok("pings-repeated")),
        ("image_rect_mild", Ok("images-rectified")),
        ("messages_zstd_each", Ok("camera-info-used")),
        ("mjpeg_without_huffman_tables", Ok("camera-info-used")),
        ("right_camera_zero_left_fine", Err("its K is zero")),
        ("split_without_tf_static", Err("a split recording")),
        ("step_zero", Ok("camera-info-used")),
        ("tf_camera_mount_on_tf_topic", Ok("camera-info-used")),
        ("tf_two_parents", Ok("transforms-conflict")),
        ("waterlinked_equal_beams", Ok("beams-all-equal")),
    ];
    for (name, expected) in expected {
        let Some(path) = field_log(name) else { return };
        match (CameraSession::open(&path, &Options::default()), expected) {
            (Ok(session), Ok(code)) => assert!(has(&session.survey, code), "{name}"),
            (Err(error), Err(words)) => {
                assert!(error.to_string().contains(words), "{name}: {error}");
            }
            (Ok(_), Err(words)) => panic!("{name} is accepted in spite of {words}"),
            (Err(error), Ok(_)) => panic!("{name}: {error}"),
        }
    }
}

#[test]
fn whole_logs_with_one_fault_give_the_right_attenuation_or_none() {
    // What the untouched log gives, which is right within three of its standard deviations.
    let right = [0.451, 0.144, 0.108];
    let names = [
        "camera_frame_is_no_optical",
        "camera_info_size_zero",
        "camera_on_tilt_servo",
        "dvl_schema_empty",
        "dvl_turned_135",
        "image_rect_mild",
        "messages_zstd_each",
        "tf_camera_mount_on_tf_topic",
        "two_channels_one_topic",
        "unchunked_unsorted",
        // Overlapping frames show the slope.
        "waterlinked_equal_beams",
    ];
    let estimated = |name: &str| {
        let path = field_log(name)?;
        Some(estimate_logs(&[&path], &Options::default(), &Silent).expect(name).0)
    };
    for name in names {
        let Some(model) = estimated(name) else { return };
        assert!(model.identified, "{name}: {:?}", model.not_identified_because);
        for (found, right) in model.attenuation_per_m.iter().zip(right) {
            assert!((found - right).abs() < 0.006, "{name}: {:?}", model.attenuation_per_m);
        }
    }
    for name in ["dark_midwater_frames", "frozen_pings_small", "long_dropout"] {
        let model = estimated(name).expect(name);
        assert!(!model.identified, "{name}: {:?}", model.attenuation_per_m);
    }
    let turned = estimated("dvl_turned_135").expect("a model");
    assert!(turned.diagnostics.iter().any(|d| d.code() == "dvl-turned-about-its-axis"));
    assert!(turned.geometry.is_some_and(|g| g.dvl_rotation_xyzw.is_some()));
    let still = estimated("camera_on_tilt_servo").expect("a model");
    assert!(still.diagnostics.iter().any(|d| d.code() == "joint-contradicted"));
    assert!(still.geometry.is_some_and(|g| g.is_camera_held));
    // Only reported, the given mount gives a wrong number.
    let mut report = Options::default();
    report.config.estimate.self_calibration = SelfCalibration::Report;
    let path = field_log("dvl_turned_135").expect("a log");
    let (kept, _) = estimate_logs(&[&path], &report, &Silent).expect("a model");
    assert!(!kept.identified && kept.geometry.is_none(), "{:?}", kept.attenuation_per_m);
}
