//! Tilts of frames whose seafloor is assumed level, where the vehicle has no attitude sensor, or
//! the seafloor a slope.
//!
//! A tilted plane makes one side of the image farther than it is taken to be, and, as the range
//! instrument sits beside the camera, the whole of it. Points that overlapping frames share show
//! it: two numbers per frame, found by Gauss-Newton steps of the joint solve. In: samples over
//! level planes. Out: the tilts, and the samples over the tilted planes.

use nalgebra::Vector3;

use super::Dataset;
use super::Mounts;
use super::camera_fit::CameraFit;
use super::other_light::{other_light, without_backscatter};
use super::plane_adjustment;
use super::quality::identifiability::MIN_FRAMES;
use super::samples::FrameSamples;
use super::self_calibration::{calibrate, with_law};
use super::strobe_search::place_strobe;
use crate::config::{EstimateConfig, SelfCalibration};
use crate::coordinates::{Body, Direction};
use crate::geometry::PlaneChange;
use crate::model::BeamGrid;
use crate::parallel::join;
use crate::solver::camera::CameraUnknowns;
use crate::solver::terms::geometry::{PlaneTrack, ShiftedPlanes};
use crate::solver::{FreeTilts, Observation, Problem, Sample, Setup, Track, thinned};

/// Observations that determine the tilts.
const MAX_OBSERVATIONS: usize = 24_000;
/// More frames than this make too large a solve.
const MAX_FRAMES: usize = 400;
/// Gauss-Newton steps, and the mean one after which the tilts are final (rad).
const STEPS: usize = 5;
const SETTLED_RAD: f64 = 2e-4;
/// Reweightings of each solve.
const ROUNDS: usize = 6;
/// Standard deviations of the tilt that all frames share, and of each frame's own: without and with
/// an attitude sensor (rad).
const WITHOUT_ATTITUDE: [f64; 2] = [0.02, 0.05];
const WITH_ATTITUDE: [f64; 2] = [0.03, 0.005];
/// Times that tilts and the strobe are found in turn; a strobe that moves less is final (m).
const TURNS: usize = 3;
const SETTLED_M: f64 = 0.03;
/// The cost decreases by at least this.
const LEAST_DECREASE: f64 = 0.02;

/// Standard deviations of the tilt that all planes share, and of each frame's own (rad); `None`
/// where planes are measured.
pub fn stds(frames: &[FrameSamples]) -> Option<[f64; 2]> {
    if frames.iter().any(|f| !f.is_level_assumed || f.is_tilt_measured) {
        return None;
    }
    let has_attitude = frames.iter().all(|f| f.has_attitude);
    Some(if has_attitude { WITH_ATTITUDE } else { WITHOUT_ATTITUDE })
}

/// Tilts that were found.
#[derive(Clone, Debug)]
pub struct TiltFit {
    /// per frame
    pub planes: Vec<PlaneChange>,
    /// whether places of points show them, not the light
    pub is_measured: bool,
}

/// The tilts of a log; `None` where its planes are measured, nothing contradicts level ones, or the
/// settings do not ask. Where the strobe's position is not known, it is found in turn with them.
pub fn find(data: &Dataset<'_>, mounts: &Mounts, config: &EstimateConfig) -> Option<TiltFit> {
    let can_tell = data.tracks.len() >= config.least_pairs
        && (MIN_FRAMES..=MAX_FRAMES).contains(&data.frames.len());
    let is_asked =
        config.self_calibration == SelfCalibration::Auto && config.estimator.may_be_joint();
    let stds = stds(data.frames).filter(|_| can_tell && is_asked)?;
    if let Some(planes) = plane_adjustment::planes(data, mounts, stds) {
        return Some(TiltFit { planes, is_measured: true });
    }
    let placed =
        |data: &Dataset<'_>| place_strobe(data, mounts.strobe_is_measured, None, config).lamps;
    let grid = BeamGrid::new(config.beam_nodes, config.beam_limit_deg);
    let (mut lamps, mut best) = (placed(data), None);
    for _ in 0..TURNS {
        let data = Dataset { lamps, ..*data };
        // Backscatter, too, changes the light with altitude and across the image.
        let (backscatter, _) = other_light(&data, &data.setup(grid, config), false);
        let (frames, tracks) = without_backscatter(&data, backscatter.as_ref());
        let direct = Dataset { frames: &frames, tracks: &tracks, ..data };
        let search = Search { data: &direct, mounts, stds, config };
        let Some((found, camera)) = search.best() else { break };
        let (mut frames, mut tracks) = found.applied_to(&frames, &tracks, mounts);
        best = Some(found);
        if mounts.strobe_is_measured {
            break;
        }
        // Over level planes the strobe was found elsewhere.
        camera.iter().for_each(|camera| camera.remove_from(&mut frames, &mut tracks));
        let (frames, tracks) = (&frames, &tracks);
        let camera = camera.as_ref();
        let next = placed(&Dataset { frames, tracks, camera, lamps: mounts.lamps, ..data });
        if next.distance_m(lamps) < SETTLED_M {
            break;
        }
        lamps = next;
    }
    best
}

/// A search for tilts.
struct Search<'s> {
    data: &'s Dataset<'s>,
    mounts: &'s Mounts,
    stds: [f64; 2],
    config: &'s EstimateConfig,
}

impl Search<'_> {
    /// The tilts, and what the log shows of its camera then. A camera that sets its own exposure
    /// hides what altitude does to the light: both are tried.
    fn best(&self) -> Option<(TiltFit, Option<CameraFit>)> {
        let Self { data, mounts, config, .. } = *self;
        let calibrated = |data: &Dataset<'_>| calibrate(data, mounts.camera, config);
        let of = |camera: Option<CameraUnknowns<'_>>| {
            let tilted = |tilt| PlaneChange { tilt, log_scale: 0.0 };
            let planes = self.run(camera)?.into_iter().map(tilted).collect();
            let fit = TiltFit { planes, is_measured: false };
            let (frames, tracks) = fit.applied_to(data.frames, data.tracks, mounts);
            let found = calibrated(&Dataset { frames: &frames, tracks: &tracks, ..*data })?;
            Some((fit, found))
        };
        let (steady, metered) =
            join(|| of(None), || with_law(data, |camera| of(Some(camera))).flatten());
        let level = calibrated(data)?.cost;
        let found = [steady, metered].into_iter().flatten();
        let best = found.min_by(|a, b| a.1.cost.total_cmp(&b.1.cost));
        let best = best.filter(|(_, found)| found.cost < level - LEAST_DECREASE);
        best.map(|(fit, found)| (fit, found.camera))
    }

    /// Tilts of all frames, with these unknowns of the camera.
    fn run(&self, camera: Option<CameraUnknowns<'_>>) -> Option<Vec<[f64; 2]>> {
        let Self { data, mounts, stds, config } = *self;
        let tracks = thinned(data.tracks, MAX_OBSERVATIONS);
        let grid = BeamGrid::new(config.beam_nodes, config.beam_limit_deg);
        let setup = Setup { rounds: ROUNDS, camera, ..data.setup(grid, config) };
        let planes = data.plane_tracks();
        // The shared tilt, then those of the frames.
        let mut state = vec![[0.0; 2]; 1 + data.frames.len()];
        for _ in 0..STEPS {
            let tilts: Vec<_> =
                sums(&state).into_iter().map(|tilt| PlaneChange { tilt, log_scale: 0.0 }).collect();
            let tilted = Tilted::new(&planes, mounts, &tilts);
            let paths = |o: &Observation, lamps| tilted.of(o.frame).path(o, lamps);
            let mut problem = Problem::new(&tracks, &setup, data.lamps, &paths)?;
            let solution = problem.solve(setup.rounds)?;
            let path = |o: &Observation, tilt: [f64; 2], lamps| {
                let mut planes = tilted.of(o.frame);
                planes.by += Vector3::new(0.0, tilt[0], tilt[1]);
                planes.path(o, lamps)
            };
            let free = FreeTilts { path: &path, stds };
            let parameters = free.parameters(data.lamps);
            let steps = problem.tilt_steps(&tracks, &parameters, &solution, (&state, stds))?;
            for (tilt, step) in state.iter_mut().zip(&steps) {
                (0..2).for_each(|axis| tilt[axis] += step[axis]);
            }
            let size = steps.iter().flatten().map(|s| s.abs()).sum::<f64>() / steps.len() as f64;
            if size < SETTLED_RAD {
                break;
            }
        }
        Some(sums(&state))
    }
}

/// The tilt of every frame: the shared one and its own.
fn sums(state: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let (shared, own) = (state[0], &state[1..]);
    own.iter().map(|own| [shared[0] + own[0], shared[1] + own[1]]).collect()
}

/// Planes of the frames, each with its own tilt.
#[derive(Clone, Copy)]
struct Tilted<'t> {
    planes: ShiftedPlanes<'t>,
    changes: &'t [PlaneChange],
}

impl<'t> Tilted<'t> {
    fn new(planes: &'t [PlaneTrack], mounts: &Mounts, changes: &'t [PlaneChange]) -> Self {
        let Mounts { body_from_optical, instrument, .. } = *mounts;
        let by = Vector3::zeros();
        let planes = ShiftedPlanes { planes, body_from_optical, instrument, by, log_scale: 0.0 };
        Self { planes, changes }
    }

    /// With the change of a frame.
    fn of(&self, frame: u32) -> ShiftedPlanes<'t> {
        let change = self.changes.get(frame as usize).copied().unwrap_or_default();
        let [about_x, about_y] = change.tilt;
        let by = Vector3::new(0.0, about_x, about_y);
        ShiftedPlanes { by, log_scale: change.log_scale, ..self.planes }
    }
}

impl TiltFit {
    /// Samples over the tilted planes.
    pub fn applied_to(
        &self,
        frames: &[FrameSamples],
        tracks: &[Track],
        mounts: &Mounts,
    ) -> (Vec<FrameSamples>, Vec<Track>) {
        let planes =
            Dataset::plain(frames, tracks, mounts.body_from_optical, mounts.lamps).plane_tracks();
        let tilted = Tilted::new(&planes, mounts, &self.planes);
        let of_frame = |(f, frame): (usize, &FrameSamples)| {
            let planes = tilted.of(f as u32);
            let over = |cells: &[(u32, Sample)]| {
                let cell = |(cell, s): &(u32, _)| Some((*cell, planes.sample(f as u32, s)?));
                cells.iter().filter_map(cell).collect::<Vec<_>>()
            };
            let (normal, distance_m) = planes.plane(&planes.planes[f]);
            let camera = mounts.body_from_optical.origin().vector();
            let around = |plane: (Direction<Body>, f64)| {
                let (normal, distance_m) = planes.plane(&PlaneTrack { plane, around: None });
                (Direction::from_vector(normal).unwrap_or(plane.0), distance_m)
            };
            FrameSamples {
                planes_around: frame.planes_around.map(|planes| planes.map(around)),
                dark: over(&frame.dark),
                normal: Direction::from_vector(normal).unwrap_or(frame.normal),
                distance_m,
                camera_altitude_m: distance_m - normal.dot(&camera),
                is_tilt_measured: self.is_measured,
                ..frame.with_grid(over(&frame.grid))
            }
        };
        let of_track = |track: &Track| {
            let of = |o: &Observation| {
                Some(Observation { sample: tilted.of(o.frame).sample(o.frame, &o.sample)?, ..*o })
            };
            track.iter().filter_map(of).collect::<Track>()
        };
        let tracks = tracks.iter().map(of_track).filter(|t| t.len() > 1).collect();
        (frames.iter().enumerate().map(of_frame).collect(), tracks)
    }
}
