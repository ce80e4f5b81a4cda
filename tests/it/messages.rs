//! Every message type, from logs that an independent writer made (`sample_logs/messages/make.py`),
//! against what that writer put into them (`expected.json`).
use std::collections::BTreeMap;
use std::path::Path;

use serde_json::Value as Json;
use unwater::image::EncodedImage;
use unwater::image::decode::{CameraResponse, decode, white_level};
use unwater::image::transfer::Transfer;
use unwater::messages::{Decoder, Kind, TYPES, header};
use unwater::recording::{Entry, Message, Recording, Window};
use unwater::vehicle::DvlFacts;

const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/sample_logs/messages");

fn read_log(name: &str) -> (Recording, Vec<Message>) {
    let recording = Recording::open(&Path::new(FOLDER).join(name)).expect(name);
    assert!(recording.is_complete && recording.damage.is_empty(), "{name}: {:?}", recording.damage);
    let messages = recording
        .messages(Window::ALL)
        .filter_map(|e| if let Entry::Message(m) = e { Some(m) } else { None })
        .collect();
    (recording, messages)
}

fn decoder(recording: &Recording, message: &Message, rig: &DvlFacts) -> Decoder {
    let channel = &recording.channels[&message.channel];
    if channel.schema_id == 0 {
        return Decoder::for_json(&channel.topic, message.data())
            .expect("JSON")
            .expect("a decoder");
    }
    let schema = &recording.schemas[&channel.schema_id];
    if rig.path.is_some() {
        return Decoder::by_path(
            &channel.message_encoding,
            &schema.name,
            &schema.encoding,
            &schema.data,
        )
        .expect("a schema");
    }
    let mut decoder = Decoder::for_channel(
        &channel.topic,
        &channel.message_encoding,
        &schema.name,
        &schema.encoding,
        &schema.data,
    )
    .expect("a schema")
    .expect("a decoder");
    decoder.refine(&channel.topic, message.data());
    decoder
}

fn rig(entry: &Json) -> DvlFacts {
    entry.get("rig").map(|r| serde_json::from_value(r.clone()).expect("facts")).unwrap_or_default()
}

fn close(a: f64, b: f64, tolerance: f64) -> bool {
    (a - b).abs() <= tolerance
}

fn floats(json: &Json) -> Vec<f64> {
    json.as_array()
        .map(|a| a.iter().map(|v| v.as_f64().unwrap_or(f64::NAN)).collect())
        .unwrap_or_default()
}

fn check_image(file: &str, image: &unwater::image::EncodedImage<'_>, expected: &Json) {
    // PixelValues as they are first: the transfer curve is undone by `auto` below.
    let codes =
        decode(image, CameraResponse { transfer: Transfer::Linear, ..CameraResponse::default() })
            .expect(file);
    let white = white_level(codes.coding.bits_used);
    let codes = decode(
        image,
        CameraResponse {
            transfer: Transfer::Linear,
            white_level: Some(white),
            ..CameraResponse::default()
        },
    )
    .expect(file);
    let automatic = decode(image, CameraResponse::default()).expect(file);
    assert_eq!(
        automatic.coding.transfer == Transfer::Linear,
        expected["linear"].as_bool().expect("linear"),
        "{file}: transfer"
    );
    assert_eq!(
        u64::from(codes.coding.bits),
        expected["bits"].as_u64().expect("bits"),
        "{file}: bits"
    );
    let image = codes.image.into_demosaiced();
    assert_eq!(
        (image.width as u64, image.height as u64, image.bands as u64),
        (
            expected["width"].as_u64().unwrap(),
            expected["height"].as_u64().unwrap(),
            expected["bands"].as_u64().unwrap()
        ),
        "{file}: size"
    );
    // Full scale is estimated from the bits in use; a dozen tiny gradients may not reach the top
    // one.
    let scale = if codes.coding.bits == 16 {
        f64::from(white) / expected["full_scale"].as_f64().unwrap()
    } else {
        1.0
    };
    assert!(close(scale, 1.0, 1e-3), "{file}: white level {white}");
    let tolerance = expected["tolerance"].as_f64().expect("tolerance") + 3e-4;
    for at in expected["rgb_at"].as_array().expect("rgb_at") {
        let (x, y, truth) =
            (at[0].as_u64().unwrap() as usize, at[1].as_u64().unwrap() as usize, floats(&at[2]));
        for (band, (value, truth)) in image.at(x, y).iter().zip(&truth).enumerate() {
            assert!(
                close(f64::from(*value), *truth, tolerance),
                "{file}: pixel {x},{y} band {band} is {value}, not {truth}"
            );
        }
    }
}

#[test]
fn every_message_type_decodes_to_the_expected_values() {
    let expected: Json = serde_json::from_str(
        &std::fs::read_to_string(Path::new(FOLDER).join("expected.json")).unwrap(),
    )
    .unwrap();
    let mut logs: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for (file, entry) in expected.as_object().expect("an object") {
        let (recording, messages) = read_log(file);
        let readings = entry["readings"].as_array().expect("readings");
        let rig = rig(entry);
        let mut known = None;
        assert_eq!(
            messages.len(),
            entry["stamps_ns"].as_array().unwrap().len(),
            "{file}: messages"
        );
        for (i, message) in messages.iter().enumerate() {
            let decoder = known.get_or_insert_with(|| decoder(&recording, message, &rig));
            if i == 0 {
                logs.entry(decoder.message_type.name).or_default().push(file);
            }
            let value = decoder.read(message.data()).expect(file);
            let said = header(&value);
            assert_eq!(
                message.log_time,
                entry["log_times_ns"][i].as_u64().unwrap(),
                "{file}: log time"
            );
            // Transforms have their headers inside.
            if !matches!(decoder.message_type.kind, Kind::Transforms(_)) {
                assert_eq!(
                    said.stamp.unwrap_or(message.log_stamp()).0,
                    entry["stamps_ns"][i].as_i64().unwrap(),
                    "{file}: stamp"
                );
                assert_eq!(
                    said.frame_id,
                    entry["frame_id"].as_str().unwrap_or(""),
                    "{file}: frame"
                );
            }
            let truth = readings.get(i).unwrap_or(&Json::Null);
            match decoder.message_type.kind {
                Kind::Image(read) if entry["kind"] == "video" => {
                    let codec = truth.as_str().unwrap();
                    assert_eq!(read(&value).expect(file), EncodedImage::Video { codec }, "{file}");
                }
                Kind::Ping(_, read) if entry["kind"] == "depth" => {
                    let pixels = read(&value, &rig).expect(file).depth.expect(file);
                    assert_eq!(
                        (pixels.width as u64, pixels.height as u64),
                        (truth["width"].as_u64().unwrap(), truth["height"].as_u64().unwrap())
                    );
                    let samples = truth["samples"].as_array().unwrap();
                    assert_eq!(pixels.samples.len(), samples.len(), "{file}: places");
                    for (found, truth) in pixels.samples.iter().zip(samples) {
                        let t = floats(truth);
                        assert!(
                            found[..2] == t[..2] && close(found[2], t[2], 1e-3),
                            "{file}: {found:?} is not {t:?}"
                        );
                    }
                }
                Kind::Image(read) => check_image(file, &read(&value).expect(file), truth),
                Kind::CameraInfo(read) => match read(&value).expect(file).camera(None, false) {
                    Err(_) => assert!(truth.is_null(), "{file}"),
                    Ok((camera, _)) => {
                        assert_eq!(
                            (camera.width as u64, camera.height as u64),
                            (truth["width"].as_u64().unwrap(), truth["height"].as_u64().unwrap())
                        );
                        let k = floats(&truth["k"]);
                        assert_eq!(
                            (camera.fx, camera.cx, camera.fy, camera.cy),
                            (k[0], k[2], k[4], k[5]),
                            "{file}"
                        );
                        assert_eq!(
                            camera.distortion.name(),
                            truth["model"].as_str().unwrap(),
                            "{file}"
                        );
                        let d = floats(&truth["d"]);
                        assert_eq!(camera.distortion.coefficients()[..d.len()], d[..], "{file}");
                    }
                },
                Kind::Transforms(read) => {
                    for (edge, truth) in read(&value).expect(file).iter().zip(readings) {
                        let (t, q) = (floats(&truth["t"]), floats(&truth["q"]));
                        assert_eq!(
                            (edge.parent.as_str(), edge.child.as_str()),
                            (truth["parent"].as_str().unwrap(), truth["child"].as_str().unwrap())
                        );
                        let pose = edge.pose.expect(file);
                        assert!(
                            (pose.translation.vector - nalgebra::Vector3::new(t[0], t[1], t[2]))
                                .norm()
                                < 1e-12,
                            "{file}"
                        );
                        let r = pose.rotation;
                        assert!(
                            close(r.i, q[0], 1e-9)
                                && close(r.j, q[1], 1e-9)
                                && close(r.k, q[2], 1e-9)
                                && close(r.w, q[3], 1e-9),
                            "{file}"
                        );
                    }
                }
                Kind::Attitude(read) => match read(&value).expect(file) {
                    None => assert!(truth.is_null(), "{file}: {i}"),
                    Some(r) => {
                        let q = floats(truth);
                        assert!(
                            close(r.i, q[0], 1e-6)
                                && close(r.j, q[1], 1e-6)
                                && close(r.k, q[2], 1e-6)
                                && close(r.w, q[3], 1e-6),
                            "{file}"
                        );
                    }
                },
                Kind::Radiometry(read) => {
                    let found: BTreeMap<&str, f64> =
                        read(&value).expect(file).into_iter().collect();
                    let expected: BTreeMap<&str, f64> = truth
                        .as_object()
                        .unwrap()
                        .iter()
                        .map(|(k, v)| (k.as_str(), v.as_f64().unwrap()))
                        .collect();
                    assert_eq!(found, expected, "{file}");
                }
                Kind::Ping(_, read) => {
                    check_ping(file, i, read(&value, &rig).expect(file).ping, entry, truth);
                }
            }
        }
    }
    for t in TYPES {
        assert!(logs.contains_key(t.name), "{} has no log", t.name);
    }
    ensure_page_is_current(&logs);
}

/// `docs/messages.md` is the table of types and of their logs; UNWATER_BLESS=1 rewrites it.
fn ensure_page_is_current(logs: &BTreeMap<&str, Vec<&str>>) {
    let mut page = String::from(
        "# Messages that are read\n\nMade from `src/messages/table.rs` and `sample_logs/messages` \
         by `UNWATER_BLESS=1 cargo test --test it messages`; do not edit.\n\nA channel is known by \
         the fields of its schema, the first row that fits; names are compared without case and \
         underscores. Encodings: [formats.md](formats.md#what-is-read).\nWhat the rig file can \
         say instead: [rig.md](rig.md#rigtoml).\n\n| shape | used for | what is read | sample \
         logs |\n| --- | --- | --- | --- |\n",
    );
    for t in TYPES {
        let files: Vec<String> =
            logs[t.name].iter().map(|f| format!("`{}`", f.trim_end_matches(".mcap"))).collect();
        page += &format!(
            "| `{}` | {} | {} | {} |\n",
            t.name,
            t.kind.label(),
            t.about,
            files.join(", ")
        );
    }
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/messages.md");
    if std::env::var_os("UNWATER_BLESS").is_some() {
        std::fs::write(&path, &page).unwrap();
    }
    assert!(
        std::fs::read_to_string(&path).unwrap_or_default() == page,
        "docs/messages.md is not up to date: UNWATER_BLESS=1 cargo test --test it messages"
    );
}

fn check_ping(
    file: &str,
    index: usize,
    ping: Option<unwater::vehicle::Ping>,
    entry: &Json,
    truth: &Json,
) {
    let ranges: Vec<Option<f64>> =
        ping.iter().flat_map(|p| p.beams.iter().map(|b| b.range.map(|r| r.0))).collect();
    let any = ranges.iter().flatten().count();
    if entry["kind"] == "altitude" {
        let value =
            ping.and_then(|p| p.altitude.map(|a| a.0)).or(ranges.first().copied().flatten());
        match (value, truth.as_f64()) {
            (Some(value), Some(truth)) => {
                assert!(close(value, truth, 1e-6), "{file}: {value} is not {truth}");
            }
            (value, truth) => {
                assert_eq!(value.is_some(), truth.is_some(), "{file}: reading {index}");
            }
        }
    } else if truth.is_null() {
        assert_eq!(any, 0, "{file}: ping {index} has no bottom range");
    } else {
        assert_eq!(ranges.len(), truth["ranges_m"].as_array().unwrap().len(), "{file}: beams");
        for (range, truth) in ranges.iter().zip(truth["ranges_m"].as_array().unwrap()) {
            match (range, truth.as_f64()) {
                (Some(range), Some(truth)) => {
                    assert!(close(*range, truth, 1e-6), "{file}: {range} is not {truth}");
                }
                (range, truth) => {
                    assert_eq!(range.is_some(), truth.is_some(), "{file}: ping {index}");
                }
            }
        }
        let ping = ping.expect(file);
        if let Some(directions) = truth["directions"].as_array() {
            for (beam, truth) in ping.beams.iter().zip(directions) {
                let t = floats(truth);
                assert!(
                    (beam.direction.vector() - nalgebra::Vector3::new(t[0], t[1], t[2])).norm()
                        < 1e-5,
                    "{file}"
                );
            }
        } else {
            // No vectors, or swapped ones: the A50's beams, 22.5° off the axis.
            assert!(
                ping.beams.iter().all(|b| close(
                    b.direction.vector().z,
                    22.5f64.to_radians().cos(),
                    1e-3
                )),
                "{file}"
            );
        }
    }
}

#[test]
fn a_truncated_message_is_an_error_and_never_a_panic() {
    let expected: Json = serde_json::from_str(
        &std::fs::read_to_string(Path::new(FOLDER).join("expected.json")).unwrap(),
    )
    .unwrap();
    for (file, entry) in expected.as_object().expect("an object") {
        let (recording, messages) = read_log(file);
        let decoder = decoder(&recording, &messages[0], &rig(entry));
        let data = messages[0].data();
        for cut in (0..data.len()).step_by(1 + data.len() / 97) {
            let read = decoder.read(&data[..cut]);
            // A protobuf message may end behind any of its fields.
            let may_end = recording.channels[&messages[0].channel].message_encoding == "protobuf";
            assert!(
                may_end || read.is_err() || cut + 8 >= data.len(),
                "{file}: cut at {cut} of {}",
                data.len()
            );
        }
        // Bytes turned over one at a time: whatever comes out, it comes out.
        let mut turned = data.to_vec();
        for at in (0..data.len()).step_by(1 + data.len() / 211) {
            turned[at] ^= 0xff;
            if let Ok(value) = decoder.read(&turned)
                && let Kind::Image(read) = decoder.message_type.kind
                && let Ok(image) = read(&value)
            {
                let _whatever = decode(&image, CameraResponse::default());
            }
            turned[at] ^= 0xff;
        }
    }
}
