//! Errors common to the whole log: they cause no scatter within it, so the solve's own standard
//! deviations do not contain them.

use crate::estimate::Dataset;
use crate::estimate::camera_fit::CameraFit;
use crate::estimate::samples::FrameSamples;
use crate::image::Bands;
use crate::solver::{JointAnswer, Observation, Sample, Setup, Track, sample_path, solve};
use crate::stats;

/// Error of planes, attitudes and the beam's grid, common to all points of a few seconds, which
/// turns into α by the spread of path lengths. By rendered dives (log light).
const COMMON_LOG_ERROR: f64 = 0.004;
/// The same where terrain is followed: altitudes between the returns are interpolated, and ridges
/// come out too gentle.
const TERRAIN_LOG_ERROR: f64 = 0.011;
/// What is less is rounding of the normal of a plane (rad).
const LEAST_SLOPE: f64 = 1e-6;
/// Error of the mean of 8-bit pixel values, in pixel values: a JPEG's rounding is seldom even. It
/// matters in dark areas.
const COMMON_VALUE_ERROR: f64 = 0.1;
/// The same of linear pixel values: a converter may truncate, half a step low, or round, and no
/// file says which it does.
const COMMON_LINEAR_VALUE_ERROR: f64 = 0.35;
/// Noise that even bright points have (log light).
const LEAST_NOISE: f64 = 0.005;
/// Error of the form of backscatter, as a share of its effect on α.
const SCATTERING_FORM_ERROR: f64 = 0.1;
/// Error of gains or of a transfer curve that were found, over the log's range of path lengths. By
/// dives of two renderers (log light).
const CAMERA_LOG_ERROR: f64 = 0.004;
/// Uniform backscatter is mistaken for a black level: error of that, as a share of its effect on α.
const BLACK_LEVEL_FORM_ERROR: f64 = 0.05;
/// Common-mode errors go with altitude, as exponent and strobe position do, and so are mistaken for
/// them more easily than errors of single frames; by rendered dives.
const COMMON_OVER_SINGLE: f64 = 2.0;
/// Reweightings of a solve of which only the size of a difference matters.
pub const FEW_ROUNDS: usize = 4;

/// Common-mode errors of α and of its differences between bands (1/m).
pub fn common_errors(
    data: &Dataset<'_>,
    without_backscatter: Option<Bands>,
    answer: &JointAnswer,
) -> (Bands, [f64; 2]) {
    let alpha = &answer.attenuation_per_m;
    let by_values: Bands =
        std::array::from_fn(|b| if b < data.bands() { value_error_per_m(data, b) } else { 0.0 });
    let by_backscatter: Bands = std::array::from_fn(|b| {
        without_backscatter.map_or(0.0, |w| SCATTERING_FORM_ERROR * (w[b] - alpha[b]))
    });
    let by_geometry = geometry_error_per_m(data, answer.systematic);
    let by_black_level = |b: usize| {
        let found = data.camera.filter(|camera| camera.found.black_level);
        found.map_or(0.0, |c| BLACK_LEVEL_FORM_ERROR * black_level_share_per_m(data, c, b))
    };
    let by_camera = camera_error_per_m(data);
    let of_camera = |b: usize| by_camera.hypot(by_black_level(b));
    let of_band =
        |b: usize| by_geometry.hypot(by_values[b]).hypot(by_backscatter[b]).hypot(of_camera(b));
    // The error of the geometry is nearly the same in all bands.
    let between = |b: usize| {
        (by_geometry / 2.0)
            .hypot(by_values[b])
            .hypot(by_values[b + 1])
            .hypot(by_backscatter[b] - by_backscatter[b + 1])
            .hypot(of_camera(b) / 2.0)
            .hypot(of_camera(b + 1) / 2.0)
    };
    (std::array::from_fn(of_band), std::array::from_fn(between))
}

/// Error of the geometry as an error of α (1/m), by the number of independent moments and the
/// spread of path lengths.
fn geometry_error_per_m(data: &Dataset<'_>, systematic: f64) -> f64 {
    let is_off = |f: &FrameSamples, sample: &Sample| {
        (sample.normal.vector() - f.normal.vector()).norm() > LEAST_SLOPE
    };
    let follows_terrain = |f: &FrameSamples| f.grid.iter().any(|(_, sample)| is_off(f, sample));
    let log_error =
        if data.frames.iter().any(follows_terrain) { TERRAIN_LOG_ERROR } else { COMMON_LOG_ERROR };
    log_error.max(systematic) / (path_std_m(data) * (data.moments() as f64).sqrt()).max(1e-9)
}

/// What each of several logs adds to the error of the geometry of all (1/m), by node: it has fewer
/// moments.
pub fn errors_of_logs(data: &Dataset<'_>, systematic: f64) -> Vec<f64> {
    let Some(drift) = data.drift.filter(|drift| drift.grid.is_of_logs()) else { return Vec::new() };
    let of_all = geometry_error_per_m(data, systematic);
    let mut errors = vec![0.0; drift.grid.nodes];
    let logs = data.frames.chunk_by(|a, b| a.log == b.log);
    for (frames, first) in logs.zip(drift.grid.frames.chunk_by(|a, b| a.0 == b.0)) {
        let alone = geometry_error_per_m(&Dataset { frames, ..*data }, systematic);
        errors[first[0].0] = (alone * alone - of_all * of_all).max(0.0).sqrt();
    }
    errors
}

/// Spread of path lengths over the log (m): down and up again.
fn path_std_m(data: &Dataset<'_>) -> f64 {
    let altitudes = || data.frames.iter().map(|f| f.camera_altitude_m);
    let n = data.frames.len().max(1) as f64;
    let mean = altitudes().sum::<f64>() / n;
    2.0 * (altitudes().map(|h| (h - mean).powi(2)).sum::<f64>() / n).sqrt()
}

/// Error of the form of gains and transfer curve as an error of α (1/m). It goes with brightness,
/// hence with altitude, and more frames do not lower it.
fn camera_error_per_m(data: &Dataset<'_>) -> f64 {
    let found = data.camera.map(|camera| camera.found).unwrap_or_default();
    let is_uncertain = found.gains || found.law || found.response;
    if is_uncertain { CAMERA_LOG_ERROR / path_std_m(data).max(1e-9) } else { 0.0 }
}

/// Slope over path length of the share of a band's light that the black level is: what α would have
/// absorbed of it (1/m).
fn black_level_share_per_m(data: &Dataset<'_>, camera: &CameraFit, band: usize) -> f64 {
    let level = camera.curve.black_level[band];
    let share = |o: &Observation| level / (f64::from(o.sample.log_color[band]).exp() + level);
    let observations = data.raw_tracks().iter().flatten();
    slope_per_m(observations.filter_map(|o| Some((data.path(o)?.length_m(), share(o), 1.0))))
}

/// Slope over path length of the log light of an error in pixel values: α absorbs it (1/m).
fn value_error_per_m(data: &Dataset<'_>, band: usize) -> f64 {
    // Error, and weight in the solve by the noise that the values are sure to have.
    let log_light = |o: &Observation| {
        let (frame, log_color) =
            (data.frames.get(o.frame as usize)?, f64::from(o.sample.log_color[band]));
        let step = 1.0 / f64::from(frame.max_value);
        Some(if frame.eight_bit {
            // The sRGB curve, which is near any gamma: light ∝ value^2.4.
            (COMMON_VALUE_ERROR * step * 2.4 / 1.055 * (-log_color / 2.4).exp(), 1.0)
        } else {
            let of_step = step * (-log_color).exp();
            (COMMON_LINEAR_VALUE_ERROR * of_step, 1.0 / (1.0 + (of_step / LEAST_NOISE).powi(2)))
        })
    };
    let observations = data.raw_tracks().iter().flatten();
    slope_per_m(observations.filter_map(|o| {
        let (error, weight) = log_light(o)?;
        Some((data.path(o)?.length_m(), error, weight))
    }))
}

/// Size of a slope over path length, of points (path length, error, weight).
fn slope_per_m(points: impl Iterator<Item = (f64, f64, f64)>) -> f64 {
    stats::slope(&points.collect::<Vec<_>>()).map_or(0.0, |(slope, _)| slope.abs())
}

/// Factor by which common-mode errors grow where exponent, strobe position, tilts or daylight are
/// free, per band.
pub fn freedom_inflation(
    data: &Dataset<'_>,
    tracks: &[Track],
    setup: &Setup<'_>,
    std_per_m: &Bands,
) -> Bands {
    let is_free = setup.fit_exponent || setup.free_strobe;
    if !is_free && setup.tilts.is_none() && setup.daylight.is_none() {
        return [1.0; 3];
    }
    let held = Setup {
        fit_exponent: false,
        free_strobe: false,
        tilts: None,
        daylight: None,
        rounds: FEW_ROUNDS,
        ..*setup
    };
    let Some(held) = solve(tracks, &held, data.lamps, &sample_path) else { return [1.0; 3] };
    std::array::from_fn(|b| COMMON_OVER_SINGLE * (std_per_m[b] / held.std_per_m[b]).max(1.0))
}
