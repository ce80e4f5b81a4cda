//! Pixels that are clipped in some bands: a clipped value is only a lower bound, and multiplied by
//! its gain it would tint the highlight. It is raised to the mean of the bands that are not
//! clipped: in corrected light the seafloor is grey on average. Where all bands are clipped, the
//! highlight is as bright as the brightest of them, and as the median seafloor at least.

use std::collections::VecDeque;

use crate::image::demosaic::BayerPattern;

/// Rows of a mosaic above and below that a demosaiced row depends on.
const MOSAIC_REACH: usize = 1;
/// Rows that are kept: demosaicing follows two rows behind.
const KEPT: usize = 4 + MOSAIC_REACH;

/// Clipped pixels of the last rows, by band.
pub struct Highlights {
    pattern: Option<BayerPattern>,
    bands: usize,
    /// number of the first row that is kept
    first: usize,
    /// bits of clipped bands per pixel; empty for a row without any
    rows: VecDeque<Vec<u8>>,
    /// pixels that were changed
    pub restored: usize,
    merged: Vec<u8>,
}

impl Highlights {
    /// For images of so many bands after demosaicing.
    pub fn new(pattern: Option<BayerPattern>, bands: usize) -> Self {
        Self { pattern, bands, first: 0, rows: VecDeque::new(), restored: 0, merged: Vec::new() }
    }

    /// Adds row `y` of raw light, in order, band after band; `is_clipped` is false where no value
    /// is.
    pub fn push(&mut self, y: usize, row: &[f32], level: f32, is_clipped: bool) {
        if self.rows.len() == KEPT {
            self.rows.pop_front();
            self.first += 1;
        }
        if !is_clipped {
            return self.rows.push_back(Vec::new());
        }
        let bands = if self.pattern.is_some() { 1 } else { self.bands };
        let width = row.len() / bands;
        let mut bits = vec![0u8; width];
        for (b, of_band) in row.chunks_exact(width).enumerate() {
            // Even and odd columns.
            let marks = match self.pattern {
                Some(pattern) => [1 << pattern.band(0, y), 1 << pattern.band(1, y)],
                None => [1 << b; 2],
            };
            for (x, (bits, v)) in bits.iter_mut().zip(of_band).enumerate() {
                *bits |= if *v >= level { marks[x % 2] } else { 0 };
            }
        }
        self.rows.push_back(if bits.iter().any(|b| *b != 0) { bits } else { Vec::new() });
    }

    /// Restores row `y` of corrected light, band after band. `level`: that of the median seafloor.
    pub fn restore(&mut self, y: usize, row: &mut [f32], level: f32) {
        if self.bands < 2 {
            return;
        }
        let reach = if self.pattern.is_some() { MOSAIC_REACH } else { 0 };
        self.merged.clear();
        for near in y.saturating_sub(reach)..=y + reach {
            let Some(bits) = near.checked_sub(self.first).and_then(|i| self.rows.get(i)) else {
                continue;
            };
            if !bits.is_empty() {
                self.merged.resize(bits.len(), 0);
                self.merged.iter_mut().zip(bits).for_each(|(merged, bits)| *merged |= bits);
            }
        }
        let last = self.merged.len().saturating_sub(1);
        let width = row.len() / self.bands;
        for x in 0..self.merged.len() {
            let around = x.saturating_sub(reach)..=(x + reach).min(last);
            let bits = match reach {
                0 => self.merged[x],
                _ => self.merged[around].iter().fold(0, |all, bits| all | bits),
            };
            if bits == 0 {
                continue;
            }
            let mut pixel: [f32; 3] =
                std::array::from_fn(|b| if b < self.bands { row[b * width + x] } else { 0.0 });
            if restore(&mut pixel[..self.bands], bits, level) {
                self.restored += 1;
                (0..self.bands).for_each(|b| row[b * width + x] = pixel[b]);
            }
        }
    }
}

/// Raises the clipped bands of a pixel; whether that changed it.
fn restore(pixel: &mut [f32], clipped: u8, level: f32) -> bool {
    let is_clipped = |b: usize| clipped >> b & 1 != 0;
    let free = || pixel.iter().enumerate().filter(|(b, _)| !is_clipped(*b));
    let neutral = match free().count() {
        0 => pixel.iter().copied().fold(level, f32::max),
        n => free().map(|(_, v)| v).sum::<f32>() / n as f32,
    };
    let mut is_changed = false;
    for (b, v) in pixel.iter_mut().enumerate() {
        if is_clipped(b) && *v < neutral {
            (*v, is_changed) = (neutral, true);
        }
    }
    is_changed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clipped_bands_are_raised_to_the_others_and_white_stays_white() {
        let restored = |mut pixel: [f32; 3], clipped: u8| {
            restore(&mut pixel, clipped, 0.2);
            pixel
        };
        assert_eq!(restored([1.6, 0.9, 0.8], 0b110), [1.6, 1.6, 1.6]);
        assert_eq!(restored([1.6, 0.9, 0.8], 0b111), [1.6, 1.6, 1.6]);
        assert_eq!(restored([1.6, 0.75, 0.8], 0b100), [1.6, 0.75, 1.175]);
        // What is brighter than the others although it is clipped stays so.
        assert_eq!(restored([0.2, 0.9, 0.3], 0b010), [0.2, 0.9, 0.3]);
    }

    #[test]
    fn a_clipped_pixel_of_a_mosaic_counts_around_it() {
        let mut highlights = Highlights::new(Some(BayerPattern::Rggb), 3);
        let restored_in = |highlights: &mut Highlights, y: usize| {
            let mut row = [[1.5f32; 8], [0.9; 8], [0.9; 8]].concat();
            highlights.restore(y, &mut row, 0.2);
            row[8..16].iter().filter(|green| **green == 1.2).count()
        };
        let mut counts = Vec::new();
        for y in 0..8 {
            let mut row = [0.5f32; 8];
            // Green at (3, 4).
            row[3] = if y == 4 { 1.0 } else { 0.5 };
            highlights.push(y, &row, 0.98, y == 4);
            if y >= 2 {
                counts.push(restored_in(&mut highlights, y - 2));
            }
        }
        assert_eq!(counts, [0, 0, 0, 3, 3, 3]);
        assert_eq!(highlights.restored, 9);
    }
}
