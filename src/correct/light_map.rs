//! Light of a frame by cells of the image, to see where there is much less than the model predicts:
//! a lamp failed, or something casts a shadow. What is left there is light of other lamps and of
//! the water, whose colour says nothing of the seafloor.

use crate::image::Bands;
use crate::image::decode::PixelValues;
use crate::image::flat_field::FlatField;

/// Most columns and rows of cells.
const COLUMNS: usize = 24;
const ROWS: usize = 18;
/// Rows and columns that are read: two of so many, as those of a mosaic alternate.
const STEP: usize = 8;
/// Smallest side of a cell (px): some of its pixels are read, wherever it begins.
const MIN_CELL: usize = 2 * STEP;
/// Share of the predicted light from which on colours are those of the seafloor, and below which
/// there are none. Dark objects reflect a fifth of the median seafloor's light.
const LIT: f64 = 0.22;
const UNLIT: f64 = 0.08;

/// Cells to each side that make a part of the image: so large an object of one colour is rare.
const REACH: usize = 2;
/// Distances of log colour in a part of the image from the predicted one, up to which it can be the
/// seafloor's, and from which it is other light's.
const LIKELY: f64 = 0.9;
const UNLIKELY: f64 = 1.4;
/// The same where a lamp failed: light reaches the seafloor by other ways through the water.
const LIKELY_WITHOUT_LAMP: f64 = 0.15;
const UNLIKELY_WITHOUT_LAMP: f64 = 0.4;

/// Mean light of cells, without vignetting and the bands' own gains.
pub struct LightMap {
    size: (usize, usize),
    /// columns and rows
    shape: (usize, usize),
    cells: Vec<Bands>,
    /// mean of the cells about each
    parts: Vec<Bands>,
    /// distances of log colour, see `LIKELY`
    likely: (f64, f64),
}

impl LightMap {
    /// Of the pixel values of a frame; `balance` divides a row, band after band, by
    /// the bands' own gains.
    pub fn of(
        codes: &PixelValues<'_>,
        flat_field: Option<&FlatField>,
        balance: impl Fn(usize, &mut [f32]),
    ) -> Self {
        let (width, height, stored) = (codes.width, codes.height, codes.stored_bands());
        let (columns, rows) = shape(width, height);
        let mut cells = vec![[0f64; 3]; columns * rows];
        let mut counts = vec![[0usize; 3]; columns * rows];
        let mut row = vec![0f32; width * stored];
        for y in (0..height).filter(|y| y % STEP < 2) {
            codes.linear_bands(y, &mut row);
            if let Some(flat) = flat_field {
                flat.divide_bands(y, codes.mosaic, &mut row);
            }
            balance(y, &mut row);
            for x in (0..width).filter(|x| x % STEP < 2) {
                let cell = y * rows / height * columns + x * columns / width;
                for b in 0..stored {
                    let band = codes.mosaic.map_or(b, |pattern| pattern.band(x, y));
                    cells[cell][band] += f64::from(row[b * width + x]);
                    counts[cell][band] += 1;
                }
            }
        }
        for (cell, counts) in cells.iter_mut().zip(&counts) {
            (0..3).for_each(|b| cell[b] /= counts[b].max(1) as f64);
        }
        Self::of_cells((width, height), (columns, rows), cells)
    }

    fn of_cells(size: (usize, usize), shape: (usize, usize), cells: Vec<Bands>) -> Self {
        let parts = (0..cells.len()).map(|i| about(&cells, shape.0, i)).collect();
        Self { size, shape, cells, parts, likely: (LIKELY, UNLIKELY) }
    }

    /// Of a frame in which a lamp failed.
    #[must_use]
    pub fn without_lamp(self) -> Self {
        Self { likely: (LIKELY_WITHOUT_LAMP, UNLIKELY_WITHOUT_LAMP), ..self }
    }

    /// Share of its colour that a pixel keeps, by the light that is predicted there.
    pub fn colour_share(&self, (u, v): (f64, f64), predicted: &Bands) -> f32 {
        let place = |at: f64, size: usize, cells: usize| {
            let cell = (at / size as f64 * cells as f64 - 0.5).clamp(0.0, (cells - 1) as f64);
            let first = (cell as usize).min(cells.saturating_sub(2));
            (first, cell - first as f64)
        };
        let (columns, rows) = self.shape;
        let (column, right) = place(u, self.size.0, columns);
        let (row, down) = place(v, self.size.1, rows);
        let (mut sum, mut part) = (0.0, [0.0; 3]);
        for (r, by_row) in [(row, 1.0 - down), (row + 1, down)] {
            for (c, by_column) in [(column, 1.0 - right), (column + 1, right)] {
                let cell = r.min(rows - 1) * columns + c.min(columns - 1);
                sum += by_row * by_column * self.cells[cell].iter().sum::<f64>();
                (0..3).for_each(|b| part[b] += by_row * by_column * self.parts[cell][b]);
            }
        }
        let share = sum / predicted.iter().sum::<f64>().max(1e-12);
        let ratio = |b: usize| (part[b].max(1e-9) / predicted[b].max(1e-9)).ln();
        let off = (ratio(0) - ratio(1)).abs().max((ratio(2) - ratio(1)).abs());
        let (likely, unlikely) = self.likely;
        (step((share - UNLIT) / (LIT - UNLIT)) * step((unlikely - off) / (unlikely - likely)))
            as f32
    }
}

/// From 0 to 1, smooth.
fn step(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

/// Mean of the cells about one.
fn about(cells: &[Bands], columns: usize, cell: usize) -> Bands {
    let rows = cells.len() / columns;
    let near = |i: usize, count: usize| i.saturating_sub(REACH)..(i + REACH + 1).min(count);
    let (mut sum, mut n) = ([0.0; 3], 0.0);
    for row in near(cell / columns, rows) {
        for column in near(cell % columns, columns) {
            (0..3).for_each(|b| sum[b] += cells[row * columns + column][b]);
            n += 1.0;
        }
    }
    sum.map(|sum| sum / n)
}

/// Columns and rows for an image of this size.
fn shape(width: usize, height: usize) -> (usize, usize) {
    ((width / MIN_CELL).clamp(1, COLUMNS), (height / MIN_CELL).clamp(1, ROWS))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::EncodedImage;
    use crate::image::decode::{CameraResponse, read_pixels};

    #[test]
    fn an_even_image_of_any_size_keeps_its_colour() {
        for (width, height) in [(7, 5), (40, 30), (160, 120), (203, 151), (640, 480)] {
            let data = vec![120u8; 3 * width * height];
            let step = 3 * width;
            let encoded = EncodedImage::Raw {
                encoding: "rgb8",
                width,
                height,
                step,
                big_endian: false,
                data: &data,
            };
            let codes = read_pixels(&encoded, CameraResponse::default()).expect("an image");
            let map = LightMap::of(&codes, None, |_, _| {});
            let light = codes.mean_light();
            for v in 0..height {
                for u in 0..width {
                    let share = map.colour_share((u as f64, v as f64), &light);
                    assert!((share - 1.0).abs() < 1e-6, "{width}×{height} at {u}, {v}: {share}");
                }
            }
        }
    }

    #[test]
    fn colour_fades_where_light_is_missing() {
        let mut cells = vec![[0.2, 0.4, 0.3]; COLUMNS * ROWS];
        cells[..COLUMNS * 6].fill([0.02, 0.01, 0.005]);
        let map = LightMap::of_cells((240, 180), (COLUMNS, ROWS), cells);
        let predicted = [0.2, 0.4, 0.3];
        assert!(map.colour_share((120.0, 20.0), &predicted).abs() < 1e-6);
        assert!((map.colour_share((120.0, 150.0), &predicted) - 1.0).abs() < 1e-6);
        let shares: Vec<f32> =
            (50..80).map(|v| map.colour_share((77.0, f64::from(v)), &predicted)).collect();
        assert!(shares.windows(2).all(|pair| pair[0] <= pair[1]), "{shares:?}");
        assert!(shares.iter().any(|s| (0.2..0.8).contains(s)), "{shares:?}");
    }

    /// A tint that an animal may have is another way through the water where a lamp failed.
    #[test]
    fn less_colour_is_believed_where_a_lamp_failed() {
        let predicted = [0.2, 0.4, 0.3];
        let mut cells = vec![predicted; COLUMNS * ROWS];
        cells[..COLUMNS * 6].fill([0.32, 0.4, 0.3]);
        let share = |map: &LightMap| map.colour_share((120.0, 20.0), &predicted);
        let map = LightMap::of_cells((240, 180), (COLUMNS, ROWS), cells);
        assert!((share(&map) - 1.0).abs() < 1e-6);
        let map = map.without_lamp();
        assert!(share(&map) < 1e-6);
        assert!((map.colour_share((120.0, 150.0), &predicted) - 1.0).abs() < 1e-6);
    }

    /// The yellow light of another lamp is not the seafloor's, a red animal is.
    #[test]
    fn colour_fades_where_a_part_of_the_image_has_that_of_other_light() {
        let predicted = [0.05, 0.4, 0.5];
        let mut cells = vec![predicted; COLUMNS * ROWS];
        cells[..COLUMNS * 6].fill([0.3, 0.3, 0.03]);
        cells[COLUMNS * 14 + 12] = [0.4, 0.4, 0.5];
        let map = LightMap::of_cells((240, 180), (COLUMNS, ROWS), cells);
        assert!(map.colour_share((120.0, 20.0), &predicted).abs() < 1e-6);
        assert!((map.colour_share((125.0, 145.0), &predicted) - 1.0).abs() < 1e-6);
    }
}
