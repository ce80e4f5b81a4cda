//! Covariance of the unknowns by a jackknife over segments of the log, with the weights held.
//!
//! An error of a frame (plane, attitude) is common to all its points, so points are not
//! independent. Tracks are grouped by segments of frames; each segment is left out in turn, and the
//! spread of the solutions is the standard deviation.

use std::ops::Range;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::normal::{LinearSystem, Normal};
use super::row::Row;
use super::terms::PriorEquations;
use super::terms::attenuation::TimeGrid;
use crate::image::Bands;

/// Frames of a segment: points are tracked over several of them.
const FRAMES_PER_SEGMENT: usize = 5;
/// Independent moments of a segment: neighbours share pings, and count as one.
const MOMENTS_PER_SEGMENT: usize = 2;
/// Fewest and most segments.
const SEGMENTS: (usize, usize) = (4, 20);

/// Frames of a log, as far as their errors are independent.
#[derive(Clone, Copy, Debug)]
pub struct Independence {
    /// number of frames
    pub frames: usize,
    /// moments with pings of their own
    pub moments: usize,
}

/// More unknowns than this are left out to first order: a factorisation for each segment would cost
/// more than the solve.
const MAX_EXACT_UNKNOWNS: usize = 700;

/// Covariance of the unknowns from `first` on; `None` where the equations are singular.
pub fn covariance(
    system: &LinearSystem<'_>,
    segments: &Segments,
    first: usize,
) -> Option<DMatrix<f64>> {
    let unknowns = system.terms.unknowns();
    let (normal, right) = system.normal_equations(system.terms.prior());
    let steps = if unknowns > MAX_EXACT_UNKNOWNS {
        first_order_steps(system, &normal.cholesky()?, &right, segments)
    } else {
        steps(system, (&normal, &right), segments)?
    };
    let mut covariance = DMatrix::zeros(unknowns - first, unknowns - first);
    let n = segments.count as f64;
    for step in steps {
        let step = step.rows(first, unknowns - first).into_owned();
        covariance += &step * step.transpose() * ((n - 1.0) / n);
    }
    // The spread of few segments is itself uncertain. Student's 95 % quantile over the normal one
    // for n − 1 degrees of freedom, by the Cornish-Fisher expansion: 1.21 for eight, 1.57 for four.
    let per_freedom = 1.0 / (segments.fewest as f64 - 1.0);
    Some(covariance * (1.0 + per_freedom * (1.21 + per_freedom * 1.44)).powi(2))
}

/// Segments of frames that are left out in turn.
pub struct Segments {
    of_frame: Vec<usize>,
    count: usize,
    /// of the log that has the fewest
    fewest: usize,
}

impl Segments {
    /// Equal parts of a log, or of each of several that have an attenuation of their own: what a
    /// part of one says of the others is little.
    pub fn new(Independence { frames, moments }: Independence, time: Option<&TimeGrid>) -> Self {
        let logs = time.filter(|time| time.is_of_logs()).map(TimeGrid::frames_per_node);
        let (mut of_frame, mut count, mut fewest) = (Vec::with_capacity(frames), 0, SEGMENTS.1);
        for of_log in logs.unwrap_or_else(|| vec![frames]) {
            let moments = moments * of_log / frames.max(1);
            let segments = (of_log / FRAMES_PER_SEGMENT).min(moments / MOMENTS_PER_SEGMENT);
            let segments = segments.clamp(SEGMENTS.0, SEGMENTS.1);
            of_frame.extend((0..of_log).map(|frame| count + frame * segments / of_log));
            (count, fewest) = (count + segments, fewest.min(segments));
        }
        Self { of_frame, count, fewest }
    }

    /// Segment of a track: that of its middle observation.
    fn of(&self, system: &LinearSystem<'_>, track: &Range<usize>) -> usize {
        let frame = system.equations[(track.start + track.end) / 2].frame as usize;
        self.of_frame.get(frame).copied().unwrap_or(self.count - 1)
    }
}

/// By how much the solution changes without each segment.
fn steps(
    system: &LinearSystem<'_>,
    (normal, right): (&DMatrix<f64>, &DVector<f64>),
    segments: &Segments,
) -> Option<Vec<DVector<f64>>> {
    let values = normal.clone().cholesky()?.solve(right);
    let none = || Normal::new(PriorEquations::none(right.len()));
    let mut parts: Vec<Normal> = (0..segments.count).map(|_| none()).collect();
    for track in system.tracks() {
        parts[segments.of(system, &track)].add(system, track);
    }
    let without = |part: Normal| {
        let solution = (normal - part.matrix).cholesky()?.solve(&(right - part.right));
        Some(solution - &values)
    };
    parts.into_iter().map(without).collect()
}

/// The same to first order: −H⁻¹ Σ w x (y − ρ − prediction) over the segment.
fn first_order_steps(
    system: &LinearSystem<'_>,
    factor: &Cholesky<f64, Dyn>,
    right: &DVector<f64>,
    segments: &Segments,
) -> Vec<DVector<f64>> {
    let values = factor.solve(right);
    let mut gradients = DMatrix::zeros(right.len(), segments.count);
    let mut row = Row::default();
    for track in system.tracks() {
        let segment = segments.of(system, &track);
        let weights = &system.weights[track.clone()];
        let alone: Vec<Bands> = system.equations[track.clone()]
            .iter()
            .map(|e| system.log_reflectance(e, values.as_slice(), &mut row))
            .collect();
        for b in 0..system.bands {
            let total: f64 = weights.iter().map(|w| w[b]).sum();
            let mean =
                alone.iter().zip(weights).map(|(v, w)| w[b] * v[b]).sum::<f64>() / total.max(1e-12);
            let views = system.equations[track.clone()].iter().zip(weights).zip(&alone);
            for ((equation, weight), value) in views {
                let pull = weight[b] * (value[b] - mean);
                system.terms.common_row(equation, &mut row);
                row.iter().for_each(|(p, x)| gradients[(*p, segment)] -= x * pull);
                system.terms.band_row(equation, b, &mut row);
                row.iter().for_each(|(p, x)| gradients[(*p, segment)] -= x * pull);
            }
        }
    }
    factor.solve_mut(&mut gradients);
    (0..gradients.ncols()).map(|k| gradients.column(k).into_owned()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_log_has_segments_of_its_own() {
        let whole = Independence { frames: 100, moments: 100 };
        let one = Segments::new(whole, None);
        assert_eq!((one.count, one.fewest, one.of_frame[0], one.of_frame[99]), (20, 20, 0, 19));
        // 70 frames of a log, then 30 of another.
        let frames = (0..100).map(|frame| (usize::from(frame >= 70), 0.0)).collect();
        let logs = TimeGrid { frames, nodes: 2, is_joined: vec![false] };
        let two = Segments::new(whole, Some(&logs));
        assert_eq!((two.count, two.fewest), (20, 6));
        assert_eq!([69, 70, 99].map(|frame| two.of_frame[frame]), [13, 14, 19]);
        // Nodes along a log are no logs.
        let along = TimeGrid { frames: vec![(0, 0.5); 100], nodes: 2, is_joined: vec![true] };
        assert_eq!(Segments::new(whole, Some(&along)).count, 20);
    }
}
