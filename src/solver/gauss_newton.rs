//! A few numbers (a position, a clock offset, a rotation) from the residual of the joint solve, by
//! Gauss-Newton: a step is taken where the residual falls, and shortened where it does not;
//! everything else is solved for again at each point.

use nalgebra::Vector3;

use super::ParameterStep;

const MAX_STEPS: usize = 25;
const MAX_STEP: f64 = 0.25;
/// Attempts of a step, each shorter by this factor.
const ATTEMPTS: usize = 5;
const SHORTER: f64 = 0.4;
/// A step this short is the last in any case.
pub const SETTLED: f64 = 5e-4;
/// A step of fewer standard deviations than this is noise.
const MIN_SIGNIFICANCE: f64 = 0.1;

/// Residual at a point, and the step from there that lowers it most.
pub type Evaluation = (f64, ParameterStep);

/// Where the residual is least.
#[derive(Clone, Copy, Debug)]
pub struct Minimum {
    /// the three numbers
    pub point: Vector3<f64>,
    /// standard deviation of each
    pub std: Vector3<f64>,
    /// residual at the start and at the minimum (log light)
    pub residual: [f64; 2],
}

/// Descends from `point` until the steps are shorter than `settled`. A point that is tried is
/// nearly always taken, so its own step is computed at once: one solve a step.
pub fn minimize(
    mut point: Vector3<f64>,
    settled: f64,
    evaluate: &dyn Fn(Vector3<f64>) -> Option<Evaluation>,
) -> Option<Minimum> {
    let (first, mut next) = evaluate(point)?;
    let mut residual = first;
    let mut std = Vector3::repeat(f64::NAN);
    for _ in 0..MAX_STEPS {
        let whole = Vector3::from_row_slice(next.step.get(..3)?);
        std = Vector3::from_row_slice(next.std.get(..3)?);
        if whole.iter().zip(&std).all(|(step, std)| step.abs() < MIN_SIGNIFICANCE * std) {
            break;
        }
        let mut step = whole * (MAX_STEP / whole.norm()).min(1.0);
        let mut is_taken = false;
        for _ in 0..ATTEMPTS {
            if let Some((lower, after)) = evaluate(point + step).filter(|(r, _)| *r < residual) {
                (point, residual, next, is_taken) = (point + step, lower, after, true);
                break;
            }
            step *= SHORTER;
        }
        if !is_taken || step.norm() < SETTLED || whole.norm() < settled {
            break;
        }
    }
    Some(Minimum { point, std, residual: [first, residual] })
}
