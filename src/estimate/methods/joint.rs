//! The joint solve as an estimator: all terms, with the error budget.

use nalgebra::Vector3;

use super::{Candidate, enough_tracks};
use crate::config::{EstimateConfig, Spreading};
use crate::diagnostics::NoAnswer;
use crate::estimate::quality::error_budget::{
    FEW_ROUNDS, common_errors, errors_of_logs, freedom_inflation,
};
use crate::estimate::{Dataset, angular_bins, daylight};
use crate::model::{
    AttenuationOverTime, BeamGrid, Daylight, ImagingModel, ScatterIntegral, SpreadingModel,
    TimeNode,
};
use crate::solver::terms::geometry::ShiftedPlanes;
use crate::solver::{
    FreeTilts, JointAnswer, Observation, ScatterOf, Setup, Track, sample_path, solve,
};
use crate::stats;
use crate::units::Stamp;
use crate::vehicle::Lamps;

/// Attenuation, beam pattern and reflectances in one robust solve.
///
/// # Errors
/// Too few tracks, or they do not determine the unknowns.
pub fn estimate(
    data: &Dataset<'_>,
    grid: BeamGrid,
    config: &EstimateConfig,
) -> Result<Candidate, NoAnswer> {
    enough_tracks(data, config)?;
    let scatter_of = |o: &Observation| {
        data.backscatter.map_or(ScatterIntegral::default(), |fit| fit.scatter(data, &o.sample))
    };
    let planes = data.plane_tracks();
    let tilted = |o: &Observation, tilt: [f64; 2], lamps: Lamps| {
        let (body_from_optical, (instrument, _)) = (data.body_from_optical, data.tilts?);
        let by = Vector3::new(0.0, tilt[0], tilt[1]);
        let planes =
            ShiftedPlanes { planes: &planes, body_from_optical, instrument, by, log_scale: 0.0 };
        planes.path(o, lamps)
    };
    let tracks = data.raw_tracks();
    let setup = Setup {
        tilts: data.tilts.map(|(_, stds)| FreeTilts { path: &tilted, stds }),
        scatter: data.backscatter.map(|fit| (&fit.backscatter, &scatter_of as &ScatterOf<'_>)),
        daylight: data.daylight.map(|fit| daylight::begun(&fit.share)),
        segments: data.drift.map(|d| &d.grid),
        fit_exponent: config.spreading == Spreading::Fit,
        free_strobe: data.strobe_is_free,
        ..data.setup(grid, config)
    };
    let mut answer =
        solve(tracks, &setup, data.lamps, &sample_path).ok_or(NoAnswer::Undetermined)?;
    let inflation = inflate(data, tracks, &setup, &mut answer);
    let low = low_frames(data, tracks, &setup);
    let details = details(data, tracks, &answer, low.as_ref(), inflation);
    let model = model_of(data, &answer, config);
    let fit = (answer.observations, answer.residual);
    Ok(Candidate {
        path_spread_m: Some(answer.path_spread_m),
        systematic: answer.systematic,
        inflation,
        low_frames: low.map(|l| (l.attenuation_per_m, l.std_per_m)),
        ..Candidate::new(model, answer.std_per_m, fit, &details)
    })
}

/// Adds common-mode errors to the standard deviations; returns the largest factor by which that
/// widens those of α.
fn inflate(
    data: &Dataset<'_>,
    tracks: &[Track],
    setup: &Setup<'_>,
    answer: &mut JointAnswer,
) -> f64 {
    let plain = Setup { scatter: None, rounds: FEW_ROUNDS, ..*setup };
    let without_backscatter =
        setup.scatter.and_then(|_| solve(tracks, &plain, data.lamps, &sample_path));
    let without_backscatter = without_backscatter.map(|a| a.attenuation_per_m);
    let (common, between) = common_errors(data, without_backscatter, answer);
    let by_freedom = freedom_inflation(data, tracks, setup, &answer.std_per_m);
    let alone = answer.std_per_m;
    for b in 0..setup.bands {
        let common = by_freedom[b] * common[b];
        answer.std_per_m[b] = answer.std_per_m[b].hypot(common);
        answer.over_time.iter_mut().for_each(|(_, std)| std[b] = std[b].hypot(common));
    }
    for ((_, std), error) in
        answer.over_time.iter_mut().zip(errors_of_logs(data, answer.systematic))
    {
        std[..setup.bands].iter_mut().for_each(|std| *std = std.hypot(error));
    }
    for (std, common) in answer.difference_std_per_m.iter_mut().zip(between) {
        *std = std.hypot(common);
    }
    let factor = |b: usize| answer.std_per_m[b] / alone[b].max(1e-12);
    (0..setup.bands).map(factor).fold(1.0, f64::max)
}

/// The answer as a model; directions that no track saw get the beam pattern of Eq. 17.
fn model_of(data: &Dataset<'_>, answer: &JointAnswer, config: &EstimateConfig) -> ImagingModel {
    let bands = data.bands();
    let spreading = SpreadingModel::of(config.spreading);
    let spreading = SpreadingModel {
        strobe_leg: answer.exponent.map_or(spreading.strobe_leg, |e| e.0),
        ..spreading
    };
    let alpha = answer.attenuation_per_m;
    let beam_pattern = angular_bins::completed(&answer.beam, data, &alpha, spreading, config);
    let daylight = answer.log_daylight.and_then(|(log_strength, _)| {
        let level = beam_pattern.level_of(&answer.beam)?;
        Some(Daylight { log_strength }.shifted(-level))
    });
    let over_time = data.drift.map(|d| {
        let node = |(stamp, node): &(Stamp, usize)| {
            let (alpha, std) = answer.over_time[*node];
            TimeNode {
                stamp_ns: stamp.0,
                attenuation_per_m: alpha[..bands].to_vec(),
                attenuation_std_per_m: std[..bands].to_vec(),
            }
        };
        AttenuationOverTime(d.stamps.iter().map(node).collect())
    });
    ImagingModel {
        over_time: over_time.unwrap_or_default(),
        backscatter: answer.backscatter.map(|b| b.0),
        daylight,
        ..data.model(alpha, spreading, beam_pattern, config)
    }
}

/// Numbers of the solve for `model.json`.
fn details(
    data: &Dataset<'_>,
    tracks: &[Track],
    answer: &JointAnswer,
    low: Option<&JointAnswer>,
    inflation: f64,
) -> Vec<(&'static str, f64)> {
    let frames = |t: &Track| t.iter().map(|o| o.frame).collect::<Vec<_>>();
    let length = |t: &Track| {
        let frames = frames(t);
        frames.iter().max().copied().unwrap_or(0) - frames.iter().min().copied().unwrap_or(0)
    };
    let longest = tracks.iter().map(length).max().unwrap_or(0);
    let mut details = vec![
        ("tracks", answer.tracks as f64),
        ("longest_track_frames", f64::from(longest)),
        ("path_spread_m", answer.path_spread_m),
        ("systematic", answer.systematic),
    ];
    if data.bands() == 3 {
        details.push(("red_minus_green_std_per_m", answer.difference_std_per_m[0]));
        details.push(("green_minus_blue_std_per_m", answer.difference_std_per_m[1]));
    }
    if let Some((exponent, std)) = answer.exponent {
        let std = std * inflation;
        details.extend([("spreading_exponent", exponent), ("spreading_exponent_std", std)]);
    }
    if let Some(low) = low {
        let names = ["low_frames_red_per_m", "low_frames_green_per_m", "low_frames_blue_per_m"];
        details.extend(names.into_iter().zip(low.attenuation_per_m).take(data.bands()));
    }
    details
}

/// The same solve on the lower half of the frames alone: backscatter grows with altitude, so that
/// the two answers differ where it is not modelled.
fn low_frames(data: &Dataset<'_>, tracks: &[Track], setup: &Setup<'_>) -> Option<JointAnswer> {
    let altitudes: Vec<f64> = data.frames.iter().map(|f| f.camera_altitude_m).collect();
    let middle = stats::median(&altitudes);
    let is_low = |o: &Observation| {
        data.frames.get(o.frame as usize).is_some_and(|f| f.camera_altitude_m <= middle)
    };
    let low: Vec<Track> = tracks
        .iter()
        .map(|t| t.iter().copied().filter(is_low).collect())
        .filter(|t: &Track| t.len() >= 2)
        .collect();
    solve(&low, setup, data.lamps, &sample_path)
}
