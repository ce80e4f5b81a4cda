//! Logs that are odd, large or broken in one way each: what `inspect` reports about them, and that
//! they are read.
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use unwater::diagnostics::{Diagnostic, LogFact};
use unwater::image::EncodedImage;
use unwater::image::decode::{CameraResponse, decode};
use unwater::recording::{Entry, Recording, Window};
use unwater::session::{Threads, index::scan};
use unwater::vehicle::DvlFacts;

const NUMBER: &[u8] = b"float64 data\n";

/// A log of so many channels of bare altitudes and rounds of messages over them.
fn log(path: &Path, options: mcap::WriteOptions, channels: u16, rounds: u32) {
    let mut writer = options
        .profile("ros2")
        .create(std::io::BufWriter::new(std::fs::File::create(path).unwrap()))
        .unwrap();
    let schema = writer.add_schema("std_msgs/msg/Float64", "ros2msg", NUMBER).unwrap();
    let ids: Vec<u16> = (0..channels)
        .map(|n| {
            writer.add_channel(schema, &format!("/n{n}/altitude"), "cdr", &BTreeMap::new()).unwrap()
        })
        .collect();
    let body = [&[0, 1, 0, 0][..], &2.5f64.to_le_bytes()].concat();
    for round in 0..rounds {
        for id in &ids {
            let time = 1_000_000_000 + u64::from(round);
            let header = mcap::records::MessageHeader {
                channel_id: *id,
                sequence: round,
                log_time: time,
                publish_time: time,
            };
            writer.write_to_known_channel(&header, &body).unwrap();
        }
    }
    writer.finish().unwrap();
}

fn diagnostics(path: &Path) -> Vec<Diagnostic> {
    Recording::open(path).unwrap().diagnostics()
}

fn sample(name: &str) -> PathBuf {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/sample_logs/messages")).join(name)
}

#[test]
fn many_chunks_and_many_channels() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("chunks.mcap");
    log(&path, mcap::WriteOptions::new().chunk_size(Some(1)), 1, 400);
    let recording = Recording::open(&path).unwrap();
    assert!(
        recording.chunk_count() >= 400 && recording.messages(Window::ALL).count() == 400,
        "{} chunks",
        recording.chunk_count()
    );
    log(&path, mcap::WriteOptions::new(), 65_000, 1);
    let recording = Recording::open(&path).unwrap();
    let (scanned, readings) =
        scan(&recording, Window::ALL, &DvlFacts::default(), &Threads::new(1)).unwrap();
    assert_eq!(
        (scanned.channels.len(), scanned.messages, scanned.damage.len()),
        (65_000, 65_000, 0)
    );
    assert!(readings.0.values().all(|c| c.pings.len() == 1));
}

#[test]
fn only_unusual_properties_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("odd.mcap");
    log(&path, mcap::WriteOptions::new(), 2, 3);
    assert_eq!(diagnostics(&path), []);
    log(&path, mcap::WriteOptions::new().use_chunks(false), 2, 3);
    assert_eq!(diagnostics(&path), [LogFact::OutsideChunks { messages: 6 }.into()]);
    log(&path, mcap::WriteOptions::new().calculate_chunk_crcs(false), 2, 3);
    assert_eq!(diagnostics(&path), [LogFact::WithoutChecksum { chunks: 1, of: 1 }.into()]);

    // No summary: the footer's numbers are 0, as a fast recorder writes them.
    log(&path, mcap::WriteOptions::new(), 2, 3);
    let mut bytes = std::fs::read(&path).unwrap();
    let footer = bytes.len() - 8 - 20;
    bytes[footer..footer + 16].fill(0);
    std::fs::write(&path, &bytes).unwrap();
    assert_eq!(diagnostics(&path), [LogFact::NoSummary.into()]);
    assert_eq!(Recording::open(&path).unwrap().messages(Window::ALL).count(), 6);
}

#[test]
fn two_schemas_of_one_name_are_reported_and_both_are_used() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("clash.mcap");
    let mut writer = mcap::WriteOptions::new()
        .create(std::io::BufWriter::new(std::fs::File::create(&path).unwrap()))
        .unwrap();
    for (n, (definition, body)) in [
        (NUMBER, 2.5f64.to_le_bytes().to_vec()),
        (b"float32 data\n", 1.5f32.to_le_bytes().to_vec()),
    ]
    .into_iter()
    .enumerate()
    {
        writer.add_schema_with_id(1 + n as u16, "p/msg/Altitude", "ros2msg", definition).unwrap();
        writer
            .add_channel_with_id(n as u16, 1 + n as u16, "/altitude", "cdr", &BTreeMap::new())
            .unwrap();
        let header = mcap::records::MessageHeader {
            channel_id: n as u16,
            sequence: 0,
            log_time: 5,
            publish_time: 5,
        };
        writer.write_to_known_channel(&header, &[vec![0, 1, 0, 0], body].concat()).unwrap();
    }
    writer.finish().unwrap();
    let recording = Recording::open(&path).unwrap();
    let reused = LogFact::SchemaNameReused { name: "p/msg/Altitude".into(), schemas: 2 };
    let several = Diagnostic::on("/altitude", LogFact::SeveralChannels { channels: 2 });
    assert_eq!(recording.diagnostics(), [reused.into(), several]);
    let (_, readings) =
        scan(&recording, Window::ALL, &DvlFacts::default(), &Threads::new(1)).unwrap();
    let read: Vec<f64> = readings.0.values().map(|c| c.pings[0].0.altitude.unwrap().0).collect();
    assert_eq!(read, [2.5, 1.5]);
}

#[test]
fn a_truncated_jpeg_is_an_error() {
    let recording = Recording::open(&sample("compressed_jpeg.mcap")).unwrap();
    let Some(Entry::Message(m)) = recording.messages(Window::ALL).next() else {
        panic!("a message")
    };
    let start = m.data().windows(3).position(|w| w == [0xff, 0xd8, 0xff]).unwrap();
    let file = &m.data()[start..];
    let whole = |data: &[u8]| {
        decode(&EncodedImage::Compressed { format: "jpeg", data }, CameraResponse::default())
            .map(drop)
    };
    assert_eq!(whole(file), Ok(()));
    // Some cameras pad.
    assert_eq!(whole(&[file, &[0; 64]].concat()), Ok(()));
    let end = file.windows(2).rposition(|w| w == [0xff, 0xd9]).unwrap();
    for cut in [end, end - 1, end - 40, end / 2, 20] {
        assert!(whole(&file[..cut]).is_err(), "cut at {cut} of {end}");
    }
}
