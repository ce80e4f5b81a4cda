//! Baseline methods for comparison (paper §III, Fig. 4). **Not radiometric corrections**: some use
//! statistics of a single frame, so that brighter pixels need not be brighter on the seafloor, and
//! none models the light path.
//!
//! All work on the demosaiced image in linear light (`ahe` on 8-bit sRGB values) and scale their
//! mean or white to a common level, so that results are comparable.

mod adaptive_histogram;
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

/// Level to which a method scales its mean [share of white].
const MEAN_LEVEL: f64 = 0.25;
/// Level to which a method scales its white [share of white].
const WHITE_LEVEL: f64 = 0.9;
/// Lower bound before logarithms [share of full scale]; about one DN of a 12-bit camera.
const MIN_LIGHT: f32 = 1e-4;

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

/// Block means of log light of one band, with at most `side` blocks along the longer side; columns
/// and rows of blocks; and the block size [px].
fn log_blocks(image: &LinearImage, band: usize, side: usize) -> (Vec<f64>, (usize, usize), usize) {
    let block = image.width.max(image.height).div_ceil(side).max(1);
    let (columns, rows) = (image.width.div_ceil(block), image.height.div_ceil(block));
    let mut sums = vec![(0.0, 0u32); columns * rows];
    for (i, pixel) in image.pixels.chunks_exact(image.bands).enumerate() {
        let (sum, count) = &mut sums[i / image.width / block * columns + i % image.width / block];
        *sum += f64::from(pixel[band].max(MIN_LIGHT).ln());
        *count += 1;
    }
    (sums.into_iter().map(|(sum, count)| sum / f64::from(count)).collect(), (columns, rows), block)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Test image that Python reproduces: `((7x + 13y + 29b) % 97 + 3) / 128`, in double precision.
    pub fn pattern(width: usize, height: usize, bands: usize) -> LinearImage {
        let mut image = LinearImage::new(width, height, bands);
        for (i, pixel) in image.pixels.chunks_exact_mut(bands).enumerate() {
            let (x, y) = (i % width, i / width);
            pixel
                .iter_mut()
                .enumerate()
                .for_each(|(b, v)| *v = ((7 * x + 13 * y + 29 * b) % 97 + 3) as f32 / 128.0);
        }
        image
    }

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
