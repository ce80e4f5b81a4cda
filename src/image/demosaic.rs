//! Bayer mosaic → three bands by the filters of Malvar, He and Cutler (ICASSP 2004, the paper's
//! reference 10).
//!
//! In: one linear value per pixel. Out: three. The 5×5 filters correct bilinear interpolation with
//! the Laplacian of the measured band. That assumes similar bands. Under water red is ten times
//! dimmer than green, and the noise and edges of green would leak into it; pass two therefore
//! demosaics *after* correcting the mosaic. Negative values are kept, so that noise stays unbiased.
//! Borders are mirrored about the edge pixel, which preserves the Bayer pattern.

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

    /// Adds the next row of the mosaic; calls `emit` with every output row that it completes.
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
                color_row::<true>(rows, red_column, &mut self.color);
            } else {
                color_row::<false>(rows, red_column, &mut self.color);
            }
            emit(&mut self.color);
        }
    }
}

/// One output row from five mosaic rows with margins.
fn color_row<const RED_ROW: bool>(rows: [&[f32]; ROWS], red_column: usize, out: &mut [f32]) {
    let [n2, n1, mid, s1, s2] = rows;
    let sums = |x: usize| {
        // Slices of constant length: one bounds check each.
        let (n1, mid, s1) = (&n1[x..x + ROWS], &mid[x..x + ROWS], &s1[x..x + ROWS]);
        let (horizontal, vertical) = (mid[1] + mid[3], n1[2] + s1[2]);
        let (far_h, far_v) = (mid[0] + mid[4], n2[x + 2] + s2[x + 2]);
        (mid[2], horizontal, vertical, far_h, far_v, n1[1] + n1[3] + s1[1] + s1[3])
    };
    // At red or blue pixels: green from the cross, the opposite colour from the diagonals.
    let on_color = |x: usize| {
        let (c, horizontal, vertical, far_h, far_v, diagonal) = sums(x);
        let g = (4.0 * c + 2.0 * (horizontal + vertical) - far_h - far_v) * 0.125;
        let opposite = (6.0 * c + 2.0 * diagonal - 1.5 * (far_h + far_v)) * 0.125;
        if RED_ROW { [c, g, opposite] } else { [opposite, g, c] }
    };
    // At green pixels: the other colour of this row, and that of this column.
    let on_green = |x: usize| {
        let (c, horizontal, vertical, far_h, far_v, diagonal) = sums(x);
        let of_row = (5.0 * c + 4.0 * horizontal - diagonal - far_h + 0.5 * far_v) * 0.125;
        let of_column = (5.0 * c + 4.0 * vertical - diagonal - far_v + 0.5 * far_h) * 0.125;
        if RED_ROW { [of_row, c, of_column] } else { [of_column, c, of_row] }
    };
    // Whether column 0 of this row is red or blue.
    let color_first = (red_column == 0) == RED_ROW;
    for (pair, rgb) in out.chunks_mut(6).enumerate() {
        let x = 2 * pair;
        rgb[..3].copy_from_slice(&if color_first { on_color(x) } else { on_green(x) });
        if rgb.len() == 6 {
            rgb[3..].copy_from_slice(&if color_first { on_green(x + 1) } else { on_color(x + 1) });
        }
    }
}

/// Demosaics an image of `height × width` pixels, at least 3×3, into three bands.
pub fn demosaic(mosaic: &[f32], width: usize, height: usize, pattern: BayerPattern) -> Vec<f32> {
    let mut out = Vec::with_capacity(3 * mosaic.len());
    let mut rows = Demosaic::new(width, height, pattern);
    for row in mosaic.chunks_exact(width) {
        rows.push(row, |color| out.extend_from_slice(color));
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
