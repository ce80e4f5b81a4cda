//! Values on a coarse grid over an image, bilinear in between, given row by row.
//!
//! A row of nodes is spread over its pixels once, and the rows of pixels down to the next one are
//! mixtures of two such rows: a multiplication and an addition per value. In rows the bands follow
//! one another, so that loops vectorise.

use crate::image::demosaic::BayerPattern;
use crate::image::vectorised;

/// Values per band on nodes every `step` pixels; the last row and column of nodes lie on the
/// edge of the image or beyond it.
pub struct NodeGrid {
    /// (px)
    pub step: usize,
    /// nodes across
    pub columns: usize,
    /// nodes down
    pub rows: usize,
    /// values per node
    pub bands: usize,
    /// `rows × columns × bands`
    pub values: Vec<f32>,
}

impl NodeGrid {
    /// All of one value.
    pub fn new((width, height): (usize, usize), step: usize, bands: usize, value: f32) -> Self {
        let (columns, rows) = ((width - 1).div_ceil(step) + 1, (height - 1).div_ceil(step) + 1);
        Self { step, columns, rows, bands, values: vec![value; columns * rows * bands] }
    }

    /// The values of a node; beyond the last row or column, those of the last.
    pub fn at(&self, row: usize, column: usize) -> &[f32] {
        &self.values
            [(row.min(self.rows - 1) * self.columns + column.min(self.columns - 1)) * self.bands..]
            [..self.bands]
    }

    /// The same, to be written.
    pub fn at_mut(&mut self, row: usize, column: usize) -> &mut [f32] {
        &mut self.values[(row * self.columns + column) * self.bands..][..self.bands]
    }

    /// Least and largest of one band at the corners of the cell whose first corner this is; `None`
    /// where a corner has no value.
    pub fn range(&self, row: usize, column: usize, band: usize) -> Option<(f32, f32)> {
        let corners =
            [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(r, c)| self.at(row + r, column + c)[band]);
        let least_and_most = || {
            corners
                .iter()
                .fold((f32::INFINITY, f32::NEG_INFINITY), |(l, m), v| (l.min(*v), m.max(*v)))
        };
        corners.iter().all(|v| v.is_finite()).then(least_and_most)
    }
}

/// Linear between two values.
#[inline(always)]
pub fn between(a: f32, b: f32, share: f32) -> f32 {
    a + (b - a) * share
}

/// Interpolates the rows of an image from top to bottom, band after band.
pub struct RowWalker<'n> {
    nodes: &'n NodeGrid,
    width: usize,
    mosaic: Option<BayerPattern>,
    /// the row of nodes that `above` was spread from
    top: Option<usize>,
    /// by parity of the pixels' row: it decides the bands of a mosaic
    above: [Vec<f32>; 2],
    below: [Vec<f32>; 2],
}

impl<'n> RowWalker<'n> {
    /// For images `width` pixels wide; a mosaic's pixels take the value of their own band.
    pub fn new(nodes: &'n NodeGrid, width: usize, mosaic: Option<BayerPattern>) -> Self {
        let bands = if mosaic.is_some() { 1 } else { nodes.bands };
        let rows = || {
            std::array::from_fn(|parity| {
                if parity == 0 || mosaic.is_some() { vec![0.0; width * bands] } else { Vec::new() }
            })
        };
        Self { nodes, width, mosaic, top: None, above: rows(), below: rows() }
    }

    /// Values of row `y`; rows must be requested from top to bottom.
    pub fn row(&mut self, y: usize, out: &mut [f32]) {
        let (above, below, share) = self.around(y);
        out.iter_mut().zip(above).zip(below).for_each(|((v, a), b)| *v = between(*a, *b, share));
    }

    /// The rows of nodes above and below row `y`, spread over its pixels, and how far it lies from
    /// the one to the other.
    pub fn around(&mut self, y: usize) -> (&[f32], &[f32], f32) {
        let top = (y / self.nodes.step).min(self.nodes.rows.saturating_sub(2));
        if self.top != Some(top) {
            let follows = top > 0 && self.top == Some(top - 1);
            for parity in 0..if self.mosaic.is_some() { 2 } else { 1 } {
                let bands = self.bands_of_row(parity);
                if follows {
                    std::mem::swap(&mut self.above[parity], &mut self.below[parity]);
                } else {
                    self.spread(top, bands, parity, true);
                }
                self.spread(top + 1, bands, parity, false);
            }
            self.top = Some(top);
        }
        let share = (y - top * self.nodes.step) as f32 / self.nodes.step as f32;
        let parity = if self.mosaic.is_some() { y % 2 } else { 0 };
        (&self.above[parity], &self.below[parity], share)
    }

    fn spread(&mut self, row: usize, bands: Option<[usize; 2]>, parity: usize, is_above: bool) {
        let rows = if is_above { &mut self.above } else { &mut self.below };
        let (nodes, width, out) = (self.nodes, self.width, &mut rows[parity]);
        vectorised(
            #[inline(always)]
            || spread(nodes, row, bands, width, out),
        );
    }

    /// Bands of even and odd pixels of a mosaic's row.
    fn bands_of_row(&self, parity: usize) -> Option<[usize; 2]> {
        self.mosaic.map(|phase| [phase.band(0, parity), phase.band(1, parity)])
    }
}

/// One band of a row of nodes over all pixels.
#[inline(always)]
fn spread_band(nodes: &NodeGrid, row: usize, band: usize, out: &mut [f32]) {
    let (step, per_step) = (nodes.step, 1.0 / nodes.step as f32);
    for (column, cell) in out.chunks_mut(step).enumerate() {
        let (left, right) = (nodes.at(row, column)[band], nodes.at(row, column + 1)[band]);
        for (k, v) in cell.iter_mut().enumerate() {
            *v = between(left, right, k as f32 * per_step);
        }
    }
}

/// One row of nodes over all pixels.
#[inline(always)]
fn spread(
    nodes: &NodeGrid,
    row: usize,
    row_bands: Option<[usize; 2]>,
    width: usize,
    out: &mut [f32],
) {
    let (step, per_step) = (nodes.step, 1.0 / nodes.step as f32);
    for (b, of_band) in out.chunks_exact_mut(width).enumerate() {
        let [even, odd] = row_bands.unwrap_or([b; 2]);
        if even == odd {
            spread_band(nodes, row, even, of_band);
            continue;
        }
        for (column, cell) in of_band.chunks_mut(step).enumerate() {
            let (left, right) = (nodes.at(row, column), nodes.at(row, column + 1));
            // Of even and odd pixels.
            let swaps = column * step % 2 == 1;
            let bands = if swaps { [odd, even] } else { [even, odd] };
            let (from, to) = (bands.map(|band| left[band]), bands.map(|band| right[band]));
            for (k, v) in cell.iter_mut().enumerate() {
                *v = between(from[k % 2], to[k % 2], k as f32 * per_step);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plane is bilinear: it must come back everywhere, in any order of colours.
    #[test]
    fn a_plane_comes_back_at_every_pixel() {
        let (width, height) = (23, 17);
        let truth = |x: usize, y: usize, band: usize| {
            1.0 + 0.1 * x as f32 - 0.05 * y as f32 + 10.0 * band as f32
        };
        let mut nodes = NodeGrid::new((width, height), 5, 3, 0.0);
        for row in 0..nodes.rows {
            for column in 0..nodes.columns {
                nodes
                    .at_mut(row, column)
                    .iter_mut()
                    .enumerate()
                    .for_each(|(b, v)| *v = truth(5 * column, 5 * row, b));
            }
        }
        for mosaic in [None, Some(BayerPattern::Gbrg)] {
            let stored = if mosaic.is_some() { 1 } else { 3 };
            let mut walk = RowWalker::new(&nodes, width, mosaic);
            let mut row = vec![0.0; width * stored];
            for y in 0..height {
                walk.row(y, &mut row);
                for (i, v) in row.iter().enumerate() {
                    let (x, band) = (i % width, mosaic.map_or(i / width, |phase| phase.band(i, y)));
                    assert!((v - truth(x, y, band)).abs() < 1e-4, "{mosaic:?} {x},{y} band {band}");
                }
            }
        }
    }
}
