//! Tilts of the seafloor plane against the camera, where no attitude is known: one that all frames
//! share (a slope, a mount), and each frame's own. They are random effects, held to 0 by the
//! variance that a vehicle's motion has; the unknowns are steps from a state.

use super::geometry::Geometry;
use super::{Equation, Prior, Row, Term};

/// About the camera's x and y axes.
pub const AXES: usize = 2;

/// Two unknowns that all frames share (rad), then two per frame.
pub struct Tilt<'g> {
    /// number of frames
    pub frames: usize,
    /// the derivatives by a tilt of the equation's frame
    pub derivatives: &'g Geometry,
    /// the tilts that steps are taken from: the shared one, then those of the frames (rad); 0
    /// where empty
    pub state: &'g [[f64; AXES]],
    /// weights that hold the shared tilt and those of the frames to 0
    pub hold_weights: [f64; 2],
}

impl Tilt<'_> {
    /// Unknown of a frame about an axis.
    pub fn unknown(&self, frame: usize, axis: usize) -> usize {
        AXES * (1 + frame) + axis
    }
}

impl Term for Tilt<'_> {
    fn columns(&self) -> usize {
        AXES * (1 + self.frames)
    }

    fn jacobian(&self, equation: &Equation, band: usize, row: &mut Row) {
        for axis in 0..AXES {
            let derivative = self.derivatives.derivative(equation, axis, band);
            row.push(axis, derivative);
            row.push(self.unknown(equation.frame as usize, axis), derivative);
        }
    }

    fn prior(&self, prior: &mut Prior<'_>) {
        let [shared, own] = self.hold_weights;
        for k in 0..self.columns() {
            let weight = if k < AXES { shared } else { own };
            let state = self.state.get(k / AXES).map_or(0.0, |tilt| tilt[k % AXES]);
            prior.hold_to(&[(k, 1.0)], -state, weight);
        }
    }
}
