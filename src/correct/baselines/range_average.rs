//! Baseline: divide by the mean of the frames that were taken at about the same height (paper
//! §III-E, after Rock, Honig, Stewart, Gallager & York, "Illumination correction for HabCam
//! imagery", unpublished: its [33]).
//!
//! One height a frame, that of the camera over the plane, in bins. The source's own bins are not
//! known. Right over level ground; it fails where the floor is not flat to the camera, and where a
//! bin has too few frames to average the floor out.

use std::collections::BTreeMap;

use super::FrameAverage;
use super::frame_average::divide_by;
use crate::image::LinearImage;

/// Width of a bin [m]. Wider, and the light changes by a tenth in it; narrower, and it has no
/// frames.
const BIN_M: f64 = 0.2;
/// A bin with fewer frames takes in its neighbours, or a frame is divided by little but itself.
const LEAST_FRAMES: usize = 4;

/// Sums of frames by height. A picture's worth of numbers per bin stays in memory.
#[derive(Clone, Debug, Default)]
pub struct RangeAverage {
    bins: BTreeMap<i64, FrameAverage>,
}

impl RangeAverage {
    /// Takes in a frame.
    pub fn add(&mut self, image: &LinearImage, camera_altitude_m: f64) {
        self.bins.entry(bin(camera_altitude_m)).or_default().add(image);
    }

    /// Divides a frame by the mean of those at its height.
    pub fn divide(&self, image: &mut LinearImage, camera_altitude_m: f64) {
        let at = bin(camera_altitude_m);
        let farthest = self.bins.keys().map(|b| (b - at).abs()).max().unwrap_or(0);
        let within = |reach: i64| {
            self.bins.range(at - reach..=at + reach).map(|(_, sum)| sum).collect::<Vec<_>>()
        };
        let enough = |sums: &Vec<&FrameAverage>| {
            sums.iter().map(|s| s.frames()).sum::<usize>() >= LEAST_FRAMES
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
    use super::super::{MEAN_LEVEL, tests::pattern};
    use super::*;

    /// Light falls with height: frames of a bin are divided by their own mean, frames between bins
    /// by the nearest.
    #[test]
    fn each_height_has_its_own_mean() {
        let floor = pattern(8, 6, 3);
        let lit = |light: f32| LinearImage {
            pixels: floor.pixels.iter().map(|v| v * light).collect(),
            ..floor.clone()
        };
        let mut average = RangeAverage::default();
        for _ in 0..LEAST_FRAMES {
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
