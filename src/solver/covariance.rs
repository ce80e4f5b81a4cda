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
    independence: Independence,
    first: usize,
) -> Option<DMatrix<f64>> {
    let unknowns = system.terms.unknowns();
    let (normal, right) = system.normal_equations(system.terms.prior());
    let segments = segments_of(independence);
    let steps = if unknowns > MAX_EXACT_UNKNOWNS {
        first_order_steps(system, &normal.cholesky()?, &right, (segments, independence.frames))
    } else {
        steps(system, (&normal, &right), (segments, independence.frames))?
    };
    let mut covariance = DMatrix::zeros(unknowns - first, unknowns - first);
    let n = segments as f64;
    for step in steps {
        let step = step.rows(first, unknowns - first).into_owned();
        covariance += &step * step.transpose() * ((n - 1.0) / n);
    }
    // The spread of few segments is itself uncertain. Student's 95 % quantile over the normal one
    // for n − 1 degrees of freedom, by the Cornish-Fisher expansion: 1.21 for eight, 1.57 for four.
    let per_freedom = 1.0 / (n - 1.0);
    Some(covariance * (1.0 + per_freedom * (1.21 + per_freedom * 1.44)).powi(2))
}

fn segments_of(Independence { frames, moments }: Independence) -> usize {
    (frames / FRAMES_PER_SEGMENT).min(moments / MOMENTS_PER_SEGMENT).clamp(SEGMENTS.0, SEGMENTS.1)
}

/// Segment of a track: that of its middle observation.
fn segment_of(
    system: &LinearSystem<'_>,
    track: &Range<usize>,
    (segments, frames): (usize, usize),
) -> usize {
    let frame = system.equations[(track.start + track.end) / 2].frame as usize;
    (frame * segments / frames.max(1)).min(segments - 1)
}

/// By how much the solution changes without each segment.
fn steps(
    system: &LinearSystem<'_>,
    (normal, right): (&DMatrix<f64>, &DVector<f64>),
    division: (usize, usize),
) -> Option<Vec<DVector<f64>>> {
    let values = normal.clone().cholesky()?.solve(right);
    let none = || Normal::new(PriorEquations::none(right.len()));
    let mut parts: Vec<Normal> = (0..division.0).map(|_| none()).collect();
    for track in system.tracks() {
        parts[segment_of(system, &track, division)].add(system, track);
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
    division: (usize, usize),
) -> Vec<DVector<f64>> {
    let values = factor.solve(right);
    let mut gradients = DMatrix::zeros(right.len(), division.0);
    let mut row = Row::default();
    for track in system.tracks() {
        let segment = segment_of(system, &track, division);
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
