//! A few numbers (places, an offset, a turn) from the residual of the joint solve: a step is taken where the residual
//! falls, and halved where it does not (Gauss-Newton, everything else solved anew at each place).

use nalgebra::Vector3;

use super::joint::places::PlaceStep;

const STEPS: usize = 25;
const LONGEST_STEP: f64 = 0.25;
const SETTLED: f64 = 5e-4;
/// A step of so many standard deviations says nothing.
const TELLING: f64 = 0.1;

/// Where the residual is least.
#[derive(Clone, Copy, Debug)]
pub struct Lowest {
    /// the three numbers
    pub place: Vector3<f64>,
    /// standard deviation of each
    pub std: Vector3<f64>,
    /// residual there [log light]
    pub residual: f64,
}

/// Goes down from `place`, where the residual is `residual`.
pub fn descend(
    (mut place, mut residual): (Vector3<f64>, f64),
    residual_at: &dyn Fn(Vector3<f64>) -> Option<f64>,
    asked_at: &dyn Fn(Vector3<f64>) -> Option<PlaceStep>,
) -> Option<Lowest> {
    let mut std = Vector3::repeat(f64::NAN);
    for _ in 0..STEPS {
        let asked = asked_at(place)?;
        let (whole, of_three) = (Vector3::from_row_slice(asked.step.get(..3)?), Vector3::from_row_slice(asked.std.get(..3)?));
        std = of_three;
        if whole.iter().zip(&std).all(|(step, std)| step.abs() < TELLING * std) {
            break;
        }
        let mut step = whole * (LONGEST_STEP / whole.norm()).min(1.0);
        let mut taken = false;
        for _ in 0..5 {
            if let Some(r) = residual_at(place + step).filter(|r| *r < residual) {
                (place, residual, taken) = (place + step, r, true);
                break;
            }
            step *= 0.4;
        }
        if !taken || step.norm() < SETTLED {
            break;
        }
    }
    Some(Lowest { place, std, residual })
}
