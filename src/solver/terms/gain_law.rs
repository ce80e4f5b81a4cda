//! The law by which a camera sets its own gain: auto-exposure answers the brightness of the whole
//! image, auto white balance its colour.
//!
//! g = κ m + κ' c_Λ with the brightness m and colour c_Λ of the frame's mean reading. A camera that
//! compensates the share s of a change has κ = −s / (1 − s).

use super::{Equation, Prior, Row, Term};
use crate::model::Metered;

/// Weight that holds κ to 0 where nothing determines it.
const HOLD_WEIGHT: f64 = 1e-8;

/// κ, and κ' of a camera of three bands.
pub struct GainLaw<'s> {
    /// 1 or 3
    pub bands: usize,
    /// per frame
    pub metered: &'s [Metered],
}

impl Term for GainLaw<'_> {
    fn columns(&self) -> usize {
        if self.bands == 3 { 2 } else { 1 }
    }

    fn jacobian(&self, equation: &Equation, band: usize, row: &mut Row) {
        let Metered { brightness, color } = self.metered[equation.frame as usize];
        let factors = [brightness, color[band]];
        factors[..self.columns()].iter().enumerate().for_each(|(k, x)| row.push(k, *x));
    }

    fn prior(&self, prior: &mut Prior<'_>) {
        (0..self.columns()).for_each(|k| prior.hold(&[(k, 1.0)], HOLD_WEIGHT));
    }
}
