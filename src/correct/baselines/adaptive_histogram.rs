//! Baseline: contrast-limited adaptive histogram equalisation (paper §III-B; Zuiderveld 1994,
//! "Contrast limited adaptive histogram equalization"), per band on 8-bit sRGB values, identical to
//! OpenCV's `createCLAHE`.

use super::common::MIN_LIGHT;
use crate::image::LinearImage;
use crate::image::tone::Tone;
use crate::image::transfer::{SrgbTable, Transfer};
use crate::stats::quantile;

/// Tiles per side, OpenCV's default.
const TILES: usize = 8;
/// Histogram bins are clipped at this multiple of their mean. A higher limit amplifies noise.
const CLIP_LIMIT: f64 = 2.0;
/// Before quantisation a frame is scaled such that this share of its values is below full scale;
/// dark frames would otherwise have few grey levels.
const BRIGHT_QUANTILE: f64 = 0.999;

/// Equalises each band.
pub fn equalise(image: &mut LinearImage) {
    let values: Vec<f64> = image.pixels.iter().map(|v| f64::from(*v)).collect();
    let bright = (quantile(&values, BRIGHT_QUANTILE) as f32).max(MIN_LIGHT);
    let (srgb, to_light) = (SrgbTable::new(Tone::Shoulder { knee: 1.0 }), Transfer::Srgb.table8());
    for band in 0..image.bands {
        let values: Vec<u8> = image
            .pixels
            .iter()
            .skip(band)
            .step_by(image.bands)
            .map(|v| srgb.encode(v / bright))
            .collect();
        let equalised = clahe(&values, image.width, image.height);
        let of_band = image.pixels.iter_mut().skip(band).step_by(image.bands);
        of_band.zip(equalised).for_each(|(v, value)| *v = to_light[usize::from(value)]);
    }
}

/// Equalises one band: tile by tile, bilinear between tile centres.
fn clahe(values: &[u8], width: usize, height: usize) -> Vec<u8> {
    // Where the size is no multiple of the tiles, the image is extended by mirroring (without
    // repeating the edge); as in OpenCV, then both sides are extended, also one that is a
    // multiple.
    let fits = width.is_multiple_of(TILES) && height.is_multiple_of(TILES);
    let tile = |size: usize| if fits { size / TILES } else { size / TILES + 1 };
    let (tile_width, tile_height) = (tile(width), tile(height));
    let mirrored = |at: usize, count: usize| {
        let folded = at % (2 * count - 2).max(1);
        if folded < count { folded } else { 2 * count - 2 - folded }
    };
    let at =
        |x: usize, y: usize| usize::from(values[mirrored(y, height) * width + mirrored(x, width)]);
    let mut tables = Vec::with_capacity(TILES * TILES);
    for tile in 0..TILES * TILES {
        let (left, top) = (tile % TILES * tile_width, tile / TILES * tile_height);
        let mut histogram = [0usize; 256];
        for y in top..top + tile_height {
            (left..left + tile_width).for_each(|x| histogram[at(x, y)] += 1);
        }
        tables.push(table(histogram, tile_width * tile_height));
    }
    let neighbours = |at: usize, size: usize| {
        let position = at as f32 * (1.0 / size as f32) - 0.5;
        let first = position.floor();
        let tile = |k: f32| k.clamp(0.0, (TILES - 1) as f32) as usize;
        (tile(first), tile(first + 1.0), position - first)
    };
    let equalised = |i: usize| {
        let ((x0, x1, a), (y0, y1, b)) =
            (neighbours(i % width, tile_width), neighbours(i / width, tile_height));
        let of = |x: usize, y: usize| f32::from(tables[y * TILES + x][usize::from(values[i])]);
        let row = |y: usize| of(x0, y) * (1.0 - a) + of(x1, y) * a;
        (row(y0) * (1.0 - b) + row(y1) * b).round_ties_even().clamp(0.0, 255.0) as u8
    };
    (0..width * height).map(equalised).collect()
}

/// Mapping of a tile: cumulative clipped histogram; the clipped excess is spread over all values.
fn table(mut histogram: [usize; 256], pixels: usize) -> [u8; 256] {
    let limit = ((CLIP_LIMIT * pixels as f64 / 256.0) as usize).max(1);
    let clipped: usize = histogram.iter().map(|n| n.saturating_sub(limit)).sum();
    histogram.iter_mut().for_each(|n| *n = (*n).min(limit) + clipped / 256);
    let rest = clipped % 256;
    if let Some(step) = 256usize.checked_div(rest) {
        histogram.iter_mut().step_by(step.max(1)).take(rest).for_each(|n| *n += 1);
    }
    let scale = 255.0 / pixels as f32;
    let mut sum = 0;
    histogram.map(|n| {
        sum += n;
        (sum as f32 * scale).round_ties_even().clamp(0.0, 255.0) as u8
    })
}

#[cfg(test)]
mod tests {
    /// OpenCV 5.0: `c = ((7*x + 13*y + x*y // 5) % 97 + 60).astype(np.uint8)`; `e =
    /// cv2.createCLAHE(2.0, (8, 8)).apply(c)`; `e[5, 7], e[0, 0], e[-1, -1], e.sum()`, 64 × 48 and
    /// 67 × 45.
    #[test]
    fn matches_opencv() {
        for (width, height, expected) in CLAHE {
            let value = |i: usize| {
                let (x, y) = (i % width, i / width);
                ((7 * x + 13 * y + x * y / 5) % 97 + 60) as u8
            };
            let values: Vec<u8> = (0..width * height).map(value).collect();
            let result = super::clahe(&values, width, height);
            let sum: usize = result.iter().map(|v| usize::from(*v)).sum();
            let points =
                [result[5 * width + 7], result[0], result[width * height - 1]].map(usize::from);
            assert_eq!(
                (points, sum),
                ([expected[0], expected[1], expected[2]], expected[3]),
                "{width}×{height}"
            );
        }
    }

    const CLAHE: [(usize, usize, [usize; 4]); 3] = [
        (64, 48, [76, 11, 228, 395876]),
        (67, 45, [77, 14, 150, 385360]),
        (64, 45, [77, 14, 57, 368450]),
    ];
}
