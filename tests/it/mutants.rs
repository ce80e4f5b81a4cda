//! Logs whose contents contradict each other: fields zeroed, negated or in another unit, frames
//! renamed, channels dropped, doubled or renamed, stamps shifted, schemas edited; the same in every
//! message of a channel, as drivers and converters do it. Whatever comes of it, nothing panics, and
//! no attenuation is called identified that is more than five standard deviations off, unless a
//! warning stands beside it. `UNWATER_FUZZ=167` tries a thousand.

use std::fmt::Write as _;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use unwater::diagnostics::{Diagnostic, Severity};
use unwater::error::Error;
use unwater::run::estimate;
use unwater::session::{CameraSession, Options, Silent};

use super::support::dice::{Dice, factor};
use super::support::edited::{Record, records, write};
use super::support::render::Dive;

const MUTANTS: usize = 6;
/// Standard deviations within which an identified attenuation is right.
const MAX_SIGMA: f64 = 5.0;

fn dive() -> Dive {
    Dive { frames: 20, width: 160, height: 120, focal_px: 185.0, ..Dive::default() }
}

/// Topics that describe the vehicle or are measured by it; images are mutated as channels alone.
fn topics(log: &[Record], with_images: bool) -> Vec<String> {
    let is_wanted = |r: &&Record| with_images || !r.topic.contains("image");
    let mut topics: Vec<String> = log.iter().filter(is_wanted).map(|r| r.topic.clone()).collect();
    topics.sort();
    topics.dedup();
    topics
}

/// One mutation of a log, and what it is.
fn mutated(log: &[Record], dice: &mut Dice) -> (Vec<Record>, String) {
    let mut log = log.to_vec();
    let kind = dice.below(8);
    let topics = topics(&log, matches!(kind, 4..=6));
    let topic = topics[dice.below(topics.len())].clone();
    let what = match kind {
        0..=2 => field(&mut log, &topic, dice),
        3 => frame(&mut log, &topic, dice),
        4 => {
            let keep = dice.below(4);
            let mut seen = 0;
            log.retain(|r| {
                seen += usize::from(r.topic == topic);
                r.topic != topic || (keep > 0 && seen % (keep + 1) == 0)
            });
            format!("one of {} messages", if keep > 0 { keep + 1 } else { 0 })
        }
        5 => {
            let mut twice: Vec<Record> = log.iter().filter(|r| r.topic == topic).cloned().collect();
            let renamed = dice.below(2) == 0;
            twice.iter_mut().for_each(|r| {
                r.lane = 1;
                r.topic += if renamed { "_2" } else { "" };
            });
            log.extend(twice);
            format!("twice{}", if renamed { " under another name" } else { "" })
        }
        6 => stamps(&mut log, &topic, dice),
        _ => schema(&mut log, &topic, dice),
    };
    (log, format!("{topic}: {what}"))
}

/// A number at the same place of every message.
fn field(log: &mut [Record], topic: &str, dice: &mut Dice) -> String {
    let is_double = dice.below(2) == 0;
    let size = if is_double { 8 } else { 4 };
    let read = |data: &[u8], at: usize| {
        let bytes = data.get(at..at + size)?;
        Some(if is_double {
            f64::from_le_bytes(bytes.try_into().ok()?)
        } else {
            f64::from(f32::from_le_bytes(bytes.try_into().ok()?))
        })
    };
    let is_number = |v: f64| v.is_finite() && (1e-4..1e4).contains(&v.abs());
    // The fields of a CDR message are aligned after its header of 4 bytes.
    let Some(first) = log.iter().find(|r| r.topic == topic) else { return "nothing".into() };
    let places: Vec<usize> = (4..first.data.len())
        .step_by(size)
        .filter(|at| read(&first.data, *at).is_some_and(is_number))
        .collect();
    let Some(at) = places.get(dice.below(places.len())).copied() else { return "nothing".into() };
    let factor = [0.0, -1.0, 1000.0, 0.001, 57.295_78, 0.3048, 2.0][dice.below(7)];
    for record in log.iter_mut().filter(|r| r.topic == topic) {
        let Some(value) = read(&record.data, at).filter(|v| is_number(*v)) else { continue };
        let value = value * factor;
        let bytes = if is_double {
            value.to_le_bytes().to_vec()
        } else {
            (value as f32).to_le_bytes().to_vec()
        };
        record.data[at..at + size].copy_from_slice(&bytes);
    }
    format!("the number at byte {at} ({size} bytes) times {factor}")
}

/// The name of a frame becomes that of another.
fn frame(log: &mut [Record], topic: &str, dice: &mut Dice) -> String {
    let names: [&[u8]; 5] = [b"camera", b"dvl", b"imu", b"strobe", b"base_link"];
    let (from, to) = (names[dice.below(5)], names[dice.below(5)]);
    let mut other = to.to_vec();
    other.resize(from.len(), b'x');
    log.iter_mut().filter(|r| r.topic == topic).for_each(|r| r.replace(from, &other));
    let text = |name: &[u8]| String::from_utf8_lossy(name).into_owned();
    format!("{} is called {}", text(from), text(&other))
}

/// The stamps of a channel, in their headers or in the log.
fn stamps(log: &mut [Record], topic: &str, dice: &mut Dice) -> String {
    let seconds = [-3600i32, -2, -1, 1, 2, 86_400][dice.below(6)];
    let of_header = dice.below(2) == 0;
    for record in log.iter_mut().filter(|r| r.topic == topic) {
        if let (true, Some(bytes)) = (of_header, record.data.get_mut(4..8)) {
            let stamp = i32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
            bytes.copy_from_slice(&stamp.wrapping_add(seconds).to_le_bytes());
        } else {
            let shift_ns = i64::from(seconds) * 1_000_000_000;
            record.log_time = record.log_time.saturating_add_signed(shift_ns);
        }
    }
    format!("{} later by {seconds} s", if of_header { "header" } else { "log time" })
}

/// The definition of a channel's messages.
fn schema(log: &mut [Record], topic: &str, dice: &mut Dice) -> String {
    let edits = [("float64", "float32"), ("uint32", "int16"), ("range", "renge"), ("\n", "")];
    let (from, to) = edits[dice.below(4)];
    let emptied = dice.below(4) == 0;
    for record in log.iter_mut().filter(|r| r.topic == topic) {
        let text = String::from_utf8_lossy(&record.schema.2).replacen(from, to, 1);
        record.schema.2 = if emptied { Vec::new() } else { text.into_bytes() };
    }
    if emptied { "no schema".into() } else { format!("schema with {to:?} for {from:?}") }
}

/// Attenuation with its standard deviations where it is identified, and whether a warning stands
/// beside it.
type Answer = (Option<Vec<(f64, f64)>>, bool);

fn answer(path: &Path) -> Result<Answer, Error> {
    let options = Options { threads: 1, ..Options::default() };
    let session = CameraSession::open(path, &options)?;
    let model = estimate(&[&session], &options, &Silent)?;
    let is_warning = |d: &Diagnostic| d.severity() != Severity::Info;
    let is_warned = session.survey.diagnostics.iter().chain(&model.diagnostics).any(is_warning);
    let std = model.attenuation_std_per_m.iter().map(|std| std.unwrap_or(f64::INFINITY));
    let found = model.attenuation_per_m.iter().copied().zip(std).collect();
    Ok((model.identified.then_some(found), is_warned))
}

#[test]
fn contradictory_logs_give_no_wrong_answer_without_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mutant.mcap");
    let dive = dive();
    dive.write(&path);
    let log = records(&path);
    let is_wrong = |found: &[(f64, f64)]| {
        let pairs = found.iter().zip(dive.attenuation_per_m);
        pairs.into_iter().any(|((alpha, std), truth)| (alpha - truth).abs() > MAX_SIGMA * std)
    };
    let (plain, _) = answer(&path).unwrap();
    assert!(!is_wrong(&plain.expect("the log itself is identified")));
    let mut dice = Dice(0x9e37_79b9_7f4a_7c15);
    let (mut faults, mut counts) = (String::new(), [0; 4]);
    for number in 0..MUTANTS * factor() {
        let (mutant, what) = mutated(&log, &mut dice);
        write(&path, &mutant);
        let (fault, kind) = match catch_unwind(AssertUnwindSafe(|| answer(&path))) {
            Err(_) => (Some("panics".into()), 3),
            // An error says more than a word.
            Ok(Err(error)) => ((error.to_string().len() < 30).then(|| error.to_string()), 0),
            Ok(Ok((None, _))) => (None, 1),
            Ok(Ok((Some(found), is_warned))) => {
                ((is_wrong(&found) && !is_warned).then(|| format!("{found:?}")), 2)
            }
        };
        counts[kind] += 1;
        if let Some(fault) = fault {
            writeln!(faults, "{number} {what}: {fault}").unwrap();
        }
    }
    let [refused, unidentified, identified, panics] = counts;
    println!(
        "refused {refused}, not identified {unidentified}, identified {identified}, panics {panics}"
    );
    assert!(faults.is_empty(), "{faults}");
}
