//! Pass two: a frame and its view → a corrected frame (paper §IV-D, Fig. 10).
//!
//! ```text
//! r_Λ = (c_Λ − B_Λ) / (BP(θ, φ) · e^(−α_Λ ℓ) · spreading · cos γ) × one gain per band for the whole log
//! ```
//!
//! A corrected pixel depends on its own raw value, its own light path and numbers of the whole log;
//! but in `baselines`, which are there for comparison, no statistic of a single frame touches it,
//! so what is brighter in the output is brighter on the seafloor. The gain is evaluated on a coarse
//! grid and interpolated: it is smooth, pixels are many. A frame goes by in rows, so that what is
//! worked on stays near the processor. Where a ray never meets the floor there is no gain: the
//! pixel stays black and is counted. Codecs do not live here.

mod baselines;
mod gain;
pub mod mask;
mod nodes;
mod rendering;

pub use baselines::{MeanFrames, apply as apply_baseline};
pub use rendering::estimate_rendering;

use crate::config::RenderConfig;
use crate::geometry::View;
use crate::image::decode::PixelValues;
use crate::image::demosaic::Demosaic;
use crate::image::flat_field::FlatField;
use crate::image::noise::{Electrons, Noise};
use crate::image::{LinearImage, max_value};
use crate::model::{Backscatter, ImagingModel, RenderingFile, ScatterTable};
use crate::vehicle::Camera;
use gain::GainGrid;

/// How a whole log is corrected.
#[derive(Clone, Copy)]
pub struct Correction<'m> {
    /// the model, its beam pattern [`refined`](crate::model::BeamPattern::refined)
    pub model: &'m ImagingModel,
    /// of that beam pattern, see [`roughness`](crate::model::BeamPattern::roughness)
    pub roughness: (f64, f64),
    /// exposure, white balance and the cap's reference
    pub rendering: &'m RenderingFile,
    /// the choices
    pub config: &'m RenderConfig,
    /// backscatter and S_Λ, where the model has backscatter and the method takes it off
    pub glow: Option<(&'m Backscatter, &'m ScatterTable)>,
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

/// A frame as it came, and what is known of it.
#[derive(Clone, Copy)]
pub struct Frame<'f> {
    /// the picture
    pub codes: &'f PixelValues<'f>,
    /// what lens and sensor took of its light
    pub flat_field: Option<&'f FlatField>,
    /// its geometry
    pub view: &'f View<'f>,
    /// light it got over its neighbours'
    pub gain: f64,
    /// how far its codes can be trusted
    pub noise: &'f Noise,
    /// the camera of a rectified picture, where lens distortion is to be undone as well
    pub rectified: Option<&'f Camera>,
}

/// What happened to a frame, beside its pixels.
#[derive(Clone, Debug)]
pub struct Corrected {
    /// bits by pixel, where they are wanted
    pub mask: Option<Vec<u8>>,
    /// what happened
    pub facts: FrameFacts,
}

/// Pixels of a row with a band that reaches a level.
fn reaching(row: &[f32], bands: usize, level: f32) -> usize {
    // Most rows have none, and that is told many at a time.
    if max_value(row) >= level {
        row.chunks_exact(bands).filter(|p| p.iter().any(|v| *v >= level)).count()
    } else {
        0
    }
}

impl Correction<'_> {
    /// Corrects one frame, row by row from codes to light where 1 is white: a mosaic first, while
    /// each pixel is one band, then all bands. `take` gets the rows of the corrected picture in
    /// order; it may change them.
    pub fn apply(&self, frame: &Frame<'_>, mut take: impl FnMut(&mut [f32])) -> Corrected {
        let Frame { codes, view, .. } = *frame;
        let (width, height, stored, bands) =
            (codes.width, codes.height, codes.stored_bands(), codes.bands());
        let is_baseline = self.config.method.is_baseline();
        // Baselines know nothing of gains, as the log does not say which frames are brighter for
        // the light's sake.
        let frame_gain = if is_baseline { 1.0 } else { frame.gain };
        let white = self.config.white() as f32;
        let grid = GainGrid::new(self, view, width, height, bands);
        let mut gains = grid.rows(codes.mosaic, frame_gain);
        let mut mask = self
            .config
            .mask
            .then(|| mask::ClippingMask::new(width, height, codes.mosaic.is_some()));
        let mut demosaic = codes.mosaic.map(|phase| Demosaic::new(width, height, phase));
        let wants_whole = is_baseline || frame.rectified.is_some();
        let mut whole = LinearImage {
            width,
            height,
            bands,
            pixels: Vec::with_capacity(if wants_whole { width * height * bands } else { 0 }),
        };
        let (mut clipped_input, mut clipped_output, mut low, mut looked) = (0, 0, 0, 0);
        let mut out = |row: &mut [f32]| {
            if wants_whole {
                whole.pixels.extend_from_slice(row);
            } else {
                clipped_output += reaching(row, bands, white);
                take(row);
            }
        };
        let mut row = vec![0f32; width * stored];
        for y in 0..height {
            codes.linear_row(y, &mut row);
            if let Some(flat) = frame.flat_field {
                flat.divide_row(y, codes.mosaic, &mut row);
            }
            if frame.flat_field.is_some() || codes.may_reach(y, self.clipped_above) {
                clipped_input += reaching(&row, stored, self.clipped_above);
            }
            if let Some(mask) = &mut mask {
                mask.mark_row(y, &row, self.clipped_above);
            }
            gains.go_to(y);
            let (l, n) = gains.low_signal(y, &row, frame.noise);
            (low, looked) = (low + l, looked + n);
            if !is_baseline {
                gains.multiply(&mut row);
            }
            match &mut demosaic {
                Some(demosaic) => demosaic.push(&row, &mut out),
                None => out(&mut row),
            }
        }
        let mut mask = mask.map(|mask| mask.bits);
        if let Some(mask) = &mut mask {
            grid.mark(mask);
        }
        if wants_whole {
            baselines::apply(self.config.method, &mut whole, self.means, view.camera_altitude_m());
            if let Some(camera) = frame.rectified {
                whole = undistorted(&whole, view.camera, camera);
                mask = mask.map(|mask| mask::rectify(&mask, view.camera, camera));
            }
            for row in whole.pixels.chunks_exact_mut(whole.width * bands) {
                clipped_output += reaching(row, bands, white);
                take(row);
            }
        }
        let of_gains = grid.facts();
        let of_gains = if is_baseline {
            FrameFacts { gain_capped_share: 0.0, mean_gain: f64::NAN, ..of_gains }
        } else {
            of_gains
        };
        let pixels = (width * height) as f64;
        Corrected {
            mask,
            facts: FrameFacts {
                camera_altitude_m: view.camera_altitude_m(),
                clipped_input_share: clipped_input as f64 / pixels,
                clipped_output_share: clipped_output as f64 / pixels,
                low_signal_share: low as f64 / looked.max(1) as f64,
                ..of_gains
            },
        }
    }
}

/// The picture a camera without distortion would have taken: bilinear in linear light, black
/// outside.
fn undistorted(raw: &LinearImage, from: &Camera, to: &Camera) -> LinearImage {
    let mut out = LinearImage::new(to.width, to.height, raw.bands);
    for (y, row) in out.pixels.chunks_exact_mut(to.width * raw.bands).enumerate() {
        for (x, pixel) in row.chunks_exact_mut(raw.bands).enumerate() {
            let Some((px, py)) = to.image_plane(x as f64, y as f64) else { continue };
            let (u, v) = from.pixel(px, py);
            if !(u >= 0.0
                && v >= 0.0
                && u <= (raw.width - 1) as f64
                && v <= (raw.height - 1) as f64)
            {
                continue;
            }
            let (i, j) = ((u as usize).min(raw.width - 2), (v as usize).min(raw.height - 2));
            let (a, b) = ((u - i as f64) as f32, (v - j as f64) as f32);
            for (band, value) in pixel.iter_mut().enumerate() {
                let at = |i: usize, j: usize| raw.at(i, j)[band];
                *value = (1.0 - b) * ((1.0 - a) * at(i, j) + a * at(i + 1, j))
                    + b * ((1.0 - a) * at(i, j + 1) + a * at(i + 1, j + 1));
            }
        }
    }
    out
}
