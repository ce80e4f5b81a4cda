//! Baseline: division by the mean of frames at similar altitude (paper §III-E, after Rock, Honig,
//! Stewart, Gallager & York, "Illumination correction for HabCam imagery", unpublished: its
//! reference 33).
//!
//! One altitude per frame, that of the camera over the plane, in bins; the bins of the source are
//! not published. Valid over level seafloor; it fails where the seafloor is tilted against the
//! camera, and where a bin has too few frames to average out the texture.

use std::collections::BTreeMap;

use super::frame_average::{FrameAverage, divide_by};
use crate::image::LinearImage;

/// Width of a bin (m). Light changes by up to 10 % within a wider bin; a narrower one has too few
/// frames.
const BIN_M: f64 = 0.2;
/// A bin with fewer frames is merged with its neighbours; a frame would otherwise be divided by
/// little but itself.
const MIN_FRAMES: usize = 4;

/// Sums of frames by altitude bin. Memory: one image of `f64` per bin.
#[derive(Clone, Debug, Default)]
pub struct RangeAverage {
    bins: BTreeMap<i64, FrameAverage>,
}

impl RangeAverage {
    /// Adds a frame.
    pub fn add(&mut self, image: &LinearImage, camera_altitude_m: f64) {
        self.bins.entry(bin(camera_altitude_m)).or_default().add(image);
    }

    /// Divides a frame by the mean at its altitude.
    pub fn divide(&self, image: &mut LinearImage, camera_altitude_m: f64) {
        let at = bin(camera_altitude_m);
        let farthest = self.bins.keys().map(|b| (b - at).abs()).max().unwrap_or(0);
        let within = |reach: i64| {
            self.bins.range(at - reach..=at + reach).map(|(_, sum)| sum).collect::<Vec<_>>()
        };
        let enough = |sums: &Vec<&FrameAverage>| {
            sums.iter().map(|s| s.frames()).sum::<usize>() >= MIN_FRAMES
        };
        let sums = (0..=farthest).map(within).find(enough).unwrap_or_else(|| within(farthest));
        divide_by(&sums, image);
    }
}

fn bin(camera_altitude_m: f64) -> i64 {
    (camera_altitude_m / BIN_M).floor() as i64
}

#[cfg(test)]
mod tests {
    use super::super::common::{MEAN_LEVEL, tests::pattern};
    use super::*;

    /// Frames of a bin are divided by the mean of that bin, frames between bins by the nearest.
    #[test]
    fn each_altitude_has_its_own_mean() {
        let seafloor = pattern(8, 6, 3);
        let lit = |light: f32| LinearImage {
            pixels: seafloor.pixels.iter().map(|v| v * light).collect(),
            ..seafloor.clone()
        };
        let mut average = RangeAverage::default();
        for _ in 0..MIN_FRAMES {
            average.add(&lit(1.0), 1.05);
            average.add(&lit(0.25), 2.05);
        }
        for (light, altitude_m) in [(1.0, 1.1), (0.25, 2.15), (0.25, 2.9), (1.0, 0.3)] {
            let mut image = lit(light);
            average.divide(&mut image, altitude_m);
            assert!(
                image.pixels.iter().all(|v| (f64::from(*v) - MEAN_LEVEL).abs() < 1e-6),
                "{altitude_m}"
            );
        }
    }
}
