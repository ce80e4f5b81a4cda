//! Gain limited by signal to noise: no colour where a band has no signal.
//!
//! ```text
//! w = s² / (s² + (k n)²)                        per band: signal s, noise n, k = render.gain_signal_to_noise
//! y' = w y + (W − w) L + (1 − W)                W = max w,  L = Σ w y / Σ w
//! ```
//!
//! s is the modelled direct light of the pixel times the seafloor's median reflectance. n is the
//! noise of the pixel values there and the uncertainty of the backscatter that is removed. y is
//! corrected light over its median M in the log. Where a band's signal is weak, its deviation from
//! the luminance L of the better bands is reduced; where no band has signal, the image fades to M,
//! a neutral grey. Weights depend on geometry and model only: they are the same for the whole log
//! and smooth in space, and y = 1 stays 1, so that nothing becomes darker. The standard deviation
//! of y' is at most 1/k, whatever the gain: of w y alone it is √(w (1 − w)) / k.

use super::gain_field::GainField;
use super::mask;
use super::node_grid::{NodeGrid, RowWalker};
use crate::geometry::LightPath;
use crate::image::noise::Noise;
use crate::model::RenderingFile;

/// Standard deviation of removed backscatter, as a share of it.
const BACKSCATTER_ERROR: f64 = 0.05;
/// Weights above this count as 1.
const FULL_WEIGHT: f64 = 0.995;
/// A band of less weight than this has hardly any colour of its own.
const MIN_WEIGHT: f32 = 0.5;
/// Median level of the corrected seafloor in models that do not have it (share of white).
const USUAL_LEVEL: f64 = 0.2;

/// Signal and noise of a frame.
#[derive(Clone, Copy)]
pub struct Signal<'s> {
    noise: &'s Noise,
    /// light of the frame over its neighbours'
    frame_gain: f64,
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
        (noise, frame_gain): (&'s Noise, f64),
    ) -> Self {
        let reflectance = |b: usize| {
            let usual = || rendering.gain.get(b).map_or(USUAL_LEVEL, |g| USUAL_LEVEL / g);
            rendering.median_reflectance.get(b).copied().unwrap_or_else(usual)
        };
        let reflectance = std::array::from_fn(reflectance);
        Self { noise, frame_gain, least_ratio, reflectance, bands }
    }

    /// w per band at a pixel: of the factor that its light is multiplied by, without exposure, and
    /// of its backscatter.
    pub fn weights(&self, factor: [f32; 3], scattered: [f32; 3]) -> [f32; 3] {
        let weight = |b: usize| {
            if b >= self.bands {
                return 0.0;
            }
            let signal = self.reflectance[b] / f64::from(factor[b]);
            let scattered = f64::from(scattered[b]);
            // Backscatter and model are those of a frame whose gain is 1.
            let light = (signal + scattered) * self.frame_gain;
            let noise = self.noise.std(light) / self.frame_gain;
            let noise = self.least_ratio * noise.hypot(BACKSCATTER_ERROR * scattered);
            let weight = signal * signal / (signal * signal + noise * noise);
            (weight / FULL_WEIGHT).min(1.0) as f32
        };
        std::array::from_fn(weight)
    }

    /// M per band: median of the corrected seafloor (share of white).
    fn levels(&self, rendering: &RenderingFile) -> [f32; 3] {
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

/// Reduces the colour of rows where bands are short of signal.
pub struct Shrinkage<'g> {
    field: &'g GainField<'g>,
    walker: RowWalker<'g>,
    /// weights of the current row
    weights: Vec<f32>,
    levels: [f32; 3],
    /// rows of nodes with a weight below 1
    is_weak: Vec<bool>,
}

impl<'g> Shrinkage<'g> {
    /// For rows of all bands; `None` where every band has signal everywhere.
    pub fn new(field: &'g GainField<'g>) -> Option<Self> {
        let nodes = field.weights.as_ref()?;
        let signal = field.signal.as_ref()?;
        let of_row = |row: &[f32]| row.iter().any(|w| *w < 1.0);
        let is_weak: Vec<bool> =
            nodes.values.chunks_exact(nodes.columns * nodes.bands).map(of_row).collect();
        is_weak.contains(&true).then(|| Self {
            field,
            walker: RowWalker::new(nodes, field.width, None),
            weights: vec![0.0; field.width * nodes.bands],
            levels: signal.levels(field.correction.rendering),
            is_weak,
        })
    }

    /// Changes row `y` of corrected light; rows come from top to bottom.
    pub fn apply(&mut self, y: usize, row: &mut [f32]) {
        let NodeGrid { step, rows, .. } = self.field.gains;
        let top = (y / step).min(rows - 1);
        if !self.is_weak[top] && !self.is_weak[(top + 1).min(rows - 1)] {
            return;
        }
        let bands = self.field.bands;
        self.walker.row(y, &mut self.weights);
        for x in self.field.uneven_pixels(y) {
            let weights = self.field.exact_weights(x, y);
            self.weights[x * bands..][..bands].copy_from_slice(&weights[..bands]);
        }
        for (pixel, weights) in row.chunks_exact_mut(bands).zip(self.weights.chunks_exact(bands)) {
            // Off the seafloor there is nothing to show.
            if weights.iter().any(|w| *w < 1.0) && weights[0] >= 0.0 {
                shrink(pixel, weights, &self.levels);
            }
        }
    }
}

/// y' of one pixel.
fn shrink(pixel: &mut [f32], weights: &[f32], levels: &[f32; 3]) {
    let most = weights.iter().copied().fold(0f32, f32::max);
    let (mut sum, mut total) = (0.0, 0.0);
    for (b, (v, w)) in pixel.iter().zip(weights).enumerate() {
        sum += w * v / levels[b];
        total += w;
    }
    let luminance = if total > 0.0 { sum / total } else { 0.0 };
    for (b, (v, w)) in pixel.iter_mut().zip(weights).enumerate() {
        *v = w * *v + levels[b] * ((most - w) * luminance + 1.0 - most);
    }
}

impl GainField<'_> {
    /// Weights of one pixel, exact; −1 off the seafloor.
    fn exact_weights(&self, x: usize, y: usize) -> [f32; 3] {
        let (u, v) = (x as f64, y as f64);
        let Some(signal) = &self.signal else { return [1.0; 3] };
        self.view.light_path(u, v).map_or([-1.0; 3], |path: LightPath| {
            let (factor, _) = self.factor(&path);
            signal.weights(factor, self.scattered_at(u, v, &path))
        })
    }

    /// Bits of a pixel with these weights.
    pub(super) fn bits_of(&self, weights: &[f32], is_seen: bool) -> u8 {
        // A baseline has no gain that could be limited.
        let limited = is_limited(weights) && !self.correction.config.method.is_baseline();
        (u8::from(limited) * mask::CAPPED) | (u8::from(!is_seen) * mask::UNSEEN_BEAM)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Container;
    use crate::image::decode::{CameraResponse, Coding};
    use crate::image::noise::Electrons;
    use crate::image::transfer::Transfer;

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
        let signal = Signal::new(&rendering(), 3, 5.0, (&noise, 1.0));
        let levels = signal.levels(&rendering());
        for exponent in 0..60 {
            let gain = 1.2f32.powi(exponent);
            for ratio in [[1.0, 1.0, 1.0], [0.01, 0.5, 1.0], [1.0, 0.02, 0.02]] {
                let factor = ratio.map(|r: f32| gain / r);
                let weights = signal.weights(factor, [0.0; 3]);
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
