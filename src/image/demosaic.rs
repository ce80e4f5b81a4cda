//! Bayer mosaic → three bands by the filters of Malvar, He and Cutler (ICASSP 2004, the paper's
//! reference 10).
//!
//! In: one linear value per pixel. Out: three. The 5×5 filters correct bilinear interpolation with
//! the Laplacian of the measured band. That assumes similar bands. Under water red is ten times
//! dimmer than green, and the noise and edges of green would leak into it; pass two therefore
//! demosaics *after* correcting the mosaic. Negative values are kept, so that noise stays unbiased.
//! Borders are mirrored about the edge pixel, which preserves the Bayer pattern.

use super::{interleaved, vectorised};

/// Bayer patterns, named by the colours of the pixels (0,0), (1,0), (0,1) and (1,1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BayerPattern {
    /// red at (0,0)
    Rggb,
    /// blue at (0,0)
    Bggr,
    /// green at (0,0), blue at (1,0)
    Gbrg,
    /// green at (0,0), red at (1,0)
    Grbg,
}

impl BayerPattern {
    /// Band (0 red, 1 green, 2 blue) of a pixel.
    pub fn band(self, x: usize, y: usize) -> usize {
        let (red_row, red_column) = self.red();
        usize::from(y % 2 != red_row) + usize::from(x % 2 != red_column)
    }

    /// Row and column of the red pixel.
    fn red(self) -> (usize, usize) {
        match self {
            Self::Rggb => (0, 0),
            Self::Bggr => (1, 1),
            Self::Gbrg => (1, 0),
            Self::Grbg => (0, 1),
        }
    }
}

const MARGIN: usize = 2;
/// Mosaic rows that one output row depends on.
const ROWS: usize = 2 * MARGIN + 1;

/// Streaming demosaicing: rows go in one by one, and output follows two rows behind, so that five
/// rows are held in memory.
pub struct Demosaic {
    width: usize,
    height: usize,
    pattern: BayerPattern,
    /// ring buffer of the last five rows with margins
    rows: [Vec<f32>; ROWS],
    pushed: usize,
    color: Vec<f32>,
}

/// Index `i` mirrored about the first and the last of `n`.
fn mirrored(i: isize, n: usize) -> usize {
    let last = n as isize - 1;
    (last - (last - i.abs()).abs()) as usize
}

impl Demosaic {
    /// For images of at least 3×3 pixels.
    pub fn new(width: usize, height: usize, pattern: BayerPattern) -> Self {
        let row = || vec![0.0; width + 2 * MARGIN];
        Self {
            width,
            height,
            pattern,
            rows: std::array::from_fn(|_| row()),
            pushed: 0,
            color: vec![0.0; 3 * width],
        }
    }

    /// Adds the next row of the mosaic; calls `emit` with every output row, band after band,
    /// that it completes.
    pub fn push(&mut self, source: &[f32], mut emit: impl FnMut(&mut [f32])) {
        let row = &mut self.rows[self.pushed % ROWS];
        row[MARGIN..MARGIN + self.width].copy_from_slice(source);
        for x in (0..MARGIN).chain(MARGIN + self.width..self.width + 2 * MARGIN) {
            row[x] = source[mirrored(x as isize - MARGIN as isize, self.width)];
        }
        self.pushed += 1;
        let complete = if self.pushed == self.height {
            self.pushed
        } else {
            self.pushed.saturating_sub(MARGIN)
        };
        for y in self.pushed.saturating_sub(1 + MARGIN)..complete {
            let rows = std::array::from_fn(|k| {
                self.rows[mirrored((y + k) as isize - MARGIN as isize, self.height) % ROWS]
                    .as_slice()
            });
            let (red_row, red_column) = self.pattern.red();
            if y % 2 == red_row {
                vectorised(
                    #[inline(always)]
                    || color_row::<true>(rows, red_column, &mut self.color),
                );
            } else {
                vectorised(
                    #[inline(always)]
                    || color_row::<false>(rows, red_column, &mut self.color),
                );
            }
            emit(&mut self.color);
        }
    }
}

/// One output row, band after band, from five mosaic rows with margins. Both kinds of pixels are
/// computed everywhere, as that vectorises.
#[inline(always)]
fn color_row<const RED_ROW: bool>(rows: [&[f32]; ROWS], red_column: usize, out: &mut [f32]) {
    let width = out.len() / 3;
    // Columns of a row, shifted.
    let from = |row: usize, shift: usize| &rows[row][shift..shift + width];
    let (n2, s2) = (from(0, 2), from(4, 2));
    let (n1_w, n1, n1_e) = (from(1, 1), from(1, 2), from(1, 3));
    let (s1_w, s1, s1_e) = (from(3, 1), from(3, 2), from(3, 3));
    let (w2, w1, mid, e1, e2) = (from(2, 0), from(2, 1), from(2, 2), from(2, 3), from(2, 4));
    let (red, rest) = out.split_at_mut(width);
    let (green, blue) = rest.split_at_mut(width);
    let (own, other) = if RED_ROW { (red, blue) } else { (blue, red) };
    let (own, green, other) = (&mut own[..width], &mut green[..width], &mut other[..width]);
    // Parity of the columns that hold red or blue.
    let colored = if RED_ROW { red_column } else { 1 - red_column };
    for x in 0..width {
        let c = mid[x];
        let (horizontal, vertical) = (w1[x] + e1[x], n1[x] + s1[x]);
        let (far_h, far_v) = (w2[x] + e2[x], n2[x] + s2[x]);
        let diagonal = n1_w[x] + n1_e[x] + s1_w[x] + s1_e[x];
        // At red or blue pixels: green from the cross, the opposite colour from the diagonals.
        let cross = (4.0 * c + 2.0 * (horizontal + vertical) - far_h - far_v) * 0.125;
        let opposite = (6.0 * c + 2.0 * diagonal - 1.5 * (far_h + far_v)) * 0.125;
        // At green pixels: the other colour of this row, and that of this column.
        let of_row = (5.0 * c + 4.0 * horizontal - diagonal - far_h + 0.5 * far_v) * 0.125;
        let of_column = (5.0 * c + 4.0 * vertical - diagonal - far_v + 0.5 * far_h) * 0.125;
        let is_colored = x % 2 == colored;
        own[x] = if is_colored { c } else { of_row };
        green[x] = if is_colored { cross } else { c };
        other[x] = if is_colored { opposite } else { of_column };
    }
}

/// Demosaics an image of `height × width` pixels, at least 3×3, into three bands.
pub fn demosaic(mosaic: &[f32], width: usize, height: usize, pattern: BayerPattern) -> Vec<f32> {
    let mut out = Vec::with_capacity(3 * mosaic.len());
    let mut rows = Demosaic::new(width, height, pattern);
    for row in mosaic.chunks_exact(width) {
        rows.push(row, |color| out.extend(interleaved(color, 3)));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_colour_gradient_is_reproduced_for_every_pattern() {
        let (w, h) = (24, 18);
        let truth = |x: usize, y: usize| {
            [0.2 + 0.01 * x as f32, 0.5 - 0.008 * y as f32, 0.3 + 0.004 * (x + y) as f32]
        };
        for pattern in
            [BayerPattern::Rggb, BayerPattern::Bggr, BayerPattern::Gbrg, BayerPattern::Grbg]
        {
            let mosaic: Vec<f32> = (0..w * h)
                .map(|i| {
                    let (x, y) = (i % w, i / w);
                    truth(x, y)[pattern.band(x, y)]
                })
                .collect();
            let rgb = demosaic(&mosaic, w, h, pattern);
            for y in 2..h - 2 {
                for x in 2..w - 2 {
                    for band in 0..3 {
                        assert!(
                            (rgb[(y * w + x) * 3 + band] - truth(x, y)[band]).abs() < 1e-5,
                            "{pattern:?} {x},{y} band {band}"
                        );
                    }
                }
            }
        }
    }
}
