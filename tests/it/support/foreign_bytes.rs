//! Every parser of foreign bytes, and the JPEG encoder, as one `fn(&[u8])` each: called by the
//! targets in `fuzz/` and by `tests/it/foreign_bytes.rs`. Any result is accepted; a panic, a hang
//! or unbounded memory is a finding.
#![allow(dead_code, clippy::unwrap_used)]

use std::path::PathBuf;

use libjpeg_turbo_rs::{PixelFormat, Subsampling};
use unwater::config::Config;
use unwater::image::EncodedImage;
use unwater::image::decode::{CameraResponse, decode, describe, grey16, size};
use unwater::image::exif::{ExifFacts, read, with_facts};
use unwater::messages::{Decoder, Kind, header};
use unwater::model::ModelFile;
use unwater::recording::{Entry, Recording, Window};
use unwater::session::survey::survey;
use unwater::session::{Log, Options, Threads};
use unwater::vehicle::{DvlFacts, RigFile};

/// Accepts any bytes.
type Parser = fn(&[u8]);

/// Functions by name, which is also the name of the fuzz target and of the folder in `fuzz/seeds`.
pub const TARGETS: &[(&str, Parser)] = &[
    ("cdr", cdr),
    ("idl", idl),
    ("ros1", ros1),
    ("protobuf", protobuf),
    ("json", json),
    ("mcap", mcap),
    ("raw_image", raw_image),
    ("image_file", image_file),
    ("exif", exif),
    ("rig", rig),
    ("model", model),
    ("config", config),
    ("jpeg_encoder", jpeg_encoder),
];

/// Calls the function of this name.
pub fn run(target: &str, bytes: &[u8]) {
    let (_, parser) = TARGETS.iter().find(|(name, _)| *name == target).unwrap();
    parser(bytes);
}

/// A message with its schema, as one piece of bytes: `topic\nschema name\nlength of the schema\n`,
/// the schema, the message.
pub fn with_schema(topic: &str, name: &str, schema: &[u8], message: &[u8]) -> Vec<u8> {
    [format!("{topic}\n{name}\n{}\n", schema.len()).as_bytes(), schema, message].concat()
}

/// The inverse of [`with_schema`].
fn parts(bytes: &[u8]) -> Option<(&str, &str, &[u8], &[u8])> {
    let mut lines = bytes.splitn(4, |b| *b == b'\n');
    let (topic, name) =
        (std::str::from_utf8(lines.next()?).ok()?, std::str::from_utf8(lines.next()?).ok()?);
    let length: usize = std::str::from_utf8(lines.next()?).ok()?.parse().ok()?;
    let rest = lines.next()?;
    let (schema, message) = rest.split_at_checked(length.min(rest.len()))?;
    Some((topic, name, schema, message))
}

fn message(message_encoding: &str, schema_encoding: &str, bytes: &[u8]) {
    let Some((topic, name, schema, message)) = parts(bytes) else { return };
    if let Ok(Some(mut decoder)) =
        Decoder::for_channel(topic, message_encoding, name, schema_encoding, schema)
    {
        decoder.refine(topic, message);
        exercise(&decoder, message);
    }
    // Whatever shape the schema has, its messages are read by it.
    if let Ok(decoder) = Decoder::by_path(message_encoding, name, schema_encoding, schema) {
        exercise(&decoder, message);
    }
}

fn exif(bytes: &[u8]) {
    let facts = read(bytes).unwrap_or_default();
    let _written = with_facts(bytes.to_vec(), &ExifFacts { depth_m: Some(1.0), ..facts });
}

/// Everything that is done with a message.
pub fn exercise(decoder: &Decoder, data: &[u8]) {
    let Ok(value) = decoder.read(data) else { return };
    let _heading = header(&value);
    match decoder.message_type.kind {
        Kind::Image(read) => {
            if let Ok(image) = read(&value)
                && let Ok(decoded) = decode(&image, CameraResponse::default())
            {
                let _bands = decoded.image.into_demosaiced();
            }
        }
        Kind::CameraInfo(read) => {
            if let Ok(info) = read(&value)
                && let Ok((camera, _)) = info.camera(Some((640, 480)), false)
            {
                let _ray = camera.ray(1.0, 1.0);
            }
        }
        Kind::Transforms(read) => drop(read(&value)),
        Kind::Attitude(read) => drop(read(&value)),
        Kind::Radiometry(read) => drop(read(&value)),
        Kind::Ping(_, read) => {
            let of_path = DvlFacts {
                path: Some("beams.distance".into()),
                valid_path: Some("beams.valid".into()),
                ..DvlFacts::default()
            };
            for facts in [
                DvlFacts::default(),
                DvlFacts { beams: Some("waterlinked-a50".into()), ..DvlFacts::default() },
                of_path,
            ] {
                drop(read(&value, &facts));
            }
        }
    }
}

fn cdr(bytes: &[u8]) {
    message("cdr", "ros2msg", bytes);
}

fn idl(bytes: &[u8]) {
    message("cdr", "ros2idl", bytes);
}

fn ros1(bytes: &[u8]) {
    message("ros1", "ros1msg", bytes);
}

fn protobuf(bytes: &[u8]) {
    message("protobuf", "protobuf", bytes);
}

fn json(bytes: &[u8]) {
    message("json", "jsonschema", bytes);
    if let Some((topic, _, _, text)) = parts(bytes)
        && let Ok(Some(decoder)) = Decoder::for_json(topic, text)
    {
        exercise(&decoder, text);
    }
}

/// A file in memory where the system has such a place: a log is read through a map.
fn scratch() -> PathBuf {
    let shared = PathBuf::from("/dev/shm");
    let folder = if shared.is_dir() { shared } else { std::env::temp_dir() };
    folder.join(format!("unwater.{}.{:?}.mcap", std::process::id(), std::thread::current().id()))
}

/// Every record, message, attachment and metadata of a log, and what is made of them.
fn mcap(bytes: &[u8]) {
    let path = scratch();
    std::fs::write(&path, bytes).unwrap();
    if let Ok(recording) = Recording::open(&path) {
        let log = Log::scan(recording, &Options::default(), &Threads::new(1)).unwrap();
        let recording = &log.recording;
        let mut total = 0;
        for entry in recording.messages(Window { start: 1, end: 1 << 62 }) {
            if let Entry::Message(m) = entry {
                total += m.data().len();
            }
        }
        total += recording.attachments().flatten().map(|a| a.size as usize).sum::<usize>();
        std::hint::black_box(total);
        let rig: RigFile = toml::from_str("[camera]\nhorizontal_field_of_view_deg = 60.0").unwrap();
        drop(survey(&log, &Options { rig, ..Options::default() }));
    }
    std::fs::remove_file(&path).unwrap();
}

/// `width height step big_endian encoding\n`, then the pixels.
fn raw_image(bytes: &[u8]) {
    let Some(end) = bytes.iter().position(|b| *b == b'\n') else { return };
    let Ok(head) = std::str::from_utf8(&bytes[..end]) else { return };
    let mut words = head.splitn(5, ' ');
    let mut number = || words.next()?.parse::<usize>().ok();
    let (Some(width), Some(height), Some(step), Some(big)) =
        (number(), number(), number(), number())
    else {
        return;
    };
    let encoding = words.next().unwrap_or("");
    let image = EncodedImage::Raw {
        width,
        height,
        encoding,
        big_endian: big == 1,
        step,
        data: &bytes[end + 1..],
    };
    let _line = (describe(&image), size(&image));
    if let Ok(decoded) =
        decode(&image, CameraResponse { white_level: Some(4095), ..CameraResponse::default() })
    {
        let _bands = decoded.image.into_demosaiced();
    }
}

/// `format\n`, then the file.
fn image_file(bytes: &[u8]) {
    let Some(end) = bytes.iter().position(|b| *b == b'\n') else { return };
    let Ok(format) = std::str::from_utf8(&bytes[..end]) else { return };
    let image = EncodedImage::Compressed { format, data: &bytes[end + 1..] };
    let _line = (describe(&image), size(&image));
    if let Ok(decoded) = decode(&image, CameraResponse::default()) {
        let _bands = decoded.image.into_demosaiced();
    }
    drop(grey16(&bytes[end + 1..]));
}

fn rig(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let Ok(file) = toml::from_str::<RigFile>(text) else { return };
    if let Ok(Some(camera)) = file.camera.calibration(Some((64, 48))) {
        let _ray = file.camera.in_water(camera).ray(1.0, 1.0);
    }
    for mount in [&file.camera.mount, &file.dvl.mount, &file.strobe.mount].into_iter().flatten() {
        drop(mount.transform::<unwater::coordinates::Dvl>());
    }
}

fn model(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    if let Ok(file) = ModelFile::from_json(text)
        && let Ok(model) = file.imaging_model()
    {
        let _then = model.at(unwater::units::Stamp(1));
        let _again = file.to_json();
    }
}

fn config(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    if let Ok(config) = Config::from_toml(text) {
        let _again = config.to_commented_toml();
    }
}

/// Whatever pixels, size and subsampling: the file must be readable and of the size given. The
/// first four bytes are width, height, quality and subsampling; the others are repeated as pixels.
fn jpeg_encoder(bytes: &[u8]) {
    let [width, height, quality, sampling, samples @ ..] = bytes else { return };
    let (width, height) = (3 + usize::from(*width) % 78, 3 + usize::from(*height) % 78);
    let samplings = [
        Subsampling::S444,
        Subsampling::S422,
        Subsampling::S420,
        Subsampling::S440,
        Subsampling::S411,
        Subsampling::S441,
    ];
    let sampling = samplings.get(usize::from(*sampling) % (samplings.len() + 1));
    let (bands, format) =
        if sampling.is_some() { (3, PixelFormat::Rgb) } else { (1, PixelFormat::Grayscale) };
    let pixels: Vec<u8> =
        samples.iter().chain([&0]).copied().cycle().take(width * height * bands).collect();
    let sampling = *sampling.unwrap_or(&Subsampling::S444);
    let quality = 1 + quality % 100;
    let file = libjpeg_turbo_rs::compress(&pixels, width, height, format, quality, sampling)
        .expect("a JPEG");
    let image = EncodedImage::Compressed { format: "jpeg", data: &file };
    assert_eq!(size(&image), Some((width, height)));
    let decoded = decode(&image, CameraResponse::default()).expect("a readable JPEG");
    let read = decoded.image.into_demosaiced();
    assert_eq!((read.width, read.height, read.bands), (width, height, bands));
}
