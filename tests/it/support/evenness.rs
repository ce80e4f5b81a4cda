//! Whether corrected images are evenly bright and evenly coloured, over the image and over the log:
//! the ratio of corrected light to true reflectance should be one constant per band.
#![allow(dead_code)]

use unwater::image::LinearImage;

use super::judge::{blocks, median};
use super::render::{Dive, Truth};

/// Cells of the image: across and down.
const CELLS: (usize, usize) = (5, 4);

/// Of the ratio of corrected light to true reflectance, in 4×4-pixel means.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct Evenness {
    /// the largest over the smallest median of a 5×4 grid's cells over all frames, worst band
    pub flat: f64,
    /// standard deviation over the frames of the log of their median, mean of the bands
    pub cv: f64,
    /// the same of the bands against their mean, worst band
    pub hue: f64,
    /// change of that mean from the first frame to the last, by a straight line
    pub drift: f64,
}

impl Evenness {
    /// `clipped`: by frame and block, left out.
    pub fn of(dive: &Dive, truth: &Truth, images: &[LinearImage], clipped: &[Vec<bool>]) -> Self {
        let bands = images[0].bands;
        let across = dive.width / 4;
        let cell = |block: usize| {
            let (x, y) = (block % across, block / across);
            y * CELLS.1 / (dive.height / 4) * CELLS.0 + x * CELLS.0 / across
        };
        let mut of_cells = vec![Vec::new(); CELLS.0 * CELLS.1 * bands];
        let mut of_frames: Vec<Vec<f64>> = Vec::new();
        for ((image, frame), clipped) in images.iter().zip(&truth.frames).zip(clipped) {
            let mut medians = Vec::new();
            for band in 0..bands {
                let true_band = if bands == 1 { 1 } else { band };
                let is = blocks(dive.width, dive.height, |x, y| f64::from(image.at(x, y)[band]));
                let expected = blocks(dive.width, dive.height, |x, y| {
                    f64::from(frame.reflectance[y * dive.width + x][true_band])
                });
                let mut ratios = Vec::new();
                for (block, (is, expected)) in is.iter().zip(&expected).enumerate() {
                    if !clipped[block] && *is > 0.0 {
                        ratios.push(is / expected);
                        of_cells[cell(block) * bands + band].push(is / expected);
                    }
                }
                medians.push(if ratios.is_empty() { f64::NAN } else { median(&mut ratios).ln() });
            }
            of_frames.push(medians);
        }
        of_frames.retain(|medians| medians.iter().all(|m| m.is_finite()));
        let brightness: Vec<f64> = of_frames.iter().map(|frame| mean(frame)).collect();
        let hue = |band: usize| {
            let off: Vec<f64> =
                of_frames.iter().zip(&brightness).map(|(f, mean)| f[band] - mean).collect();
            deviation(&off)
        };
        Self {
            flat: (0..bands).map(|b| flatness(&mut of_cells, bands, b)).fold(1.0, f64::max),
            cv: deviation(&brightness),
            hue: (0..bands).map(hue).fold(0.0, f64::max),
            drift: drift(&brightness),
        }
    }
}

/// Largest over smallest median of the cells of one band.
fn flatness(of_cells: &mut [Vec<f64>], bands: usize, band: usize) -> f64 {
    let seen = of_cells.iter_mut().skip(band).step_by(bands).filter(|ratios| !ratios.is_empty());
    let medians: Vec<f64> = seen.map(|ratios| median(ratios)).collect();
    let high = medians.iter().copied().fold(0.0, f64::max);
    high / medians.iter().copied().fold(f64::INFINITY, f64::min)
}

/// Slope of the least-squares line through equally spaced values, times their number.
fn drift(values: &[f64]) -> f64 {
    let centre = (values.len() as f64 - 1.0) / 2.0;
    let level = mean(values);
    let (mut moment, mut inertia) = (0.0, 0.0);
    for (k, value) in values.iter().enumerate() {
        let from_centre = k as f64 - centre;
        moment += from_centre * (value - level);
        inertia += from_centre * from_centre;
    }
    moment / inertia * values.len() as f64
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Standard deviation of a population.
fn deviation(values: &[f64]) -> f64 {
    let level = mean(values);
    (values.iter().map(|v| (v - level).powi(2)).sum::<f64>() / values.len() as f64).sqrt()
}
