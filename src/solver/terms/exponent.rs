//! p_a, the exponent of spreading on the strobe's leg: log light falls with p_a log ℓ_a (Eq. 4).

use super::{Equation, Row, Term};

/// p_a, one unknown.
pub struct Exponent;

impl Term for Exponent {
    fn columns(&self) -> usize {
        1
    }

    fn jacobian(&self, equation: &Equation, band: usize, row: &mut Row) {
        row.push(0, -equation.path.lamp_share[band] * equation.path.log_strobe_leg);
    }
}
