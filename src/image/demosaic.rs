//! Bayer mosaic → colour by Malvar, He and Cutler (ICASSP 2004, the paper's [10]).
//!
//! In: one linear value per pixel. Out: three. The 5×5 filters correct bilinear interpolation with
//! the Laplacian of the band that was measured, which is right where the bands are alike: under
//! water red is ten times dimmer than green, and green's noise and edges would end up in it. So
//! pass two demosaics *after* it has corrected the mosaic. Noise may go below 0, so that means stay
//! true. Borders are mirrored about the edge pixel, which keeps the phase.

/// The four phases: colours of the pixels (0,0) and (1,0), (0,1) and (1,1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BayerPattern {
    /// red first
    Rggb,
    /// blue first
    Bggr,
    /// green first, blue beside it
    Gbrg,
    /// green first, red beside it
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
/// Rows that one row of colour is made from.
const ROWS: usize = 2 * MARGIN + 1;

/// A mosaic that comes row by row: colour follows two rows behind, so that no more than five are
/// held.
pub struct Demosaic {
    width: usize,
    height: usize,
    phase: BayerPattern,
    /// the last five rows with their margins, by number modulo five
    rows: [Vec<f32>; ROWS],
    pushed: usize,
    color: Vec<f32>,
}

/// Index `i` mirrored about the first and the last of `n`, which keeps the phase.
fn mirrored(i: isize, n: usize) -> usize {
    let last = n as isize - 1;
    (last - (last - i.abs()).abs()) as usize
}

impl Demosaic {
    /// For pictures of at least 3×3 pixels.
    pub fn new(width: usize, height: usize, phase: BayerPattern) -> Self {
        let row = || vec![0.0; width + 2 * MARGIN];
        Self {
            width,
            height,
            phase,
            rows: std::array::from_fn(|_| row()),
            pushed: 0,
            color: vec![0.0; 3 * width],
        }
    }

    /// Takes the next row of the mosaic; hands on each row of colour that it completes.
    pub fn push(&mut self, source: &[f32], mut take: impl FnMut(&mut [f32])) {
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
            let (red_row, red_column) = self.phase.red();
            if y % 2 == red_row {
                color_row::<true>(rows, red_column, &mut self.color);
            } else {
                color_row::<false>(rows, red_column, &mut self.color);
            }
            take(&mut self.color);
        }
    }
}

/// One row of colour from five of the mosaic, with margins.
fn color_row<const RED_ROW: bool>(rows: [&[f32]; ROWS], red_column: usize, out: &mut [f32]) {
    let [n2, n1, mid, s1, s2] = rows;
    let sums = |x: usize| {
        // Slices of five: checked once each.
        let (n1, mid, s1) = (&n1[x..x + ROWS], &mid[x..x + ROWS], &s1[x..x + ROWS]);
        let (horizontal, vertical) = (mid[1] + mid[3], n1[2] + s1[2]);
        let (far_h, far_v) = (mid[0] + mid[4], n2[x + 2] + s2[x + 2]);
        (mid[2], horizontal, vertical, far_h, far_v, n1[1] + n1[3] + s1[1] + s1[3])
    };
    // on red or blue: green from the cross, the opposite colour from the diagonal
    let on_color = |x: usize| {
        let (c, horizontal, vertical, far_h, far_v, diagonal) = sums(x);
        let g = (4.0 * c + 2.0 * (horizontal + vertical) - far_h - far_v) * 0.125;
        let opposite = (6.0 * c + 2.0 * diagonal - 1.5 * (far_h + far_v)) * 0.125;
        if RED_ROW { [c, g, opposite] } else { [opposite, g, c] }
    };
    // on green: the colour of this row, and the colour of this column
    let on_green = |x: usize| {
        let (c, horizontal, vertical, far_h, far_v, diagonal) = sums(x);
        let of_row = (5.0 * c + 4.0 * horizontal - diagonal - far_h + 0.5 * far_v) * 0.125;
        let of_column = (5.0 * c + 4.0 * vertical - diagonal - far_v + 0.5 * far_h) * 0.125;
        if RED_ROW { [of_row, c, of_column] } else { [of_column, c, of_row] }
    };
    // Colours stand in the columns of red in its rows, in the other ones in the rows of blue.
    let color_first = (red_column == 0) == RED_ROW;
    for (pair, rgb) in out.chunks_mut(6).enumerate() {
        let x = 2 * pair;
        rgb[..3].copy_from_slice(&if color_first { on_color(x) } else { on_green(x) });
        if rgb.len() == 6 {
            rgb[3..].copy_from_slice(&if color_first { on_green(x + 1) } else { on_color(x + 1) });
        }
    }
}

/// Interpolates `mosaic` (`height × width`). Pictures under 3×3 are not taken.
pub fn demosaic(mosaic: &[f32], width: usize, height: usize, phase: BayerPattern) -> Vec<f32> {
    let mut out = Vec::with_capacity(3 * mosaic.len());
    let mut rows = Demosaic::new(width, height, phase);
    for row in mosaic.chunks_exact(width) {
        rows.push(row, |color| out.extend_from_slice(color));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_colour_gradient_comes_back_in_every_phase() {
        let (w, h) = (24, 18);
        let truth = |x: usize, y: usize| {
            [0.2 + 0.01 * x as f32, 0.5 - 0.008 * y as f32, 0.3 + 0.004 * (x + y) as f32]
        };
        for phase in
            [BayerPattern::Rggb, BayerPattern::Bggr, BayerPattern::Gbrg, BayerPattern::Grbg]
        {
            let mosaic: Vec<f32> = (0..w * h)
                .map(|i| {
                    let (x, y) = (i % w, i / w);
                    truth(x, y)[phase.band(x, y)]
                })
                .collect();
            let rgb = demosaic(&mosaic, w, h, phase);
            for y in 2..h - 2 {
                for x in 2..w - 2 {
                    for band in 0..3 {
                        assert!(
                            (rgb[(y * w + x) * 3 + band] - truth(x, y)[band]).abs() < 1e-5,
                            "{phase:?} {x},{y} band {band}"
                        );
                    }
                }
            }
        }
    }
}
