//! A log with changes: its messages are read, edited and written to another file.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use unwater::recording::{Entry, Recording, Window};

/// A message with all that the file states about its channel.
#[derive(Clone)]
pub struct Record {
    /// messages of one topic and lane share a channel
    pub lane: usize,
    pub topic: String,
    pub encoding: String,
    /// name, encoding and definition
    pub schema: (String, String, Vec<u8>),
    pub log_time: u64,
    pub data: Vec<u8>,
}

impl Record {
    /// Replaces every occurrence of some bytes by others of the same number.
    pub fn replace(&mut self, from: &[u8], to: &[u8]) {
        assert_eq!(from.len(), to.len());
        for at in 0..self.data.len().saturating_sub(from.len()) + 1 {
            if self.data[at..].starts_with(from) {
                self.data[at..at + from.len()].copy_from_slice(to);
            }
        }
    }

    /// Replaces a 64-bit float.
    pub fn replace_f64(&mut self, from: f64, to: f64) {
        self.replace(&from.to_le_bytes(), &to.to_le_bytes());
    }
}

/// The sample log of the repository: 20 frames.
pub fn sample() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("sample_logs/rendered_clear.mcap")
}

/// All messages of a log, in the order of the file.
pub fn records(source: &Path) -> Vec<Record> {
    let recording = Recording::open(source).unwrap();
    let record = |entry| {
        let Entry::Message(m) = entry else { panic!("the source is damaged") };
        let channel = &recording.channels[&m.channel];
        let schema = &recording.schemas[&channel.schema_id];
        Record {
            lane: 0,
            topic: channel.topic.clone(),
            encoding: channel.message_encoding.clone(),
            schema: (schema.name.clone(), schema.encoding.clone(), schema.data.clone()),
            log_time: m.log_time,
            data: m.data().to_vec(),
        }
    };
    recording.messages(Window::ALL).map(record).collect()
}

/// Writes messages into a log.
pub fn write(target: &Path, records: &[Record]) {
    let file = std::io::BufWriter::new(std::fs::File::create(target).unwrap());
    let mut writer = mcap::WriteOptions::new().profile("ros2").create(file).unwrap();
    let mut channels: BTreeMap<(String, usize), u16> = BTreeMap::new();
    for record in records {
        let key = (record.topic.clone(), record.lane);
        let next = channels.len() as u16 + 1;
        let id = *channels.entry(key).or_insert(next);
        if id == next {
            let (name, encoding, data) = &record.schema;
            writer.add_schema_with_id(next, name, encoding, data).unwrap();
            let metadata = BTreeMap::new();
            writer
                .add_channel_with_id(id, next, &record.topic, &record.encoding, &metadata)
                .unwrap();
        }
        let header = mcap::records::MessageHeader {
            channel_id: id,
            sequence: 0,
            log_time: record.log_time,
            publish_time: record.log_time,
        };
        writer.write_to_known_channel(&header, &record.data).unwrap();
    }
    writer.finish().unwrap();
}

/// The same dive, so many seconds later.
pub fn delay(path: &Path, seconds: i32) {
    let mut log = records(path);
    for record in &mut log {
        record.log_time += u64::from(seconds.unsigned_abs()) * 1_000_000_000;
        // An array of transforms begins with its length, the others with a stamp.
        if record.topic != "/tf_static" {
            let stamp = i32::from_le_bytes(record.data[4..8].try_into().unwrap());
            record.data[4..8].copy_from_slice(&(stamp + seconds).to_le_bytes());
        }
    }
    write(path, &log);
}

/// The sample with every message edited.
pub fn edited(target: &Path, edit: impl Fn(&mut Record)) {
    let mut records = records(&sample());
    records.iter_mut().for_each(edit);
    write(target, &records);
}

/// A writer of another file, with the schemas and channels of a log under their ids.
pub fn writer_like(
    log: &Recording,
    target: &Path,
    options: mcap::WriteOptions,
) -> mcap::Writer<std::io::BufWriter<std::fs::File>> {
    let file = std::io::BufWriter::new(std::fs::File::create(target).unwrap());
    let mut writer = options.profile("ros2").create(file).unwrap();
    for (id, s) in &log.schemas {
        writer.add_schema_with_id(*id, &s.name, &s.encoding, &s.data).unwrap();
    }
    for (id, c) in &log.channels {
        let encoding = &c.message_encoding;
        writer.add_channel_with_id(*id, c.schema_id, &c.topic, encoding, &c.metadata).unwrap();
    }
    writer
}

/// Copies the messages of a log that `edit` keeps, by topic and payload, which it may change.
pub fn copy_messages<W: std::io::Write + std::io::Seek>(
    log: &Recording,
    writer: &mut mcap::Writer<W>,
    mut edit: impl FnMut(&str, &mut Vec<u8>) -> bool,
) {
    for entry in log.messages(Window::ALL) {
        let Entry::Message(m) = entry else { panic!("the source is damaged") };
        let header = mcap::records::MessageHeader {
            channel_id: m.channel,
            sequence: m.sequence,
            log_time: m.log_time,
            publish_time: m.publish_time,
        };
        let mut data = m.data().to_vec();
        if edit(&log.channels[&m.channel].topic, &mut data) {
            writer.write_to_known_channel(&header, &data).unwrap();
        }
    }
}
