//! How near the truth the estimators come, over many rendered dives: the table of `docs/accuracy.md`.
//!
//!     cargo run --release --example accuracy -- [SEEDS [CASE [SETTINGS.toml]]]
#[path = "../tests/support/mod.rs"]
mod support;

use std::sync::atomic::{AtomicU64, Ordering};

use support::judge::{Verdict, run};
use support::render::{Dive, Sensor, Truth};
use unwater::config::{Config, Estimator, Spreading, Switch};
use unwater::pipeline::Options;
use unwater::units::Stamp;

type Judged = (Verdict, Truth);
/// What a case shows beside the columns that all have.
type Extra = fn(&[Judged]) -> String;

struct Case {
    name: &'static str,
    dive: fn(u64) -> Dive,
    change: fn(&mut Config),
    extra: Extra,
}

fn plain(seed: u64) -> Dive {
    Dive { seed, frames: 40, ..Dive::default() }
}

const CASES: &[Case] = &[
    Case { name: "16-bit Bayer, clear", dive: plain, change: |_| {}, extra: |_| String::new() },
    Case { name: "JPEG q92, clear", dive: |s| Dive { sensor: Sensor::Jpeg(92), ..plain(s) }, change: |_| {}, extra: |_| String::new() },
    Case { name: "the paper's pairs", dive: plain, change: |c| c.estimate.estimator = Estimator::Pairs, extra: |_| String::new() },
    Case { name: "exponent fitted", dive: plain, change: |c| c.estimate.spreading = Spreading::Fit, extra: exponents },
    Case { name: "strobe not given", dive: |s| Dive { with_strobe_mount: false, ..plain(s) }, change: |_| {}, extra: strobe_found },
    Case { name: "5 % at half power", dive: |s| Dive { half_power_frames: 0.05, ..plain(s) }, change: |_| {}, extra: drop_outs },
    Case { name: "gains 1 to 1/8, told", dive: |s| Dive { gain_channel: Some(s % 2 == 0), ..plain(s) }, change: |_| {}, extra: |_| String::new() },
    Case { name: "backscatter 10 %", dive: |s| Dive { backscatter: 0.1, ..plain(s) }, change: |_| {}, extra: modelled },
    Case {
        name: "the same, `--backscatter off`",
        dive: |s| Dive { backscatter: 0.1, ..plain(s) },
        change: |c| c.estimate.backscatter = Switch::Off,
        extra: modelled,
    },
    Case { name: "backscatter 30 %", dive: |s| Dive { backscatter: 0.3, ..plain(s) }, change: |_| {}, extra: modelled },
    Case { name: "α drifts by 30 %", dive: |s| Dive { attenuation_drift: 0.3, ..plain(s) }, change: |_| {}, extra: followed },
    Case { name: "ridges of 0.15 m", dive: |s| Dive { relief_m: 0.15, ..plain(s) }, change: |_| {}, extra: |_| String::new() },
    Case {
        name: "the same ridges, a plane",
        dive: |s| Dive { relief_m: 0.15, ..plain(s) },
        change: |c| c.seafloor.relief = Switch::Off,
        extra: |_| String::new(),
    },
    Case { name: "two strobes", dive: |s| Dive { second_strobe: true, ..plain(s) }, change: |_| {}, extra: |_| String::new() },
    Case { name: "slope 15°", dive: |s| Dive { slope_deg: (15.0, 0.0), ..plain(s) }, change: |_| {}, extra: |_| String::new() },
];

fn main() {
    let argument = |n: usize| std::env::args().nth(n);
    let seeds: u64 = argument(1).and_then(|n| n.parse().ok()).unwrap_or(8);
    let wanted = argument(2).unwrap_or_default();
    let base = argument(3).map(|path| Config::from_toml(&std::fs::read_to_string(path).expect("settings")).expect("settings")).unwrap_or_default();
    println!(
        "| case ({seeds} seeds) | mean error of α R, G, B | largest | largest of α_R − α_G, α_G − α_B | log BP RMSE | reflectance, median error | 95 % holds | identified | |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- | --- |");
    let folder = std::env::temp_dir().join(format!("unwater-accuracy-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    for case in CASES.iter().filter(|c| c.name.starts_with(&wanted)) {
        let mut options = Options { config: base.clone(), ..Options::default() };
        (case.change)(&mut options.config);
        options.threads = 1;
        let judged = on_all_cores(seeds, |seed| {
            let own = folder.join(seed.to_string());
            std::fs::create_dir_all(&own).expect("a folder");
            let judged = run(&(case.dive)(seed), &options, &own);
            std::fs::remove_dir_all(own).expect("an emptied folder");
            judged
        });
        let n = judged.len() as f64;
        let mean = |f: &dyn Fn(&Verdict) -> f64| judged.iter().map(|(v, _)| f(v)).sum::<f64>() / n;
        let largest = |f: &dyn Fn(&Verdict) -> f64| judged.iter().map(|(v, _)| f(v).abs()).fold(0.0, f64::max);
        let error = |v: &Verdict, b: usize| v.attenuation_error_per_m[b];
        let list = |values: Vec<f64>, digits: usize| values.iter().map(|v| format!("{v:.digits$}")).collect::<Vec<_>>().join(", ");
        let held: usize = judged
            .iter()
            .map(|(v, _)| v.attenuation_error_per_m.iter().zip(&v.attenuation_std_per_m).filter(|(e, s)| e.abs() <= 1.96 * **s).count())
            .sum();
        println!(
            "| {} | {} | {} | {} | {:.3} | {} | {:.0} % | {} of {n} | {} |",
            case.name,
            list((0..3).map(|b| mean(&|v| error(v, b))).collect(), 4),
            list((0..3).map(|b| largest(&|v| error(v, b))).collect(), 4),
            list((0..2).map(|b| largest(&|v| error(v, b) - error(v, b + 1))).collect(), 4),
            mean(&|v| v.beam_log_rmse),
            list((0..3).map(|b| mean(&|v| v.reflectance_error[b])).collect(), 3),
            100.0 * held as f64 / (3.0 * n),
            judged.iter().filter(|(v, _)| v.model.identified).count(),
            (case.extra)(&judged),
        );
    }
    let _gone = std::fs::remove_dir_all(folder);
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

fn exponents(judged: &[Judged]) -> String {
    let off = judged.iter().filter_map(|(v, _)| Some((v.model.spreading_exponents?[0] - 2.0).abs()));
    format!("exponent off by {:.3} at most", off.fold(0.0, f64::max))
}

fn strobe_found(judged: &[Judged]) -> String {
    let off = judged.iter().map(|(v, truth)| {
        // The camera looks straight down, image up is forward: right = −y, down = −x, ahead = −z of the vehicle.
        let s: Vec<f64> = truth.strobe_position_in_base.iter().zip([0.34, -0.10, -0.12]).map(|(s, c)| s - c).collect();
        let found = v.model.strobe.as_ref().map_or([f64::NAN; 3], |s| s.position_in_optical_m);
        found.iter().zip([-s[1], -s[0], -s[2]]).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
    });
    let off: Vec<f64> = off.collect();
    format!("found within {:.3} m at most, {:.3} m in the mean", off.iter().copied().fold(0.0, f64::max), off.iter().sum::<f64>() / off.len() as f64)
}

fn drop_outs(judged: &[Judged]) -> String {
    let (mut there, mut found, mut false_alarms) = (0, 0, 0);
    for (v, truth) in judged {
        let halved: Vec<i64> = truth.frames.iter().filter(|f| f.gain < 1.0).map(|f| f.stamp_ns as i64).collect();
        there += halved.len();
        found += v.model.frame_gains.iter().filter(|g| halved.contains(&g.stamp_ns)).count();
        false_alarms += v.model.frame_gains.iter().filter(|g| !halved.contains(&g.stamp_ns)).count();
    }
    format!("{found} of {there} found, {false_alarms} false")
}

fn modelled(judged: &[Judged]) -> String {
    format!("modelled in {}", judged.iter().filter(|(v, _)| v.model.backscatter.is_some()).count())
}

fn followed(judged: &[Judged]) -> String {
    let mut largest = 0.0f64;
    for (v, truth) in judged {
        for f in &truth.frames {
            let at = v.model.segments.at(Stamp(f.stamp_ns as i64));
            for b in 0..3 {
                let alpha = at.map_or(v.model.attenuation_per_m[b], |at| at[b]);
                largest = largest.max((alpha / f.attenuation_per_m[b] - 1.0).abs());
            }
        }
    }
    format!("α of any frame within {:.0} %; followed in {}", 100.0 * largest, judged.iter().filter(|(v, _)| !v.model.segments.0.is_empty()).count())
}
