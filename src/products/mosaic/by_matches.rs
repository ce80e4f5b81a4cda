//! Where frames lie beside each other by the points they share, for logs that tell no way over the
//! ground.
//!
//! Ranges give every point its place on the floor in metres, so two frames differ by a turn about
//! the vertical and a shift: least squares over the shared points, far ones left out. Neighbours
//! are chained; errors add up along the chain.

use std::collections::BTreeSet;

use nalgebra::{Isometry3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::error::Result;
use crate::estimate::{FrameSamples, Matchable, matches};
use crate::run::bench::Bench;

/// How many frames back a frame is joined to, where the one before shows nothing it shows.
const BACK: usize = 3;
/// Points farther off than so many medians are left out of the fit.
const FAR: f64 = 3.0;

/// A frame and its points on the level floor.
struct Frame {
    samples: FrameSamples,
    log_time: u64,
    /// the body, its floor level and below, the camera's right along x
    level_from_body: UnitQuaternion<f64>,
    points: Vec<[f64; 2]>,
}

/// A place, and the same place in another frame's metres.
pub type Pair = ([f64; 2], [f64; 2]);

/// Which stretch a frame belongs to, and world_from_body; `None` where nothing is known of it.
pub type Stretched = Option<(u32, Isometry3<f64>)>;

/// A turn and a shift in the plane.
#[derive(Clone, Copy, Debug)]
pub struct Rigid {
    cos: f64,
    sin: f64,
    shift: [f64; 2],
}

impl Rigid {
    const NONE: Self = Self { cos: 1.0, sin: 0.0, shift: [0.0; 2] };

    fn of(&self, p: [f64; 2]) -> [f64; 2] {
        [
            self.cos * p[0] - self.sin * p[1] + self.shift[0],
            self.sin * p[0] + self.cos * p[1] + self.shift[1],
        ]
    }

    fn after(&self, first: &Self) -> Self {
        let shift = self.of(first.shift);
        Self {
            cos: self.cos * first.cos - self.sin * first.sin,
            sin: self.sin * first.cos + self.cos * first.sin,
            shift,
        }
    }

    /// The turn [rad].
    pub fn turn_rad(&self) -> f64 {
        self.sin.atan2(self.cos)
    }

    /// Least squares, thrice over without what lies far off; `None` where too few points are left.
    pub fn fitted(pairs: &[Pair]) -> Option<Self> {
        let mut kept: Vec<_> = pairs.to_vec();
        let mut found = Self::least_squares(&kept)?;
        for _ in 0..3 {
            let off = |(p, q): &Pair| {
                let r = found.of(*p);
                (r[0] - q[0]).hypot(r[1] - q[1])
            };
            let mut all: Vec<f64> = pairs.iter().map(off).collect();
            all.sort_by(f64::total_cmp);
            let limit = FAR * all[all.len() / 2].max(1e-4);
            kept = pairs.iter().filter(|pair| off(pair) <= limit).copied().collect();
            found = Self::least_squares(&kept)?;
        }
        Some(found)
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
        let turn = Self { cos: dot / norm, sin: cross / norm, shift: [0.0; 2] };
        let turned = turn.of(p0);
        Some(Self { shift: [q0[0] - turned[0], q0[1] - turned[1]], ..turn })
    }
}

/// world_from_body of frames at these log times, by stretch; a frame that shows nothing known
/// begins a new one.
///
/// # Errors
/// The file cannot be read.
pub fn poses(bench: &Bench, times: &[u64]) -> Result<Vec<Stretched>> {
    let wanted: BTreeSet<u64> = times.iter().copied().collect();
    let frames = &bench.log.survey.frames;
    let is_wanted = |logged: i64| u64::try_from(logged).is_ok_and(|t| wanted.contains(&t));
    let chosen: BTreeSet<usize> =
        frames.iter().enumerate().filter(|(_, f)| is_wanted(f.logged.0)).map(|(i, _)| i).collect();
    let mut found: Vec<Frame> = Vec::new();
    bench.each(
        &chosen,
        |frame| levelled(bench, bench.samples(&frame, true), frame.log_time),
        |frame| found.push(frame),
    )?;
    let matching = &bench.config.matching;
    let camera = &bench.log.survey.rig.camera;
    let reduction =
        camera.width.max(camera.height).div_ceil(matching.detection_side_px).max(1) as f64;
    let inlier = matching.inlier_px * reduction / camera.fx;
    let joined = |earlier: usize, later: usize| {
        let (a, b) = (&found[earlier], &found[later]);
        let seed = (earlier as u64) << 32 | later as u64;
        let pairs = matches(&matchable(b), &matchable(a), matching, inlier, seed);
        let points: Vec<_> = pairs
            .iter()
            .filter_map(|(i, j)| Some((*b.points.get(*i as usize)?, *a.points.get(*j as usize)?)))
            .collect();
        Rigid::fitted(&points)
    };
    let mut placed: Vec<(u32, Rigid)> = Vec::new();
    let mut stretch = 0;
    for later in 0..found.len() {
        let known = (later.saturating_sub(BACK)..later)
            .rev()
            .find_map(|earlier| Some((earlier, joined(earlier, later)?)));
        placed.push(match known {
            Some((earlier, turn)) => (placed[earlier].0, placed[earlier].1.after(&turn)),
            None => {
                stretch += 1;
                (stretch, Rigid::NONE)
            }
        });
    }
    let pose = |(frame, (stretch, rigid)): (&Frame, &(u32, Rigid))| {
        let yaw = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), rigid.turn_rad());
        let shift = Translation3::new(rigid.shift[0], rigid.shift[1], 0.0);
        (*stretch, Isometry3::from_parts(shift, yaw * frame.level_from_body))
    };
    let by_time: Vec<(u64, (u32, Isometry3<f64>))> =
        found.iter().zip(&placed).map(|both| (both.0.log_time, pose(both))).collect();
    Ok(times
        .iter()
        .map(|time| by_time.iter().find(|(t, _)| t == time).map(|(_, pose)| *pose))
        .collect())
}

fn matchable(frame: &Frame) -> Matchable<'_> {
    Matchable { keypoints: &frame.samples.keypoints, places: &frame.samples.places }
}

fn levelled(bench: &Bench, samples: FrameSamples, log_time: u64) -> Frame {
    let down = samples.normal.vector();
    let right = bench.log.survey.rig.body_from_optical.isometry().rotation * Vector3::x();
    // Rows of the turn: right made level, the third of a right-handed set, and up.
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
    Frame { samples, log_time, level_from_body, points }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turn_and_a_shift_are_found_among_strays() {
        let truth = Rigid { cos: 0.4f64.cos(), sin: 0.4f64.sin(), shift: [0.7, -1.3] };
        let point =
            |i: usize| [(i * 37 % 101) as f64 / 50.0 - 1.0, (i * 53 % 97) as f64 / 48.0 - 1.0];
        let pair = |i: usize| {
            if i.is_multiple_of(5) {
                (point(i), point(i + 3))
            } else {
                (point(i), truth.of(point(i)))
            }
        };
        let found = Rigid::fitted(&(0..100).map(pair).collect::<Vec<_>>()).expect("many points");
        assert!(
            (found.cos - truth.cos).abs() < 1e-9 && (found.shift[1] + 1.3).abs() < 1e-9,
            "{found:?}"
        );
        // One after the other is the same as both at once.
        let both = truth.after(&found).of([0.3, 0.2]);
        let twice = truth.of(truth.of([0.3, 0.2]));
        assert!((both[0] - twice[0]).hypot(both[1] - twice[1]) < 1e-9);
        assert!(Rigid::fitted(&[([0.0; 2], [1.0; 2]); 5]).is_none(), "one point tells no turn");
    }
}
