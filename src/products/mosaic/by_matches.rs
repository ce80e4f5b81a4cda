//! Poses from keypoint matches between frames, for logs without odometry and velocities.
//!
//! Ranges give the position of every keypoint on the seafloor in metres, so that two frames differ
//! by a rotation about the vertical and a translation: least squares over the matches, without
//! outliers. Neighbours are chained; errors accumulate along the chain.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Isometry3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::error::Result;
use crate::estimate::FrameSamples;
use crate::products::dive::ImageSource;
use crate::products::match_frames;
use crate::recording::FrameId;
use crate::run::bench::Bench;
use crate::stats::median;

/// Number of preceding frames that a frame is matched with, nearest first.
const MAX_STEPS_BACK: usize = 3;
/// Residuals above this multiple of the median are outliers.
const OUTLIER_RATIO: f64 = 3.0;

/// A frame and its keypoints on the level seafloor.
struct Frame {
    samples: FrameSamples,
    record: usize,
    /// rotation from body space to axes with z up and the camera's right along x
    level_from_body: UnitQuaternion<f64>,
    /// (m)
    points: Vec<[f64; 2]>,
}

/// A point in one frame's coordinates and in another's (m).
pub type Pair = ([f64; 2], [f64; 2]);

/// Segment of a frame and world_from_body, comparable within a segment; `None` without matches.
pub type SegmentPose = Option<(u32, Isometry3<f64>)>;

/// A rotation and a translation in the plane.
#[derive(Clone, Copy, Debug)]
pub struct Rigid {
    cos: f64,
    sin: f64,
    /// (m)
    translation: [f64; 2],
}

impl Rigid {
    const IDENTITY: Self = Self { cos: 1.0, sin: 0.0, translation: [0.0; 2] };

    fn apply(&self, p: [f64; 2]) -> [f64; 2] {
        [
            self.cos * p[0] - self.sin * p[1] + self.translation[0],
            self.sin * p[0] + self.cos * p[1] + self.translation[1],
        ]
    }

    fn after(&self, first: &Self) -> Self {
        let translation = self.apply(first.translation);
        Self {
            cos: self.cos * first.cos - self.sin * first.sin,
            sin: self.sin * first.cos + self.cos * first.sin,
            translation,
        }
    }

    /// Rotation angle (rad).
    pub fn angle_rad(&self) -> f64 {
        self.sin.atan2(self.cos)
    }

    /// Least squares with three rounds of outlier rejection; `None` for too few points.
    pub fn fitted(pairs: &[Pair]) -> Option<Self> {
        let mut kept: Vec<_> = pairs.to_vec();
        let mut fit = Self::least_squares(&kept)?;
        for _ in 0..3 {
            let residual = |(p, q): &Pair| {
                let r = fit.apply(*p);
                (r[0] - q[0]).hypot(r[1] - q[1])
            };
            let all: Vec<f64> = pairs.iter().map(residual).collect();
            let limit = OUTLIER_RATIO * median(&all).max(1e-4);
            kept = pairs.iter().filter(|pair| residual(pair) <= limit).copied().collect();
            fit = Self::least_squares(&kept)?;
        }
        Some(fit)
    }

    fn least_squares(pairs: &[Pair]) -> Option<Self> {
        if pairs.len() < 3 {
            return None;
        }
        let n = pairs.len() as f64;
        let mean = |of: fn(&Pair) -> [f64; 2]| {
            let sum = pairs.iter().map(of).fold([0.0; 2], |s, p| [s[0] + p[0], s[1] + p[1]]);
            [sum[0] / n, sum[1] / n]
        };
        let (p0, q0) = (mean(|p| p.0), mean(|p| p.1));
        let (dot, cross) = pairs.iter().fold((0.0, 0.0), |(d, c), (p, q)| {
            let (a, b) = ([p[0] - p0[0], p[1] - p0[1]], [q[0] - q0[0], q[1] - q0[1]]);
            (d + a[0] * b[0] + a[1] * b[1], c + a[0] * b[1] - a[1] * b[0])
        });
        let norm = dot.hypot(cross);
        if norm <= 1e-12 {
            return None;
        }
        let rotation = Self { cos: dot / norm, sin: cross / norm, translation: [0.0; 2] };
        let rotated = rotation.apply(p0);
        Some(Self { translation: [q0[0] - rotated[0], q0[1] - rotated[1]], ..rotation })
    }
}

/// world_from_body of the frames of these records, by segment; a frame without matches starts a new
/// segment.
///
/// # Errors
/// The file cannot be read.
pub fn poses(source: &ImageSource, records: &[usize]) -> Result<Vec<SegmentPose>> {
    let ImageSource { bench, records: known } = source;
    let wanted: BTreeSet<usize> = records.iter().copied().collect();
    let chosen: BTreeSet<FrameId> =
        known.iter().filter(|(_, record)| wanted.contains(record)).map(|(id, _)| *id).collect();
    let mut found: Vec<Frame> = Vec::new();
    bench.each(
        &chosen,
        |frame| {
            let record = known.get(&frame.frame.at.id).copied()?;
            Some(level(bench, bench.samples(frame, true), record))
        },
        |frame| found.extend(frame),
    )?;
    let relative_pose = |earlier: usize, later: usize| {
        let (a, b) = (&found[earlier], &found[later]);
        let seed = (earlier as u64) << 32 | later as u64;
        let pairs = match_frames(bench, &b.samples, &a.samples, seed);
        let points: Vec<_> = pairs
            .iter()
            .filter_map(|(i, j)| Some((*b.points.get(*i as usize)?, *a.points.get(*j as usize)?)))
            .collect();
        Rigid::fitted(&points)
    };
    let mut chained: Vec<(u32, Rigid)> = Vec::new();
    let mut segment = 0;
    for later in 0..found.len() {
        let matched = (later.saturating_sub(MAX_STEPS_BACK)..later)
            .rev()
            .find_map(|earlier| Some((earlier, relative_pose(earlier, later)?)));
        chained.push(match matched {
            Some((earlier, step)) => (chained[earlier].0, chained[earlier].1.after(&step)),
            None => {
                segment += 1;
                (segment, Rigid::IDENTITY)
            }
        });
    }
    let pose = |(frame, (segment, rigid)): (&Frame, &(u32, Rigid))| {
        let yaw = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), rigid.angle_rad());
        let translation = Translation3::new(rigid.translation[0], rigid.translation[1], 0.0);
        (*segment, Isometry3::from_parts(translation, yaw * frame.level_from_body))
    };
    let by_record: BTreeMap<usize, (u32, Isometry3<f64>)> =
        found.iter().zip(&chained).map(|both| (both.0.record, pose(both))).collect();
    Ok(records.iter().map(|record| by_record.get(record).copied()).collect())
}

fn level(bench: &Bench, samples: FrameSamples, record: usize) -> Frame {
    let down = samples.normal.vector();
    let right = bench.session.survey.rig.body_from_optical.isometry().rotation * Vector3::x();
    // Rows of the rotation: right projected to the horizontal, the third axis, and up.
    let x = (right - down * right.dot(&down)).normalize();
    let up = -down;
    let rows =
        nalgebra::Matrix3::from_rows(&[x.transpose(), up.cross(&x).transpose(), up.transpose()]);
    let level_from_body =
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rows));
    let points = samples
        .samples
        .iter()
        .map(|s| level_from_body * s.sample.hit.vector())
        .map(|p| [p.x, p.y])
        .collect();
    Frame { samples, record, level_from_body, points }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotation_and_translation_are_found_despite_outliers() {
        let truth = Rigid { cos: 0.4f64.cos(), sin: 0.4f64.sin(), translation: [0.7, -1.3] };
        let point =
            |i: usize| [(i * 37 % 101) as f64 / 50.0 - 1.0, (i * 53 % 97) as f64 / 48.0 - 1.0];
        let pair = |i: usize| {
            if i.is_multiple_of(5) {
                (point(i), point(i + 3))
            } else {
                (point(i), truth.apply(point(i)))
            }
        };
        let found = Rigid::fitted(&(0..100).map(pair).collect::<Vec<_>>()).expect("many points");
        assert!(
            (found.cos - truth.cos).abs() < 1e-9 && (found.translation[1] + 1.3).abs() < 1e-9,
            "{found:?}"
        );
        // Composition equals successive application.
        let both = truth.after(&found).apply([0.3, 0.2]);
        let twice = truth.apply(truth.apply([0.3, 0.2]));
        assert!((both[0] - twice[0]).hypot(both[1] - twice[1]) < 1e-9);
        assert!(
            Rigid::fitted(&[([0.0; 2], [1.0; 2]); 5]).is_none(),
            "one point does not determine a rotation"
        );
    }
}
