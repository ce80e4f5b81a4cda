//! A log as long and as large as one likes, to measure on: a rendered dive, over and over.
//!
//! cargo run --release --example long_log -- OUT.mcap FRAMES [WIDTH HEIGHT [KIND [DISTINCT]]]
//!
//! KIND: jpeg (quality 92, 4:4:4), jpeg420 (the same, 4:2:0), bayer16. Frames are rendered once
//! (`DISTINCT` of them, 24 by default: one swing of the altitude) and repeated with later stamps.
#[path = "../tests/it/support/mod.rs"]
mod support;

use std::io::BufWriter;
use std::path::PathBuf;

use support::render::{Dive, Sensor};
use unwater::recording::{Entry, Recording, Window};

fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let number =
        |i: usize, default: usize| words.get(i).map_or(default, |w| w.parse().expect("a number"));
    let [path, frames, ..] = words.as_slice() else {
        eprintln!("long_log OUT.mcap FRAMES [WIDTH HEIGHT [jpeg|jpeg420|bayer16 [DISTINCT]]]");
        std::process::exit(2);
    };
    let frames: usize = frames.parse().expect("a number of frames");
    let (width, height, distinct) = (number(2, 1344), number(3, 1008), number(5, 24).min(frames));
    let sensor = match words.get(4).map(String::as_str) {
        Some("bayer16") => Sensor::Bayer16,
        Some("jpeg420") => Sensor::Jpeg420(92),
        _ => Sensor::Jpeg(92),
    };
    let once = PathBuf::from(format!("{path}.once"));
    // As sharp to the camera as the small dives of the tests: the same field of view.
    let focal_px = 460.0 * width as f64 / 384.0;
    Dive { frames: distinct, width, height, focal_px, sensor, ..Dive::default() }.write(&once);
    repeat(&once, &PathBuf::from(path), frames, distinct);
    std::fs::remove_file(once).expect("an unneeded file");
}

/// The log's messages again and again, each time as much later as the dive lasts.
fn repeat(once: &std::path::Path, path: &std::path::Path, frames: usize, distinct: usize) {
    let recording = Recording::open(once).expect("a log");
    let file = BufWriter::new(std::fs::File::create(path).expect("a file"));
    let mut writer = mcap::WriteOptions::new()
        .profile("ros2")
        .compression(None)
        .chunk_size(Some(4 << 20))
        .create(file)
        .expect("a writer");
    for (id, schema) in &recording.schemas {
        writer
            .add_schema_with_id(*id, &schema.name, &schema.encoding, &schema.data)
            .expect("a schema");
    }
    for (id, c) in &recording.channels {
        writer
            .add_channel_with_id(*id, c.schema_id, &c.topic, &c.message_encoding, &c.metadata)
            .expect("a channel");
    }
    let is_image = |channel: u16| recording.channels[&channel].topic.contains("/image_raw");
    let mut images = 0;
    let period_ns = distinct as u64 * 1_000_000_000;
    let start = recording
        .messages(Window::ALL)
        .find_map(|e| if let Entry::Message(m) = e { Some(m.log_time) } else { None })
        .expect("a message");
    for round in 0..frames.div_ceil(distinct) {
        for entry in recording.messages(Window::ALL) {
            let Entry::Message(m) = entry else { continue };
            // What runs on after the last frame would meet the next round's beginning.
            if m.log_time >= start + period_ns || (is_image(m.channel) && images == frames) {
                continue;
            }
            images += usize::from(is_image(m.channel));
            let later_s = round as u32 * distinct as u32;
            let mut data = m.data().to_vec();
            if !recording.channels[&m.channel].topic.starts_with("/tf") {
                let seconds = u32::from_le_bytes([data[4], data[5], data[6], data[7]]) + later_s;
                data[4..8].copy_from_slice(&seconds.to_le_bytes());
            }
            let later_ns = u64::from(later_s) * 1_000_000_000;
            let header = mcap::records::MessageHeader {
                channel_id: m.channel,
                sequence: m.sequence,
                log_time: m.log_time + later_ns,
                publish_time: m.publish_time + later_ns,
            };
            writer.write_to_known_channel(&header, &data).expect("a message");
        }
    }
    writer.finish().expect("a whole log");
}
