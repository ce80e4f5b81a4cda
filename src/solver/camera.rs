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
use crate::model::Metered;

/// Cubic B-splines that R is made of, evenly spaced over log light.
pub const SPLINES: usize = 16;
/// Log light where R begins; it ends at full scale. Darker values are not sampled.
const DARKEST: f64 = -6.5;
/// Segments of the tabulated curve, which reaches this far beyond the splines (log light).
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
    /// what the camera meters of each frame, where the camera's law is solved for
    pub law: Option<&'s [Metered]>,
    /// V
    pub vignetting: bool,
    /// the coefficients of R
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
    /// those of the splines of R, beside `transfer`
    pub coefficients: [f64; SPLINES],
    /// w at evenly spaced x, increasing
    table: Vec<f64>,
}

impl Default for ReadingCurve {
    fn default() -> Self {
        Self::new([0.0; 3], None, [0.0; SPLINES])
    }
}

impl ReadingCurve {
    /// A curve; made monotone where R is not.
    pub fn new(
        black_level: Bands,
        transfer: Option<Transfer>,
        coefficients: [f64; SPLINES],
    ) -> Self {
        let correction = |x: f64| {
            let by_transfer = transfer
                .map_or(0.0, |t| x - t.to_linear(srgb_encode(x.exp())).max(f64::MIN_POSITIVE).ln());
            by_transfer + splines(x).iter().map(|(k, value)| value * coefficients[*k]).sum::<f64>()
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
        Self { black_level, transfer, coefficients, table }
    }

    /// Whether it changes nothing.
    pub fn is_identity(&self) -> bool {
        self.black_level == [0.0; 3] && self.is_straight()
    }

    /// Whether the assumed transfer curve is right.
    pub fn is_straight(&self) -> bool {
        self.transfer.is_none() && self.coefficients == [0.0; SPLINES]
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
    pub fn with(&self, black_level: Bands, coefficients: [f64; SPLINES]) -> Self {
        if black_level == self.black_level && coefficients == self.coefficients {
            return self.clone();
        }
        Self::new(black_level, self.transfer, coefficients)
    }
}

/// Values of the cubic B-splines that are not 0 at a reading, each with its number. R is smooth, as
/// a camera's curve is: straight pieces would miss a contrast curve by as much as the noise.
pub fn splines(x: f64) -> [(usize, f64); 4] {
    let segments = (SPLINES - 3) as f64;
    let at = ((x - DARKEST) / -DARKEST * segments).clamp(0.0, segments);
    let k = (at as usize).min(SPLINES - 4);
    let t = at - k as f64;
    let (t2, t3) = (t * t, t * t * t);
    [
        (k, (1.0 - t).powi(3) / 6.0),
        (k + 1, (4.0 - 6.0 * t2 + 3.0 * t3) / 6.0),
        (k + 2, (1.0 + 3.0 * t + 3.0 * t2 - 3.0 * t3) / 6.0),
        (k + 3, t3 / 6.0),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_and_its_inverse_agree_and_slopes_are_derivatives() {
        let mut coefficients = [0.0; SPLINES];
        (0..SPLINES).for_each(|k| coefficients[k] = 0.1 * (0.7 * k as f64).sin());
        for curve in [
            ReadingCurve::new([0.0; 3], Some(Transfer::Linear), [0.0; SPLINES]),
            ReadingCurve::new([0.0; 3], Some(Transfer::Gamma(2.2)), coefficients),
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
        let linear = ReadingCurve::new([0.0; 3], Some(Transfer::Linear), [0.0; SPLINES]);
        let x = Transfer::Srgb.to_linear(0.5).ln();
        assert!((linear.light(x).0 - 0.5f64.ln()).abs() < 1e-3);
    }

    #[test]
    fn splines_add_up_to_one_and_are_a_smooth_curve() {
        for x in [-7.0, -6.5, -3.3, -0.2, 0.0, 0.4] {
            let sum: f64 = splines(x).iter().map(|(_, value)| value).sum();
            assert!((sum - 1.0).abs() < 1e-12);
        }
        assert_eq!(splines(0.0)[3].0, SPLINES - 1);
        // Coefficients along a parabola make a parabola: the same second difference everywhere.
        let sum =
            |x: f64| splines(x).iter().map(|(k, value)| value * (*k as f64).powi(2)).sum::<f64>();
        let bend = |x: f64| sum(x - 0.1) - 2.0 * sum(x) + sum(x + 0.1);
        for x in [-6.0, -3.77, -3.5, -1.2, -0.3] {
            assert!((bend(x) - bend(-2.0)).abs() < 1e-9, "{x}: {} {}", bend(x), bend(-2.0));
        }
    }
}
