//! Noise of linear light. Without a data sheet only quantisation is known: a uniform error of one
//! step of the pixel value, standard deviation step/√12. Shot noise and read noise are added where
//! the rig file gives full well and read noise in electrons. JPEG artefacts are not modelled.

use super::pixel_values::{CameraResponse, Coding};
use super::transfer::Transfer;

/// Full well and read noise of a sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Electrons {
    /// (electrons); without it shot and read noise are not modelled
    pub full_well: Option<f64>,
    /// standard deviation (electrons)
    pub read_noise: f64,
}

/// Noise of linear light for images of one encoding.
#[derive(Clone, Debug, PartialEq)]
pub struct Noise {
    /// linear light of every pixel value; empty for a linear response
    levels: Vec<f32>,
    /// largest quantisation step (share of full scale)
    largest_step: f64,
    electrons: Electrons,
}

impl Noise {
    /// Noise of images of this encoding.
    pub fn of(coding: &Coding, response: CameraResponse<'_>, electrons: Electrons) -> Self {
        let max_value = usize::from(coding.max_value(response.white_level));
        let share = |value: usize| value as f64 / max_value as f64;
        let levels = match (response.response, coding.transfer) {
            (Some(table), _) => (0..=max_value).map(|v| table.to_linear(share(v)) as f32).collect(),
            (None, Transfer::Linear | Transfer::Auto) => Vec::new(),
            (None, transfer) => {
                (0..=max_value).map(|v| transfer.to_linear(share(v)) as f32).collect()
            }
        };
        let steps = levels.windows(2).map(|pair: &[f32]| f64::from(pair[1] - pair[0]));
        let largest_step =
            if levels.is_empty() { 1.0 / max_value as f64 } else { steps.fold(0.0, f64::max) };
        Self { levels, largest_step, electrons }
    }

    /// Standard deviation at `light` (share of full scale).
    pub fn std(&self, light: f64) -> f64 {
        let step = match self.levels.len() {
            0 => self.largest_step,
            n => {
                let next = self.levels.partition_point(|l| f64::from(*l) < light).clamp(1, n - 1);
                f64::from(self.levels[next] - self.levels[next - 1])
            }
        };
        self.with_step(step, light)
    }

    /// Upper bound of [`Self::std`], without a search for the step.
    pub fn max_std(&self, light: f64) -> f64 {
        self.with_step(self.largest_step, light)
    }

    fn with_step(&self, step: f64, light: f64) -> f64 {
        let shot = self.electrons.full_well.map_or(0.0, |full| {
            (light.max(0.0) * full + self.electrons.read_noise.powi(2)) / (full * full)
        });
        (step * step / 12.0 + shot).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Container;

    #[test]
    fn quantisation_shot_and_read_noise() {
        let coding = |bits, transfer, bits_used| Coding {
            bits,
            container: Container::Raw,
            transfer,
            bits_used,
        };
        let response = |white_level| CameraResponse { white_level, ..CameraResponse::default() };
        // 12 bits in the upper bits of 16.
        let twelve = Noise::of(
            &coding(16, Transfer::Linear, 0xfff0),
            response(Some(0xfff0)),
            Electrons::default(),
        );
        assert!((twelve.std(0.3) * 12f64.sqrt() * 4095.0 - 1.0).abs() < 1e-9);
        // sRGB 128 is 0.2159 in linear light, 129 is 0.2195.
        let eight =
            Noise::of(&coding(8, Transfer::Srgb, 0xff), response(None), Electrons::default());
        assert!(
            eight.max_std(0.2175) > eight.std(0.2175) && eight.max_std(0.2175) == eight.std(0.999)
        );
        assert!((eight.std(0.2175) * 12f64.sqrt() - 0.0036).abs() < 2e-4, "{}", eight.std(0.2175));
        // 10 000 electrons at full scale: at a quarter, shot noise is √2500 electrons; read noise
        // 5.
        let shot = Noise::of(
            &coding(16, Transfer::Linear, 0xffff),
            response(None),
            Electrons { full_well: Some(1e4), read_noise: 5.0 },
        );
        assert!((shot.std(0.25) * 1e4 - 2525f64.sqrt()).abs() < 0.01, "{}", shot.std(0.25));
    }
}
