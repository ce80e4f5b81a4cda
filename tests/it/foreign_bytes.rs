//! The parsers of foreign bytes on seeds, and on seeds that were damaged: what `fuzz/` does for
//! hours, for seconds and with a stable compiler. Seeds stand in `fuzz/seeds/<parser>`; what
//! fuzzing found is kept there under a name that begins with `found`.
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use crate::support::dice::{Dice, factor, with_bounded_memory};
use crate::support::foreign_bytes::{TARGETS, with_schema};
use unwater::config::Config;
use unwater::image::EncodedImage;
use unwater::image::exif::{ExifFacts, with_facts};
use unwater::messages::{Decoder, Kind};
use unwater::recording::{Entry, Recording, Window};
use unwater::run::estimate_logs;
use unwater::session::{Options, Silent};

const ROOT: &str = env!("CARGO_MANIFEST_DIR");
/// Longer than this with one seed is a hang, on any machine.
const HANG: Duration = Duration::from_secs(10);

fn files(folder: &Path, extension: Option<&str>) -> Vec<PathBuf> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let mut files: Vec<PathBuf> = entries
        .flatten()
        .map(|e| e.path())
        .filter(|p| {
            extension.is_none()
                || p.extension().is_some_and(|e| Some(e.to_str().unwrap()) == extension)
        })
        .collect();
    files.sort();
    files
}

fn sample_logs() -> Vec<PathBuf> {
    files(&Path::new(ROOT).join("sample_logs/messages"), Some("mcap"))
}

/// The seeds of a parser. Those of `mcap` are the sample logs themselves.
fn seeds(target: &str) -> Vec<PathBuf> {
    let mut seeds = files(&Path::new(ROOT).join("fuzz/seeds").join(target), None);
    if target == "mcap" {
        seeds.extend(sample_logs());
    }
    seeds
}

#[test]
fn every_parser_reads_its_seeds_intact_and_damaged() {
    with_bounded_memory("foreign_bytes::every_parser_reads_its_seeds_intact_and_damaged", || {
        for (target, parser) in TARGETS {
            let mut dice = Dice(0x0dd_ba11);
            let seeds = seeds(target);
            assert!(
                !seeds.is_empty(),
                "{target} has no seeds: UNWATER_BLESS=1 cargo test --test it foreign_bytes"
            );
            let rounds = (8000 * factor()).div_ceil(seeds.len());
            for seed in seeds {
                let bytes = std::fs::read(&seed).unwrap();
                let began = Instant::now();
                parser(&bytes);
                for _ in 0..rounds {
                    let mut damaged = dice.damage(&bytes);
                    for _ in 0..dice.below(3) {
                        damaged = dice.damage(&damaged);
                    }
                    parser(&damaged);
                }
                assert!(
                    began.elapsed() < HANG * (factor() as u32),
                    "{} took {:?}",
                    seed.display(),
                    began.elapsed()
                );
            }
        }
    });
}

#[test]
fn fuzz_targets_and_parsers_correspond() {
    let manifest = std::fs::read_to_string(Path::new(ROOT).join("fuzz/Cargo.toml")).unwrap();
    let there: BTreeSet<&str> = manifest
        .lines()
        .filter_map(|l| l.strip_prefix("path = \"fuzz_targets/")?.strip_suffix(".rs\""))
        .collect();
    assert_eq!(there, TARGETS.iter().map(|(name, _)| *name).collect());
}

/// EXIF with every field.
fn facts() -> ExifFacts {
    ExifFacts {
        taken_at: "2026:05:01 10:00:00.123+00:00".into(),
        position_deg: Some([-44.0, 179.5]),
        depth_m: Some(30.0),
        heading_deg: Some(90.0),
        distance_m: Some(2.0),
        exposure_s: Some(0.001),
        id: "0123456789abcdef0123456789abcdef".into(),
    }
}

/// Rewrites the seeds from the sample logs where UNWATER_BLESS is set; what was found stays.
#[test]
fn seeds_are_written_from_the_sample_logs() {
    if std::env::var_os("UNWATER_BLESS").is_none() {
        return;
    }
    let mut seeds: BTreeMap<(&str, String), Vec<u8>> = BTreeMap::new();
    for log in sample_logs() {
        let name = log.file_stem().unwrap().to_string_lossy().into_owned();
        let recording = Recording::open(&log).unwrap();
        let Some(Entry::Message(m)) = recording.messages(Window::ALL).next() else { continue };
        let channel = &recording.channels[&m.channel];
        let schema = recording.schemas.get(&channel.schema_id);
        let (schema_name, schema_encoding, definition) =
            schema.map_or(("", "jsonschema", &[][..]), |s| (&s.name, &s.encoding, &s.data));
        let target = match schema_encoding {
            "ros2msg" => "cdr",
            "ros2idl" => "idl",
            "ros1msg" => "ros1",
            "protobuf" => "protobuf",
            _ => "json",
        };
        seeds.insert(
            (target, name.clone()),
            with_schema(&channel.topic, schema_name, definition, m.data()),
        );
        let Some(decoder) = Decoder::for_channel(
            &channel.topic,
            &channel.message_encoding,
            schema_name,
            schema_encoding,
            definition,
        )
        .ok()
        .flatten() else {
            continue;
        };
        let value = decoder.read(m.data()).unwrap();
        let Kind::Image(read) = decoder.message_type.kind else { continue };
        match read(&value).unwrap() {
            EncodedImage::Raw { width, height, encoding, big_endian, step, data } => {
                let head = format!("{width} {height} {step} {} {encoding}\n", u8::from(big_endian));
                seeds.insert(("raw_image", name), [head.as_bytes(), data].concat());
            }
            EncodedImage::Compressed { format, data } => {
                if let Ok(with_exif) = with_facts(data.to_vec(), &facts()) {
                    seeds.insert(("exif", name.clone()), with_exif);
                }
                seeds.insert(("image_file", name), [format.as_bytes(), b"\n", data].concat());
            }
            EncodedImage::Video { .. } => {}
        }
    }
    let dive = Path::new(ROOT).join("sample_logs/rendered_clear.mcap");
    let (model, _) = estimate_logs(&[&dive], &Options::default(), &Silent).unwrap();
    seeds.insert(("model", "rendered_clear".into()), model.to_json().unwrap().into_bytes());
    seeds.insert(("config", "default".into()), Config::default().to_commented_toml().into_bytes());
    for sampling in 0..7u8 {
        let pixels: Vec<u8> = (0..=255).map(|i: u8| i.wrapping_mul(37)).collect();
        let head = [8 + sampling, 30 - sampling, 91, sampling];
        seeds.insert(("jpeg_encoder", sampling.to_string()), [&head[..], &pixels].concat());
    }
    seeds.insert(("rig", "full".into()), include_bytes!("support/full_rig.toml").to_vec());
    for (target, _) in TARGETS {
        let folder = Path::new(ROOT).join("fuzz/seeds").join(target);
        std::fs::create_dir_all(&folder).unwrap();
        for old in files(&folder, None)
            .iter()
            .filter(|f| !f.file_name().unwrap().to_string_lossy().starts_with("found"))
        {
            std::fs::remove_file(old).unwrap();
        }
    }
    for ((target, name), bytes) in seeds {
        std::fs::write(Path::new(ROOT).join("fuzz/seeds").join(target).join(name), bytes).unwrap();
    }
}
