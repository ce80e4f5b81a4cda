//! Mean light of regions of the image, frame by frame. Dark regions stay in, as they show
//! backscatter; clipped ones are left out.

use crate::coordinates::{Body, Optical, Transform};
use crate::estimate::samples::FrameSamples;
use crate::image::Bands;
use crate::model::{EmpiricalForm, ImageGrid};
use crate::solver::Sample;

/// Most regions across and down.
const MAX_COLUMNS: usize = 24;
const MAX_ROWS: usize = 16;

/// Regions of the image plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RegionGrid {
    /// range of x/z
    pub x: [f64; 2],
    /// range of y/z
    pub y: [f64; 2],
    /// regions across
    pub columns: usize,
    /// regions down
    pub rows: usize,
    /// width and height of a sampled block, at most those of a region
    block: [f64; 2],
}

impl RegionGrid {
    /// A grid over blocks whose centres lie in these ranges, of which a frame has up to `most`.
    pub(super) fn over(x: [f64; 2], y: [f64; 2], most: usize) -> Option<Self> {
        let aspect = (x[1] - x[0]) / (y[1] - y[0]);
        if most < 16 || !aspect.is_finite() || aspect <= 0.0 {
            return None;
        }
        // Blocks across: n (1 + (n − 1) / aspect) = most.
        let half = (aspect - 1.0) / 2.0;
        let across = (half * half + most as f64 * aspect).sqrt() - half;
        let down = most as f64 / across;
        let size =
            |[from, to]: [f64; 2], blocks: f64| (to - from) / (blocks.round() - 1.0).max(1.0);
        let block = [size(x, across), size(y, down)];
        let edges = |[from, to]: [f64; 2], size: f64| [from - size / 2.0, to + size / 2.0];
        Some(Self {
            x: edges(x, block[0]),
            y: edges(y, block[1]),
            columns: (across.round() as usize).clamp(2, MAX_COLUMNS),
            rows: (down.round() as usize).clamp(2, MAX_ROWS),
            block,
        })
    }

    /// Regions that the block around a point covers, and the share of it in each. Whole blocks
    /// would shift the mean of a region from its centre by another amount in every column.
    fn covered(&self, x: f64, y: f64) -> [(usize, f64); 4] {
        let along = |v: f64, [from, to]: [f64; 2], count: usize, block: f64| {
            let size = (to - from) / count as f64;
            let (at, extent) = ((v - block / 2.0 - from) / size, block / size);
            let first = (at.max(0.0) as usize).min(count - 1);
            let next = (first + 1).min(count - 1);
            let beyond = ((at + extent - next as f64) / extent).clamp(0.0, 1.0);
            [(first, 1.0 - beyond), (next, beyond)]
        };
        let columns = along(x, self.x, self.columns, self.block[0]);
        let rows = along(y, self.y, self.rows, self.block[1]);
        std::array::from_fn(|k| {
            let ((row, down), (column, across)) = (rows[k / 2], columns[k % 2]);
            (row * self.columns + column, down * across)
        })
    }

    /// As in the file.
    pub fn rounded(&self) -> ImageGrid {
        let (x, y) = (self.x.map(rounded), self.y.map(rounded));
        ImageGrid { x, y, columns: self.columns, rows: self.rows }
    }

    /// Centre of a region.
    pub fn centre(&self, region: usize) -> (f64, f64) {
        let place = |i: usize, [from, to]: [f64; 2], count: usize| {
            from + (to - from) * (i as f64 + 0.5) / count as f64
        };
        let (row, column) = (region / self.columns, region % self.columns);
        (place(column, self.x, self.columns), place(row, self.y, self.rows))
    }

    /// Whether a region refines the range of a held-out frame; the others judge it.
    pub fn refines(&self, region: usize) -> bool {
        (region / self.columns + region % self.columns).is_multiple_of(2)
    }

    /// Means by region of values at points of the image plane.
    pub fn means(&self, values: impl Iterator<Item = ((f64, f64), Bands)>) -> Vec<Option<Bands>> {
        let mut sums = vec![(0.0, [0.0; 3]); self.columns * self.rows];
        for ((x, y), value) in values {
            for (region, share) in self.covered(x, y) {
                let (covered, sum) = &mut sums[region];
                *covered += share;
                (0..3).for_each(|b| sum[b] += share * value[b]);
            }
        }
        let mean = |(covered, sum): (f64, Bands)| {
            (covered > LEAST_COVERED).then(|| sum.map(|s| s / covered))
        };
        sums.into_iter().map(mean).collect()
    }

    /// Regions beside one, above and below it.
    pub fn neighbours(&self, region: usize) -> impl Iterator<Item = usize> + '_ {
        let (row, column) = (region / self.columns, region % self.columns);
        let beside = [
            (column > 0).then(|| region - 1),
            (column + 1 < self.columns).then_some(region + 1),
            (row > 0).then(|| region - self.columns.min(region)),
            (row + 1 < self.rows).then_some(region + self.columns),
        ];
        beside.into_iter().flatten()
    }
}

/// One region in one frame.
#[derive(Clone, Copy, Debug)]
pub struct RegionSample {
    /// index of the region
    pub region: usize,
    /// ℓ_s, mean of the region (m)
    pub range_m: f64,
    /// log of the mean light per band; NaN for a band that is clipped
    pub log_light: Bands,
}

/// All regions of all frames.
#[derive(Clone, Debug)]
pub struct Regions {
    /// where they are
    pub grid: RegionGrid,
    /// 1 or 3
    pub bands: usize,
    /// per frame
    pub frames: Vec<Vec<RegionSample>>,
    /// standard deviation of the noise of dark light, about (share of full scale)
    pub noise: f64,
}

/// Noise of dark light: an 8-bit sRGB step over √12, or a step of 12 bits.
const NOISE_8_BIT: f64 = 1e-4;
const NOISE_16_BIT: f64 = 7e-5;
/// Least light whose logarithm is taken, in standard deviations of the noise.
const LEAST_LIGHT: f64 = 1.0;
/// Blocks that a region needs, and the least share of a block that counts: a clipped one spoils
/// what it covers.
const LEAST_COVERED: f64 = 0.25;
const LEAST_SHARE: f64 = 0.05;

impl Regions {
    /// From the samples of frames; `None` where too few blocks were sampled.
    pub fn of(frames: &[FrameSamples], camera: Transform<Body, Optical>) -> Option<Self> {
        let optical = camera.inverse();
        let ray = |sample: &Sample| {
            let hit = (optical * sample.hit).vector();
            (hit.x / hit.z, hit.y / hit.z)
        };
        let blocks = |f: &FrameSamples| -> Vec<Sample> {
            f.grid.iter().chain(&f.dark).map(|(_, sample)| *sample).collect()
        };
        let all: Vec<Vec<Sample>> = frames.iter().map(blocks).collect();
        let (mut x, mut y) =
            ([f64::INFINITY, f64::NEG_INFINITY], [f64::INFINITY, f64::NEG_INFINITY]);
        for (u, v) in all.iter().flatten().map(ray) {
            x = [x[0].min(u), x[1].max(u)];
            y = [y[0].min(v), y[1].max(v)];
        }
        let most = all.iter().map(Vec::len).max().unwrap_or(0);
        let grid = RegionGrid::over(x, y, most)?;
        let bands = frames.iter().map(|f| f.bands).max().unwrap_or(1);
        let is_8_bit = frames.iter().any(|f| f.eight_bit);
        let noise = if is_8_bit { NOISE_8_BIT } else { NOISE_16_BIT };
        let of_frame = |samples: &Vec<Sample>| {
            let mut sums = vec![(0.0, 0.0, [0.0; 3]); grid.columns * grid.rows];
            for sample in samples {
                let (u, v) = ray(sample);
                for (region, share) in grid.covered(u, v).into_iter().filter(|c| c.1 > LEAST_SHARE)
                {
                    let (covered, range_m, light) = &mut sums[region];
                    *covered += share;
                    *range_m += share * sample.seafloor_to_camera_m;
                    for (sum, log) in light.iter_mut().zip(sample.log_color).take(bands) {
                        *sum += share * f64::from(log).exp();
                    }
                }
            }
            let log = |mean: f64| mean.max(LEAST_LIGHT * noise).ln();
            let seen =
                sums.into_iter().enumerate().filter(|(_, (covered, ..))| *covered > LEAST_COVERED);
            let mean =
                |(region, (covered, range_m, light)): (usize, (f64, f64, Bands))| RegionSample {
                    region,
                    range_m: range_m / covered,
                    log_light: light.map(|sum| if sum.is_nan() { sum } else { log(sum / covered) }),
                };
            seen.map(mean).collect()
        };
        Some(Self { grid, bands, frames: all.iter().map(of_frame).collect(), noise })
    }

    /// Whether a form can be estimated from so many frames.
    pub fn has_enough(&self, form: EmpiricalForm) -> bool {
        let needed = match form {
            EmpiricalForm::Ranges | EmpiricalForm::Backscatter => 12,
            EmpiricalForm::Range => 8,
            EmpiricalForm::FrameAverage => 6,
            EmpiricalForm::WhiteBalance => 2,
        };
        self.frames.iter().filter(|f| !f.is_empty()).count() >= needed
    }
}

/// To seven decimals, as in the file.
pub fn rounded(v: f64) -> f64 {
    (v * 1e7).round() / 1e7
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of light that rises evenly over blocks of any number, every region has the value at its
    /// centre: no stripes where columns of regions hold two blocks and three in turn.
    #[test]
    fn means_of_regions_are_those_of_their_centres() {
        for (across, down) in [(64usize, 48usize), (53, 30), (24, 16), (9, 7)] {
            let at = |k: usize| (k as f64 + 0.5) / 40.0;
            let blocks = (0..across * down).map(|k| (at(k % across), at(k / across)));
            let (x, y) = ([at(0), at(across - 1)], [at(0), at(down - 1)]);
            let grid = RegionGrid::over(x, y, across * down).expect("a grid");
            assert!((grid.block[0] - 1.0 / 40.0).abs() < 1e-9, "{across}: {:?}", grid.block);
            let ramp = blocks.map(|(x, y)| ((x, y), [x, y, x + y]));
            for (region, mean) in grid.means(ramp).into_iter().enumerate() {
                let ((x, y), mean) = (grid.centre(region), mean.expect("every region is covered"));
                // Parts of a block have its mean: a few per cent of a region are left.
                let size = (grid.x[1] - grid.x[0]) / grid.columns as f64;
                let near = |a: f64, b: f64| (a - b).abs() < 0.05 * size;
                assert!(near(mean[0], x) && near(mean[1], y), "{region}: {mean:?} {x} {y}");
            }
        }
    }
}
