//! Gain limited by signal to noise: no colour where a band has no signal.
//!
//! ```text
//! w = s² / (s² + (k n)²)             per band: signal s, noise n; k render.gain_signal_to_noise
//! y' = w y + (W − w) L + (1 − W)     W = max w,  L = Σ w y / Σ w
//! ```
//!
//! s is the modelled direct light of the pixel times the seafloor's median reflectance. n is the
//! noise of the pixel values there and the uncertainty of the backscatter that is removed. y is
//! corrected light over its median M in the log. Where a band's signal is weak, its deviation from
//! the luminance L of the better bands is reduced; where no band has signal, the image fades to M,
//! a neutral grey. Weights depend on geometry and model only, but for places where a frame has
//! hardly any light (`light_map`): they are the same for the whole log
//! and smooth in space, and y = 1 stays 1, so that nothing becomes darker. The standard deviation
//! of y' is at most 1/k, whatever the gain: of w y alone it is √(w (1 − w)) / k.

use super::light_map::LightMap;
use crate::image::noise::Noise;
use crate::model::limited::{EMPIRICAL_BACKSCATTER_ERROR, weight};
use crate::model::{RangeFactor, RenderingFile};

/// Standard deviation of removed backscatter of the physical model, as a share of it.
const BACKSCATTER_ERROR: f64 = 0.05;
/// A band of less weight than this has hardly any colour of its own.
const MIN_WEIGHT: f32 = 0.5;
/// The band of a colour image that water and lamps leave the most of.
const GREEN: usize = 1;
/// Median level of the corrected seafloor in models that do not have it (share of white).
const USUAL_LEVEL: f64 = 0.2;

/// What a frame got: noise of its pixel values, light and slant ranges.
#[derive(Clone, Copy)]
pub struct FrameLight<'s> {
    /// of its pixel values
    pub noise: &'s Noise,
    /// its light over its neighbours'
    pub gain: f64,
    /// factor of its slant ranges, in the empirical model
    pub range_factor: RangeFactor,
    /// where it got less light than the empirical model predicts
    pub map: Option<&'s LightMap>,
}

/// Signal and noise of a frame.
#[derive(Clone, Copy)]
pub struct Signal<'s> {
    frame: FrameLight<'s>,
    /// share of backscatter that is uncertain
    backscatter_error: f64,
    /// k
    least_ratio: f64,
    /// median of light over the model, by band
    reflectance: [f64; 3],
    bands: usize,
}

impl<'s> Signal<'s> {
    /// For frames of a log with this exposure.
    pub fn new(
        rendering: &RenderingFile,
        bands: usize,
        least_ratio: f64,
        is_empirical: bool,
        frame: FrameLight<'s>,
    ) -> Self {
        let reflectance = |b: usize| {
            let usual = || rendering.gain.get(b).map_or(USUAL_LEVEL, |g| USUAL_LEVEL / g);
            rendering.median_reflectance.get(b).copied().unwrap_or_else(usual)
        };
        let reflectance = std::array::from_fn(reflectance);
        let backscatter_error =
            if is_empirical { EMPIRICAL_BACKSCATTER_ERROR } else { BACKSCATTER_ERROR };
        Self { frame, backscatter_error, least_ratio, reflectance, bands }
    }

    /// w per band at a pixel: of the factor that its light is multiplied by, without exposure, and
    /// of its backscatter. Where light is missing, all bands follow green.
    pub fn weights(&self, at: (f64, f64), factor: [f32; 3], scattered: [f32; 3]) -> [f32; 3] {
        let signal = |b: usize| self.reflectance[b] / f64::from(factor[b]);
        let of_band = |b: usize| {
            if b >= self.bands {
                return 0.0;
            }
            let signal = signal(b);
            let scattered = f64::from(scattered[b]);
            // Backscatter and model are those of a frame whose gain is 1.
            let FrameLight { noise, gain, .. } = self.frame;
            let noise = noise.std((signal + scattered) * gain) / gain;
            let noise = noise.hypot(self.backscatter_error * scattered);
            weight(signal, noise, self.least_ratio) as f32
        };
        let mut weights: [f32; 3] = std::array::from_fn(of_band);
        if let Some(map) = self.frame.map {
            let light = |b: usize| signal(b) + f64::from(scattered[b]);
            let light = |b: usize| if b < self.bands { light(b) * self.frame.gain } else { 0.0 };
            let share = map.colour_share(at, &std::array::from_fn(light));
            // One and the same band everywhere: a change of band would be seen as an edge.
            (0..self.bands).filter(|b| *b != GREEN).for_each(|b| weights[b] *= share);
        }
        weights
    }

    /// M per band: median of the corrected seafloor (share of white).
    pub fn levels(&self, rendering: &RenderingFile) -> [f32; 3] {
        std::array::from_fn(|b| {
            let gain = rendering.gain.get(b).copied().unwrap_or(1.0);
            (self.reflectance[b] * gain).max(1e-6) as f32
        })
    }
}

/// Whether a band of a pixel has hardly any signal.
pub fn is_limited(weights: &[f32]) -> bool {
    weights.iter().any(|w| *w < MIN_WEIGHT)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Container;
    use crate::image::decode::{CameraResponse, Coding};
    use crate::image::noise::Electrons;
    use crate::image::transfer::Transfer;
    use crate::model::limited::shrink;

    fn noise() -> Noise {
        let coding = Coding {
            bits: 16,
            container: Container::Raw,
            transfer: Transfer::Linear,
            bits_used: 0xfff0,
        };
        let electrons = Electrons { full_well: Some(1e4), read_noise: 10.0 };
        Noise::of(&coding, CameraResponse::default(), electrons)
    }

    fn rendering() -> RenderingFile {
        RenderingFile {
            gain: vec![2.0; 3],
            median_correction: vec![1.0; 3],
            median_reflectance: vec![0.1; 3],
            ..RenderingFile::default()
        }
    }

    #[test]
    fn noise_of_the_result_is_at_most_one_over_the_setting() {
        let noise = noise();
        let range_factor = RangeFactor::default();
        let frame = FrameLight { noise: &noise, gain: 1.0, range_factor, map: None };
        let signal = Signal::new(&rendering(), 3, 5.0, false, frame);
        let levels = signal.levels(&rendering());
        for exponent in 0..60 {
            let gain = 1.2f32.powi(exponent);
            for ratio in [[1.0, 1.0, 1.0], [0.01, 0.5, 1.0], [1.0, 0.02, 0.02]] {
                let factor = ratio.map(|r: f32| gain / r);
                let weights = signal.weights((0.0, 0.0), factor, [0.0; 3]);
                // One band's noise after another: the result is linear in them.
                let mut variance = [0f64; 3];
                for band in 0..3 {
                    let signal = 0.1 / f64::from(factor[band]);
                    let relative = noise.std(signal) / signal;
                    let mut pixel = levels;
                    pixel[band] *= 1.0 + relative as f32;
                    shrink(&mut pixel, &weights, &levels);
                    for b in 0..3 {
                        variance[b] += f64::from(pixel[b] / levels[b] - 1.0).powi(2);
                    }
                }
                assert!(
                    variance.iter().all(|v| v.sqrt() <= 0.2 + 1e-3),
                    "{variance:?} {factor:?} {weights:?}"
                );
            }
        }
    }

    #[test]
    fn a_band_without_signal_takes_the_luminance_and_none_gives_grey() {
        let levels = [0.2; 3];
        let mut pixel = [9.0, 0.3, 0.3];
        shrink(&mut pixel, &[0.0, 1.0, 1.0], &levels);
        assert!(pixel.iter().all(|v| (v - 0.3).abs() < 1e-6), "{pixel:?}");
        let mut pixel = [9.0, -3.0, 7.0];
        shrink(&mut pixel, &[0.0; 3], &levels);
        assert_eq!(pixel, levels);
        let mut pixel = [0.5, 0.1, 0.4];
        shrink(&mut pixel, &[1.0; 3], &levels);
        assert_eq!(pixel, [0.5, 0.1, 0.4]);
    }
}
