//! Same points in two frames after one method: a scatter of log light, and how wide it is.
//!
//! ```text
//! scatter = 1.4826 · median |d − median d| / √2,  d = ln a − ln b      light of one point in two frames
//! ```
//!
//! divided by the spread between points, as contrast that is lost lowers both. The median of d is
//! the frames' difference as a whole, and is said apart.

use super::{INK, Looked, SOFT};
use crate::image::LinearImage;
use crate::plot::{Canvas, ticks};

/// Pixels of points in this frame and in another.
pub type Pairs = Vec<((f64, f64), (f64, f64))>;

/// Height of a scatter with its axes [px].
pub const HEIGHT: i64 = 244;
const SIDE: i64 = 176;
/// Light is taken as the mean over this many pixels to each side, at the methods' size.
const REACH: i64 = 2;
/// Points drawn, at most.
const MOST_DRAWN: usize = 900;
const BANDS: [[u8; 3]; 3] = [[192, 48, 40], [31, 128, 68], [42, 95, 192]];

/// Whether a place's raw light is a measurement, in this frame and in others.
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

/// How well two frames agree.
pub struct Agreement {
    /// log light here and there, and the band
    points: Vec<(f64, f64, usize)>,
    bands: usize,
    /// what was wrong, where there is nothing to draw
    why_none: &'static str,
}

/// Mean of each band around a place; `None` over the edge.
fn pooled(image: &LinearImage, (u, v): (f64, f64)) -> Option<[f32; 3]> {
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
    /// `scale` takes pixels of the picture to those of `here`; `shown` makes the other frames'
    /// pictures.
    pub fn of(
        here: &LinearImage,
        scale: f64,
        usable: &Usable<'_>,
        others: &[(&Looked, Pairs)],
        shown: impl Fn(&Looked) -> LinearImage,
    ) -> Self {
        let bands = here.bands;
        let mut points = Vec::new();
        // The centre of the first pixel is (0, 0) at every size.
        let small = |(u, v): (f64, f64)| ((u + 0.5) * scale - 0.5, (v + 0.5) * scale - 0.5);
        for ((other, pairs), raw_there) in others.iter().zip(&usable.others) {
            let there = shown(other);
            for (a, b) in pairs {
                let (a, b) = (small(*a), small(*b));
                let measured = |raw: &LinearImage, at| {
                    pooled(raw, at).filter(|p| {
                        p[..bands]
                            .iter()
                            .all(|v| (usable.dark_below..usable.clipped_above).contains(v))
                    })
                };
                if measured(usable.here, a).is_none() || measured(raw_there, b).is_none() {
                    continue;
                }
                if let (Some(p), Some(q)) = (pooled(here, a), pooled(&there, b)) {
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

    /// Scatter, over the spread between points, and the whole frames' difference; medians over
    /// bands.
    pub fn numbers(&self) -> Option<(f64, f64, f64)> {
        let of_band = |band: usize| {
            let points: Vec<_> = self.points.iter().filter(|p| p.2 == band).collect();
            if points.len() < 8 {
                return None;
            }
            let differences: Vec<f64> = points.iter().map(|(p, q, _)| p - q).collect();
            let (shift, width) = robust(&differences);
            let (_, spread) =
                robust(&points.iter().map(|(p, q, _)| (p + q) / 2.0).collect::<Vec<_>>());
            let scatter = width / std::f64::consts::SQRT_2;
            Some((scatter, scatter / spread.max(1e-9), shift.abs()))
        };
        let all: Option<Vec<_>> = (0..self.bands).map(of_band).collect();
        let all = all?;
        let middle = |f: fn(&(f64, f64, f64)) -> f64| median(all.iter().map(f).collect());
        Some((middle(|n| n.0), middle(|n| n.1), middle(|n| n.2)))
    }

    /// Draws it with its upper left corner at a place, with words beside it.
    pub fn draw(&self, canvas: &mut Canvas, (x, y): (i64, i64), width: i64) {
        let Some((scatter, over_spread, shift)) = self.numbers() else {
            for (i, line) in Canvas::wrapped(self.why_none, 2, width as usize).iter().enumerate() {
                canvas.text((x, y + 6 + 22 * i as i64), 2, SOFT, line);
            }
            return;
        };
        let mut values: Vec<f64> = self.points.iter().flat_map(|p| [p.0, p.1]).collect();
        values.sort_by(f64::total_cmp);
        let at = |share: f64| values[((values.len() - 1) as f64 * share) as usize];
        let room = 0.08 * (at(0.99) - at(0.01)).max(0.05);
        let (from, to) = (at(0.01) - room, at(0.99) + room);
        let (left, top) = (x + 58, y);
        canvas.fill((left, top), (SIDE, SIDE), [255; 3]);
        let place = |v: f64| (v - from) / (to - from) * SIDE as f64;
        for (value, word) in ticks(from, to, 3) {
            let at = place(value) as i64;
            canvas.fill((left + at, top + SIDE), (1, 4), SOFT);
            canvas.fill((left - 4, top + SIDE - at), (4, 1), SOFT);
            let wide = Canvas::text_width(&word, 2) as i64;
            canvas.text((left + at - wide / 2, top + SIDE + 8), 2, INK, &word);
            canvas.text((left - 8 - wide, top + SIDE - at - 8), 2, INK, &word);
        }
        canvas.line((left as f64, (top + SIDE) as f64), ((left + SIDE) as f64, top as f64), SOFT);
        let step = self.points.len().div_ceil(MOST_DRAWN).max(1);
        for (p, q, band) in self
            .points
            .iter()
            .step_by(step)
            .filter(|(p, q, _)| (from..to).contains(p) && (from..to).contains(q))
        {
            let color = if self.bands == 1 { INK } else { BANDS[*band] };
            canvas.fill(
                (left + place(*p) as i64 - 1, top + SIDE - place(*q) as i64 - 1),
                (2, 2),
                color,
            );
        }
        for k in 0..SIDE {
            [(left + k, top), (left + k, top + SIDE), (left, top + k), (left + SIDE, top + k)]
                .iter()
                .for_each(|(x, y)| canvas.set(*x, *y, SOFT));
        }
        canvas.text((x, top + SIDE + 30), 2, SOFT, "ln light: right here, up in others");
        let words = [
            ("scatter", format!("{scatter:.3}")),
            ("over spread", format!("{over_spread:.2}")),
            ("frames differ", format!("{shift:.3}")),
            ("values", self.points.len().to_string()),
        ];
        let column = left + SIDE + 16;
        for (i, (name, value)) in words.iter().enumerate() {
            canvas.text((column, top + 4 + 42 * i as i64), 2, SOFT, name);
            canvas.text((column, top + 24 + 42 * i as i64), 2, INK, value);
        }
    }
}

/// Median, and 1.4826 times the median distance from it.
fn robust(values: &[f64]) -> (f64, f64) {
    let middle = median(values.to_vec());
    (middle, 1.4826 * median(values.iter().map(|v| (v - middle).abs()).collect()))
}

fn median(mut values: Vec<f64>) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two frames that differ by a factor and by a scatter of known width; a method that takes half
    /// of the contrast away halves the scatter, but not scatter over spread.
    #[test]
    fn the_numbers_are_what_they_say() {
        let points = |contrast: f64| {
            let random = |k: usize, seed: f64| ((k as f64 * seed).sin() * 43_758.545_3).fract();
            let point = |k: usize| {
                let floor = random(k, 3.711);
                (
                    contrast * (floor + 0.1 * random(k, 12.9898)),
                    contrast * (floor + 0.1 * random(k, 78.233)) + 0.3,
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
