//! How far a picture's codes can be trusted, as far as that is known without the camera's data
//! sheet: a code is one of so many, and light between two of them is lost (a uniform error of one
//! step, standard deviation step/√12). Where the rig file tells the sensor's electrons, shot and
//! read noise are added. What a JPEG loses beside that is not counted.

use super::decode::{CameraResponse, Coding};
use super::transfer::Transfer;

/// A sensor's electrons.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Electrons {
    /// at full scale; none where nobody told
    pub full_well: Option<f64>,
    /// standard deviation of reading, in electrons
    pub read_noise: f64,
}

/// The noise of one camera's pictures.
#[derive(Clone, Debug, PartialEq)]
pub struct Noise {
    /// light of every code; empty where codes are proportional to it
    levels: Vec<f32>,
    /// light of the largest step
    largest_step: f64,
    electrons: Electrons,
}

impl Noise {
    /// Of pictures coded like this.
    pub fn of(coding: &Coding, light: CameraResponse<'_>, electrons: Electrons) -> Self {
        let codes = match coding.bits {
            0..=8 => 255,
            _ => {
                let unused = coding.bits_used.trailing_zeros().min(8);
                usize::from(light.white_level.unwrap_or(u16::MAX) >> unused).max(1)
            }
        };
        let share = |code: usize| code as f64 / codes as f64;
        let levels = match (light.response, coding.transfer) {
            (Some(response), _) => {
                (0..=codes).map(|c| response.to_linear(share(c)) as f32).collect()
            }
            (None, Transfer::Linear | Transfer::Auto) => Vec::new(),
            (None, transfer) => (0..=codes).map(|c| transfer.to_linear(share(c)) as f32).collect(),
        };
        let steps = levels.windows(2).map(|pair: &[f32]| f64::from(pair[1] - pair[0]));
        let largest_step =
            if levels.is_empty() { 1.0 / codes as f64 } else { steps.fold(0.0, f64::max) };
        Self { levels, largest_step, electrons }
    }

    /// Standard deviation of light [share of full scale].
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

    /// No more than this is it, wherever its step lies: told without looking for it.
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
    fn steps_of_codes_and_electrons() {
        let coding = |bits, transfer, bits_used| Coding {
            bits,
            container: Container::Raw,
            transfer,
            bits_used,
        };
        let light = |white_level| CameraResponse { white_level, ..CameraResponse::default() };
        // 12 bits at the top of 16.
        let twelve = Noise::of(
            &coding(16, Transfer::Linear, 0xfff0),
            light(Some(0xfff0)),
            Electrons::default(),
        );
        assert!((twelve.std(0.3) * 12f64.sqrt() * 4095.0 - 1.0).abs() < 1e-9);
        // Code 128 of sRGB is 0.2159, the next 0.2195.
        let eight = Noise::of(&coding(8, Transfer::Srgb, 0xff), light(None), Electrons::default());
        assert!(
            eight.max_std(0.2175) > eight.std(0.2175) && eight.max_std(0.2175) == eight.std(0.999)
        );
        assert!((eight.std(0.2175) * 12f64.sqrt() - 0.0036).abs() < 2e-4, "{}", eight.std(0.2175));
        // 10 000 electrons at full scale: a quarter of it has 50 of 2500, and reading adds 5.
        let told = Noise::of(
            &coding(16, Transfer::Linear, 0xffff),
            light(None),
            Electrons { full_well: Some(1e4), read_noise: 5.0 },
        );
        assert!((told.std(0.25) * 1e4 - 2525f64.sqrt()).abs() < 0.01, "{}", told.std(0.25));
    }
}
