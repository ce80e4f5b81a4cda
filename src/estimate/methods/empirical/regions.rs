//! Mean light of regions of the image, frame by frame. Dark regions stay in, as they show
//! backscatter; clipped ones are left out.

use crate::coordinates::{Body, Optical, Transform};
use crate::estimate::samples::FrameSamples;
use crate::image::Bands;
use crate::model::EmpiricalForm;
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
}

impl RegionGrid {
    /// Index of the region of a point.
    fn index(&self, x: f64, y: f64) -> usize {
        let place = |v: f64, [from, to]: [f64; 2], count: usize| {
            let at = (v - from) / (to - from).max(1e-9) * count as f64;
            (at.max(0.0) as usize).min(count - 1)
        };
        place(y, self.y, self.rows) * self.columns + place(x, self.x, self.columns)
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
        let mut sums = vec![(0usize, [0.0; 3]); self.columns * self.rows];
        for ((x, y), value) in values {
            let (n, sum) = &mut sums[self.index(x, y)];
            *n += 1;
            (0..3).for_each(|b| sum[b] += value[b]);
        }
        let mean = |(n, sum): (usize, Bands)| (n > 0).then(|| sum.map(|s| s / n as f64));
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
        let aspect = (x[1] - x[0]) / (y[1] - y[0]);
        if most < 16 || !aspect.is_finite() || aspect <= 0.0 {
            return None;
        }
        // A region holds a block at least.
        let columns = ((most as f64 * aspect).sqrt() as usize).clamp(2, MAX_COLUMNS);
        let rows = ((most as f64 / aspect).sqrt() as usize).clamp(2, MAX_ROWS);
        let grid = RegionGrid { x, y, columns, rows };
        let bands = frames.iter().map(|f| f.bands).max().unwrap_or(1);
        let is_8_bit = frames.iter().any(|f| f.eight_bit);
        let noise = if is_8_bit { NOISE_8_BIT } else { NOISE_16_BIT };
        let of_frame = |samples: &Vec<Sample>| {
            let mut sums = vec![(0usize, 0.0, [0.0; 3]); columns * rows];
            for sample in samples {
                let (u, v) = ray(sample);
                let (n, range_m, light) = &mut sums[grid.index(u, v)];
                (*n, *range_m) = (*n + 1, *range_m + sample.seafloor_to_camera_m);
                for (sum, log) in light.iter_mut().zip(sample.log_color).take(bands) {
                    *sum += f64::from(log).exp();
                }
            }
            let log = |mean: f64| mean.max(LEAST_LIGHT * noise).ln();
            let seen = sums.into_iter().enumerate().filter(|(_, (n, ..))| *n > 0);
            let mean = |(region, (n, range_m, light)): (usize, (usize, f64, Bands))| RegionSample {
                region,
                range_m: range_m / n as f64,
                log_light: light.map(|sum| if sum.is_nan() { sum } else { log(sum / n as f64) }),
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
