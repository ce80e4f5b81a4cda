//! The same points in two frames after one method: scatter plot of log light, and its width.
//!
//! ```text
//! scatter = 1.4826 · median |d − median d| / √2,  d = ln a − ln b   light of a point in two frames
//! ```
//!
//! also divided by the spread between points, since a loss of contrast reduces both. The median of
//! d, the difference between the frames, is reported separately.

use crate::image::LinearImage;
use crate::plot::{Canvas, ticks};
use crate::products::display::{BANDS, INK, SOFT};
use crate::stats::{lower_quantile, median, robust_std};

/// Pixels of the same points in this frame and in another.
pub type Pairs = Vec<((f64, f64), (f64, f64))>;

/// Height of a scatter plot with its axes (px).
pub const HEIGHT: i64 = 244;
const SIDE: i64 = 176;
/// Half width of the square over which light is averaged (px of the downscaled image).
const REACH: i64 = 2;
/// Maximum number of points drawn.
const MAX_DRAWN: usize = 900;

/// Raw images and limits that decide whether a pixel is neither too dark nor clipped.
pub struct Usable<'u> {
    here: &'u LinearImage,
    others: Vec<&'u LinearImage>,
    dark_below: f32,
    clipped_above: f32,
}

pub fn usable<'u>(
    here: &'u LinearImage,
    others: impl Iterator<Item = &'u LinearImage>,
    dark_below: f32,
    clipped_above: f32,
) -> Usable<'u> {
    Usable { here, others: others.collect(), dark_below, clipped_above }
}

/// Agreement of the same points between frames.
pub struct Agreement {
    /// log light in this frame and in the other, and the band
    points: Vec<(f64, f64, usize)>,
    bands: usize,
    /// reason for a missing plot
    why_none: &'static str,
}

/// Mean of each band around a pixel; `None` beyond the edge.
fn local_mean(image: &LinearImage, (u, v): (f64, f64)) -> Option<[f32; 3]> {
    let (x, y) = (u.round() as i64, v.round() as i64);
    if x < REACH || y < REACH || x + REACH >= image.width as i64 || y + REACH >= image.height as i64
    {
        return None;
    }
    let mut sum = [0.0; 3];
    for row in y - REACH..=y + REACH {
        for column in x - REACH..=x + REACH {
            image.at(column as usize, row as usize).iter().zip(&mut sum).for_each(|(v, s)| *s += v);
        }
    }
    let count = ((2 * REACH + 1) * (2 * REACH + 1)) as f32;
    Some(sum.map(|s| s / count))
}

impl Agreement {
    /// `scale` is the ratio of pixels of `here` to pixels of the keypoints; `apply` processes
    /// another frame.
    pub fn of<F>(
        here: &LinearImage,
        scale: f64,
        usable: &Usable<'_>,
        others: &[(F, Pairs)],
        apply: impl Fn(&F) -> LinearImage,
    ) -> Self {
        let bands = here.bands;
        let mut points = Vec::new();
        // The centre of the first pixel is (0, 0) at every size.
        let small = |(u, v): (f64, f64)| ((u + 0.5) * scale - 0.5, (v + 0.5) * scale - 0.5);
        for ((other, pairs), raw_there) in others.iter().zip(&usable.others) {
            let there = apply(other);
            for (a, b) in pairs {
                let (a, b) = (small(*a), small(*b));
                let measured = |raw: &LinearImage, at| {
                    local_mean(raw, at).filter(|p| {
                        p[..bands]
                            .iter()
                            .all(|v| (usable.dark_below..usable.clipped_above).contains(v))
                    })
                };
                if measured(usable.here, a).is_none() || measured(raw_there, b).is_none() {
                    continue;
                }
                if let (Some(p), Some(q)) = (local_mean(here, a), local_mean(&there, b)) {
                    let logs = (0..bands)
                        .map(|band| (f64::from(p[band]).ln(), f64::from(q[band]).ln(), band));
                    points.extend(logs.filter(|(p, q, _)| p.is_finite() && q.is_finite()));
                }
            }
        }
        let why_none = if others.is_empty() {
            "no overlap with other frames"
        } else {
            "points are too dark or clipped"
        };
        Self { points, bands, why_none }
    }

    /// Scatter (log light), scatter over the spread between points, and the difference between the
    /// frames (log light); medians over bands.
    pub fn numbers(&self) -> Option<(f64, f64, f64)> {
        let of_band = |band: usize| {
            let points: Vec<_> = self.points.iter().filter(|p| p.2 == band).collect();
            if points.len() < 8 {
                return None;
            }
            let differences: Vec<f64> = points.iter().map(|(p, q, _)| p - q).collect();
            let (shift, width) = median_and_std(&differences);
            let (_, spread) =
                median_and_std(&points.iter().map(|(p, q, _)| (p + q) / 2.0).collect::<Vec<_>>());
            let scatter = width / std::f64::consts::SQRT_2;
            Some((scatter, scatter / spread.max(1e-9), shift.abs()))
        };
        let all: Option<Vec<_>> = (0..self.bands).map(of_band).collect();
        let all = all?;
        let over_bands =
            |f: fn(&(f64, f64, f64)) -> f64| median(&all.iter().map(f).collect::<Vec<_>>());
        Some((over_bands(|n| n.0), over_bands(|n| n.1), over_bands(|n| n.2)))
    }

    /// Draws the plot with its upper left corner at `(x, y)` and the numbers beside it.
    pub fn draw(&self, canvas: &mut Canvas, (x, y): (i64, i64), width: i64) {
        let Some((scatter, over_spread, shift)) = self.numbers() else {
            for (i, line) in Canvas::wrapped(self.why_none, 2, width as usize).iter().enumerate() {
                canvas.text((x, y + 6 + 22 * i as i64), 2, SOFT, line);
            }
            return;
        };
        let values: Vec<f64> = self.points.iter().flat_map(|p| [p.0, p.1]).collect();
        let (low, high) = (lower_quantile(&values, 0.01), lower_quantile(&values, 0.99));
        let margin = 0.08 * (high - low).max(0.05);
        let (from, to) = (low - margin, high + margin);
        let (left, top) = (x + 58, y);
        canvas.fill((left, top), (SIDE, SIDE), [255; 3]);
        let position = |v: f64| (v - from) / (to - from) * SIDE as f64;
        for (value, label) in ticks(from, to, 3) {
            let at = position(value) as i64;
            canvas.fill((left + at, top + SIDE), (1, 4), SOFT);
            canvas.fill((left - 4, top + SIDE - at), (4, 1), SOFT);
            let wide = Canvas::text_width(&label, 2) as i64;
            canvas.text((left + at - wide / 2, top + SIDE + 8), 2, INK, &label);
            canvas.text((left - 8 - wide, top + SIDE - at - 8), 2, INK, &label);
        }
        canvas.line((left as f64, (top + SIDE) as f64), ((left + SIDE) as f64, top as f64), SOFT);
        let step = self.points.len().div_ceil(MAX_DRAWN).max(1);
        for (p, q, band) in self
            .points
            .iter()
            .step_by(step)
            .filter(|(p, q, _)| (from..to).contains(p) && (from..to).contains(q))
        {
            let color = if self.bands == 1 { INK } else { BANDS[*band] };
            canvas.fill(
                (left + position(*p) as i64 - 1, top + SIDE - position(*q) as i64 - 1),
                (2, 2),
                color,
            );
        }
        for k in 0..SIDE {
            [(left + k, top), (left + k, top + SIDE), (left, top + k), (left + SIDE, top + k)]
                .iter()
                .for_each(|(x, y)| canvas.set(*x, *y, SOFT));
        }
        canvas.text((x, top + SIDE + 30), 2, SOFT, "ln light: this frame right, others up");
        let numbers = [
            ("scatter", format!("{scatter:.3}")),
            ("over spread", format!("{over_spread:.2}")),
            ("frames differ", format!("{shift:.3}")),
            ("values", self.points.len().to_string()),
        ];
        let column = left + SIDE + 16;
        for (i, (name, value)) in numbers.iter().enumerate() {
            canvas.text((column, top + 4 + 42 * i as i64), 2, SOFT, name);
            canvas.text((column, top + 24 + 42 * i as i64), 2, INK, value);
        }
    }
}

/// Median and robust standard deviation about it.
fn median_and_std(values: &[f64]) -> (f64, f64) {
    let middle = median(values);
    (middle, robust_std(&values.iter().map(|v| v - middle).collect::<Vec<_>>()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two frames that differ by a factor and by a scatter of known width. A method that halves the
    /// contrast halves the scatter, but not scatter over spread.
    #[test]
    fn scatter_is_relative_to_contrast() {
        let points = |contrast: f64| {
            let random = |k: usize, seed: f64| ((k as f64 * seed).sin() * 43_758.545_3).fract();
            let point = |k: usize| {
                let reflectance = random(k, 3.711);
                (
                    contrast * (reflectance + 0.1 * random(k, 12.9898)),
                    contrast * (reflectance + 0.1 * random(k, 78.233)) + 0.3,
                    0,
                )
            };
            Agreement { points: (0..4000).map(point).collect(), bands: 1, why_none: "" }
        };
        let (whole, half) =
            (points(1.0).numbers().expect("many"), points(0.5).numbers().expect("many"));
        assert!((whole.2 - 0.3).abs() < 0.02, "{whole:?}");
        assert!(
            (whole.0 / half.0 - 2.0).abs() < 0.1 && (whole.1 / half.1 - 1.0).abs() < 0.05,
            "{whole:?} {half:?}"
        );
        assert_eq!(
            Agreement { points: Vec::new(), bands: 3, why_none: "no overlap" }.numbers(),
            None
        );
    }
}
