//! Baseline: contrast-limited adaptive histogram equalisation (paper §III-B; Zuiderveld 1994,
//! "Contrast limited adaptive histogram equalization"), band by band on 8-bit sRGB codes, step by
//! step as OpenCV's `createCLAHE` does it.

use super::LEAST_LIGHT;
use crate::image::LinearImage;
use crate::image::transfer::{Shoulder, SrgbTable, Transfer};

/// Tiles along each side, as OpenCV has them.
const TILES: usize = 8;
/// A histogram is clipped at this many times its mean: twice, as is usual; more brings out noise.
const CLIP_LIMIT: f64 = 2.0;
/// A frame is first brought to where this share of its values is below full scale: codes of dark
/// frames would be few.
const BRIGHT_QUANTILE: f64 = 0.999;

/// Equalises each band.
pub fn equalise(image: &mut LinearImage) {
    let mut values = image.pixels.clone();
    let index = ((values.len() - 1) as f64 * BRIGHT_QUANTILE).round() as usize;
    let bright = (*values.select_nth_unstable_by(index, f32::total_cmp).1).max(LEAST_LIGHT);
    let (to_code, to_light) = (SrgbTable::new(Shoulder { knee: 1.0 }), Transfer::Srgb.table8());
    for band in 0..image.bands {
        let codes: Vec<u8> = image
            .pixels
            .iter()
            .skip(band)
            .step_by(image.bands)
            .map(|v| to_code.encode(v / bright))
            .collect();
        let equalised = clahe(&codes, image.width, image.height);
        let of_band = image.pixels.iter_mut().skip(band).step_by(image.bands);
        of_band.zip(equalised).for_each(|(v, code)| *v = to_light[usize::from(code)]);
    }
}

/// The codes of one band, equalised tile by tile, bilinear between the tiles' centres.
fn clahe(codes: &[u8], width: usize, height: usize) -> Vec<u8> {
    // Where the tiles do not fit, the picture goes on mirrored, the edge itself not repeated; by a
    // whole tile's worth on a side where they would, as OpenCV has it.
    let fits = width.is_multiple_of(TILES) && height.is_multiple_of(TILES);
    let tile = |size: usize| if fits { size / TILES } else { size / TILES + 1 };
    let (tile_width, tile_height) = (tile(width), tile(height));
    let mirrored = |at: usize, count: usize| {
        let folded = at % (2 * count - 2).max(1);
        if folded < count { folded } else { 2 * count - 2 - folded }
    };
    let at =
        |x: usize, y: usize| usize::from(codes[mirrored(y, height) * width + mirrored(x, width)]);
    let mut tables = Vec::with_capacity(TILES * TILES);
    for tile in 0..TILES * TILES {
        let (left, top) = (tile % TILES * tile_width, tile / TILES * tile_height);
        let mut histogram = [0usize; 256];
        for y in top..top + tile_height {
            (left..left + tile_width).for_each(|x| histogram[at(x, y)] += 1);
        }
        tables.push(table(histogram, tile_width * tile_height));
    }
    let place = |at: usize, size: usize| {
        let place = at as f32 * (1.0 / size as f32) - 0.5;
        let first = place.floor();
        let tile = |k: f32| k.clamp(0.0, (TILES - 1) as f32) as usize;
        (tile(first), tile(first + 1.0), place - first)
    };
    let one = |i: usize| {
        let ((x0, x1, a), (y0, y1, b)) =
            (place(i % width, tile_width), place(i / width, tile_height));
        let of = |x: usize, y: usize| f32::from(tables[y * TILES + x][usize::from(codes[i])]);
        let row = |y: usize| of(x0, y) * (1.0 - a) + of(x1, y) * a;
        (row(y0) * (1.0 - b) + row(y1) * b).round_ties_even().clamp(0.0, 255.0) as u8
    };
    (0..width * height).map(one).collect()
}

/// A tile's table: its clipped histogram, summed up; what was clipped is spread over all codes.
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
    fn as_opencv_has_it() {
        for (width, height, ought) in CLAHE {
            let code = |i: usize| {
                let (x, y) = (i % width, i / width);
                ((7 * x + 13 * y + x * y / 5) % 97 + 60) as u8
            };
            let codes: Vec<u8> = (0..width * height).map(code).collect();
            let is = super::clahe(&codes, width, height);
            let sum: usize = is.iter().map(|v| usize::from(*v)).sum();
            let points = [is[5 * width + 7], is[0], is[width * height - 1]].map(usize::from);
            assert_eq!(
                (points, sum),
                ([ought[0], ought[1], ought[2]], ought[3]),
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
