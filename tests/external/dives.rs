//! Runs on dives that are too large or not free to be in the tree: named by the variable
//! `UNWATER_DATA`. Without it they are reported as ignored, never as passed.
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::support::{ensure, judge::assert_within, render::Dive, replay};
use libtest_mimic::{Failed, Trial};
use unwater::config::{OutputConfig, OutputEncoding};
use unwater::model::ModelFile;
use unwater::recording::{Entry, Output, RawChunk, Recording, Window};
use unwater::report::Report;
use unwater::run::correct;
use unwater::session::{Options, Silent};

fn run(
    input: &Path,
    options: &Options,
) -> Result<(tempfile::TempDir, PathBuf, Report, ModelFile), Failed> {
    let folder = tempfile::tempdir()?;
    let out = folder.path().join("out.mcap");
    let (report, model) = correct(input, &out, None, options, &Silent)?;
    Ok((folder, out, report, model))
}

fn rendered_a(data: &Path) -> Result<(), Failed> {
    let (_folder, _, report, model) =
        run(&data.join("rendered/A/A_clear_flat_raw16.mcap"), &Options::default())?;
    ensure(report.corrected == 48, format!("{} of 48 corrected", report.corrected))?;
    let a = &model.attenuation_per_m;
    for (band, expected) in [0.45, 0.14, 0.10].into_iter().enumerate() {
        let what = format!("rendered A: attenuation, band {band} [1/m]");
        assert_within(&what, a[band] - expected, [0.0034, 0.002, 0.0021][band]);
    }
    assert_within("rendered A: red − green [1/m]", a[0] - a[1] - 0.31, 0.0014);
    assert_within("rendered A: green − blue [1/m]", a[1] - a[2] - 0.04, 0.0005);
    Ok(())
}

fn finishes(data: &Path, log: &str, frames: usize) -> Result<Report, Failed> {
    let (_folder, out, report, model) = run(&data.join(log), &Options::default())?;
    ensure(
        report.frames == frames
            && report.corrected + report.uncorrected.values().sum::<usize>() == frames,
        format!("{report:?}"),
    )?;
    let physical = model.attenuation_per_m.iter().all(|a| *a > 0.0);
    ensure(physical || !model.identified, "an attenuation below 0 is not to be called identified")?;
    let recording = Recording::open(&out)?;
    ensure(recording.is_complete, "the output is whole")?;
    Ok(report)
}

fn stonefish(data: &Path) -> Result<(), Failed> {
    finishes(data, "stonefish/sf_w020_square_srgb.mcap", 25).map(drop)
}

/// A real dive comes out, and no figure of its verdict is worse than that of the raw images.
fn is_not_worse_than_raw(data: &Path, log: &str, frames: usize) -> Result<(), Failed> {
    let verdict = finishes(data, log, frames)?.verdict.ok_or("no verdict")?;
    let (raw, used) = verdict.of("raw").zip(verdict.of(&verdict.used)).ok_or("no figures")?;
    println!("measured {log}: raw {raw:?}, used {used:?}");
    let pairs = [
        ("agreement", raw.agreement, used.agreement),
        ("colour", raw.chroma, used.chroma),
        ("brightness", raw.light, used.light),
    ];
    for (what, raw, used) in pairs {
        let (Some(raw), Some(used)) = (raw, used) else { continue };
        ensure(used <= raw, format!("{log}: {what} is {used:.3}, raw images have {raw:.3}"))?;
    }
    Ok(())
}

/// Every file of the corpus opens without a panic, and what is read is what a second reader counts.
fn corpus(data: &Path) -> Result<(), Failed> {
    let page = std::fs::read_to_string(data.join("mcap_corpus/SOURCE.md"))?;
    let mut checked = 0;
    for line in page.lines().filter(|l| l.contains(".mcap |")) {
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        let path = data.join("mcap_corpus").join(cells[1]);
        let counted: Option<u64> = cells[6].parse().ok();
        let recording =
            Recording::open(&path).map_err(|e| Failed::from(format!("{}: {e}", cells[1])))?;
        let messages =
            recording.messages(Window::ALL).filter(|e| matches!(e, Entry::Message(_))).count()
                as u64;
        if let Some(counted) = counted {
            ensure(
                messages == counted && recording.is_complete,
                format!("{}: {messages} messages, not {counted}", cells[1]),
            )?;
        }
        checked += 1;
    }
    ensure(checked >= 25, format!("{checked} files"))
}

/// Every file of the corpus, rewritten with its chunks unchanged, is read by another reader,
/// with the same content but for messages of channels that are declared nowhere.
fn corpus_goes_through(data: &Path) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let out = folder.path().join("out.mcap");
    let (mut checked, mut through) = (0, 0);
    for path in logs_below(&data.join("mcap_corpus"))? {
        through += copied(&path, &out)?;
        let (before, after) = (messages(&path)?, messages(&out)?);
        ensure(
            before == after,
            format!("{}: {} channels, not {}", path.display(), after.len(), before.len()),
        )?;
        let bytes = std::fs::read(&out)?;
        let counted = mcap::MessageStream::new(&bytes)?.try_fold(0, |n, m| m.map(|_| n + 1))?;
        ensure(
            counted == before.values().map(Vec::len).sum::<usize>(),
            format!("{}: {counted} messages", path.display()),
        )?;
        let summary = mcap::Summary::read(&bytes)?.ok_or("a summary")?;
        for index in &summary.chunk_indexes {
            let indexes: Vec<_> =
                summary.read_message_indexes(&bytes, index)?.into_iter().collect();
            for (_, entries) in indexes {
                entries
                    .iter()
                    .try_for_each(|entry| summary.seek_message(&bytes, index, entry).map(drop))?;
            }
        }
        checked += 1;
    }
    ensure(checked >= 25 && through > 20, format!("{checked} files, {through} chunks as they are"))
}

fn logs_below(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let mut logs = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            logs.extend(logs_below(&path)?);
        } else if path.extension().is_some_and(|e| e == "mcap") {
            logs.push(path);
        }
    }
    Ok(logs)
}

/// Rewrites a log; the number of chunks that were copied unchanged.
fn copied(path: &Path, out: &Path) -> Result<usize, Failed> {
    let input = Recording::open(path)?;
    let (mut output, mut file) = Output::create(out, &input.profile, &OutputConfig::default())?;
    input.schemas.iter().for_each(|(id, schema)| output.copy_schema(*id, schema));
    input.channels.iter().for_each(|(id, channel)| output.copy_channel(*id, channel));
    let mut through = 0;
    for block in input.blocks() {
        let contents = input.read(block, Window::ALL)?;
        let is_declared =
            |chunk: &RawChunk| chunk.messages.iter().all(|m| input.channels.contains_key(&m.0));
        if let Some(chunk) = contents.chunk.filter(is_declared) {
            output.copy_chunk(chunk);
            through += 1;
        } else {
            for entry in contents.entries {
                // As pass two does: what no reader could make sense of stays behind, with a
                // warning.
                if let Entry::Message(message) = entry
                    && input.channels.contains_key(&message.channel)
                {
                    output.copy_message(&message);
                }
            }
        }
    }
    output.flush();
    while let Some(piece) = output.next_piece() {
        file.put(piece.into_bytes())?;
    }
    for attachment in input.attachments().flatten() {
        file.copy_attachment(&input, &attachment)?;
    }
    input.metadata.iter().try_for_each(|record| file.metadata(&record.name, &record.metadata))?;
    file.finish(output.declarations())?;
    Ok(through)
}

type Kept = std::collections::BTreeMap<u16, Vec<(u32, u64, u64, Vec<u8>)>>;

fn messages(path: &Path) -> Result<Kept, Failed> {
    let mut kept = Kept::new();
    let recording = Recording::open(path)?;
    for entry in recording.messages(Window::ALL) {
        if let Entry::Message(m) = entry
            && recording.channels.contains_key(&m.channel)
        {
            kept.entry(m.channel).or_default().push((
                m.sequence,
                m.log_time,
                m.publish_time,
                m.data().to_vec(),
            ));
        }
    }
    Ok(kept)
}

/// What is written in each encoding, read by Python's readers.
fn read_by_others() -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let dive = folder.path().join("dive.mcap");
    Dive { frames: 14, width: 288, height: 216, focal_px: 340.0, ..Dive::default() }.write(&dive);
    let mut model = None;
    for (word, encoding) in [
        ("cdr", OutputEncoding::Cdr),
        ("ros1", OutputEncoding::Ros1),
        ("protobuf", OutputEncoding::Protobuf),
    ] {
        let out = folder.path().join(format!("{word}.mcap"));
        let mut options = Options::default();
        options.config.output.encoding = encoding;
        options.config.render.rectify = true;
        let (report, found) = correct(&dive, &out, model.take(), &options, &Silent)?;
        model = Some(found);
        ensure(report.corrected == 14, format!("{word}: {} corrected", report.corrected))?;
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/read_by_others.py");
        let ran = Command::new("python3").arg(script).arg(&out).arg(word).output()?;
        let said = String::from_utf8_lossy(&ran.stderr);
        ensure(ran.status.success(), format!("{word}: {said}"))?;
    }
    Ok(())
}

fn has_readers() -> bool {
    let wanted = "import mcap, mcap_ros1, mcap_ros2, mcap_protobuf";
    Command::new("python3").args(["-c", wanted]).output().is_ok_and(|ran| ran.status.success())
}

pub fn trials() -> Vec<Trial> {
    let data = std::env::var_os("UNWATER_DATA").map(PathBuf::from).filter(|d| d.is_dir());
    let missing = data.is_none();
    let data = data.unwrap_or_default();
    type Check = Box<dyn Fn(&Path) -> Result<(), Failed> + Send>;
    let checks: Vec<(&str, Check)> = vec![
        ("rendered A: attenuation", Box::new(rendered_a)),
        ("stonefish finishes", Box::new(stonefish)),
        ("auv_set02", Box::new(|d| is_not_worse_than_raw(d, "real/auv_set02.mcap", 8))),
        ("auv_set07", Box::new(|d| is_not_worse_than_raw(d, "real/auv_set07.mcap", 8))),
        ("towed_port", Box::new(|d| is_not_worse_than_raw(d, "real/towed_port.mcap", 50))),
        ("towed_114", Box::new(|d| is_not_worse_than_raw(d, "real/towed_114_port.mcap", 50))),
        (
            "rov_soft_bottom",
            Box::new(|d| is_not_worse_than_raw(d, "real/rov_soft_bottom.mcap", 20)),
        ),
        ("MCAP corpus is read", Box::new(corpus)),
        ("MCAP corpus goes through", Box::new(corpus_goes_through)),
        ("a Water Linked A50 agrees with itself", Box::new(replay::a50)),
        ("a Teledyne PD0 agrees with its vehicle", Box::new(replay::pd0)),
        ("a Nortek DVL333 agrees with itself", Box::new(replay::dvl333)),
        ("a Ping altimeter's drop-outs are seen", Box::new(replay::ping1d)),
    ];
    let others =
        Trial::test("dives: every output encoding is read by others (Python)", read_by_others)
            .with_ignored_flag(!has_readers());
    let trials = checks
        .into_iter()
        .map(|(name, check)| {
            let data = data.clone();
            Trial::test(format!("dives: {name}"), move || check(&data)).with_ignored_flag(missing)
        })
        .chain([others])
        .collect();
    if missing {
        eprintln!("UNWATER_DATA names no folder: the tests on dives are skipped");
    }
    trials
}
