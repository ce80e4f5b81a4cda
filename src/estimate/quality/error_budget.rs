//! Errors common to the whole log: they cause no scatter within it, so the solve's own standard
//! deviations do not contain them.

use crate::estimate::Dataset;
use crate::estimate::samples::FrameSamples;
use crate::image::Bands;
use crate::solver::{Observation, Setup, Track, sample_path, solve};

/// Error of planes, attitudes and the beam's grid, common to all points of a few seconds, which
/// turns into α by the spread of path lengths. By rendered dives (log light).
const COMMON_LOG_ERROR: f64 = 0.004;
/// The same where terrain is followed: altitudes between the returns are interpolated, and ridges
/// come out too gentle.
const TERRAIN_LOG_ERROR: f64 = 0.011;
/// Error of the mean of 8-bit pixel values, in pixel values: a JPEG's rounding is seldom even. It
/// matters in dark areas.
const COMMON_VALUE_ERROR: f64 = 0.1;
/// Error of the form of backscatter, as a share of its effect on α.
const SCATTERING_FORM_ERROR: f64 = 0.1;
/// Common-mode errors go with altitude, as exponent and strobe position do, and so are mistaken for
/// them more easily than errors of single frames; by rendered dives.
const COMMON_OVER_SINGLE: f64 = 2.0;
/// Reweightings of a solve of which only the size of a difference matters.
pub const FEW_ROUNDS: usize = 4;

/// Common-mode errors of α and of its differences between bands (1/m).
pub fn common_errors(
    data: &Dataset<'_>,
    without_backscatter: Option<Bands>,
    alpha: &Bands,
) -> (Bands, [f64; 2]) {
    let by_values: Bands =
        std::array::from_fn(|b| if b < data.bands() { value_error_per_m(data, b) } else { 0.0 });
    let by_backscatter: Bands = std::array::from_fn(|b| {
        without_backscatter.map_or(0.0, |w| SCATTERING_FORM_ERROR * (w[b] - alpha[b]))
    });
    let by_geometry = geometry_error_per_m(data);
    let of_band = |b: usize| by_geometry.hypot(by_values[b]).hypot(by_backscatter[b]);
    // The error of the geometry is nearly the same in all bands.
    let between = |b: usize| {
        (by_geometry / 2.0)
            .hypot(by_values[b])
            .hypot(by_values[b + 1])
            .hypot(by_backscatter[b] - by_backscatter[b + 1])
    };
    (std::array::from_fn(of_band), std::array::from_fn(between))
}

/// Error of the geometry as an error of α (1/m), by the number of independent moments and the
/// spread of path lengths.
fn geometry_error_per_m(data: &Dataset<'_>) -> f64 {
    let altitudes = || data.frames.iter().map(|f| f.camera_altitude_m);
    let n = data.frames.len().max(1) as f64;
    let mean = altitudes().sum::<f64>() / n;
    // Down and up again.
    let path_std_m = 2.0 * (altitudes().map(|h| (h - mean).powi(2)).sum::<f64>() / n).sqrt();
    let follows_terrain =
        |f: &FrameSamples| f.grid.iter().any(|(_, sample)| sample.normal != f.normal);
    let log_error =
        if data.frames.iter().any(follows_terrain) { TERRAIN_LOG_ERROR } else { COMMON_LOG_ERROR };
    log_error / (path_std_m * (data.moments() as f64).sqrt()).max(1e-9)
}

/// Slope over path length of the log light of an error in pixel values: α absorbs it (1/m).
fn value_error_per_m(data: &Dataset<'_>, band: usize) -> f64 {
    // The sRGB curve, which is near any gamma: light ∝ value^2.4.
    let log_light = |o: &Observation| {
        COMMON_VALUE_ERROR * 2.4 / (255.0 * 1.055)
            * (-f64::from(o.sample.log_color[band]) / 2.4).exp()
    };
    let is_8_bit =
        |o: &&Observation| data.frames.get(o.frame as usize).is_some_and(|f| f.eight_bit);
    let of_8_bit = data.raw_tracks().iter().flatten().filter(is_8_bit);
    let points = of_8_bit.filter_map(|o| Some((data.path(o)?.length_m(), log_light(o))));
    let (n, sum_l, sum_e, sum_ll, sum_le) = points
        .fold((0.0, 0.0, 0.0, 0.0, 0.0), |(n, l, e, ll, le), (x, y)| {
            (n + 1.0, l + x, e + y, ll + x * x, le + x * y)
        });
    let variance = sum_ll - sum_l * sum_l / f64::max(n, 1.0);
    if variance > 0.0 { ((sum_le - sum_l * sum_e / n) / variance).abs() } else { 0.0 }
}

/// Factor by which common-mode errors grow where the exponent or the strobe position is free, per
/// band.
pub fn freedom_inflation(
    data: &Dataset<'_>,
    tracks: &[Track],
    setup: &Setup<'_>,
    std_per_m: &Bands,
) -> Bands {
    if !setup.fit_exponent && !setup.free_strobe {
        return [1.0; 3];
    }
    let held = Setup { fit_exponent: false, free_strobe: false, rounds: FEW_ROUNDS, ..*setup };
    let Some(held) = solve(tracks, &held, data.lamps, &sample_path) else { return [1.0; 3] };
    std::array::from_fn(|b| COMMON_OVER_SINGLE * (std_per_m[b] / held.std_per_m[b]).max(1.0))
}
