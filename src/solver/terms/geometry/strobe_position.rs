//! The strobe's position in body space: three unknowns (m). All lamps move together.

use super::Parameter;
use crate::solver::PathFor;
use crate::vehicle::Lamps;

/// Step of the numeric derivative (m).
const STEP_M: f64 = 0.01;

/// The position's x, y, z.
pub fn strobe_position<'f>(lamps: Lamps, paths: &'f PathFor<'f>) -> [Parameter<'f>; 3] {
    std::array::from_fn(|axis| {
        let moved = move |by: f64| {
            let mut position = lamps.origin().vector();
            position[axis] += by;
            lamps.moved_to(position)
        };
        Parameter { step: STEP_M, path: Box::new(move |o, by| paths(o, moved(by))) }
    })
}
