//! The camera's clock and the range instrument's mount, checked against the log.
//!
//! A late clock pairs every frame with the plane of another moment: where the robot climbs, all its
//! points are too dark or too bright for their altitude. A rotated mount tilts every plane in the
//! same way. Both raise the residual of the joint solve: three numbers, found like the strobe's
//! position. In: samples
//! with the planes shortly before and after each frame.

use nalgebra::Vector3;

use super::quality::identifiability::MIN_FRAMES;
use super::{Dataset, Mounts};
use crate::config::EstimateConfig;
use crate::diagnostics::NotIdentified;
use crate::model::BeamGrid;
use crate::solver::terms::geometry::{PlaneTrack, ShiftedPlanes, strobe_position};
use crate::solver::{Minimum, Observation, Problem, SETTLED, Setup, minimize, thinned};

/// Observations that hold three numbers well enough.
const MAX_OBSERVATIONS: usize = 8_000;
/// What counts as a contradiction, if it is also surer than five standard deviations: few frames
/// share their pings.
const LEAST_OFFSET_S: f64 = 0.03;
const LEAST_TURN_RAD: f64 = 0.012;
const SURE: f64 = 5.0;
/// … and lowers the residual by this share.
const LEAST_GAIN: f64 = 0.02;
/// Reweightings of each solve.
const ROUNDS: usize = 5;

/// What fits better than what was given.
#[derive(Clone, Copy, Debug)]
pub struct MountFit {
    /// to add to the camera's stamps (s)
    pub clock_offset_s: f64,
    /// its standard deviation (s)
    pub clock_offset_std_s: f64,
    /// how the planes turn, as a rotation vector in body space (rad)
    pub turn_rad: Vector3<f64>,
    /// about the camera's x and y axes (rad)
    pub turn_about_axes_rad: [f64; 2],
    /// standard deviation of those (rad)
    pub turn_std_rad: [f64; 2],
    /// residual as given, and with these (log light)
    pub residual: [f64; 2],
    /// whether the planes' turn is the attitude's, no mount's: most floors were taken to be level
    pub turn_is_attitudes: bool,
    /// whether the strobe's place was found in the same log: it has taken part of what is off
    pub at_least: bool,
}

impl MountFit {
    fn gains(&self) -> bool {
        self.residual[1] < (1.0 - LEAST_GAIN) * self.residual[0]
    }

    /// The planes as they are with this clock and mount.
    pub fn shifted<'p>(&self, planes: &'p [PlaneTrack], mounts: &Mounts) -> ShiftedPlanes<'p> {
        let [about_x, about_y] = self.turn_about_axes_rad;
        ShiftedPlanes {
            planes,
            body_from_optical: mounts.body_from_optical,
            instrument: mounts.instrument,
            by: Vector3::new(self.clock_offset_s, about_x, about_y),
            log_scale: 0.0,
        }
    }

    /// Whether the camera's clock is contradicted.
    pub fn contradicts_clock(&self) -> bool {
        self.gains()
            && self.clock_offset_s.abs() > LEAST_OFFSET_S.max(SURE * self.clock_offset_std_s)
    }

    /// Why attenuation is not identified where the seafloor is assumed level and contradicts it:
    /// the rotation that fits is not used, as it is no mount's.
    pub fn contradicts_level(&self) -> Option<NotIdentified> {
        let rotation_deg = self.turn_rad.norm().to_degrees();
        let is_contradicted = self.turn_is_attitudes && self.contradicts_mount();
        is_contradicted.then_some(NotIdentified::NotLevel { rotation_deg })
    }

    /// Whether the mount is.
    pub fn contradicts_mount(&self) -> bool {
        let surely = |k: usize| {
            self.turn_about_axes_rad[k].abs() > LEAST_TURN_RAD.max(SURE * self.turn_std_rad[k])
        };
        self.gains() && (surely(0) || surely(1))
    }
}

/// Searches for a better clock and mount; `None` where the log cannot tell. `instrument` is the
/// position of the range instrument in the body (m).
pub fn check_mounts(
    data: &Dataset<'_>,
    instrument: Vector3<f64>,
    config: &EstimateConfig,
) -> Option<MountFit> {
    let can_tell = data.tracks.len() >= config.least_pairs
        && data.altitude_varies(config)
        && data.frames.len() >= MIN_FRAMES;
    // Backscatter that is not modelled looks like any tilt.
    if !can_tell || data.unmodelled_backscatter.is_some() {
        return None;
    }
    let tracks = thinned(data.tracks, MAX_OBSERVATIONS);
    let grid = BeamGrid::new(config.beam_nodes, config.beam_limit_deg);
    let setup = Setup { rounds: ROUNDS, ..data.setup(grid, config) };
    let planes = data.plane_tracks();
    let (planes, body_from_optical) = (planes.as_slice(), data.body_from_optical);
    let at = |by: Vector3<f64>| ShiftedPlanes {
        planes,
        body_from_optical,
        instrument,
        by,
        log_scale: 0.0,
    };
    let evaluate = |by: Vector3<f64>| {
        let shifted = at(by);
        let paths = |o: &Observation, lamps| shifted.path(o, lamps);
        let mut problem = Problem::new(&tracks, &setup, data.lamps, &paths)?;
        let solution = problem.solve(setup.rounds)?;
        let mut parameters = shifted.parameters(data.lamps);
        if data.strobe_is_free {
            parameters.extend(strobe_position(data.lamps, &paths));
        }
        Some((solution.residual, problem.parameter_step(&tracks, &parameters, &solution)?))
    };
    let Minimum { point, std, residual } = minimize(Vector3::zeros(), SETTLED, &evaluate)?;
    let assumed_level = data.frames.iter().filter(|f| f.is_level_assumed).count();
    std.iter().all(|s| s.is_finite()).then(|| MountFit {
        clock_offset_s: point.x,
        clock_offset_std_s: std.x,
        turn_rad: at(point).rotation(),
        turn_about_axes_rad: [point.y, point.z],
        turn_std_rad: [std.y, std.z],
        residual,
        turn_is_attitudes: assumed_level * 2 > data.frames.len(),
        at_least: data.strobe_is_free,
    })
}
