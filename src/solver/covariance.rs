//! Covariance of the unknowns by a jackknife over segments of the log, with the weights held.
//!
//! An error of a frame (plane, attitude) is common to all its points, so points are not
//! independent. Tracks are grouped by segments of frames; each segment is left out in turn, and the
//! spread of the solutions is the standard deviation.

use nalgebra::DMatrix;

use super::normal::{LinearSystem, Normal};

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

/// Covariance of the unknowns from `first` on; `None` where the equations are singular.
pub fn covariance(
    system: &LinearSystem<'_>,
    independence: Independence,
    first: usize,
) -> Option<DMatrix<f64>> {
    let Independence { frames, moments } = independence;
    let unknowns = system.terms.unknowns();
    let (normal, whole) = system.normal_equations(&system.terms.prior());
    let values = normal.clone().cholesky()?.solve(&whole);
    let segments = (frames / FRAMES_PER_SEGMENT)
        .min(moments / MOMENTS_PER_SEGMENT)
        .clamp(SEGMENTS.0, SEGMENTS.1);
    let mut parts: Vec<Normal> =
        (0..segments).map(|_| Normal::new(DMatrix::zeros(unknowns, unknowns))).collect();
    for track in system.tracks() {
        // A track belongs to the segment of its middle observation.
        let frame = system.equations[(track.start + track.end) / 2].frame as usize;
        parts[(frame * segments / frames.max(1)).min(segments - 1)].add(system, track);
    }
    let mut covariance = DMatrix::zeros(unknowns - first, unknowns - first);
    let n = segments as f64;
    for Normal { matrix, right, .. } in parts {
        let without = (&normal - matrix).cholesky()?.solve(&(&whole - right));
        let step = (without - &values).rows(first, unknowns - first).into_owned();
        covariance += &step * step.transpose() * ((n - 1.0) / n);
    }
    // The spread of few segments is itself uncertain. Student's 95 % quantile over the normal one
    // for n − 1 degrees of freedom, by the Cornish-Fisher expansion: 1.21 for eight, 1.57 for four.
    let per_freedom = 1.0 / (n - 1.0);
    Some(covariance * (1.0 + per_freedom * (1.21 + per_freedom * 1.44)).powi(2))
}
