//! A few numbers (places, an offset, a turn) from the residual of the joint solve: a step is taken
//! where the residual falls, and halved where it does not (Gauss-Newton, everything else solved
//! anew at each place).

use nalgebra::Vector3;

use super::joint::places::PlaceStep;

const STEPS: usize = 25;
const LONGEST_STEP: f64 = 0.25;
/// A step so short is the last in any case.
pub const SETTLED: f64 = 5e-4;
/// A step of so many standard deviations says nothing.
const TELLING: f64 = 0.1;

/// What is found at a place: the residual there, and the step that it asks for.
pub type Asked = (f64, PlaceStep);

/// Where the residual is least.
#[derive(Clone, Copy, Debug)]
pub struct Lowest {
    /// the three numbers
    pub place: Vector3<f64>,
    /// standard deviation of each
    pub std: Vector3<f64>,
    /// residual at the start and there [log light]
    pub residual: [f64; 2],
}

/// Goes down from `place`, until steps that are asked for are shorter than `settled`. A place that
/// is tried is nearly always taken, so it is asked for its own step at once: one solve a step.
pub fn descend(
    mut place: Vector3<f64>,
    settled: f64,
    asked_at: &dyn Fn(Vector3<f64>) -> Option<Asked>,
) -> Option<Lowest> {
    let (first, mut asked) = asked_at(place)?;
    let mut residual = first;
    let mut std = Vector3::repeat(f64::NAN);
    for _ in 0..STEPS {
        let (whole, of_three) = (
            Vector3::from_row_slice(asked.step.get(..3)?),
            Vector3::from_row_slice(asked.std.get(..3)?),
        );
        std = of_three;
        if whole.iter().zip(&std).all(|(step, std)| step.abs() < TELLING * std) {
            break;
        }
        let mut step = whole * (LONGEST_STEP / whole.norm()).min(1.0);
        let mut taken = false;
        for _ in 0..5 {
            if let Some((lower, next)) = asked_at(place + step).filter(|(r, _)| *r < residual) {
                (place, residual, asked, taken) = (place + step, lower, next, true);
                break;
            }
            step *= 0.4;
        }
        if !taken || step.norm() < SETTLED || whole.norm() < settled {
            break;
        }
    }
    Some(Lowest { place, std, residual: [first, residual] })
}
