//! Correction R of the transfer curve: splines over the reading. Steps from the state in hand.
//!
//! x = w + R(x), so dx = dR · dx/dw at given w; derivatives are those of log D at given x.

use super::{Equation, Prior, Row, Term};
use crate::solver::camera::{SPLINES, splines};

/// Weight of second differences of coefficients: one of 0.1 costs as much as a residual of 0.01.
const BEND_WEIGHT: f64 = 0.01;
/// Weight that holds R where no light determines it.
const HOLD_WEIGHT: f64 = 1e-3;
/// A step changes no coefficient by more than this (log light).
const MAX_STEP: f64 = 0.15;

/// Steps of the coefficients of R; the bands share the curve.
pub struct ResponseTerm {
    /// the state that steps are taken from
    pub coefficients: [f64; SPLINES],
}

impl Term for ResponseTerm {
    fn columns(&self) -> usize {
        SPLINES
    }

    fn jacobian(&self, equation: &Equation, band: usize, row: &mut Row) {
        let reading = &equation.reading;
        let per_direct = reading.light_per_direct[band];
        for (spline, value) in splines(reading.predicted[band]) {
            row.push(spline, value * per_direct);
        }
    }

    fn prior(&self, prior: &mut Prior<'_>) {
        // Of the values, not of the steps.
        let at = |k: usize| self.coefficients[k];
        for k in 1..SPLINES - 1 {
            let bend = at(k - 1) - 2.0 * at(k) + at(k + 1);
            prior.hold_to(&[(k - 1, 1.0), (k, -2.0), (k + 1, 1.0)], -bend, BEND_WEIGHT);
        }
        (0..SPLINES).for_each(|k| prior.hold_to(&[(k, 1.0)], -at(k), HOLD_WEIGHT));
    }

    fn apply(&mut self, values: &mut [f64]) {
        let largest = values.iter().map(|v| v.abs()).fold(0.0, f64::max);
        let shorter = (MAX_STEP / largest.max(1e-12)).min(1.0);
        for (coefficient, step) in self.coefficients.iter_mut().zip(values) {
            *coefficient += shorter * std::mem::take(step);
        }
    }
}
