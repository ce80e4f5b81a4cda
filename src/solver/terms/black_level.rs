//! Black level per band: what the sensor adds to every pixel value. It differs from backscatter by
//! being the same at every range. Steps from the state in hand; d log D = dk / D at given light.

use super::{Equation, Prior, Row, Term};
use crate::image::Bands;

/// Largest black level either way (share of full scale).
const MAX_LEVEL: f64 = 0.1;
/// Weight that holds a step to 0 where nothing determines it.
const HOLD_WEIGHT: f64 = 1e-3;

/// Steps of k per band.
pub struct BlackLevel {
    /// 1 or 3
    pub bands: usize,
    /// the state that steps are taken from
    pub level: Bands,
}

impl Term for BlackLevel {
    fn columns(&self) -> usize {
        self.bands
    }

    fn jacobian(&self, equation: &Equation, band: usize, row: &mut Row) {
        row.push(band, equation.reading.per_direct[band]);
    }

    fn prior(&self, prior: &mut Prior<'_>) {
        (0..self.bands).for_each(|b| prior.hold(&[(b, 1.0)], HOLD_WEIGHT));
    }

    fn apply(&mut self, values: &mut [f64]) {
        for (level, step) in self.level.iter_mut().zip(values) {
            *level = (*level + std::mem::take(step)).clamp(-MAX_LEVEL, MAX_LEVEL);
        }
    }
}
