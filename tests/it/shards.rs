//! Shards that are corrected apart, joined: the bytes of the undivided run.
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::support::edited::{copy_messages, sample, writer_like};
use unwater::recording::Recording;

fn unwater(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_unwater")).args(args).output().expect("the program runs")
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn error(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// The sample in many small chunks; without the pings around two times, so that some frames are
/// not corrected, and with an attachment.
fn in_small_chunks(target: &Path) {
    let log = Recording::open(&sample()).unwrap();
    let options = mcap::WriteOptions::new().chunk_size(Some(1 << 17));
    let mut writer = writer_like(&log, target, options);
    let mut pings = 0;
    copy_messages(&log, &mut writer, |topic, _| {
        let is_ping = topic == "/dvl/data";
        pings += usize::from(is_ping);
        !is_ping || !((20..45).contains(&pings) || (80..105).contains(&pings))
    });
    writer
        .attach(&mcap::Attachment {
            log_time: 5,
            create_time: 6,
            name: "report.json".into(),
            media_type: "text/plain".into(),
            data: b"of somebody else"[..].into(),
        })
        .unwrap();
    writer
        .write_metadata(&mcap::records::Metadata {
            name: "rosbag2".into(),
            metadata: [("ROS_DISTRO".into(), "jazzy".into())].into(),
        })
        .unwrap();
    writer.finish().unwrap();
}

#[test]
fn joined_shards_are_the_undivided_log() {
    let folder = tempfile::tempdir().unwrap();
    let of = |name: &str| folder.path().join(name);
    let (log, model, whole) = (of("dive.mcap"), of("model.json"), of("whole.mcap"));
    in_small_chunks(&log);
    assert!(Recording::open(&log).unwrap().chunk_count() > 10);
    let ran = unwater(&["estimate", text(&sample()), "-o", text(&model), "-q"]);
    assert_eq!(ran.status.code(), Some(0), "{}", error(&ran));
    let common = ["correct", text(&log), "--model", text(&model), "-q", "--force"];
    for (count, options) in [
        (4, &[][..]),
        (3, &["--drop-raw", "--image-format", "raw"]),
        (7, &["--compression", "zstd", "--only", "^/(camera|imu)"]),
        (1, &["--depth", "16"]),
    ] {
        let correct = |more: &[&str], out: &Path| {
            let ran = unwater(&[&common[..], options, more, &["-o", text(out)]].concat());
            // Frames are lost in the whole log, and in some of its parts.
            let is_done = ran.status.code() == Some(3) || ran.status.success() && !more.is_empty();
            assert!(is_done, "{options:?} {more:?}: {}", error(&ran));
        };
        correct(&[], &whole);
        let parts: Vec<PathBuf> = (1..=count)
            .rev()
            .map(|shard| {
                let part = of(&format!("part_{shard}.mcap"));
                correct(&["--shard", &format!("{shard}/{count}")], &part);
                part
            })
            .collect();
        let joined = of("joined.mcap");
        let paths: Vec<&str> = parts.iter().map(|part| text(part)).collect();
        let join = |paths: &[&str]| {
            unwater(&[&["join"], paths, &["-o", text(&joined), "--force"]].concat())
        };
        let ran = join(&paths);
        assert_eq!(ran.status.code(), Some(3), "{}", error(&ran));
        let (a, b) = (std::fs::read(&whole).unwrap(), std::fs::read(&joined).unwrap());
        assert!(a == b, "{count} {options:?}: {} and {} bytes", a.len(), b.len());
        if count == 4 {
            // One is missing, one is twice there, one is of another run.
            std::fs::remove_file(&joined).unwrap();
            let ran = join(&paths[1..]);
            assert!(ran.status.code() == Some(2) && error(&ran).contains("4/4"), "{}", error(&ran));
            let twice = [&paths[..], &paths[..1]].concat();
            let ran = join(&twice);
            assert!(
                ran.status.code() == Some(2) && error(&ran).contains("part_4.mcap and"),
                "{}",
                error(&ran)
            );
            // A shard is no finished dive.
            let ran = unwater(&["table", text(&whole), paths[0]]);
            let table = String::from_utf8_lossy(&ran.stdout).into_owned();
            let ends: Vec<&str> = table.lines().map(str::trim_end).collect();
            assert!(ends[1].ends_with("with losses") && ends[2].ends_with("shard 4/4"), "{table}");
            let other = of("other.mcap");
            let ran = unwater(
                &[&common[..], &["--shard", "0/4", "--jpeg-quality", "80", "-o", text(&other)]]
                    .concat(),
            );
            assert!(matches!(ran.status.code(), Some(0 | 3)), "{}", error(&ran));
            let ran = join(&[&[text(&other)], &paths[1..]].concat());
            assert!(
                ran.status.code() == Some(1) && error(&ran).contains("another run"),
                "{}",
                error(&ran)
            );
            let ran = join(&[text(&whole)]);
            assert!(error(&ran).contains("--shard"), "{}", error(&ran));
            assert!(!joined.exists());
        }
    }
    // Without a model each shard would estimate its own.
    let ran = unwater(&["correct", text(&log), "--shard", "1/2"]);
    assert_eq!(ran.status.code(), Some(2), "{}", error(&ran));
    for wrong in ["3/2", "1", "1/0", "a/b"] {
        let ran = unwater(&[&common[..], &["--shard", wrong]].concat());
        assert_eq!(ran.status.code(), Some(2), "{wrong}");
    }
}
