//! Bundle adjustment over a plane: tilts of frames by where overlapping frames see the same points
//! of the seafloor. The light takes no part in it.
//!
//! Cut with its plane, the rays of a frame are a map of the seafloor around it. Maps of overlapping
//! frames agree, up to a turn and a shift, only where planes and altitudes are right: a tilted
//! plane stretches the map to one side, and a point that moves through the image moves through
//! that stretch.
//!
//! ```text
//! P_fk = X_f + R(ψ_f) p(r_fk, t_f, s_f)           Σ |P_fk − P̄_k|² / (σ ρ_fk)² + priors → min
//! ```
//!
//! with the place p where ray r meets the plane of tilts t and log scale s, at range ρ, shift X and
//! turn ψ of frame f, and the mean P̄_k of a point over its frames. Gauss-Newton steps; the points
//! are eliminated in closed form.

use std::ops::Range;

use nalgebra::{DMatrix, DVector, Matrix2x6, Rotation2, Vector2, Vector3};

use super::{Dataset, Mounts};
use crate::geometry::PlaneChange;
use crate::parallel::par_map;
use crate::solver::terms::geometry::{PlaneTrack, ShiftedPlanes};
use crate::solver::{Observation, Track, thinned};
use crate::stats;

/// Consecutive frames that are adjusted together.
const BLOCK: usize = 60;
/// Observations of a block.
const MAX_OBSERVATIONS: usize = 12_000;
/// Unknowns of a frame: tilts about the camera's x and y axes, log scale, turn, shift.
const OF_FRAME: usize = 6;
/// Points that place a frame beside others.
const LEAST_SHARED: usize = 6;
/// Standard deviation of a frame's altitude (log).
const SCALE_STD: f64 = 0.01;
/// Standard deviations of what is not known beforehand: turn and shift (rad, m).
const FREE: f64 = 100.0;
/// Error of a keypoint (image plane), at least.
const LEAST_ERROR: f64 = 1e-5;
/// Errors beyond so many standard deviations count less.
const ROBUST: f64 = 2.0;
/// Gauss-Newton steps, and the mean change of a tilt after which they end (rad).
const STEPS: usize = 12;
const SETTLED_RAD: f64 = 1e-5;
/// Step of the numeric derivatives by tilts (rad).
const STEP_RAD: f64 = 1e-4;
/// Steps that align one frame with others.
const ALIGNMENTS: usize = 5;
/// Tilts with smaller standard deviations than this are determined (rad).
const DETERMINED_RAD: f64 = 0.01;

/// What the planes of all frames are off by, `prior` being the standard deviations of the tilt that
/// all share, and of each frame's own (rad). `None` where the overlaps do not determine the tilts.
pub fn planes(data: &Dataset<'_>, mounts: &Mounts, prior: [f64; 2]) -> Option<Vec<PlaneChange>> {
    let count = data.frames.len().div_ceil(BLOCK).max(1);
    let bounds: Vec<usize> = (0..=count).map(|k| k * data.frames.len() / count).collect();
    let planes = data.plane_tracks();
    let adjusted =
        |frames: Range<usize>| Block::new(data, &planes, frames, (mounts, prior)).adjusted();
    let blocks = par_map(bounds.windows(2).map(|pair| pair[0]..pair[1]).collect(), adjusted);
    let blocks: Option<Vec<_>> = blocks.into_iter().collect();
    Some(blocks?.concat())
}

/// One frame's unknowns.
#[derive(Clone, Copy, Debug, Default)]
struct Pose {
    plane: PlaneChange,
    turn: f64,
    shift: Vector2<f64>,
}

/// Consecutive frames.
struct Block<'b> {
    mounts: &'b Mounts,
    planes: &'b [PlaneTrack],
    /// frames are numbered within the block
    tracks: Vec<Track>,
    /// standard deviations of the tilt that all frames share, and of each frame's own (rad)
    prior: [f64; 2],
}

impl<'b> Block<'b> {
    fn new(
        data: &Dataset<'_>,
        planes: &'b [PlaneTrack],
        frames: Range<usize>,
        (mounts, prior): (&'b Mounts, [f64; 2]),
    ) -> Self {
        let of_track = |track: &Track| {
            let of_block = track.iter().filter(|o| frames.contains(&(o.frame as usize)));
            let numbered =
                |o: &Observation| Observation { frame: o.frame - frames.start as u32, ..*o };
            let kept: Track = of_block.map(numbered).collect();
            (kept.len() > 1).then_some(kept)
        };
        let tracks: Vec<Track> = data.tracks.iter().filter_map(of_track).collect();
        let tracks = thinned(&tracks, MAX_OBSERVATIONS);
        Self { mounts, planes: &planes[frames], tracks, prior }
    }

    /// Where a frame sees a point, in the plane around its camera, and the range (m).
    fn seen(&self, o: &Observation, plane: PlaneChange) -> Option<(Vector2<f64>, f64)> {
        let Mounts { body_from_optical, instrument, .. } = *self.mounts;
        let PlaneChange { tilt: [about_x, about_y], log_scale } = plane;
        let by = Vector3::new(0.0, about_x, about_y);
        let planes = self.planes;
        let planes = ShiftedPlanes { planes, body_from_optical, instrument, by, log_scale };
        let sample = planes.sample(o.frame, &o.sample)?;
        let (normal, _) = planes.plane(&self.planes[o.frame as usize]);
        let along_x = body_from_optical.isometry().rotation * Vector3::x();
        let across = (along_x - normal * normal.dot(&along_x)).normalize();
        let from_camera = sample.hit.vector() - body_from_optical.origin().vector();
        let place = Vector2::new(from_camera.dot(&across), from_camera.dot(&normal.cross(&across)));
        Some((place, sample.seafloor_to_camera_m))
    }

    /// The point in the common plane, and the range (m).
    fn placed(&self, o: &Observation, pose: &Pose) -> Option<(Vector2<f64>, f64)> {
        let (place, range_m) = self.seen(o, pose.plane)?;
        Some((pose.shift + Rotation2::new(pose.turn) * place, range_m))
    }

    /// Derivatives of the point by the unknowns of its frame.
    fn derivatives(&self, o: &Observation, pose: &Pose) -> Option<Matrix2x6<f64>> {
        let mut by = Matrix2x6::zeros();
        for axis in 0..2 {
            let at = |step: f64| {
                let mut pose = *pose;
                pose.plane.tilt[axis] += step;
                Some(self.placed(o, &pose)?.0)
            };
            by.set_column(axis, &((at(STEP_RAD)? - at(-STEP_RAD)?) / (2.0 * STEP_RAD)));
        }
        let from_camera = self.placed(o, pose)?.0 - pose.shift;
        by.set_column(2, &from_camera);
        by.set_column(3, &Vector2::new(-from_camera.y, from_camera.x));
        by.set_column(4, &Vector2::x());
        by.set_column(5, &Vector2::y());
        Some(by)
    }

    /// Turns and shifts over the planes as given, each by the points that a frame shares with those
    /// before it.
    fn first_poses(&self) -> Vec<Pose> {
        let mut of_frames: Vec<Vec<(usize, &Observation)>> = vec![Vec::new(); self.planes.len()];
        for (k, track) in self.tracks.iter().enumerate() {
            track.iter().for_each(|o| of_frames[o.frame as usize].push((k, o)));
        }
        let mut points: Vec<Option<Vector2<f64>>> = vec![None; self.tracks.len()];
        let of_frame = |seen: &Vec<(usize, &Observation)>| {
            let known = |(k, o): &(usize, &Observation)| {
                Some((self.seen(o, PlaneChange::default())?.0, points[*k]?))
            };
            let shared: Vec<_> = seen.iter().filter_map(known).collect();
            let pose = aligned(&shared).unwrap_or_default();
            for (k, o) in seen {
                points[*k] = points[*k].or_else(|| Some(self.placed(o, &pose)?.0));
            }
            pose
        };
        of_frames.iter().map(of_frame).collect()
    }

    /// How far the observations of a track are from their mean, and their ranges (m).
    fn misfits(&self, track: &Track, poses: &[Pose]) -> Option<Vec<(Vector2<f64>, f64)>> {
        let placed = |o: &Observation| self.placed(o, &poses[o.frame as usize]);
        let placed: Vec<_> = track.iter().map(placed).collect::<Option<_>>()?;
        let total: f64 = placed.iter().map(|(_, range_m)| range_m.powi(-2)).sum();
        let sum: Vector2<f64> = placed.iter().map(|(p, range_m)| p * range_m.powi(-2)).sum();
        Some(placed.iter().map(|(p, range_m)| (p - sum / total, *range_m)).collect())
    }

    /// Robust standard deviation of the observations (image plane).
    fn error(&self, poses: &[Pose]) -> f64 {
        let of_track = |track: &Track| {
            // The mean takes its part.
            let share = (1.0 - 1.0 / track.len() as f64).sqrt();
            let misfits = self.misfits(track, poses).unwrap_or_default();
            misfits
                .into_iter()
                .flat_map(move |(m, range_m)| [m.x, m.y].map(|v| v / range_m / share))
        };
        let all: Vec<f64> = self.tracks.iter().flat_map(of_track).collect();
        stats::robust_std(&all).max(LEAST_ERROR)
    }

    /// Normal equations of the frames' unknowns and, last, the tilt that they share.
    fn equations(&self, poses: &[Pose], shared: [f64; 2]) -> (DMatrix<f64>, DVector<f64>) {
        let error = self.error(poses);
        let size = OF_FRAME * poses.len() + 2;
        let (mut normal, mut right) = (DMatrix::zeros(size, size), DVector::zeros(size));
        for track in &self.tracks {
            let by = |o: &Observation| self.derivatives(o, &poses[o.frame as usize]);
            let by: Option<Vec<_>> = track.iter().map(by).collect();
            let (Some(by), Some(misfits)) = (by, self.misfits(track, poses)) else { continue };
            let largest = misfits.iter().map(|(m, range_m)| m.norm() / range_m).fold(0.0, f64::max);
            let robust = stats::cauchy_weight(largest, ROBUST * error);
            let weight = |(_, range_m): &(Vector2<f64>, f64)| robust / (error * range_m).powi(2);
            let weights: Vec<f64> = misfits.iter().map(weight).collect();
            let total: f64 = weights.iter().sum();
            for (i, o) in track.iter().enumerate() {
                let at = OF_FRAME * o.frame as usize;
                let mut gradient = right.rows_mut(at, OF_FRAME);
                gradient -= by[i].transpose() * misfits[i].0 * weights[i];
                for (j, other) in track.iter().enumerate() {
                    let own = if i == j { weights[i] } else { 0.0 };
                    let to = OF_FRAME * other.frame as usize;
                    let mut block = normal.view_mut((at, to), (OF_FRAME, OF_FRAME));
                    block += by[i].transpose() * by[j] * (own - weights[i] * weights[j] / total);
                }
            }
        }
        self.add_priors((poses, shared), &mut normal, &mut right);
        (normal, right)
    }

    fn add_priors(
        &self,
        (poses, shared): (&[Pose], [f64; 2]),
        normal: &mut DMatrix<f64>,
        right: &mut DVector<f64>,
    ) {
        let [of_shared, of_own] = self.prior.map(|std| std.powi(-2));
        let of_scale = SCALE_STD.powi(-2);
        for axis in 0..2 {
            let common = OF_FRAME * poses.len() + axis;
            for (f, pose) in poses.iter().enumerate() {
                let own = OF_FRAME * f + axis;
                let off = pose.plane.tilt[axis] - shared[axis];
                normal[(own, own)] += of_own;
                normal[(common, common)] += of_own;
                normal[(own, common)] -= of_own;
                normal[(common, own)] -= of_own;
                right[own] -= of_own * off;
                right[common] += of_own * off;
            }
            normal[(common, common)] += of_shared;
            right[common] -= of_shared * shared[axis];
        }
        for (f, pose) in poses.iter().enumerate() {
            let at = OF_FRAME * f;
            normal[(at + 2, at + 2)] += of_scale;
            right[at + 2] -= of_scale * pose.plane.log_scale;
            (3..OF_FRAME).for_each(|k| normal[(at + k, at + k)] += FREE.powi(-2));
        }
    }

    /// What the planes are off by; `None` where tilts are not determined.
    fn adjusted(&self) -> Option<Vec<PlaneChange>> {
        let (mut poses, mut shared) = (self.first_poses(), [0.0; 2]);
        let common = OF_FRAME * poses.len();
        for _ in 0..STEPS {
            let (normal, right) = self.equations(&poses, shared);
            let steps = normal.cholesky()?.solve(&right);
            for (pose, step) in poses.iter_mut().zip(steps.as_slice().chunks_exact(OF_FRAME)) {
                (0..2).for_each(|axis| pose.plane.tilt[axis] += step[axis]);
                pose.plane.log_scale += step[2];
                pose.turn += step[3];
                pose.shift += Vector2::new(step[4], step[5]);
            }
            (0..2).for_each(|axis| shared[axis] += steps[common + axis]);
            // Overlaps do not determine the size of the whole; noise is less where all is small.
            let mean = poses.iter().map(|p| p.plane.log_scale).sum::<f64>() / poses.len() as f64;
            for pose in &mut poses {
                pose.plane.log_scale -= mean;
                pose.shift *= (-mean).exp();
            }
            let tilts = (0..common).filter(|k| k % OF_FRAME < 2).map(|k| steps[k].abs());
            if tilts.sum::<f64>() < SETTLED_RAD * poses.len() as f64 {
                break;
            }
        }
        let covariance = self.equations(&poses, shared).0.cholesky()?.inverse();
        let stds = (0..common).filter(|k| k % OF_FRAME < 2).map(|k| covariance[(k, k)].sqrt());
        let is_determined = stats::median(&stds.collect::<Vec<_>>()) < DETERMINED_RAD;
        is_determined.then(|| poses.iter().map(|pose| pose.plane).collect())
    }
}

/// Turn and shift that bring points to others, strays held in check.
fn aligned(points: &[(Vector2<f64>, Vector2<f64>)]) -> Option<Pose> {
    if points.len() < LEAST_SHARED {
        return None;
    }
    let (mut weights, mut pose) = (vec![1.0; points.len()], Pose::default());
    for _ in 0..ALIGNMENTS {
        let weighted = || points.iter().zip(&weights);
        let total: f64 = weights.iter().sum();
        let from = weighted().map(|((p, _), w)| p * *w).sum::<Vector2<f64>>() / total;
        let to = weighted().map(|((_, q), w)| q * *w).sum::<Vector2<f64>>() / total;
        let cos: f64 = weighted().map(|((p, q), w)| w * (p - from).dot(&(q - to))).sum();
        let sin: f64 = weighted().map(|((p, q), w)| w * (p - from).perp(&(q - to))).sum();
        let turn = sin.atan2(cos);
        let shift = to - Rotation2::new(turn) * from;
        pose = Pose { turn, shift, ..pose };
        let misfit =
            |(p, q): &(Vector2<f64>, Vector2<f64>)| (shift + Rotation2::new(turn) * p - q).norm();
        let misfits: Vec<f64> = points.iter().map(misfit).collect();
        let scale = stats::median(&misfits).max(1e-6);
        weights = misfits.iter().map(|m| stats::cauchy_weight(*m, scale)).collect();
    }
    Some(pose)
}

#[cfg(test)]
mod tests;
