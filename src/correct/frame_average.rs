//! The baseline: divide by the mean of all frames (paper §III-E, Eq. 14).
//!
//! ```text
//! (1/K) Σ_k c_Λ,k ≈ I_Λ r̄_Λ        a white balance per pixel whose white is the log's mean      Eq. 14
//! ```
//!
//! Fair at one altitude over even ground; it knows nothing of path lengths.

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
    /// Takes in a frame; one of another size than the first is left out.
    pub fn add(&mut self, image: &LinearImage) {
        if self.frames == 0 {
            self.sum = vec![0.0; image.pixels.len()];
            (self.bands, self.size) = (image.bands, (image.width, image.height));
        }
        if (image.width, image.height) == self.size && image.bands == self.bands {
            self.sum.iter_mut().zip(&image.pixels).for_each(|(s, v)| *s += f64::from(*v));
            self.frames += 1;
        }
    }

    /// Whether any frame is in it.
    pub fn is_empty(&self) -> bool {
        self.frames == 0
    }

    /// Divides a frame by the mean; `gain` is the light a mean pixel gets.
    pub fn divide(&self, image: &mut LinearImage, gain: &[f64]) {
        if (image.width, image.height) != self.size || image.bands != self.bands {
            return;
        }
        for (i, (value, sum)) in image.pixels.iter_mut().zip(&self.sum).enumerate() {
            let mean = (sum / self.frames as f64).max(1e-6);
            *value = (f64::from(*value) / mean * gain[i % self.bands]) as f32;
        }
    }
}
