//! Vignetting of lens and sensor: V = v₁ϱ² + v₂ϱ⁴ + v₃ϱ⁶ (log light), ϱ the image radius, 1 at the
//! corner. Changes of altitude separate it from the beam pattern, as the strobe is off the axis.

use super::{Equation, Prior, Row, Term};
use crate::solver::camera::VIGNETTING_TERMS;

/// Weight that holds the coefficients to 0 where nothing determines them.
const HOLD_WEIGHT: f64 = 1e-3;

/// v₁ to v₃.
pub struct Vignetting;

impl Term for Vignetting {
    fn columns(&self) -> usize {
        VIGNETTING_TERMS
    }

    fn jacobian(&self, equation: &Equation, _: usize, row: &mut Row) {
        let mut power = 1.0;
        for k in 0..VIGNETTING_TERMS {
            power *= equation.radius_squared;
            row.push(k, power);
        }
    }

    fn prior(&self, prior: &mut Prior<'_>) {
        (0..VIGNETTING_TERMS).for_each(|k| prior.hold(&[(k, 1.0)], HOLD_WEIGHT));
    }
}
