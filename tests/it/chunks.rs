//! Chunks: those with nothing to leave out go through as they are, others lose nothing either, and
//! only those are read that are needed. What is written is read by the mcap crate here, which
//! shares no code with the writer.
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use crate::support::render::Dive;
use mcap::records::Record;
use unwater::config::Compression;
use unwater::model::ModelFile;
use unwater::recording::{Entry, LogIdentity, Recording, Window};
use unwater::run::{correct, estimate_logs};
use unwater::session::index::{scan, scan_with};
use unwater::session::{CameraSession, Log, Options, Silent, Threads};
use unwater::vehicle::DvlFacts;

/// A small dive and its model, made once.
fn dive() -> &'static (tempfile::TempDir, PathBuf, ModelFile) {
    static DIVE: OnceLock<(tempfile::TempDir, PathBuf, ModelFile)> = OnceLock::new();
    DIVE.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("dive.mcap");
        Dive { frames: 12, width: 192, height: 144, focal_px: 220.0, ..Dive::default() }
            .write(&path);
        let (model, _) = estimate_logs(&[&path], &Options::default(), &Silent).unwrap();
        (folder, path, model)
    })
}

/// The dive, so many times one after the other, written so.
fn written(target: &Path, options: mcap::WriteOptions, times: u64) {
    let recording = Recording::open(&dive().1).unwrap();
    let mut writer = options
        .profile("ros2")
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
    writer.add_channel_with_id(900, 0, "/note", "json", &BTreeMap::new()).unwrap();
    for n in 0..times {
        for entry in recording.messages(Window::ALL) {
            let Entry::Message(m) = entry else { continue };
            if n > 0 && recording.channels[&m.channel].topic == "/tf_static" {
                continue; // latched: said once
            }
            let later = n * 60_000_000_000;
            let (log_time, publish_time) = (m.log_time + later, m.publish_time + later);
            let mut header = mcap::records::MessageHeader {
                channel_id: m.channel,
                sequence: m.sequence + 3,
                log_time,
                publish_time,
            };
            writer.write_to_known_channel(&header, m.data()).unwrap();
            // Times that go back and forth, and one number for all.
            (header.channel_id, header.sequence, header.log_time) =
                (900, 7, log_time - log_time % 3);
            writer
                .write_to_known_channel(&header, format!("{{\"at\": {log_time}}}").as_bytes())
                .unwrap();
        }
    }
    writer.finish().unwrap();
}

type Kept = BTreeMap<u16, Vec<(u32, u64, u64, Vec<u8>)>>;

/// Messages by channel in the order of the file, by a reader that does not seek and checks every
/// checksum.
fn streamed(bytes: &[u8]) -> Kept {
    let mut kept = Kept::new();
    for message in mcap::MessageStream::new(bytes).unwrap() {
        let m = message.unwrap();
        kept.entry(m.channel.id).or_default().push((
            m.sequence,
            m.log_time,
            m.publish_time,
            m.data.into_owned(),
        ));
    }
    kept
}

/// Chunks as they lie in a file.
fn raw_chunks(bytes: &[u8]) -> Vec<(mcap::records::ChunkHeader, Vec<u8>)> {
    let chunk = |record| match record {
        Ok(Record::Chunk { header, data }) => Some((header, data.into_owned())),
        Ok(_) => None,
        Err(e) => panic!("{e}"),
    };
    mcap::read::LinearReader::new(bytes).unwrap().filter_map(chunk).collect()
}

/// Every index entry of a file leads to its message, and all messages have one; checksums hold.
fn ensure_sound(bytes: &[u8]) {
    let summary = mcap::Summary::read(bytes).unwrap().expect("a summary");
    let statistics = summary.stats.as_ref().expect("statistics");
    let mut count = 0;
    for index in &summary.chunk_indexes {
        let (mut first, mut last) = (u64::MAX, 0);
        let indexes: Vec<_> =
            summary.read_message_indexes(bytes, index).unwrap().into_iter().collect();
        for (channel, entries) in indexes {
            for entry in entries {
                let message = summary.seek_message(bytes, index, &entry).unwrap();
                assert_eq!((message.channel.id, message.log_time), (channel.id, entry.log_time));
                (first, last) = (first.min(entry.log_time), last.max(entry.log_time));
                count += 1;
            }
        }
        assert_eq!((first, last), (index.message_start_time, index.message_end_time));
    }
    let streamed = streamed(bytes);
    assert_eq!(
        (count, statistics.message_count),
        (statistics.message_count, streamed.values().map(|m| m.len() as u64).sum())
    );
    for (channel, messages) in &streamed {
        assert_eq!(statistics.channel_message_counts.get(channel), Some(&(messages.len() as u64)));
    }
    assert_eq!(statistics.chunk_count as usize, summary.chunk_indexes.len());
    // Checksums of data and summary: of all up to the record, and from the summary to the last
    // number of the footer.
    let footer = mcap::read::footer(bytes).unwrap();
    let (start, end) = (footer.summary_start as usize, bytes.len() - 8 - 4);
    assert_eq!(crc32(&bytes[start..end]), footer.summary_crc);
    let data_end = start - 9 - 4;
    assert_eq!(bytes[data_end], mcap::records::op::DATA_END);
    assert_eq!(crc32(&bytes[..data_end]).to_le_bytes(), bytes[start - 4..start]);
}

/// CRC-32 (IEEE), bit by bit.
fn crc32(bytes: &[u8]) -> u32 {
    let turned = |crc: u32, _| (crc >> 1) ^ (0xedb8_8320 & (crc & 1).wrapping_neg());
    let step = |crc: u32, byte: &u8| (0..8).fold(crc ^ u32::from(*byte), turned);
    !bytes.iter().fold(!0, step)
}

fn corrected(input: &Path, options: &Options) -> Vec<u8> {
    let out = input.with_extension("corrected.mcap");
    let options = Options { force: true, ..options.clone() };
    let (report, _) = correct(input, &out, Some(dive().2.clone()), &options, &Silent).unwrap();
    assert!(report.damage.is_empty(), "{:?}", report.damage);
    let bytes = std::fs::read(&out).unwrap();
    ensure_sound(&bytes);
    bytes
}

#[test]
fn chunks_are_copied_byte_for_byte_and_in_order() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("in.mcap");
    let chunked = || mcap::WriteOptions::new().chunk_size(Some(1 << 17));
    for options in [
        chunked().compression(Some(mcap::Compression::Lz4)),
        chunked().compression(None),
        chunked().calculate_chunk_crcs(false).emit_message_indexes(false),
        chunked().repeat_channels(false).repeat_schemas(false),
    ] {
        written(&path, options, 1);
        let input = std::fs::read(&path).unwrap();
        let output = corrected(&path, &Options::default());
        let (before, after) = (raw_chunks(&input), raw_chunks(&output));
        assert!(before.len() > 4);
        let mut rest = after.iter();
        assert!(
            before.iter().all(|chunk| rest.any(|c| c == chunk)),
            "all chunks of the input, in their order"
        );
        let (kept, all) = (streamed(&input), streamed(&output));
        assert!(kept.iter().all(|(channel, messages)| all[channel] == *messages));
    }
}

#[test]
fn rewritten_chunks_lose_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("in.mcap");
    let lz4 = || {
        mcap::WriteOptions::new()
            .chunk_size(Some(1 << 17))
            .compression(Some(mcap::Compression::Lz4))
    };
    let mut zstd = Options::default();
    zstd.config.output.compression = Compression::Zstd;
    for (options, run) in
        [(mcap::WriteOptions::new().use_chunks(false), Options::default()), (lz4(), zstd)]
    {
        written(&path, options, 1);
        let input = std::fs::read(&path).unwrap();
        let output = corrected(&path, &run);
        let (kept, all) = (streamed(&input), streamed(&output));
        assert!(kept.iter().all(|(channel, messages)| all[channel] == *messages));
        assert!(raw_chunks(&output).iter().all(|(header, _)| header.compression != "lz4"));
    }
    // Leaving out the images leaves all else, in its order, also where only some chunks hold
    // images.
    written(&path, lz4().chunk_size(Some(4096)), 1);
    let mut dropping = Options::default();
    dropping.config.output.drop_raw = true;
    let camera = CameraSession::open(&path, &dropping).unwrap().survey.camera_channels[0];
    let input = std::fs::read(&path).unwrap();
    let output = corrected(&path, &dropping);
    let (mut kept, all) = (streamed(&input), streamed(&output));
    assert_eq!(kept.remove(&camera).map(|m| m.len()), Some(12));
    assert!(
        !all.contains_key(&camera)
            && kept.iter().all(|(channel, messages)| all[channel] == *messages)
    );
    let (before, after) = (raw_chunks(&input), raw_chunks(&output));
    let through = before.iter().filter(|chunk| after.contains(chunk)).count();
    assert!(through > 4 && through < before.len(), "{through} of {} go through", before.len());
}

#[test]
fn contradicting_declarations_are_dropped() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("in.mcap");
    written(&path, mcap::WriteOptions::new().chunk_size(Some(1 << 17)).compression(None), 1);
    // The chunk's own copy of a topic, made another one; its checksum is made none.
    let mut bytes = std::fs::read(&path).unwrap();
    let at = bytes.windows(5).position(|w| w == b"/note").unwrap();
    bytes[at + 4] = b'x';
    let (first, _) = raw_chunks(&bytes).swap_remove(0);
    let crc = bytes.windows(4).position(|w| w == first.uncompressed_crc.to_le_bytes()).unwrap();
    bytes[crc..crc + 4].fill(0);
    std::fs::write(&path, &bytes).unwrap();
    let kept = Recording::open(&path).unwrap().channels[&900].topic.clone();
    assert_eq!(kept, "/note", "the summary's");
    let output = corrected(&path, &Options::default());
    assert!(
        raw_chunks(&output).iter().all(|(header, _)| header.uncompressed_crc != 0),
        "the chunk was written again"
    );
}

#[test]
fn compressed_images_are_not_compressed_again_and_other_messages_are() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("in.mcap");
    written(
        &path,
        mcap::WriteOptions::new()
            .chunk_size(Some(1 << 17))
            .compression(Some(mcap::Compression::Lz4)),
        1,
    );
    // Beside images this small, the seafloor's points would be most of a chunk.
    let mut files = Options::default();
    (files.config.output.seafloor_points_across, files.config.output.raw_preview_side_px) = (0, 0);
    let mut raw = files.clone();
    raw.config.render.image_format = unwater::config::ImageFormat::Raw;
    for (options, wanted) in [(files, ""), (raw, "zstd")] {
        let ours = raw_chunks(&corrected(&path, &options))
            .into_iter()
            .map(|(header, _)| header.compression)
            .filter(|c| c != "lz4");
        let ours: Vec<String> = ours.collect();
        assert!(!ours.is_empty() && ours.iter().all(|c| c == wanted), "{ours:?}");
    }
}

#[test]
fn a_window_reads_only_the_chunks_it_needs() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("long.mcap");
    written(&path, mcap::WriteOptions::new().chunk_size(Some(1 << 17)), 20);
    let recording = Recording::open(&path).unwrap();
    assert!(
        recording.bytes_read() < recording.length() / 20,
        "the index: {} of {}",
        recording.bytes_read(),
        recording.length()
    );
    let log_time = |e: Entry| if let Entry::Message(m) = e { m.log_time } else { 0 };
    let start = recording.messages(Window::ALL).next().map(log_time).unwrap() + 10 * 60_000_000_000;
    let window = Window { start, end: start + 60_000_000_000 };
    let whole = Recording::open(&path).unwrap();
    let (scanned, _) = scan(&whole, window, &DvlFacts::default(), &Threads::new(2)).unwrap();
    // A twentieth is in the window; the first of every channel lies in the first chunks.
    let share = whole.bytes_read() as f64 / whole.length() as f64;
    assert!(share < 0.15, "{share}");
    assert!(
        scanned.channels.values().any(|c| c.camera.is_some())
            && scanned.channels.values().any(|c| !c.joints.is_empty())
    );
    assert_eq!(scanned.channels.values().map(|c| c.frames.len()).sum::<usize>(), 12);
}

/// A run of a window does not read the rest for its fingerprint either; the index identifies the
/// log then.
#[test]
fn a_window_is_identified_without_reading_the_rest() {
    let folder = tempfile::tempdir().unwrap();
    let (path, other) = (folder.path().join("long.mcap"), folder.path().join("other.mcap"));
    for (path, minutes) in [(&path, 20), (&other, 19)] {
        written(path, mcap::WriteOptions::new().chunk_size(Some(1 << 17)), minutes);
    }
    let log_time = |e: Entry| if let Entry::Message(m) = e { m.log_time } else { 0 };
    let whole = Recording::open(&path).unwrap();
    let start = whole.messages(Window::ALL).next().map(log_time).unwrap() + 10 * 60_000_000_000;
    let window = Some(Window { start, end: start + 60_000_000_000 });
    let options = Options { window, ..Options::default() };
    let log = Log::open_with_sha256(&path.as_path().into(), &options, &Threads::new(2)).unwrap();
    let share = log.recording.bytes_read() as f64 / log.recording.length() as f64;
    assert!(share < 0.15, "{share}");
    let of_window = log.recording.identity();
    assert!(!of_window.is_whole());
    assert!(whole.is(&of_window).unwrap() && whole.equals(&of_window).unwrap());
    whole.sha256().unwrap();
    assert!(whole.is(&of_window).unwrap() && log.recording.is(&whole.identity()).unwrap());
    let of_other = Recording::open(&other).unwrap();
    assert!(!of_other.is(&of_window).unwrap() && !of_other.equals(&of_window).unwrap());
    // Files of earlier versions have the fingerprint of all bytes alone.
    let before = LogIdentity { index_sha256: String::new(), ..whole.identity() };
    assert!(log.recording.is(&before).unwrap() && !of_other.is(&before).unwrap());
}

/// Blocks of a scan and what lies beside them give the fingerprint of the file.
#[test]
fn a_scan_computes_the_fingerprint_of_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("in.mcap");
    written(&path, mcap::WriteOptions::new().chunk_size(Some(1 << 17)), 3);
    let expected = Recording::open(&path).unwrap().sha256().unwrap().to_string();
    let (start, end) = Recording::open(&path).unwrap().blocks()[0].times().unwrap();
    for (window, threads) in [(Window::ALL, 1), (Window::ALL, 2), (Window { start, end }, 2)] {
        let (recording, dvl) = (Recording::open(&path).unwrap(), DvlFacts::default());
        let fingerprint = Some(recording.fingerprint());
        scan_with(&recording, window, &dvl, fingerprint, &Threads::new(threads)).unwrap();
        let file = std::fs::File::create(&path).unwrap();
        // It is known already: the file is not needed any more.
        drop(file);
        assert_eq!(recording.sha256().unwrap(), expected);
        written(&path, mcap::WriteOptions::new().chunk_size(Some(1 << 17)), 3);
    }
}

#[test]
fn a_log_truncated_while_it_is_read_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("in.mcap");
    written(&path, mcap::WriteOptions::new().chunk_size(Some(1 << 17)), 2);
    let recording = Recording::open(&path).unwrap();
    let file = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
    file.set_len(recording.length() / 2).unwrap();
    for threads in [1, 2] {
        let error = scan(&recording, Window::ALL, &DvlFacts::default(), &Threads::new(threads))
            .err()
            .expect("an error")
            .to_string();
        assert!(error.contains("became shorter"), "{error}");
    }
    assert!(recording.sha256().is_err());
}
