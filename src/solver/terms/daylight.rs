//! Daylight on the seafloor (Eq. 3): d_Λ, its light over that of the strobe at a distance of 1 m in
//! the beam's peak, before the path to the camera.
//!
//! Light of lamps and daylight add up, so d is a step of its logarithm from the state in hand.
//! Steps are not damped: the level that beam pattern and reflectance share moves d with it.

use super::{Equation, Row, Term};
use crate::image::Bands;

/// Largest step of log d.
const MAX_STEP: f64 = 1.0;
/// Least and largest log d about the one that the solve begins with.
const RANGE: f64 = 7.0;

/// Steps of log d per band.
pub struct Daylight {
    bands: usize,
    /// where the state began
    begun: Bands,
    /// log d, in the unit of the beam pattern's unknowns
    pub log_strength: Bands,
}

impl Daylight {
    /// Begins at log d.
    pub fn new(bands: usize, log_strength: Bands) -> Self {
        Self { bands, begun: log_strength, log_strength }
    }
}

impl Term for Daylight {
    fn columns(&self) -> usize {
        self.bands
    }

    fn jacobian(&self, equation: &Equation, band: usize, row: &mut Row) {
        row.push(band, 1.0 - equation.path.lamp_share[band]);
    }

    fn apply(&mut self, values: &mut [f64]) {
        for (b, value) in values.iter_mut().enumerate().take(self.bands) {
            let (begun, step) = (self.begun[b], std::mem::take(value).clamp(-MAX_STEP, MAX_STEP));
            self.log_strength[b] =
                (self.log_strength[b] + step).clamp(begun - RANGE, begun + RANGE);
        }
    }
}
