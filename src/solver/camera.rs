//! What the camera does to the light before it is a pixel value, and which of it is solved for.
//!
//! ```text
//! log D = ρ + BP − α ℓ + geometry + g_f + g_fΛ + κ m_f + V(ϱ²)  direct light at the sensor
//! w     = log(D + B + k)                                        backscatter B, black level k
//! x     = w + R(x)                                              log light by the assumed curve
//! ```
//!
//! g are gains of frames, κ the law by which the camera sets them, V is vignetting, R corrects the
//! transfer curve.

use super::Sample;
use crate::coordinates::{Body, Optical, Transform};
use crate::image::Bands;
use crate::image::transfer::{Transfer, srgb_encode};

/// Knots of R, evenly spaced over log light.
pub const KNOTS: usize = 16;
/// Log light of the first knot; the last is at full scale. Darker values are not sampled.
const DARKEST: f64 = -6.5;
/// Segments of the tabulated curve, which reaches this far beyond the knots (log light).
const SEGMENTS: usize = 320;
const BEYOND: f64 = 1.0;
/// Least slope of w over x: more light never lowers a pixel value.
const MIN_SLOPE: f64 = 0.05;
/// Coefficients of V.
pub const VIGNETTING_TERMS: usize = 3;

/// ϱ²: squared distance from the principal point in the image plane, 1 at the corner.
#[derive(Clone, Copy, Debug)]
pub struct ImageRadius {
    /// the camera's mount
    pub body_from_optical: Transform<Body, Optical>,
    /// square of the corner's distance, at focal length 1
    pub corner_squared: f64,
}

impl ImageRadius {
    /// ϱ² of a sample.
    pub fn squared(&self, sample: &Sample) -> f64 {
        let hit = (self.body_from_optical.inverse() * sample.hit).vector();
        (hit.x.powi(2) + hit.y.powi(2)) / (hit.z.powi(2) * self.corner_squared)
    }
}

/// V at ϱ² (log light).
pub fn vignetting_at(coefficients: &[f64; VIGNETTING_TERMS], radius_squared: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, v| (sum + v) * radius_squared)
}

/// What of the camera is solved for.
#[derive(Clone, Copy)]
pub struct CameraUnknowns<'s> {
    /// gains of the frames
    pub gains: Option<FrameGains<'s>>,
    /// log of each frame's mean reading over the log's, where the camera's law is solved for
    pub law: Option<&'s [Bands]>,
    /// V
    pub vignetting: bool,
    /// the knots of R
    pub response: bool,
    /// k
    pub black_level: bool,
    /// curve and black level to begin with
    pub start: &'s ReadingCurve,
    /// ϱ² of an observation
    pub radius: ImageRadius,
}

/// Gains of frames as random effects.
#[derive(Clone, Copy)]
pub struct FrameGains<'s> {
    /// their means, per frame
    pub means: &'s [Bands],
    /// their standard deviations: of what the bands share, and of each band's own (log light); 0:
    /// no such gain
    pub std: [f64; 2],
    /// whether the standard deviations follow from the solve, by evidence
    pub is_estimated: bool,
}

/// Light at the sensor → reading: black level and transfer curve.
#[derive(Clone, Debug, PartialEq)]
pub struct ReadingCurve {
    /// k, share of full scale
    pub black_level: Bands,
    /// the curve that was inverted is sRGB, the camera's is this
    pub transfer: Option<Transfer>,
    /// R at the knots, beside `transfer`
    pub knots: [f64; KNOTS],
    /// w at evenly spaced x, increasing
    table: Vec<f64>,
}

impl Default for ReadingCurve {
    fn default() -> Self {
        Self::new([0.0; 3], None, [0.0; KNOTS])
    }
}

impl ReadingCurve {
    /// A curve; made monotone where the knots are not.
    pub fn new(black_level: Bands, transfer: Option<Transfer>, knots: [f64; KNOTS]) -> Self {
        let correction = |x: f64| {
            let by_transfer = transfer
                .map_or(0.0, |t| x - t.to_linear(srgb_encode(x.exp())).max(f64::MIN_POSITIVE).ln());
            by_transfer + hats(x).iter().map(|(k, weight)| weight * knots[*k]).sum::<f64>()
        };
        let step = Self::step();
        let mut table: Vec<f64> = Vec::with_capacity(SEGMENTS + 1);
        for i in 0..=SEGMENTS {
            // At full scale the encoding clips: beyond, the curve goes on straight.
            let x = Self::x_at(i);
            let light = x - correction(x.min(0.0));
            let least = table.last().map_or(f64::NEG_INFINITY, |before| before + MIN_SLOPE * step);
            table.push(light.max(least));
        }
        Self { black_level, transfer, knots, table }
    }

    /// Whether it changes nothing.
    pub fn is_identity(&self) -> bool {
        self.black_level == [0.0; 3] && self.is_straight()
    }

    /// Whether the assumed transfer curve is right.
    pub fn is_straight(&self) -> bool {
        self.transfer.is_none() && self.knots == [0.0; KNOTS]
    }

    fn step() -> f64 {
        (BEYOND * 2.0 - DARKEST) / SEGMENTS as f64
    }

    fn x_at(i: usize) -> f64 {
        DARKEST - BEYOND + i as f64 * Self::step()
    }

    /// w of a reading, and dx/dw there.
    pub fn light(&self, x: f64) -> (f64, f64) {
        if self.is_straight() {
            return (x, 1.0);
        }
        let step = Self::step();
        let at = (x - Self::x_at(0)) / step;
        let i = (at.max(0.0) as usize).min(SEGMENTS - 1);
        let rise = self.table[i + 1] - self.table[i];
        (self.table[i] + rise * (at - i as f64), step / rise)
    }

    /// The reading of w, and dx/dw there.
    pub fn reading(&self, w: f64) -> (f64, f64) {
        if self.is_straight() {
            return (w, 1.0);
        }
        let step = Self::step();
        let i = self.table.partition_point(|v| *v <= w).clamp(1, SEGMENTS) - 1;
        let slope = step / (self.table[i + 1] - self.table[i]);
        (Self::x_at(i) + (w - self.table[i]) * slope, slope)
    }

    /// The same with other values.
    pub fn with(&self, black_level: Bands, knots: [f64; KNOTS]) -> Self {
        if black_level == self.black_level && knots == self.knots {
            return self.clone();
        }
        Self::new(black_level, self.transfer, knots)
    }
}

/// Knots about a reading and their weights.
pub fn hats(x: f64) -> [(usize, f64); 2] {
    let at = ((x - DARKEST) / -DARKEST * (KNOTS - 1) as f64).clamp(0.0, (KNOTS - 1) as f64);
    let k = (at as usize).min(KNOTS - 2);
    [(k, 1.0 - (at - k as f64)), (k + 1, at - k as f64)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_and_its_inverse_agree_and_slopes_are_derivatives() {
        let mut knots = [0.0; KNOTS];
        (0..KNOTS).for_each(|k| knots[k] = 0.1 * (0.7 * k as f64).sin());
        for curve in [
            ReadingCurve::new([0.0; 3], Some(Transfer::Linear), [0.0; KNOTS]),
            ReadingCurve::new([0.0; 3], Some(Transfer::Gamma(2.2)), knots),
            ReadingCurve::default(),
        ] {
            for i in 0..60 {
                let x = -6.3 + 0.1 * f64::from(i);
                let (w, slope) = curve.light(x);
                let (back, same_slope) = curve.reading(w);
                assert!((back - x).abs() < 1e-9, "{x}: {back}");
                assert!((slope - same_slope).abs() < 1e-6 * slope, "{x}: {slope} {same_slope}");
            }
        }
        // A linear camera read as sRGB: the light is the coded value.
        let linear = ReadingCurve::new([0.0; 3], Some(Transfer::Linear), [0.0; KNOTS]);
        let x = Transfer::Srgb.to_linear(0.5).ln();
        assert!((linear.light(x).0 - 0.5f64.ln()).abs() < 1e-3);
    }

    #[test]
    fn hats_interpolate() {
        for x in [-7.0, -6.5, -3.3, -0.2, 0.0, 0.4] {
            let sum: f64 = hats(x).iter().map(|(_, weight)| weight).sum();
            assert!((sum - 1.0).abs() < 1e-12);
        }
        assert_eq!(hats(0.0)[1], (KNOTS - 1, 1.0));
    }
}
