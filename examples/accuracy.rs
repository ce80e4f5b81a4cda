//! How near the truth the estimators come, over many rendered dives: the tables of
//! `docs/accuracy.md`.
//!
//!     cargo run --release --example accuracy -- [--json] [SEEDS [CASE,CASE… [SETTINGS.toml]]]
//!
//!     cargo run --release --example accuracy -- --write FOLDER SEED [CASE,CASE…]
//!
//! A case is named by how it begins.
//! With `--json` one line of JSON per dive and per goal instead of tables. With `--write` the dives
//! of the cases are written to `FOLDER`, with their truth, and nothing is measured.
#[path = "accuracy/conditions.rs"]
mod conditions;
#[path = "accuracy/goals.rs"]
mod goals;
#[path = "../tests/it/support/mod.rs"]
mod support;
#[path = "accuracy/write.rs"]
mod write;

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

use goals::{drop_outs, held};
use support::judge::{Verdict, images, run_and_show, shown_again, unbend};
use support::render::{Dive, Sensor, Truth};
use support::same_point::{Ground, Shown};
use unwater::config::{Config, Estimator, ImageFormat, Method, Spreading, Switch};
use unwater::image::LinearImage;
use unwater::session::Options;
use unwater::units::Stamp;

/// What one dive showed. The truth's images are not kept.
pub struct Outcome {
    verdict: Verdict,
    true_attenuation_per_m: [f64; 3],
    raw: Shown,
    shown: Shown,
    others: Vec<(&'static str, Shown)>,
    /// frames at half power
    halved: Vec<i64>,
    /// of the strobe's place, along the vehicle's axes
    strobe_off_m: [f64; 3],
    followed_within: f64,
}

impl Outcome {
    /// What another method showed of the same dive.
    fn of(&self, method: &str) -> Option<&Shown> {
        self.others.iter().find(|(name, _)| *name == method).map(|(_, shown)| shown)
    }
}

/// A dive after all is measured.
pub struct Judged(pub Outcome);

/// What a case shows beside the columns that all have.
type Extra = fn(&[Judged]) -> String;

struct Case {
    name: &'static str,
    dive: fn(u64) -> Dive,
    change: fn(&mut Config),
    extra: Extra,
    /// the baselines too: a run of pass two each
    compared: bool,
}

fn plain(seed: u64) -> Dive {
    Dive { seed, frames: 40, ..Dive::default() }
}

/// A case with no more than its name and its dive.
const fn case(name: &'static str, dive: fn(u64) -> Dive) -> Case {
    Case { name, dive, change: |_| {}, extra: |_| String::new(), compared: false }
}

const CASES: &[Case] = &[
    Case { compared: true, ..case("16-bit Bayer, clear", plain) },
    Case {
        compared: true,
        ..case("JPEG q92, clear", |s| Dive { sensor: Sensor::Jpeg(92), ..plain(s) })
    },
    Case {
        change: |c| c.estimate.estimator = Estimator::Pairs,
        ..case("the paper's pairs", plain)
    },
    Case {
        change: |c| c.estimate.spreading = Spreading::Fit,
        extra: exponents,
        ..case("exponent fitted", plain)
    },
    Case {
        extra: strobe_found,
        ..case("strobe not given", |s| Dive { with_strobe_mount: false, ..plain(s) })
    },
    Case {
        extra: dropped_out,
        ..case("5 % at half power", |s| Dive { half_power_frames: 0.05, ..plain(s) })
    },
    case("gains 1 to 1/8, recorded", |s| Dive { gain_channel: Some(s % 2 == 0), ..plain(s) }),
    Case { extra: modelled, ..case("backscatter 10 %", |s| Dive { backscatter: 0.1, ..plain(s) }) },
    Case {
        change: |c| c.estimate.backscatter = Switch::Off,
        extra: modelled,
        ..case("the same, `--backscatter off`", |s| Dive { backscatter: 0.1, ..plain(s) })
    },
    Case { extra: modelled, ..case("backscatter 30 %", |s| Dive { backscatter: 0.3, ..plain(s) }) },
    Case {
        extra: followed,
        ..case("α drifts by 30 %", |s| Dive { attenuation_drift: 0.3, ..plain(s) })
    },
    case("ridges of 0.15 m", |s| Dive { relief_m: 0.15, ..plain(s) }),
    Case {
        change: |c| c.seafloor.relief = Switch::Off,
        ..case("the same ridges, a plane", |s| Dive { relief_m: 0.15, ..plain(s) })
    },
    case("two strobes", |s| Dive { second_strobe: true, ..plain(s) }),
    case("slope 15°", |s| Dive { slope_deg: (15.0, 0.0), ..plain(s) }),
];

/// The baselines and their words.
const BASELINES: &[(&str, Method)] = &[
    ("frame-average", Method::FrameAverage),
    ("range-average", Method::RangeAverage),
    ("grey-world", Method::GreyWorld),
    ("white-patch", Method::WhitePatch),
    ("homomorphic", Method::Homomorphic),
    ("homomorphic-surface", Method::HomomorphicSurface),
    ("ahe", Method::Ahe),
];

fn main() {
    let (flags, words): (Vec<String>, Vec<String>) =
        std::env::args().skip(1).partition(|word| word.starts_with("--"));
    if flags.iter().any(|flag| flag == "--write") {
        return write_dives(&words);
    }
    let json = flags.iter().any(|flag| flag == "--json");
    let seeds: u64 = words.first().and_then(|n| n.parse().ok()).unwrap_or(8);
    let wanted = words.get(1).cloned().unwrap_or_default();
    let base = words
        .get(2)
        .map(|path| {
            Config::from_toml(&std::fs::read_to_string(path).expect("settings")).expect("settings")
        })
        .unwrap_or_default();
    let folder = std::env::temp_dir().join(format!("unwater-accuracy-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    if !json {
        println!(
            "| case ({seeds} seeds) | mean error of α R, G, B | largest | largest of α_R − α_G, \
             α_G − α_B | log BP RMSE | reflectance, median error | 95 % holds | identified | |\n| \
             --- | --- | --- | --- | --- | --- | --- | --- | --- |"
        );
    }
    let mut done: Vec<(&'static str, Vec<Judged>)> = Vec::new();
    for case in cases(&wanted) {
        let mut options = Options { config: base.clone(), ..Options::default() };
        (case.change)(&mut options.config);
        options.threads = 1;
        let judged = on_all_cores(seeds, |seed| {
            let own = folder.join(seed.to_string());
            std::fs::create_dir_all(&own).expect("a folder");
            let judged = judged(&(case.dive)(seed), &options, case.compared, &own);
            std::fs::remove_dir_all(own).expect("an emptied folder");
            judged
        });
        if json {
            print_json(case, &judged);
        } else {
            print_estimates(case, &judged);
        }
        done.push((case.name, judged));
    }
    if !json {
        print_images(&done);
        conditions::print(&done);
    }
    goals::print(&done, json);
    let _gone = std::fs::remove_dir_all(folder);
}

/// Cases by how their names begin.
fn cases(wanted: &str) -> impl Iterator<Item = &'static Case> + '_ {
    let is_wanted =
        move |case: &&Case| wanted.split(',').any(|begins| case.name.starts_with(begins));
    CASES.iter().chain(conditions::CASES).filter(is_wanted)
}

/// FOLDER SEED [CASE,CASE…]
fn write_dives(words: &[String]) {
    let folder = Path::new(words.first().expect("a folder"));
    let seed = words.get(1).and_then(|seed| seed.parse().ok()).expect("a seed");
    std::fs::create_dir_all(folder).expect("a folder");
    cases(words.get(2).map_or("", String::as_str)).for_each(|c| write::write(c, seed, folder));
}

/// Renders, corrects, measures; with the baselines where they are wanted.
fn judged(dive: &Dive, options: &Options, compared: bool, folder: &Path) -> Judged {
    let (verdict, truth, corrected) = run_and_show(dive, options, folder);
    let raw = images(&folder.join("dive.mcap"), &verdict.report.camera_topic);
    let ground = Ground::of(dive, &truth, &raw);
    let shown = |images: &[LinearImage]| ground.shown(dive, &truth, images);
    let mut others = Vec::new();
    if compared {
        let mut deep = options.clone();
        deep.config.render.depth = 16;
        for (name, method) in BASELINES {
            deep.config.render.method = *method;
            others.push((*name, shown(&shown_again(&verdict.model, &deep, folder))));
        }
        let mut eight = options.clone();
        (eight.config.render.depth, eight.config.render.image_format) = (8, ImageFormat::Png);
        let mut in_codes = shown_again(&verdict.model, &eight, folder);
        unbend(&mut in_codes, eight.config.render.shoulder_from);
        others.push(("8 bit out", shown(&in_codes)));
        let of_truth = ground.floor(&truth);
        let (scatter, scatter_over_spread) =
            of_truth.iter().map(|(within, between)| (*within, within / between)).unzip();
        others
            .push(("the truth itself", Shown { scatter, scatter_over_spread, ..Shown::default() }));
    }
    Judged(Outcome {
        true_attenuation_per_m: truth.attenuation_per_m,
        raw: shown(&raw),
        shown: shown(&corrected),
        others,
        halved: truth.frames.iter().filter(|f| f.gain < 1.0).map(|f| f.stamp_ns as i64).collect(),
        strobe_off_m: strobe_off_in(&verdict, &truth),
        followed_within: followed_in(&verdict, &truth),
        verdict,
    })
}

fn list(values: impl IntoIterator<Item = f64>, digits: usize) -> String {
    values.into_iter().map(|v| format!("{v:.digits$}")).collect::<Vec<_>>().join(", ")
}

fn print_estimates(case: &Case, judged: &[Judged]) {
    let n = judged.len() as f64;
    let mean =
        |f: &dyn Fn(&Verdict) -> f64| judged.iter().map(|j| f(&j.0.verdict)).sum::<f64>() / n;
    let largest = |f: &dyn Fn(&Verdict) -> f64| {
        judged.iter().map(|j| f(&j.0.verdict).abs()).fold(0.0, f64::max)
    };
    let error = |v: &Verdict, b: usize| v.attenuation_error_per_m[b];
    println!(
        "| {} | {} | {} | {} | {:.3} | {} | {:.0} % | {} of {n} | {} |",
        case.name,
        list((0..3).map(|b| mean(&|v| error(v, b))), 4),
        list((0..3).map(|b| largest(&|v| error(v, b))), 4),
        list((0..2).map(|b| largest(&|v| error(v, b) - error(v, b + 1))), 4),
        mean(&|v| v.beam_log_rmse),
        list((0..3).map(|b| mean(&|v| v.reflectance_error[b])), 3),
        100.0 * held(judged),
        judged.iter().filter(|j| j.0.verdict.model.identified).count(),
        (case.extra)(judged),
    );
}

/// What the images show, raw, corrected and by others: means over the seeds.
fn print_images(done: &[(&'static str, Vec<Judged>)]) {
    println!(
        "\n| case | images | same-point scatter R, G, B | over between-point spread | ΔE00, \
         median | 95 % |\n| --- | --- | --- | --- | --- | --- |"
    );
    for (case, judged) in done {
        let row = |what: &str, of: &dyn Fn(&Outcome) -> Option<Shown>| {
            let all: Vec<Shown> = judged.iter().filter_map(|j| of(&j.0)).collect();
            if all.is_empty() {
                return;
            }
            let mean =
                |f: &dyn Fn(&Shown) -> f64| all.iter().map(f).sum::<f64>() / all.len() as f64;
            println!(
                "| {case} | {what} | {} | {} | {:.2} | {:.2} |",
                list((0..3).map(|b| mean(&|s| s.scatter[b])), 3),
                list((0..3).map(|b| mean(&|s| s.scatter_over_spread[b])), 3),
                mean(&|s| s.delta_e_median),
                mean(&|s| s.delta_e_95),
            );
        };
        row("raw", &|o| Some(o.raw.clone()));
        row("corrected", &|o| Some(o.shown.clone()));
        for name in judged
            .first()
            .map(|j| j.0.others.iter().map(|(name, _)| *name).collect::<Vec<_>>())
            .unwrap_or_default()
        {
            row(name, &|o| o.of(name).cloned());
        }
    }
}

fn print_json(case: &Case, judged: &[Judged]) {
    for (seed, judged) in (1..).zip(judged) {
        let o = &judged.0;
        let others: BTreeMap<&str, &Shown> =
            o.others.iter().map(|(name, shown)| (*name, shown)).collect();
        let v = &o.verdict;
        let line = serde_json::json!({
            "case": case.name, "seed": seed, "identified": v.model.identified,
            "attenuation_error_per_m": v.attenuation_error_per_m,
            "attenuation_std_per_m": v.attenuation_std_per_m,
            "z": conditions::z(judged), "beam_log_rmse": v.beam_log_rmse,
            "reflectance_error": v.reflectance_error,
            "raw": o.raw, "corrected": o.shown, "others": others,
        });
        println!("{line}");
    }
}

/// A dive a core; the results in the order of the seeds.
fn on_all_cores(seeds: u64, work: impl Fn(u64) -> Judged + Sync) -> Vec<Judged> {
    let next = AtomicU64::new(1);
    let worker = || {
        let mut done = Vec::new();
        loop {
            let seed = next.fetch_add(1, Ordering::Relaxed);
            if seed > seeds {
                return done;
            }
            done.push((seed, work(seed)));
        }
    };
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let mut done: Vec<(u64, Judged)> = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..cores).map(|_| scope.spawn(worker)).collect();
        workers.into_iter().flat_map(|w| w.join().expect("a worker that ends")).collect()
    });
    done.sort_by_key(|(seed, _)| *seed);
    done.into_iter().map(|(_, judged)| judged).collect()
}

fn exponent_off(o: &Outcome) -> f64 {
    o.verdict.model.spreading_exponents.map_or(f64::NAN, |e| (e[0] - 2.0).abs())
}

fn exponents(judged: &[Judged]) -> String {
    let held = judged.iter().filter_map(|j| {
        let std =
            j.0.verdict
                .model
                .estimators
                .get(&Estimator::Joint)?
                .details
                .get("spreading_exponent_std")?;
        Some(exponent_off(&j.0) <= 1.96 * std)
    });
    format!(
        "exponent off by {:.3} at most; its interval holds {}",
        judged.iter().map(|j| exponent_off(&j.0)).fold(0.0, f64::max),
        share(held)
    )
}

/// How many of them are so, in percent.
fn share(held: impl Iterator<Item = bool>) -> String {
    let held: Vec<bool> = held.collect();
    format!(
        "{:.0} % of {}",
        100.0 * held.iter().filter(|h| **h).count() as f64 / held.len() as f64,
        held.len()
    )
}

fn strobe_off(o: &Outcome) -> f64 {
    o.strobe_off_m.iter().map(|d| d * d).sum::<f64>().sqrt()
}

/// How far from its place the strobe is taken to be, along the vehicle's axes (m).
fn strobe_off_in(v: &Verdict, truth: &Truth) -> [f64; 3] {
    // The camera looks straight down, image up is forward: ahead = −y, left = −x, up = −z of the
    // optical space.
    let camera = [0.34, -0.10, -0.12];
    let found = v.model.strobe.as_ref().map_or([f64::NAN; 3], |s| s.position_in_optical_m);
    let in_base = [-found[1], -found[0], -found[2]];
    std::array::from_fn(|i| camera[i] + in_base[i] - truth.strobe_position_in_base[i])
}

fn strobe_found(judged: &[Judged]) -> String {
    let off: Vec<f64> = judged.iter().map(|j| strobe_off(&j.0)).collect();
    let held = judged.iter().filter_map(|j| {
        Some((j.0.strobe_off_m, j.0.verdict.model.strobe.as_ref()?.position_std_m?))
    });
    let held = held.flat_map(|(off, std)| {
        std::array::from_fn::<bool, 3, _>(|i| off[i].abs() <= 1.96 * std[i])
    });
    let (most, mean) =
        (off.iter().copied().fold(0.0, f64::max), off.iter().sum::<f64>() / off.len() as f64);
    format!(
        "found within {most:.3} m at most, {mean:.3} m in the mean; intervals of its place hold {}",
        share(held)
    )
}

fn dropped_out(judged: &[Judged]) -> String {
    let (there, found, false_alarms) = drop_outs(judged);
    format!("{found} of {there} found, {false_alarms} false")
}

fn modelled(judged: &[Judged]) -> String {
    format!(
        "modelled in {}",
        judged.iter().filter(|j| j.0.verdict.model.backscatter.is_some()).count()
    )
}

fn followed_within(o: &Outcome) -> f64 {
    o.followed_within
}

/// The largest error of α of any frame, relative.
fn followed_in(v: &Verdict, truth: &Truth) -> f64 {
    let mut largest = 0.0f64;
    for f in &truth.frames {
        let at = v.model.segments.at(Stamp(f.stamp_ns as i64));
        for b in 0..3 {
            let alpha = at.map_or(v.model.attenuation_per_m[b], |at| at[b]);
            largest = largest.max((alpha / f.attenuation_per_m[b] - 1.0).abs());
        }
    }
    largest
}

fn followed(judged: &[Judged]) -> String {
    let largest = judged.iter().map(|j| followed_within(&j.0)).fold(0.0, f64::max);
    let in_segments = judged.iter().filter(|j| !j.0.verdict.model.segments.0.is_empty()).count();
    format!("α of any frame within {:.0} %; followed in {in_segments}", 100.0 * largest)
}
