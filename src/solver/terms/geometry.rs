//! Numbers of the geometry (strobe position, camera clock, mount of the range instrument), to first
//! order, by central differences of the log radiance.

mod mount_and_clock;
mod strobe_position;

pub use mount_and_clock::{PLANES_AROUND_S, PlaneTrack, ShiftedPlanes};
pub use strobe_position::strobe_position;

use super::{Equation, Row, Term};
use crate::geometry::LightPath;
use crate::image::Bands;
use crate::solver::Observation;

/// The light path of an observation with an unknown off by a step.
pub type SteppedPath<'f> = dyn Fn(&Observation, f64) -> Option<LightPath> + 'f;

/// One unknown: the step of its numeric derivative, and the light path when it is off by a step.
pub struct Parameter<'f> {
    /// in the unknown's unit
    pub step: f64,
    /// (observation, step) → light path
    pub path: Box<SteppedPath<'f>>,
}

/// Parameters with their derivatives at every equation.
pub struct Geometry {
    /// by equation, then by parameter
    derivatives: Vec<Vec<Bands>>,
    parameters: usize,
}

impl Geometry {
    /// Differentiates the log radiance `log_radiance(equation, path, band)`. An observation that a
    /// step takes out of view has a derivative of 0.
    pub fn new(
        parameters: &[Parameter<'_>],
        equations: &[Equation],
        observations: &[&Observation],
        log_radiance: &dyn Fn(&Equation, &LightPath) -> Bands,
    ) -> Self {
        let of_equation = |equation: &Equation| {
            let observation = observations[equation.source];
            let of_parameter = |p: &Parameter<'_>| {
                let (Some(ahead), Some(behind)) =
                    ((p.path)(observation, p.step), (p.path)(observation, -p.step))
                else {
                    return [0.0; 3];
                };
                let (ahead, behind) =
                    (log_radiance(equation, &ahead), log_radiance(equation, &behind));
                let per_unit = 1.0 / (2.0 * p.step);
                std::array::from_fn(|b| (ahead[b] - behind[b]) * per_unit)
            };
            parameters.iter().map(of_parameter).collect()
        };
        Self {
            derivatives: equations.iter().map(of_equation).collect(),
            parameters: parameters.len(),
        }
    }
}

impl Geometry {
    /// The derivative of an equation by a parameter.
    pub fn derivative(&self, equation: &Equation, parameter: usize, band: usize) -> f64 {
        self.derivatives[equation.index][parameter][band]
    }
}

impl Term for Geometry {
    fn columns(&self) -> usize {
        self.parameters
    }

    fn jacobian(&self, equation: &Equation, band: usize, row: &mut Row) {
        let of_equation = self.derivatives[equation.index].iter().enumerate();
        of_equation.for_each(|(k, derivative)| row.push(k, derivative[band]));
    }
}
