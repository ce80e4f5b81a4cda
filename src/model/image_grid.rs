//! A grid of regions over the image plane, and values on it.

use serde::{Deserialize, Serialize};

/// Regions of the image plane.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ImageGrid {
    /// range of x/z in the image plane that the grid covers
    pub x: [f64; 2],
    /// range of y/z
    pub y: [f64; 2],
    /// regions across
    pub columns: usize,
    /// regions down
    pub rows: usize,
}

impl ImageGrid {
    /// Whether values by band and region can be evaluated.
    ///
    /// # Errors
    /// What is needed, in a few words.
    pub fn check<'v>(
        &self,
        parts: impl IntoIterator<Item = &'v Vec<Vec<f64>>>,
        bands: usize,
    ) -> Result<(), String> {
        let Self { columns, rows, x, y } = *self;
        let regions = columns.checked_mul(rows);
        let is_whole = |values: &Vec<Vec<f64>>| {
            let is_finite = |v: &Vec<f64>| v.iter().all(|v| v.is_finite());
            values.len() == bands && values.iter().all(|v| Some(v.len()) == regions && is_finite(v))
        };
        if columns < 2 || rows < 2 || !parts.into_iter().all(is_whole) {
            return Err(format!("{bands} bands of {columns} × {rows} finite numbers"));
        }
        if x[0] >= x[1] || y[0] >= y[1] {
            return Err("x and y from a smaller number to a larger".into());
        }
        Ok(())
    }

    /// Regions around a point of the image plane with their weights.
    pub fn around(&self, x: f64, y: f64) -> [(usize, f64); 16] {
        let (columns, rows) = (taps(x, self.x, self.columns), taps(y, self.y, self.rows));
        std::array::from_fn(|k| {
            let ((row, down), (column, across)) = (rows[k / 4], columns[k % 4]);
            (row * self.columns + column, across * down)
        })
    }
}

/// Four regions along an axis and their weights: cubic (Catmull and Rom) between the centres, as
/// light has no edges where a grid has nodes; straight on beyond the outermost ones, up to a
/// region.
fn taps(v: f64, [from, to]: [f64; 2], count: usize) -> [(usize, f64); 4] {
    let last = count - 1;
    let at = (v - from) / (to - from).max(1e-9) * count as f64 - 0.5;
    let at = at.clamp(-1.0, last as f64 + 1.0);
    let i = (at.max(0.0) as usize).min(last - 1);
    let t = at - i as f64;
    if !(0.0..=1.0).contains(&t) {
        return [(i, 1.0 - t), (i + 1, t), (i, 0.0), (i, 0.0)];
    }
    let cubic = [
        t * (-0.5 + t * (1.0 - 0.5 * t)),
        1.0 + t * t * (1.5 * t - 2.5),
        t * (0.5 + t * (2.0 - 1.5 * t)),
        t * t * (0.5 * t - 0.5),
    ];
    let [mut before, mut near, mut next, mut after] = cubic;
    // Before the first centre and after the last, the line goes straight on.
    if i == 0 {
        (near, next) = (near + 2.0 * before, next - before);
        before = 0.0;
    }
    if i + 1 == last {
        (next, near) = (next + 2.0 * after, near - after);
        after = 0.0;
    }
    [(i.saturating_sub(1), before), (i, near), (i + 1, next), ((i + 2).min(last), after)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn between_regions_a_parabola_has_no_kinks() {
        let count = 9;
        let value = |at: f64| 0.3 * at * at - at;
        let interpolated = |at: f64| {
            let v = (at + 0.5) / count as f64;
            taps(v, [0.0, 1.0], count).iter().map(|(i, w)| w * value(*i as f64)).sum::<f64>()
        };
        for k in 10..70 {
            let at = 0.1 * f64::from(k);
            assert!((interpolated(at) - value(at)).abs() < 1e-9, "{at}");
        }
    }
}
