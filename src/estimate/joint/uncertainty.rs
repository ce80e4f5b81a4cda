//! How sure the joint solve is. What a frame gets wrong (plane, attitude) it gets wrong in all its
//! points, so points do not count as independent: tracks are taken in stretches of frames, each
//! stretch is left out in turn, and the spread of the answers is the standard deviation (a
//! jackknife over blocks, with the weights held).

use nalgebra::DMatrix;

use super::Problem;
use super::normal::Normal;

/// Frames of a stretch: points are followed over several of them.
const FRAMES_PER_STRETCH: usize = 5;
/// Independent moments of a stretch: neighbours share pings, and what they share is not to count as
/// two.
const MOMENTS_PER_STRETCH: usize = 2;
/// Stretches whose errors are taken to be independent.
const STRETCHES: (usize, usize) = (4, 20);

impl Problem<'_> {
    /// Covariance of the unknowns from `first` on.
    pub fn covariance(&self, first: usize) -> Option<DMatrix<f64>> {
        let (unknowns, frames) = (self.columns.count(), self.setting.frames);
        let (normal, whole) = self.normal_equations(&self.smoothness());
        let values = normal.clone().cholesky()?.solve(&whole);
        let apart = (frames / FRAMES_PER_STRETCH).min(self.setting.moments / MOMENTS_PER_STRETCH);
        let stretches = apart.clamp(STRETCHES.0, STRETCHES.1);
        let mut parts: Vec<Normal> =
            (0..stretches).map(|_| Normal::new(DMatrix::zeros(unknowns, unknowns))).collect();
        for track in self.tracks() {
            // A track belongs where its middle view is.
            let frame = self.rows[(track.start + track.end) / 2].frame as usize;
            parts[(frame * stretches / frames.max(1)).min(stretches - 1)].add(self, track);
        }
        let mut covariance = DMatrix::zeros(unknowns - first, unknowns - first);
        let n = stretches as f64;
        for Normal { matrix, right, .. } in parts {
            let without = (&normal - matrix).cholesky()?.solve(&(&whole - right));
            let step = (without - &values).rows(first, unknowns - first).into_owned();
            covariance += &step * step.transpose() * ((n - 1.0) / n);
        }
        // Few stretches: their own spread is uncertain. Student's 95 % over the normal one, for n −
        // 1 degrees of freedom, by its expansion (Cornish and Fisher): 1.21 for eight stretches,
        // 1.57 for four.
        let per_freedom = 1.0 / (n - 1.0);
        Some(covariance * (1.0 + per_freedom * (1.21 + per_freedom * 1.44)).powi(2))
    }
}
