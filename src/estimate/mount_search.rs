//! What the log says against the camera's clock and the range instrument's mount.
//!
//! A clock that is late shows every frame the plane of another moment: where the robot climbs, all
//! its points are too dark or too bright for the altitude they are given. A mount that is turned
//! tilts every plane alike. Both are in the residual of the joint solve: three numbers, found as
//! the strobe's place is. They are reported, never applied: stamps and mounts are the user's word.
//! In: samples with the planes shortly before and after each frame.

use nalgebra::{UnitQuaternion, Vector3};

use super::Samples;
use super::candidates::LEAST_FRAMES;
use super::descent::{Lowest, SETTLED, descend};
use super::joint::places::Place;
use super::joint::{Problem, Setting, strobe_places};
use super::samples::{FrameSamples, PLANES_AROUND_S, Sample};
use super::tracks::{Observation, Track};
use crate::config::EstimateConfig;
use crate::coordinates::{Direction, Point};
use crate::geometry::{LightPath, MIN_COS_INCIDENCE};
use crate::model::BeamGrid;
use crate::vehicle::Lamps;

/// Observations that hold three numbers well enough.
const MOST_OBSERVATIONS: usize = 8_000;
/// What counts as a contradiction, if it is also surer than five standard deviations: few frames
/// share their pings.
const LEAST_OFFSET_S: f64 = 0.03;
const LEAST_TURN_RAD: f64 = 0.012;
const SURE: f64 = 5.0;
/// … and lowers the residual by this share.
const LEAST_GAIN: f64 = 0.02;
/// The parabola is followed this many times as far as its planes lie.
const FARTHEST: f64 = 2.0;

/// What fits better than what was given.
#[derive(Clone, Copy, Debug)]
pub struct MountFit {
    /// to add to the camera's stamps [s]
    pub clock_offset_s: f64,
    /// its standard deviation [s]
    pub clock_offset_std_s: f64,
    /// how the planes turn, as a rotation vector in body space [rad]
    pub turn_rad: Vector3<f64>,
    /// about the camera's x and y axes [rad]
    pub turn_about_axes_rad: [f64; 2],
    /// standard deviation of those [rad]
    pub turn_std_rad: [f64; 2],
    /// residual as given, and with these [log light]
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

    /// Whether the camera's clock is contradicted.
    pub fn contradicts_clock(&self) -> bool {
        self.gains()
            && self.clock_offset_s.abs() > LEAST_OFFSET_S.max(SURE * self.clock_offset_std_s)
    }

    /// Whether the mount is.
    pub fn contradicts_mount(&self) -> bool {
        let surely = |k: usize| {
            self.turn_about_axes_rad[k].abs() > LEAST_TURN_RAD.max(SURE * self.turn_std_rad[k])
        };
        self.gains() && (surely(0) || surely(1))
    }
}

/// The camera's clock off by x [s], and the planes turned by y, z about the camera's axes [rad]
/// around the instrument.
struct Shift<'s> {
    samples: &'s Samples<'s>,
    by: Vector3<f64>,
    instrument: Vector3<f64>,
}

impl Shift<'_> {
    fn turn(&self) -> Vector3<f64> {
        let axes = self.samples.body_from_optical.isometry().rotation;
        axes * Vector3::new(self.by.y, self.by.z, 0.0)
    }

    /// n and d of a frame's plane.
    fn plane(&self, frame: &FrameSamples) -> (Vector3<f64>, f64) {
        let (mut normal, mut distance) = (frame.normal.vector(), frame.distance_m);
        if let Some([before, after]) = frame.planes_around {
            // A parabola through three planes: a swell curves.
            let t = (self.by.x / PLANES_AROUND_S).clamp(-FARTHEST, FARTHEST);
            let (b, n, a) = (t * (t - 1.0) / 2.0, 1.0 - t * t, t * (t + 1.0) / 2.0);
            normal = before.0.vector() * b + normal * n + after.0.vector() * a;
            distance = before.1 * b + distance * n + after.1 * a;
        }
        let turned = UnitQuaternion::from_scaled_axis(self.turn()) * normal.normalize();
        (turned, distance + (turned - normal).dot(&self.instrument))
    }

    fn path(&self, o: &Observation, mount: Lamps) -> Option<LightPath> {
        let frame = self.samples.frames.get(o.frame as usize)?;
        let (normal, distance) = self.plane(frame);
        let camera = self.samples.body_from_optical.origin().vector();
        let ray = (o.sample.hit.vector() - camera) / o.sample.seafloor_to_camera_m;
        let far = |normal: &Vector3<f64>, distance: f64| {
            let (towards, along) = (normal.dot(&ray), distance - normal.dot(&camera));
            (towards > MIN_COS_INCIDENCE && along > 0.0).then(|| along / towards)
        };
        // What stands over the plane as given stands over the other.
        let seafloor_to_camera_m = o.sample.seafloor_to_camera_m + far(&normal, distance)?
            - far(&frame.normal.vector(), frame.distance_m)?;
        let own_normal =
            Direction::from_vector(o.sample.normal.vector() + normal - frame.normal.vector())?;
        let hit = Point::from_vector(camera + ray * seafloor_to_camera_m);
        Sample { hit, seafloor_to_camera_m, normal: own_normal, ..o.sample }.path(mount)
    }
}

/// Seeks what fits better; `None` where the log cannot tell. `instrument` is where the range
/// instrument sits in the body [m].
pub fn check_mounts(
    samples: &Samples<'_>,
    instrument: Vector3<f64>,
    config: &EstimateConfig,
) -> Option<MountFit> {
    let can_tell = samples.tracks.len() >= config.least_pairs
        && samples.altitude_varies(config)
        && samples.frames.len() >= LEAST_FRAMES;
    // Scattered light that is not modelled looks like any tilt.
    if !can_tell || samples.unmodelled_glow.is_some() {
        return None;
    }
    let observations: usize = samples.tracks.iter().map(Vec::len).sum();
    let some: Vec<Track> = samples
        .tracks
        .iter()
        .step_by(observations.div_ceil(MOST_OBSERVATIONS).max(1))
        .cloned()
        .collect();
    let setting = Setting {
        rounds: 5,
        ..samples.setting(BeamGrid::new(config.beam_nodes, config.beam_limit_deg), config)
    };
    let mount = samples.lamps;
    let at = |by: Vector3<f64>| Shift { samples, by, instrument };
    let asked_at = |by: Vector3<f64>| {
        let shift = at(by);
        let paths = |o: &Observation, m| shift.path(o, m);
        let mut problem = Problem::new(&some, &setting, mount, &paths)?;
        let solution = problem.solve(setting.rounds)?;
        let moved = |k: usize| {
            move |o: &Observation, step: f64| {
                let mut by = by;
                by[k] += step;
                at(by).path(o, mount)
            }
        };
        let mut places: Vec<Place<'_>> = (0..3)
            .map(|k| Place { step: [0.02, 0.005, 0.005][k], path: Box::new(moved(k)) })
            .collect();
        if samples.strobe_is_free {
            places.extend(strobe_places(mount, &paths));
        }
        Some((solution.residual, problem.place_step(&some, &places, &solution)?))
    };
    let Lowest { place, std, residual } = descend(Vector3::zeros(), SETTLED, &asked_at)?;
    std.iter().all(|s| s.is_finite()).then(|| MountFit {
        clock_offset_s: place.x,
        clock_offset_std_s: std.x,
        turn_rad: at(place).turn(),
        turn_about_axes_rad: [place.y, place.z],
        turn_std_rad: [std.y, std.z],
        residual,
        turn_is_attitudes: samples.frames.iter().filter(|f| f.is_level_assumed).count() * 2
            > samples.frames.len(),
        at_least: samples.strobe_is_free,
    })
}
