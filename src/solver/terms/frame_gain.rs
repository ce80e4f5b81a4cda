//! Light of a frame over that of the others: a strobe drop-out, an exposure that no channel
//! reports.
//!
//! A free gain per frame takes the level of α with it, as gain and altitude are nearly degenerate:
//! the gain is held to 0 by a prior.

use super::{Equation, Prior, Row, Term};

/// Log gain per frame.
pub struct FrameGain {
    /// number of frames
    pub frames: usize,
    /// weight that holds a gain to 0, in observations
    pub hold_weight: f64,
}

impl Term for FrameGain {
    fn columns(&self) -> usize {
        self.frames
    }

    fn jacobian(&self, equation: &Equation, _: usize, row: &mut Row) {
        row.push(equation.frame as usize, 1.0);
    }

    fn prior(&self, prior: &mut Prior<'_>) {
        (0..self.frames).for_each(|f| prior.hold(&[(f, 1.0)], self.hold_weight));
    }
}
