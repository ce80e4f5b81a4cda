//! Backscatter (Eq. 5, 6): strength b per band, and the shape of S_Λ, as steps from the state in
//! hand. Light is added, not multiplied: c = D + b S, so d log D = (S / D) db at given c.

use super::{Equation, Prior, Row, Term};
use crate::image::Bands;
use crate::model::{Backscatter, SHAPES};

/// Factor by which an unknown that stands at a bound is held.
pub const HOLDING: f64 = 1e6;
/// Weight that holds η and ζ where they are, in case no light determines them.
const SHAPE_WEIGHT: f64 = 1e-3;

/// Steps of b (1/m) per band, then of η and ζ.
pub struct BackscatterTerm {
    bands: usize,
    /// the state that steps are taken from
    pub state: Backscatter,
    /// largest b that the darkest observations allow (1/m)
    pub max_strength_per_m: Bands,
    is_held: [bool; 3],
}

impl BackscatterTerm {
    /// Begins at a state, without an upper bound.
    pub fn new(bands: usize, state: Backscatter) -> Self {
        Self { bands, state, max_strength_per_m: [f64::INFINITY; 3], is_held: [false; 3] }
    }
}

impl Term for BackscatterTerm {
    fn columns(&self) -> usize {
        self.bands + SHAPES
    }

    fn jacobian(&self, equation: &Equation, band: usize, row: &mut Row) {
        let reading = &equation.reading;
        let (scatter, per_direct) = (&reading.scatter, reading.per_direct[band]);
        row.push(band, scatter.of_band(band, &self.state.shape) * per_direct);
        for (k, x) in scatter.by_shape(band).iter().enumerate() {
            row.push(self.bands + k, x * self.state.strength_per_m[band] * per_direct);
        }
    }

    fn prior(&self, prior: &mut Prior<'_>) {
        (0..SHAPES).for_each(|k| prior.hold(&[(self.bands + k, 1.0)], SHAPE_WEIGHT));
    }

    fn apply(&mut self, values: &mut [f64]) {
        for b in 0..self.bands {
            let (step, now) = (std::mem::take(&mut values[b]), &mut self.state.strength_per_m[b]);
            let wanted = *now + if self.is_held[b] { step * HOLDING } else { step };
            *now = wanted.clamp(0.0, self.max_strength_per_m[b]);
            // At a bound its column is held, or it would go on taking part of α with it.
            self.is_held[b] = *now != wanted;
        }
        self.state.reshape(std::array::from_fn(|k| std::mem::take(&mut values[self.bands + k])));
    }

    fn held(&self) -> Vec<usize> {
        (0..self.bands).filter(|b| self.is_held[*b]).collect()
    }
}
