//! The law by which a camera sets its own gain: auto-exposure answers the brightness of the whole
//! image, auto white balance its colour.
//!
//! g = κ m + κ' (m_Λ − m), m_Λ: log of the frame's mean reading in band Λ over that of the log, m:
//! the mean of m_Λ. A camera that compensates the share s of a change has κ = −s / (1 − s).

use super::{Equation, Prior, Row, Term};
use crate::image::Bands;

/// Weight that holds κ to 0 where nothing determines it.
const HOLD_WEIGHT: f64 = 1e-3;

/// κ, and κ' of a camera of three bands.
pub struct GainLaw<'s> {
    /// 1 or 3
    pub bands: usize,
    /// m_Λ per frame
    pub log_means: &'s [Bands],
}

/// m, and m_Λ − m of a band.
pub fn factors(log_means: &Bands, bands: usize, band: usize) -> [f64; 2] {
    let mean = log_means[..bands].iter().sum::<f64>() / bands as f64;
    [mean, log_means[band] - mean]
}

impl Term for GainLaw<'_> {
    fn columns(&self) -> usize {
        if self.bands == 3 { 2 } else { 1 }
    }

    fn jacobian(&self, equation: &Equation, band: usize, row: &mut Row) {
        let factors = factors(&self.log_means[equation.frame as usize], self.bands, band);
        factors[..self.columns()].iter().enumerate().for_each(|(k, x)| row.push(k, *x));
    }

    fn prior(&self, prior: &mut Prior<'_>) {
        (0..self.columns()).for_each(|k| prior.hold(&[(k, 1.0)], HOLD_WEIGHT));
    }
}
