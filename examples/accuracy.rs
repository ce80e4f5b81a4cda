//! How near the truth the estimators come, over many rendered dives: the table of `docs/accuracy.md`.
//!
//!     cargo run --release --example accuracy -- [SEEDS [SETTINGS.toml [CASE]]]
#[path = "../tests/support/mod.rs"]
mod support;

use support::judge::{Verdict, run};
use support::render::{Dive, Sensor};
use unwater::config::Estimator;
use unwater::pipeline::Options;

fn main() {
    let seeds: u64 = std::env::args().nth(1).and_then(|n| n.parse().ok()).unwrap_or(8);
    let plain = |seed| Dive { seed, frames: 40, ..Dive::default() };
    let mut joint = Options::default();
    if let Some(path) = std::env::args().nth(2) {
        joint.config = unwater::config::Config::from_toml(&std::fs::read_to_string(path).expect("settings")).expect("settings");
    }
    let wanted = std::env::args().nth(3).unwrap_or_default();
    let mut pairs = joint.clone();
    pairs.config.estimate.estimator = Estimator::Pairs;
    type Case = (&'static str, Box<dyn Fn(u64) -> Dive>, Options);
    let cases: Vec<Case> = vec![
        ("bayer16, clear", Box::new(plain), joint.clone()),
        ("bayer16, clear, pairs", Box::new(plain), pairs),
        ("JPEG q92, clear", Box::new(move |s| Dive { sensor: Sensor::Jpeg(92), ..plain(s) }), joint.clone()),
        ("strobe not given", Box::new(move |s| Dive { with_strobe_mount: false, ..plain(s) }), joint.clone()),
        ("5 % at half power", Box::new(move |s| Dive { half_power_frames: 0.05, ..plain(s) }), joint.clone()),
        ("backscatter 10 %", Box::new(move |s| Dive { backscatter: 0.1, ..plain(s) }), joint.clone()),
        ("backscatter 30 %", Box::new(move |s| Dive { backscatter: 0.3, ..plain(s) }), joint.clone()),
        ("alpha drifts by 30 %", Box::new(move |s| Dive { attenuation_drift: 0.3, ..plain(s) }), joint.clone()),
        ("slope 15 deg", Box::new(move |s| Dive { slope_deg: (15.0, 0.0), ..plain(s) }), joint.clone()),
    ];
    println!(
        "{:<29} {:>24} {:>24} {:>8} {:>21} {:>7} {:>10}",
        "case", "mean error of alpha", "worst error of alpha", "beam", "reflectance error", "in 95 %", "identified"
    );
    let folder = std::env::temp_dir().join(format!("unwater-accuracy-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    for (name, dive, options) in cases.into_iter().filter(|c| c.0.starts_with(&wanted)) {
        let verdicts: Vec<Verdict> = (1..=seeds).map(|seed| run(&dive(seed), &options, &folder).0).collect();
        let n = verdicts.len() as f64;
        let mean = |f: &dyn Fn(&Verdict) -> f64| verdicts.iter().map(f).sum::<f64>() / n;
        let three = |f: &dyn Fn(usize) -> f64| (0..3).map(|b| format!("{:+.4}", f(b))).collect::<Vec<_>>().join(" ");
        let held: usize = verdicts
            .iter()
            .map(|v| v.attenuation_error_per_m.iter().zip(&v.attenuation_std_per_m).filter(|(e, s)| e.abs() <= 1.96 * **s).count())
            .sum();
        println!(
            "{name:<29} {:>24} {:>24} {:>8.4} {:>21} {:>6.0}% {:>7}/{n:.0}",
            three(&|b| mean(&|v| v.attenuation_error_per_m[b])),
            three(&|b| verdicts.iter().map(|v| v.attenuation_error_per_m[b].abs()).fold(0.0, f64::max)),
            mean(&|v| v.beam_log_rmse),
            three(&|b| mean(&|v| v.reflectance_error[b])),
            100.0 * held as f64 / (3.0 * n),
            verdicts.iter().filter(|v| v.model.identified).count(),
        );
    }
    let _gone = std::fs::remove_dir_all(folder);
}
