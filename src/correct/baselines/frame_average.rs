//! Baseline: division by the mean of all frames (paper §III-E, Eq. 14).
//!
//! ```text
//! (1/K) Σ_k c_Λ,k ≈ I_Λ r̄_Λ        white balance per pixel; the log's mean is white      Eq. 14
//! ```
//!
//! Valid at constant altitude over homogeneous seafloor; path lengths are ignored.

use super::common::MEAN_LEVEL;
use crate::image::LinearImage;

/// Sum of frames.
#[derive(Clone, Debug, Default)]
pub struct FrameAverage {
    sum: Vec<f64>,
    frames: usize,
    bands: usize,
    size: (usize, usize),
}

impl FrameAverage {
    /// Adds a frame; frames of another size than the first are ignored.
    pub fn add(&mut self, image: &LinearImage) {
        if self.frames == 0 {
            self.sum = vec![0.0; image.pixels.len()];
            (self.bands, self.size) = (image.bands, (image.width, image.height));
        }
        if self.fits(image) {
            self.sum.iter_mut().zip(&image.pixels).for_each(|(s, v)| *s += f64::from(*v));
            self.frames += 1;
        }
    }

    fn fits(&self, image: &LinearImage) -> bool {
        (image.width, image.height) == self.size && image.bands == self.bands
    }

    /// Divides a frame by the mean.
    pub fn divide(&self, image: &mut LinearImage) {
        divide_by(&[self], image);
    }

    /// Number of frames.
    pub fn frames(&self) -> usize {
        self.frames
    }
}

/// Divides a frame by the joint mean of several sums.
pub fn divide_by(sums: &[&FrameAverage], image: &mut LinearImage) {
    let sums: Vec<_> = sums.iter().filter(|s| s.frames > 0 && s.fits(image)).collect();
    let frames = sums.iter().map(|s| s.frames).sum::<usize>() as f64;
    if sums.is_empty() {
        return;
    }
    for (i, value) in image.pixels.iter_mut().enumerate() {
        let mean = (sums.iter().map(|s| s.sum[i]).sum::<f64>() / frames).max(1e-6);
        *value = (f64::from(*value) / mean * MEAN_LEVEL) as f32;
    }
}
