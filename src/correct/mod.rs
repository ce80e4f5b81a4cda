//! Pass two: a frame and its view → a corrected frame (paper §IV-D, Fig. 10).
//!
//! ```text
//! r_Λ = (c_Λ − B_Λ) / (BP(θ, φ) · e^(−α_Λ ℓ) · spreading · cos γ) × one gain per band for the whole log
//! ```
//!
//! A corrected pixel depends on its own raw value, its own light path and numbers of the whole log; but in `baselines`,
//! which are there for comparison, no statistic of a single frame touches it, so what is brighter in the output is brighter on the seafloor. The gain is
//! evaluated on a coarse grid and interpolated: it is smooth, pixels are many. Where a ray never meets the floor
//! there is no gain: the pixel stays black and is counted. Codecs do not live here.

mod baselines;
mod gain;
pub mod mask;
mod rendering;

pub use baselines::MeanFrames;
pub use rendering::rendering;

use crate::config::{Method, RenderConfig};
use crate::geometry::{LightPath, View};
use crate::image::noise::{Electrons, Noise};
use crate::image::{LinearImage, SensorImage};
use crate::model::{Backscatter, GlowTable, ImagingModel, RenderingFile};
use crate::vehicle::Camera;
use gain::GainGrid;

/// How a whole log is corrected.
#[derive(Clone, Copy)]
pub struct Correction<'m> {
    /// the model
    pub model: &'m ImagingModel,
    /// exposure, white balance and the cap's reference
    pub rendering: &'m RenderingFile,
    /// the choices
    pub config: &'m RenderConfig,
    /// backscatter and S_Λ, where the model has backscatter and the method takes it off
    pub glow: Option<(&'m Backscatter, &'m GlowTable)>,
    /// mean frames, for the baselines that divide by them
    pub means: &'m MeanFrames,
    /// input above this share of full scale counts as clipped
    pub clipped_above: f32,
    /// the sensor's electrons, for the account of noise
    pub electrons: Electrons,
}

/// What happened to one frame; shares are of its pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct FrameFacts {
    /// height of the camera over the plane [m]
    pub camera_altitude_m: f64,
    /// shortest way of light [m]
    pub path_length_min_m: f64,
    /// mean
    pub path_length_mean_m: f64,
    /// longest
    pub path_length_max_m: f64,
    /// input at full scale
    pub clipped_input_share: f64,
    /// output that the highest code shows
    pub clipped_output_share: f64,
    /// gain held at the cap
    pub gain_capped_share: f64,
    /// rays that never meet the floor
    pub off_surface_share: f64,
    /// directions of the beam that pass one never saw
    pub unseen_beam_share: f64,
    /// mean factor from raw to corrected light
    pub mean_gain: f64,
    /// light of the floor, less what the water scattered, too near its own noise
    pub low_signal_share: f64,
}

/// A corrected frame: light where 1 is white, and what happened.
#[derive(Clone, Debug)]
pub struct Corrected {
    /// the picture
    pub image: LinearImage,
    /// bits by pixel, where they are wanted
    pub mask: Option<Vec<u8>>,
    /// what happened
    pub facts: FrameFacts,
}

impl Correction<'_> {
    /// Corrects one frame: a mosaic first, while each pixel is one band, then all bands. With the camera of a
    /// rectified picture, lens distortion is undone as well. `frame_gain` is the light this frame got over its neighbours'.
    pub fn apply(&self, mut raw: SensorImage, view: &View<'_>, frame_gain: f64, rectified: Option<&Camera>, noise: &Noise) -> Corrected {
        let pixels = (raw.light.width * raw.light.height) as f64;
        let shares =
            |image: &LinearImage, most: f32| image.pixels.chunks_exact(image.bands).filter(|p| p.iter().any(|v| *v >= most)).count() as f64 / pixels;
        let clipped_input_share = shares(&raw.light, self.clipped_above);
        let mut mask = self.config.mask.then(|| mask::clipped(&raw, self.clipped_above));
        let method = self.config.method;
        // Baselines know nothing of gains, as the log does not say which frames are brighter for the light's sake.
        if frame_gain != 1.0 && !method.is_baseline() {
            raw.light.pixels.iter_mut().for_each(|v| *v /= frame_gain as f32);
        }
        let grid = GainGrid::new(self, view, raw.light.width, raw.light.height, raw.bands());
        let low_signal_share = grid.low_signal_share(&raw, if method.is_baseline() { 1.0 } else { frame_gain }, noise);
        if let Some(mask) = &mut mask {
            grid.mark(mask, raw.light.width);
        }
        if !method.is_baseline() {
            grid.multiply(&mut raw);
        }
        let mut image = raw.into_bands();
        baselines::apply(method, &mut image, self.means, view.camera_altitude_m());
        if let Some(camera) = rectified {
            image = undistorted(&image, view.camera, camera);
            mask = mask.map(|mask| mask::undistorted(&mask, view.camera, camera));
        }
        let clipped_output_share = shares(&image, self.config.white() as f32);
        let of_gains = grid.facts();
        let of_gains = if method.is_baseline() { FrameFacts { gain_capped_share: 0.0, mean_gain: f64::NAN, ..of_gains } } else { of_gains };
        Corrected {
            image,
            mask,
            facts: FrameFacts {
                camera_altitude_m: view.camera_altitude_m(),
                clipped_input_share,
                clipped_output_share,
                low_signal_share,
                ..of_gains
            },
        }
    }
}

/// Log of what a method divides out of one band for one way of light (Fig. 10).
fn log_removed(method: Method, model: &ImagingModel, path: &LightPath, band: usize) -> f64 {
    match method {
        Method::Attenuation => model.log_water(path, band) + model.spreading.log_light(path),
        Method::BeamPattern => model.log_light(path, band) - model.log_water(path, band) - model.log_geometry(path),
        // Baselines divide nothing out; what full correction would have done stands in the facts.
        _ => model.log_light(path, band),
    }
}

/// The picture a camera without distortion would have taken: bilinear in linear light, black outside.
fn undistorted(raw: &LinearImage, from: &Camera, to: &Camera) -> LinearImage {
    let mut out = LinearImage::new(to.width, to.height, raw.bands);
    for (y, row) in out.pixels.chunks_exact_mut(to.width * raw.bands).enumerate() {
        for (x, pixel) in row.chunks_exact_mut(raw.bands).enumerate() {
            let Some((px, py)) = to.image_plane(x as f64, y as f64) else { continue };
            let (u, v) = from.pixel(px, py);
            if !(u >= 0.0 && v >= 0.0 && u <= (raw.width - 1) as f64 && v <= (raw.height - 1) as f64) {
                continue;
            }
            let (i, j) = ((u as usize).min(raw.width - 2), (v as usize).min(raw.height - 2));
            let (a, b) = ((u - i as f64) as f32, (v - j as f64) as f32);
            for (band, value) in pixel.iter_mut().enumerate() {
                let at = |i: usize, j: usize| raw.at(i, j)[band];
                *value = (1.0 - b) * ((1.0 - a) * at(i, j) + a * at(i + 1, j)) + b * ((1.0 - a) * at(i, j + 1) + a * at(i + 1, j + 1));
            }
        }
    }
    out
}
