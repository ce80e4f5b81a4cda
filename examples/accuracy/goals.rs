//! What the table must show and should show, quantity by quantity, and whether it does.

use crate::{Judged, Outcome, exponent_off, followed_within, strobe_off};

/// One quantity of one case.
struct Goal {
    quantity: &'static str,
    case: &'static str,
    must: f64,
    aim: f64,
    /// less is better
    at_most: bool,
    /// from the case's dives, and those of the first case
    measure: fn(&[Judged], &[Judged]) -> f64,
}

/// Errors are the largest over all seeds and bands; what images show is the mean over the seeds.
const GOALS: &[Goal] = &[
    Goal {
        quantity: "α, 16 bit [1/m]",
        case: CLEAR,
        must: 0.01,
        aim: 0.004,
        at_most: true,
        measure: |j, _| alpha(j),
    },
    Goal {
        quantity: "α, JPEG [1/m]",
        case: JPEG,
        must: 0.015,
        aim: 0.006,
        at_most: true,
        measure: |j, _| alpha(j),
    },
    Goal {
        quantity: "α_R − α_G, α_G − α_B, 16 bit [1/m]",
        case: CLEAR,
        must: 0.005,
        aim: 0.002,
        at_most: true,
        measure: |j, _| differences(j),
    },
    Goal {
        quantity: "α_R − α_G, α_G − α_B, JPEG [1/m]",
        case: JPEG,
        must: 0.005,
        aim: 0.002,
        at_most: true,
        measure: |j, _| differences(j),
    },
    Goal {
        quantity: "α with backscatter, relative",
        case: "backscatter 10 %",
        must: 0.10,
        aim: 0.05,
        at_most: true,
        measure: |j, _| alpha_share(j),
    },
    Goal {
        quantity: "spreading exponent",
        case: "exponent fitted",
        must: 0.2,
        aim: 0.1,
        at_most: true,
        measure: |j, _| largest(j, exponent_off),
    },
    Goal {
        quantity: "95 % interval holds, 16 bit",
        case: CLEAR,
        must: 0.88,
        aim: 0.93,
        at_most: false,
        measure: |j, _| held(j),
    },
    Goal {
        quantity: "95 % interval holds, JPEG",
        case: JPEG,
        must: 0.88,
        aim: 0.93,
        at_most: false,
        measure: |j, _| held(j),
    },
    Goal {
        quantity: "log BP RMSE",
        case: CLEAR,
        must: 0.05,
        aim: 0.02,
        at_most: true,
        measure: |j, _| largest(j, |o| o.verdict.beam_log_rmse),
    },
    Goal {
        quantity: "same-point scatter, raw over corrected, R",
        case: CLEAR,
        must: 5.0,
        aim: 7.0,
        at_most: false,
        measure: |j, _| gain(j, 0),
    },
    Goal {
        quantity: "the same, G",
        case: CLEAR,
        must: 5.0,
        aim: 10.0,
        at_most: false,
        measure: |j, _| gain(j, 1),
    },
    Goal {
        quantity: "the same, B",
        case: CLEAR,
        must: 5.0,
        aim: 10.0,
        at_most: false,
        measure: |j, _| gain(j, 2),
    },
    Goal {
        quantity: "the same, Eq. 14 over corrected, least band",
        case: CLEAR,
        must: 2.0,
        aim: 4.0,
        at_most: false,
        measure: |j, _| over_frame_average(j),
    },
    Goal {
        quantity: "scatter over spread, range average over corrected, least band",
        case: CLEAR,
        must: 1.2,
        aim: 1.5,
        at_most: false,
        measure: |j, _| over_range_average(j),
    },
    Goal {
        quantity: "ΔE00, median",
        case: CLEAR,
        must: 4.0,
        aim: 2.5,
        at_most: true,
        measure: |j, _| mean(j, |o| o.shown.delta_e_median),
    },
    Goal {
        quantity: "ΔE00, 95th percentile",
        case: CLEAR,
        must: 12.0,
        aim: 8.0,
        at_most: true,
        measure: |j, _| mean(j, |o| o.shown.delta_e_95),
    },
    Goal {
        quantity: "ΔE00, median, 8 bit out",
        case: CLEAR,
        must: 4.0,
        aim: 2.5,
        at_most: true,
        measure: |j, _| mean(j, |o| o.of("8 bit out").map_or(f64::NAN, |s| s.delta_e_median)),
    },
    Goal {
        quantity: "ΔE00 of a slope of 15° above flat",
        case: "slope 15°",
        must: 1.0,
        aim: 0.5,
        at_most: true,
        measure: |j, flat| {
            mean(j, |o| o.shown.delta_e_median) - mean(flat, |o| o.shown.delta_e_median)
        },
    },
    Goal {
        quantity: "strobe that was not given [m]",
        case: "strobe not given",
        must: 0.06,
        aim: 0.02,
        at_most: true,
        measure: |j, _| largest(j, strobe_off),
    },
    Goal {
        quantity: "frames at half power: found",
        case: DROPS,
        must: 0.95,
        aim: 0.95,
        at_most: false,
        measure: |j, _| found(j),
    },
    Goal {
        quantity: "frames at half power: α moves by, relative",
        case: DROPS,
        must: 0.02,
        aim: 0.01,
        at_most: true,
        measure: moved,
    },
    Goal {
        quantity: "α of any frame where it drifts, relative",
        case: "α drifts by 30 %",
        must: 0.10,
        aim: 0.05,
        at_most: true,
        measure: |j, _| largest(j, followed_within),
    },
];

const CLEAR: &str = "16-bit Bayer, clear";
const JPEG: &str = "JPEG q92, clear";
const DROPS: &str = "5 % at half power";

/// Prints the goals whose cases were run.
pub fn print(cases: &[(&'static str, Vec<Judged>)], json: bool) {
    let of = |name: &str| {
        cases.iter().find(|(case, _)| *case == name).map(|(_, judged)| judged.as_slice())
    };
    if !json {
        println!(
            "\n| quantity | case | must | aim | is | |\n| --- | --- | --- | --- | --- | --- |"
        );
    }
    for goal in GOALS {
        let Some(judged) = of(goal.case) else { continue };
        let is = (goal.measure)(judged, of(CLEAR).unwrap_or_default());
        let reaches = |bound: f64| if goal.at_most { is <= bound } else { is >= bound };
        let word = if reaches(goal.aim) {
            "aim"
        } else if reaches(goal.must) {
            "must"
        } else if is.is_nan() {
            "not measured"
        } else {
            "**no**"
        };
        if json {
            let line = serde_json::json!({
                "quantity": goal.quantity, "case": goal.case, "must": goal.must,
                "aim": goal.aim, "at_most": goal.at_most, "is": is,
            });
            println!("{line}");
        } else {
            let sign = if goal.at_most { "≤" } else { "≥" };
            println!(
                "| {} | {} | {sign} {} | {sign} {} | {is:.4} | {word} |",
                goal.quantity, goal.case, goal.must, goal.aim
            );
        }
    }
}

fn mean(judged: &[Judged], of: impl Fn(&Outcome) -> f64) -> f64 {
    judged.iter().map(|j| of(&j.0)).sum::<f64>() / judged.len() as f64
}

fn largest(judged: &[Judged], of: impl Fn(&Outcome) -> f64) -> f64 {
    // Not `f64::max`, to which what was not measured is nothing at all.
    judged
        .iter()
        .map(|j| of(&j.0))
        .fold(0.0, |most, v| if v > most || v.is_nan() { v } else { most })
}

fn alpha(judged: &[Judged]) -> f64 {
    largest(judged, |o| {
        o.verdict.attenuation_error_per_m.iter().map(|e| e.abs()).fold(0.0, f64::max)
    })
}

fn alpha_share(judged: &[Judged]) -> f64 {
    largest(judged, |o| {
        let errors = o.verdict.attenuation_error_per_m.iter().zip(&o.true_attenuation_per_m);
        errors.map(|(e, truth)| (e / truth).abs()).fold(0.0, f64::max)
    })
}

fn differences(judged: &[Judged]) -> f64 {
    largest(judged, |o| {
        o.verdict
            .attenuation_error_per_m
            .windows(2)
            .map(|e| (e[0] - e[1]).abs())
            .fold(0.0, f64::max)
    })
}

/// Share of seeds and bands whose estimate ± 1.96 standard deviations holds the truth.
pub fn held(judged: &[Judged]) -> f64 {
    mean(judged, |o| {
        let v = &o.verdict;
        let holds = v
            .attenuation_error_per_m
            .iter()
            .zip(&v.attenuation_std_per_m)
            .filter(|(e, s)| e.abs() <= 1.96 * **s)
            .count();
        holds as f64 / v.attenuation_error_per_m.len() as f64
    })
}

fn gain(judged: &[Judged], band: usize) -> f64 {
    mean(judged, |o| o.raw.scatter[band] / o.shown.scatter[band])
}

fn least_band(judged: &[Judged], of: impl Fn(&Outcome, usize) -> f64) -> f64 {
    (0..3)
        .map(|b| mean(judged, |o| of(o, b)))
        .fold(f64::INFINITY, |least, v| if v < least || v.is_nan() { v } else { least })
}

fn over_frame_average(judged: &[Judged]) -> f64 {
    least_band(judged, |o, b| {
        o.of("frame-average").map_or(f64::NAN, |s| s.scatter[b]) / o.shown.scatter[b]
    })
}

fn over_range_average(judged: &[Judged]) -> f64 {
    least_band(judged, |o, b| {
        o.of("range-average").map_or(f64::NAN, |s| s.scatter_over_spread[b])
            / o.shown.scatter_over_spread[b]
    })
}

/// Frames at half power: there, of them found, and found where there is none.
pub fn drop_outs(judged: &[Judged]) -> (usize, usize, usize) {
    let (mut there, mut found, mut false_alarms) = (0, 0, 0);
    for Judged(o) in judged {
        let gains = &o.verdict.model.frame_gains;
        there += o.halved.len();
        found += gains.iter().filter(|g| o.halved.contains(&g.stamp_ns)).count();
        false_alarms += gains.iter().filter(|g| !o.halved.contains(&g.stamp_ns)).count();
    }
    (there, found, false_alarms)
}

fn found(judged: &[Judged]) -> f64 {
    let (there, found, _) = drop_outs(judged);
    found as f64 / there as f64
}

/// How far α moves against the same dives without drop-outs.
fn moved(judged: &[Judged], clear: &[Judged]) -> f64 {
    if judged.len() != clear.len() {
        return f64::NAN;
    }
    let pairs = judged.iter().zip(clear).flat_map(|(a, b)| {
        let (a, b) = (&a.0.verdict.model.attenuation_per_m, &b.0.verdict.model.attenuation_per_m);
        a.iter().zip(b).map(|(a, b)| (a / b - 1.0).abs()).collect::<Vec<_>>()
    });
    pairs.fold(0.0, f64::max)
}
