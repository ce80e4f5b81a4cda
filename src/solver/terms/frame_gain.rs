//! Gains of frames: a strobe that flickers or drops out, an exposure that no channel reports.
//!
//! A free gain per frame takes the level of α with it, as gain and altitude are nearly degenerate:
//! gains are random effects, held to their means by a prior of known variance.

use super::{Equation, Prior, Row, Term};

/// Log gain per frame, of all bands together or of each.
#[derive(Clone)]
pub struct FrameGain {
    /// number of frames
    pub frames: usize,
    /// 1: one gain for all bands
    pub bands: usize,
    /// what they are held to, frame by frame; 0 where empty
    pub means: Vec<f64>,
    /// weight that holds them, in observations
    pub hold_weight: f64,
}

impl FrameGain {
    /// One gain per frame for all bands, held to 0.
    pub fn common(frames: usize, hold_weight: f64) -> Self {
        Self { frames, bands: 1, means: Vec::new(), hold_weight }
    }

    /// Unknown of a frame and band.
    pub fn unknown(&self, frame: usize, band: usize) -> usize {
        frame * self.bands + if self.bands > 1 { band } else { 0 }
    }

    /// What an unknown is held to.
    pub fn mean(&self, unknown: usize) -> f64 {
        self.means.get(unknown).copied().unwrap_or(0.0)
    }
}

impl Term for FrameGain {
    fn columns(&self) -> usize {
        self.frames * self.bands
    }

    fn jacobian(&self, equation: &Equation, band: usize, row: &mut Row) {
        row.push(self.unknown(equation.frame as usize, band), 1.0);
    }

    fn prior(&self, prior: &mut Prior<'_>) {
        for k in 0..self.columns() {
            prior.hold_to(&[(k, 1.0)], self.mean(k), self.hold_weight);
        }
    }
}
