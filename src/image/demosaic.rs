//! Bayer mosaic → colour by Malvar, He and Cutler (ICASSP 2004, the paper's [10]).
//!
//! In: one linear value per pixel. Out: three. The 5×5 filters correct bilinear interpolation with the
//! Laplacian of the band that was measured, which is right where the bands are alike: under water red is
//! ten times dimmer than green, and green's noise and edges would end up in it. So pass two demosaics *after* it has
//! corrected the mosaic. Noise may go below 0, so that means stay true. Borders are mirrored about the edge pixel, which keeps the phase.

/// The four phases: colours of the pixels (0,0) and (1,0), (0,1) and (1,1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// red first
    Rggb,
    /// blue first
    Bggr,
    /// green first, blue beside it
    Gbrg,
    /// green first, red beside it
    Grbg,
}

impl Phase {
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

/// Interpolates `mosaic` (`height × width`). Pictures under 3×3 are not taken.
pub fn demosaic(mosaic: &[f32], width: usize, height: usize, phase: Phase) -> Vec<f32> {
    let mirror = |i: usize, n: usize| -> usize {
        let i = i as isize - MARGIN as isize;
        let last = n as isize - 1;
        (if i < 0 {
            -i
        } else if i > last {
            2 * last - i
        } else {
            i
        }) as usize
    };
    let padded_width = width + 2 * MARGIN;
    let mut padded = vec![0f32; padded_width * (height + 2 * MARGIN)];
    for (y, row) in padded.chunks_exact_mut(padded_width).enumerate() {
        let source = &mosaic[mirror(y, height) * width..][..width];
        row[MARGIN..MARGIN + width].copy_from_slice(source);
        for x in (0..MARGIN).chain(MARGIN + width..padded_width) {
            row[x] = source[mirror(x, width)];
        }
    }
    let (red_row, red_column) = phase.red();
    let mut out = vec![0f32; width * height * 3];
    for (y, out) in out.chunks_exact_mut(width * 3).enumerate() {
        let rows: [&[f32]; 5] = std::array::from_fn(|k| &padded[(y + k) * padded_width..][..padded_width]);
        let in_red_row = y % 2 == red_row;
        for (x, rgb) in out.chunks_exact_mut(3).enumerate() {
            let [n2, n1, mid, s1, s2] = rows.map(|r| &r[x..x + 5]);
            let c = mid[2];
            let (horizontal, vertical) = (mid[1] + mid[3], n1[2] + s1[2]);
            let (far_h, far_v) = (mid[0] + mid[4], n2[2] + s2[2]);
            let diagonal = n1[1] + n1[3] + s1[1] + s1[3];
            let in_red_column = x % 2 == red_column;
            let (r, g, b) = if in_red_row == in_red_column {
                // on red or blue: green from the cross, the opposite colour from the diagonal
                let g = (4.0 * c + 2.0 * (horizontal + vertical) - far_h - far_v) / 8.0;
                let opposite = (6.0 * c + 2.0 * diagonal - 1.5 * (far_h + far_v)) / 8.0;
                if in_red_row { (c, g, opposite) } else { (opposite, g, c) }
            } else {
                // on green: the colour of this row, and the colour of this column
                let of_row = (5.0 * c + 4.0 * horizontal - diagonal - far_h + 0.5 * far_v) / 8.0;
                let of_column = (5.0 * c + 4.0 * vertical - diagonal - far_v + 0.5 * far_h) / 8.0;
                if in_red_row { (of_row, c, of_column) } else { (of_column, c, of_row) }
            };
            rgb.copy_from_slice(&[r, g, b]);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_colour_gradient_comes_back_in_every_phase() {
        let (w, h) = (24, 18);
        let truth = |x: usize, y: usize| [0.2 + 0.01 * x as f32, 0.5 - 0.008 * y as f32, 0.3 + 0.004 * (x + y) as f32];
        for phase in [Phase::Rggb, Phase::Bggr, Phase::Gbrg, Phase::Grbg] {
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
                        assert!((rgb[(y * w + x) * 3 + band] - truth(x, y)[band]).abs() < 1e-5, "{phase:?} {x},{y} band {band}");
                    }
                }
            }
        }
    }
}
