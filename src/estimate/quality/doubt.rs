//! What else explains the log, though not surely: a strobe, a clock or a mount that fits better
//! than the one that is used, errors of planes in place of a curve. α is no surer than by how much
//! it would change.

use nalgebra::Vector3;

use super::error_budget::FEW_ROUNDS;
use crate::config::EstimateConfig;
use crate::estimate::camera_fit::{CameraFit, slope_of_gains};
use crate::estimate::mount_search::MountFit;
use crate::estimate::strobe_search::StrobePlacement;
use crate::estimate::{Dataset, Mounts};
use crate::image::Bands;
use crate::model::{BeamGrid, ImagingModel};
use crate::parallel::join;
use crate::solver::{Observation, PathFor, Setup, sample_path, solve, thinned};
use crate::vehicle::Lamps;

/// Observations that show a change of α well enough.
const MAX_OBSERVATIONS: usize = 8_000;

/// Error of α (1/m) by what of strobe, clock and mount is more than chance.
pub fn by_geometry(
    data: &Dataset<'_>,
    strobe: &StrobePlacement,
    mount: Option<&MountFit>,
    (mounts, config): (&Mounts, &EstimateConfig),
) -> Bands {
    let by_strobe = strobe.search.as_ref().filter(|_| strobe.source.is_none()).map(|found| {
        let moved = found.lamps.origin().vector() - strobe.lamps.origin().vector();
        (found.lamps, share_beyond_chance(moved, found.std_m))
    });
    // Tilts that are unknown make α less sure anyway.
    let by_mount = mount.filter(|_| data.tilts.is_none()).map(|found| {
        let [about_x, about_y] = found.turn_about_axes_rad;
        let by = Vector3::new(found.clock_offset_s, about_x, about_y);
        let [std_x, std_y] = found.turn_std_rad;
        (found, share_beyond_chance(by, [found.clock_offset_std_s, std_x, std_y]))
    });
    let (by_strobe, by_mount) =
        (by_strobe.filter(|(_, share)| *share > 0.0), by_mount.filter(|(_, share)| *share > 0.0));
    if by_strobe.is_none() && by_mount.is_none() {
        return [0.0; 3];
    }
    let tracks = thinned(data.tracks, MAX_OBSERVATIONS);
    let grid = BeamGrid::new(config.beam_nodes, config.beam_limit_deg);
    let segments = data.drift.map(|drift| &drift.grid);
    let setup = Setup { rounds: FEW_ROUNDS, segments, ..data.setup(grid, config) };
    let alpha = |lamps: Lamps, paths: &PathFor<'_>| {
        solve(&tracks, &setup, lamps, paths).map(|answer| answer.attenuation_per_m)
    };
    let Some(as_used) = alpha(data.lamps, &sample_path) else { return [0.0; 3] };
    let change = |other: Option<Bands>, share: f64| {
        other.map_or([0.0; 3], |other| std::array::from_fn(|b| share * (other[b] - as_used[b])))
    };
    let by_strobe =
        by_strobe.map_or([0.0; 3], |(lamps, share)| change(alpha(lamps, &sample_path), share));
    let planes = data.plane_tracks();
    let by_mount = by_mount.map_or([0.0; 3], |(found, share)| {
        let shifted = found.shifted(&planes, mounts);
        change(alpha(data.lamps, &|o: &Observation, lamps| shifted.path(o, lamps)), share)
    });
    std::array::from_fn(|b| by_strobe[b].hypot(by_mount[b]))
}

/// Error of α (1/m) where a strobe that is elsewhere explains the log as well as backscatter and
/// daylight do: the difference between the two.
pub fn by_rival(
    data: &Dataset<'_>,
    rival: Option<Lamps>,
    model: &ImagingModel,
    config: &EstimateConfig,
) -> Bands {
    let Some(lamps) = rival else { return [0.0; 3] };
    let tracks = thinned(data.raw_tracks(), MAX_OBSERVATIONS);
    let grid = BeamGrid::new(config.beam_nodes, config.beam_limit_deg);
    let setup = Setup { rounds: FEW_ROUNDS, ..data.setup(grid, config) };
    let Some(other) = solve(&tracks, &setup, lamps, &sample_path) else { return [0.0; 3] };
    std::array::from_fn(|b| other.attenuation_per_m[b] - model.attenuation_per_m[b])
}

/// Error of α (1/m) by what was found of the camera.
pub fn by_camera(data: &Dataset<'_>, config: &EstimateConfig) -> Bands {
    let (by_curve, by_gains) = (by_curve(data, config), by_gains(data));
    std::array::from_fn(|b| by_curve[b].hypot(by_gains[b]))
}

/// Error of α (1/m) beside a fitted transfer curve. Its contrast rests on how light falls with
/// range from frame to frame, so that errors of a few planes bend it and take α along: the
/// difference to frames that need not agree in brightness.
fn by_curve(data: &Dataset<'_>, config: &EstimateConfig) -> Bands {
    let is_held = |camera: &&CameraFit| camera.found.response && !camera.found.gains;
    let Some(camera) = data.camera.filter(is_held) else { return [0.0; 3] };
    let tracks = thinned(data.tracks, MAX_OBSERVATIONS);
    let grid = BeamGrid::new(config.beam_nodes, config.beam_limit_deg);
    let segments = data.drift.map(|drift| &drift.grid);
    let setup = Setup { segments, ..data.setup(grid, config) };
    let uneven = Setup { camera: Some(camera.with_uneven_frames()), ..setup };
    let solved = |setup: &Setup<'_>| solve(&tracks, setup, data.lamps, &sample_path);
    let (Some(even), Some(uneven)) = join(|| solved(&setup), || solved(&uneven)) else {
        return [0.0; 3];
    };
    std::array::from_fn(|b| uneven.attenuation_per_m[b] - even.attenuation_per_m[b])
}

/// Error of α (1/m) beside gains of frames that no law explains, and that follow altitude: flicker
/// does not, so that part of them may be attenuation. Their slope over path length, where it is
/// more than chance.
fn by_gains(data: &Dataset<'_>) -> Bands {
    let is_random = |camera: &&CameraFit| camera.found.gains && camera.law.is_none();
    let Some(camera) = data.camera.filter(is_random) else { return [0.0; 3] };
    let slope = slope_of_gains(data.frames, &camera.log_gains, camera.bands).unwrap_or(0.0);
    std::array::from_fn(|b| if b < camera.bands { slope } else { 0.0 })
}

/// How much of three numbers is more than their standard deviations explain: 0 where these are as
/// large, near 1 where they are much smaller.
fn share_beyond_chance(found: Vector3<f64>, std: [f64; 3]) -> f64 {
    let square = found.iter().zip(std).map(|(v, std)| (v / std).powi(2)).sum::<f64>() / 3.0;
    if square.is_finite() { (1.0 - 1.0 / square.max(1.0)).sqrt() } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_chance_explains_is_no_doubt() {
        let found = Vector3::new(0.01, -0.02, 0.03);
        assert_eq!(share_beyond_chance(found, [0.01, 0.02, 0.03]), 0.0);
        assert_eq!(share_beyond_chance(found, [f64::NAN; 3]), 0.0);
        let share = share_beyond_chance(found, [0.005, 0.01, 0.015]);
        assert!((share - 0.75f64.sqrt()).abs() < 1e-12, "{share}");
    }
}
