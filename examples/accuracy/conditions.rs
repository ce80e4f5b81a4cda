//! Dives with conditions of real recordings, one at a time or all at once, and what is measured of
//! them.

use crate::support::render::conditions::{Conditions, Response, SecondLamp, SettingsMessage};
use crate::support::render::{Dive, DvlType, Sensor};
use crate::{Case, Judged, case, goals, plain, share};

/// 40 frames from a 16-bit Bayer sensor under these conditions.
fn under(seed: u64, conditions: Conditions) -> Dive {
    Dive { conditions, ..plain(seed) }
}

fn coded(seed: u64, response: Response, sensor: Sensor) -> Dive {
    Dive { sensor, ..under(seed, Conditions { response, ..Conditions::default() }) }
}

fn metered(seed: u64) -> Dive {
    let automatic =
        Conditions { auto_exposure: 0.8, auto_white_balance: 0.5, ..Conditions::default() };
    under(seed, automatic)
}

/// The strobe's mount off by 0.2 m: ahead, upwards or to port by the seed.
fn strobe_off(seed: u64) -> Dive {
    let mut strobe_mount_error_m = [0.0; 3];
    strobe_mount_error_m[[0, 2, 1][seed as usize % 3]] = 0.2;
    under(seed, Conditions { strobe_mount_error_m, ..Conditions::default() })
}

fn cheap_rov(seed: u64) -> Dive {
    let conditions = Conditions {
        auto_exposure: 0.8,
        auto_white_balance: 0.5,
        vignetting_exponent: 4.0,
        ..Conditions::default()
    };
    Dive {
        sensor: Sensor::Jpeg(75),
        dvl: DvlType::Altimeter,
        with_imu: false,
        with_strobe_mount: false,
        ..under(seed, conditions)
    }
}

fn recorded(seed: u64, message: SettingsMessage) -> Dive {
    under(seed, Conditions { settings: Some(message), ..Conditions::default() })
}

fn daylight(seed: u64, share: f64) -> Dive {
    under(seed, Conditions { daylight: share, has_depth_sensor: true, ..Conditions::default() })
}

pub const CASES: &[Case] = &[
    case("auto-exposure", |s| under(s, Conditions { auto_exposure: 0.8, ..Conditions::default() })),
    case("auto-exposure and auto white balance", metered),
    case("auto-exposure and auto white balance (JPEG q92)", |s| Dive {
        sensor: Sensor::Jpeg(92),
        ..metered(s)
    }),
    case("flicker 5 %", |s| under(s, Conditions { strobe_flicker: 0.05, ..Conditions::default() })),
    case("black level 0.3 %", |s| {
        under(s, Conditions { black_level: 0.003, ..Conditions::default() })
    }),
    case("black level 1 %", |s| {
        under(s, Conditions { black_level: 0.01, ..Conditions::default() })
    }),
    case("ADC truncating", |s| {
        under(s, Conditions { has_truncating_adc: true, ..Conditions::default() })
    }),
    case("vignetting", |s| {
        under(s, Conditions { vignetting_exponent: 4.0, ..Conditions::default() })
    }),
    case("strobe 0.2 m off", strobe_off),
    case("clock 0.25 s off", |s| {
        under(s, Conditions { stamp_delay_s: 0.25, ..Conditions::default() })
    }),
    case("gamma 2.2 (JPEG q92)", |s| coded(s, Response::Gamma22, Sensor::Jpeg(92))),
    case("gamma 2.2 (rgb8)", |s| coded(s, Response::Gamma22, Sensor::Rgb8)),
    case("linear 8 bit (JPEG q92)", |s| coded(s, Response::Linear, Sensor::Jpeg(92))),
    case("linear 8 bit (rgb8)", |s| coded(s, Response::Linear, Sensor::Rgb8)),
    case("contrast curve (JPEG q92)", |s| coded(s, Response::Contrast, Sensor::Jpeg(92))),
    case("contrast curve (rgb8)", |s| coded(s, Response::Contrast, Sensor::Rgb8)),
    case("second lamp not in TF", |s| {
        under(s, Conditions { second_lamp: SecondLamp::Unlisted, ..Conditions::default() })
    }),
    case("second lamp in TF", |s| {
        under(s, Conditions { second_lamp: SecondLamp::Listed, ..Conditions::default() })
    }),
    case("daylight 20 %", |s| daylight(s, 0.2)),
    case("daylight twice the strobe", |s| daylight(s, 2.0)),
    case("daylight 50 times the strobe", |s| daylight(s, 50.0)),
    case("uniform backscatter 10 %", |s| {
        under(s, Conditions { uniform_backscatter: 0.1, ..Conditions::default() })
    }),
    case("bare altimeter with IMU", |s| Dive { dvl: DvlType::Altimeter, ..plain(s) }),
    case("bare altimeter without IMU", |s| Dive {
        dvl: DvlType::Altimeter,
        with_imu: false,
        ..plain(s)
    }),
    case("auto-exposure, bare altimeter without IMU", |s| Dive {
        dvl: DvlType::Altimeter,
        with_imu: false,
        ..under(s, Conditions { auto_exposure: 0.8, ..Conditions::default() })
    }),
    case("cheap ROV", cheap_rov),
    case("settings change 8× (ImageMetaData)", |s| recorded(s, SettingsMessage::ImageMetaData)),
    case("settings change 8× (Float64)", |s| recorded(s, SettingsMessage::Float64)),
    case("settings change 8× (stops)", |s| recorded(s, SettingsMessage::Stops)),
    case("clear from 1.2 to 4.5 m", |s| Dive {
        altitude_m: (1.2, 4.5),
        attenuation_per_m: [0.30, 0.08, 0.05],
        ..plain(s)
    }),
];

/// What a case must show: the largest error of α [1/m] and means over the seeds of the images'
/// measures.
struct Required {
    /// beginning of the names of the cases
    case: &'static str,
    /// only of dives whose α is reported as identified
    alpha: f64,
    is_of_identified: bool,
    /// ΔE00 median, flat, cv, hue
    images: [f64; 4],
}

const fn required(case: &'static str, alpha: f64, images: [f64; 4]) -> Required {
    Required { case, alpha, is_of_identified: false, images }
}

const fn or_not_identified(case: &'static str, alpha: f64, images: [f64; 4]) -> Required {
    Required { case, alpha, is_of_identified: true, images }
}

const REQUIRED: &[Required] = &[
    required("16-bit Bayer, clear", 0.003, [0.70, 1.02, 0.004, 0.002]),
    or_not_identified("auto-exposure, bare", 0.015, [0.9, 1.03, 0.02, 0.01]),
    required("auto-exposure", 0.015, [0.75, 1.03, 0.012, 0.006]),
    required("flicker", 0.010, [0.80, 1.03, 0.015, 0.003]),
    required("black level", 0.005, [0.95, 1.02, 0.006, 0.004]),
    required("ADC", 0.005, [0.95, 1.02, 0.006, 0.004]),
    required("vignetting", 0.004, [0.72, 1.02, 0.005, 0.003]),
    required("strobe 0.2 m off", 0.004, [0.72, 1.02, 0.005, 0.003]),
    required("clock", 0.004, [0.72, 1.02, 0.005, 0.003]),
    required("gamma", 0.012, [0.85, 1.03, 0.006, 0.004]),
    required("linear", 0.012, [0.85, 1.03, 0.006, 0.004]),
    required("contrast", 0.012, [0.85, 1.03, 0.006, 0.004]),
    or_not_identified("second lamp", 0.015, [1.2, 1.05, 0.02, 0.01]),
    required("daylight", 0.010, [1.0, 1.04, 0.015, 0.01]),
    required("uniform backscatter", 0.010, [1.0, 1.04, 0.015, 0.01]),
    required("bare altimeter with IMU", 0.010, [0.9, 1.03, 0.02, 0.01]),
    or_not_identified("bare altimeter without IMU", 0.03, [1.3, 1.06, 0.02, 0.01]),
    // Its α cannot be identified.
    or_not_identified("cheap ROV", 0.0, [2.0, 1.12, 0.02, 0.015]),
    required("settings", 0.003, [0.70, 1.02, 0.004, 0.002]),
];

type Measure = (&'static str, fn(&Judged) -> f64);

const IMAGES: [Measure; 4] = [
    ("ΔE00", |j| j.0.shown.delta_e_median),
    ("flat", |j| j.0.shown.evenness.flat),
    ("cv", |j| j.0.shown.evenness.cv),
    ("hue", |j| j.0.shown.evenness.hue),
];

/// Errors, in standard deviations too, and evenness of the corrected images.
pub fn print(done: &[(&'static str, Vec<Judged>)]) {
    println!(
        "\n| case | α, largest | z, largest | z, largest where identified | 95 % holds | \
         identified | ΔE00 median, mean (largest) | flat | cv | hue | drift | required, not \
         reached |\n| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |"
    );
    for (name, judged) in done {
        println!("| {name} | {} | {} |", row(judged), not_reached(name, judged));
    }
    let all = done.iter().flat_map(|(_, judged)| judged);
    let is_held = all.flat_map(|j| {
        let v = &j.0.verdict;
        let bands = v.attenuation_error_per_m.iter().zip(&v.attenuation_std_per_m);
        bands.map(|(error, std)| error.abs() <= 1.96 * std).collect::<Vec<_>>()
    });
    println!("\nThe 95 % intervals of all these dives and bands hold {}.", share(is_held));
}

fn row(judged: &[Judged]) -> String {
    let identified: Vec<&Judged> = judged.iter().filter(is_identified).collect();
    let z_identified = match identified.len() {
        0 => "none".into(),
        _ => format!("{:.1}", largest(identified.iter().copied().map(z))),
    };
    let mean_and_largest = |digits: usize, of: fn(&Judged) -> f64| {
        format!("{:.digits$} ({:.digits$})", mean(judged, of), largest(judged.iter().map(of)))
    };
    [
        format!("{:.4}", largest_error(judged.iter())),
        format!("{:.1}", largest(judged.iter().map(z))),
        z_identified,
        format!("{:.0} %", 100.0 * goals::held(judged)),
        format!("{} of {}", identified.len(), judged.len()),
        mean_and_largest(2, IMAGES[0].1),
        mean_and_largest(3, IMAGES[1].1),
        mean_and_largest(4, IMAGES[2].1),
        mean_and_largest(4, IMAGES[3].1),
        mean_and_largest(3, |j| j.0.shown.evenness.drift.abs()),
    ]
    .join(" | ")
}

/// Requirements that are not met, by their bounds; "none", or "" where there are none.
fn not_reached(name: &str, judged: &[Judged]) -> String {
    let Some(required) = REQUIRED.iter().find(|r| name.starts_with(r.case)) else {
        return String::new();
    };
    let counted = judged.iter().filter(|j| !required.is_of_identified || is_identified(j));
    let mut missed = Vec::new();
    let exceeds = |value: f64, bound: f64| value.is_nan() || value > bound;
    if exceeds(largest_error(counted), required.alpha) {
        missed.push(format!("α ≤ {}", required.alpha));
    }
    if exceeds(largest(judged.iter().filter(is_identified).map(z)), 3.0) {
        missed.push("z ≤ 3".into());
    }
    for ((what, of), bound) in IMAGES.iter().zip(required.images) {
        if exceeds(mean(judged, *of), bound) {
            missed.push(format!("{what} ≤ {bound}"));
        }
    }
    if missed.is_empty() { "none".into() } else { missed.join(", ") }
}

fn is_identified(judged: &&Judged) -> bool {
    judged.0.verdict.model.identified
}

fn mean(judged: &[Judged], of: fn(&Judged) -> f64) -> f64 {
    judged.iter().map(of).sum::<f64>() / judged.len() as f64
}

/// Of α, over bands and dives [1/m].
fn largest_error<'a>(judged: impl Iterator<Item = &'a Judged>) -> f64 {
    largest(judged.flat_map(|j| &j.0.verdict.attenuation_error_per_m).map(|e| e.abs()))
}

/// The largest error of α over its standard deviation, of all bands.
pub fn z(Judged(o): &Judged) -> f64 {
    let v = &o.verdict;
    let bands = v.attenuation_error_per_m.iter().zip(&v.attenuation_std_per_m);
    largest(bands.map(|(error, std)| (error / std).abs()))
}

/// NaN where any is: what was not measured is not small.
fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, |most, v| if v > most || v.is_nan() { v } else { most })
}
