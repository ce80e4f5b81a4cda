//! Baseline methods for comparison (paper §III, Fig. 4). **Not radiometric corrections**: some use
//! statistics of a single frame, so that brighter pixels need not be brighter on the seafloor, and
//! none models the light path.
//!
//! All work on the demosaiced image in linear light (`ahe` on 8-bit sRGB values) and scale their
//! mean or white to a common level, so that results are comparable.

mod adaptive_histogram;
mod common;
mod frame_average;
mod grey_world;
mod homomorphic;
mod illumination_surface;
mod range_average;
mod white_patch;

pub use frame_average::FrameAverage;
pub use range_average::RangeAverage;

use crate::config::Method;
use crate::image::LinearImage;

/// Mean frames of a log, for [`Method::FrameAverage`] and [`Method::RangeAverage`].
#[derive(Clone, Debug, Default)]
pub struct MeanFrames {
    /// over all frames
    pub all: FrameAverage,
    /// over frames at similar altitude
    pub by_range: RangeAverage,
}

impl MeanFrames {
    /// Adds a frame for a method that needs it; other methods ignore it.
    pub fn add(&mut self, method: Method, image: &LinearImage, camera_altitude_m: f64) {
        match method {
            Method::FrameAverage => self.all.add(image),
            Method::RangeAverage => self.by_range.add(image, camera_altitude_m),
            _ => {}
        }
    }
}

/// Applies a baseline; other methods leave the image unchanged.
pub fn apply(method: Method, image: &mut LinearImage, means: &MeanFrames, camera_altitude_m: f64) {
    match method {
        Method::FrameAverage => means.all.divide(image),
        Method::RangeAverage => means.by_range.divide(image, camera_altitude_m),
        Method::GreyWorld => grey_world::balance(image),
        Method::WhitePatch => white_patch::balance(image),
        Method::Homomorphic => homomorphic::flatten(image),
        Method::HomomorphicSurface => illumination_surface::flatten(image),
        Method::Ahe => adaptive_histogram::equalise(image),
        Method::Full | Method::Attenuation | Method::BeamPattern => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_black_image_stays_finite_in_every_baseline() {
        let methods = [
            Method::GreyWorld,
            Method::WhitePatch,
            Method::Homomorphic,
            Method::HomomorphicSurface,
            Method::Ahe,
        ];
        for method in methods {
            for bands in [1, 3] {
                let mut image = LinearImage::new(5, 3, bands);
                apply(method, &mut image, &MeanFrames::default(), 2.0);
                assert!(image.pixels.iter().all(|v| v.is_finite()), "{method:?} {bands}");
            }
        }
    }
}
