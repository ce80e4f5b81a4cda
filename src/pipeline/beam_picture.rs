//! The beam pattern as a false-colour picture (the paper's Fig. 9): warmer is brighter, grey was never seen.

use crate::geometry::StrobeAngles;
use crate::image::encode;
use crate::model::BeamPattern;

const SIDE: usize = 320;
/// colours from dark to bright, at even steps of the gain
const RAMP: [[f64; 3]; 6] = [[0.05, 0.03, 0.25], [0.15, 0.25, 0.65], [0.10, 0.60, 0.65], [0.50, 0.80, 0.35], [0.97, 0.85, 0.25], [0.85, 0.15, 0.10]];

/// A PNG, θ down and φ to the right over the grid's whole range.
pub fn png(beam: &BeamPattern) -> Vec<u8> {
    let limit = beam.nodes().limit_rad;
    let angle = |i: usize| (2.0 * (i as f64 + 0.5) / SIDE as f64 - 1.0) * limit;
    let pixels: Vec<u8> = (0..SIDE * SIDE)
        .flat_map(|i| {
            let angles = StrobeAngles { theta_rad: angle(i / SIDE), phi_rad: angle(i % SIDE) };
            if !beam.is_seen(angles) {
                return [70, 70, 70];
            }
            let gain = beam.log_gain(angles).exp().clamp(0.0, 1.0) * (RAMP.len() - 1) as f64;
            let step = (gain as usize).min(RAMP.len() - 2);
            let share = gain - step as f64;
            std::array::from_fn(|b| ((RAMP[step][b] + (RAMP[step + 1][b] - RAMP[step][b]) * share) * 255.0).round() as u8)
        })
        .collect();
    encode::png(&pixels, SIDE, SIDE, 3, 8).unwrap_or_default()
}
