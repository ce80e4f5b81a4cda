//! Pass two: a frame and its view → a corrected frame (paper §IV-D, Fig. 10).
//!
//! ```text
//! r_Λ = (c_Λ − B_Λ) / (BP(θ, φ) · e^(−α_Λ ℓ) · spreading · cos γ) × gain_Λ
//! ```
//! with one gain per band for the whole log.
//!
//! A corrected pixel depends on its own raw value, its own light path and numbers of the whole log.
//! Except in `baselines`, which are there for comparison, and but for colour where light is missing
//! (`light_map`), no statistic of a single frame affects it, so what is brighter in the output is
//! brighter on the seafloor. The gain is evaluated on a coarse grid and interpolated: it is smooth,
//! pixels are many. A frame is processed row by row, so that the data stay in the cache. Where a
//! ray never meets the seafloor there is no gain: the pixel stays black and is counted.

mod baselines;
mod gain_field;
mod gain_rows;
mod highlights;
mod light_map;
pub mod mask;
mod node_grid;
mod rectify;
mod rendering;
mod signal;

pub use baselines::{MeanFrames, apply as apply_baseline};
pub use rendering::{estimate_rendering, rendering_of, tone};

use crate::config::{Method, RenderConfig};
use crate::geometry::View;
use crate::image::decode::PixelValues;
use crate::image::demosaic::Demosaic;
use crate::image::flat_field::FlatField;
use crate::image::noise::{Electrons, Noise};
use crate::image::{Bands, LinearImage, interleaved, vectorised};
use crate::model::{Backscatter, ImagingModel, RangeFactor, RenderingFile, ScatterTable};
use crate::vehicle::Camera;
use gain_field::GainField;
use gain_rows::{GainRows, Shrinkage};
use highlights::Highlights;
use light_map::LightMap;
use rectify::rectified;
use signal::FrameLight;

/// How a whole log is corrected.
#[derive(Clone, Copy)]
pub struct Correction<'m> {
    /// the model, its beam pattern [`refined`](crate::model::BeamPattern::refined)
    pub model: &'m ImagingModel,
    /// of that beam pattern, see [`roughness`](crate::model::BeamPattern::roughness)
    pub roughness: (f64, f64),
    /// exposure, white balance and the median reflectance
    pub rendering: &'m RenderingFile,
    /// the settings
    pub config: &'m RenderConfig,
    /// backscatter and S_Λ, where the model has backscatter and the method removes it
    pub backscatter: Option<(&'m Backscatter, &'m ScatterTable)>,
    /// mean frames, for the baselines that divide by them
    pub means: &'m MeanFrames,
    /// input above this share of full scale counts as clipped
    pub clipped_above: f32,
    /// electrons of the sensor, for its noise
    pub electrons: Electrons,
}

/// Facts of one corrected frame; shares are of its pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct FrameFacts {
    /// altitude of the camera over the seafloor plane (m)
    pub camera_altitude_m: f64,
    /// shortest light path ℓ (m)
    pub path_length_min_m: f64,
    /// mean light path (m)
    pub path_length_mean_m: f64,
    /// longest light path (m)
    pub path_length_max_m: f64,
    /// raw pixels at full scale
    pub clipped_input_share: f64,
    /// corrected pixels at full scale
    pub clipped_output_share: f64,
    /// pixels with a band whose gain is limited, as its signal is near its noise
    pub gain_capped_share: f64,
    /// rays that never meet the seafloor
    pub off_surface_share: f64,
    /// pixels lit from directions of the beam that pass one never saw
    pub unseen_beam_share: f64,
    /// mean factor from raw to corrected light
    pub mean_gain: f64,
    /// pixels whose light, less backscatter, is too close to its noise
    pub low_signal_share: f64,
    /// pixels clipped in some bands that are rendered neutral
    pub restored_share: f64,
    /// light of the frame over that of others, per band, which is divided out
    pub frame_gain: Bands,
}

/// A raw frame and its geometry.
#[derive(Clone, Copy)]
pub struct Frame<'f> {
    /// pixel values
    pub codes: &'f PixelValues<'f>,
    /// vignetting of lens and sensor
    pub flat_field: Option<&'f FlatField>,
    /// its geometry
    pub view: &'f View<'f>,
    /// light of this frame over its neighbours'
    pub gain: f64,
    /// each band's own gain over that
    pub balance: Bands,
    /// factor of its slant ranges, in the empirical model
    pub range_factor: RangeFactor,
    /// noise of its pixel values
    pub noise: &'f Noise,
    /// the camera without distortion, where the image is to be rectified
    pub rectified: Option<&'f Camera>,
}

impl Frame<'_> {
    /// Divides a row, band after band, by each band's own gain.
    fn balance_row(&self, y: usize, row: &mut [f32]) {
        let per_band = self.balance.map(|own| 1.0 / own as f32);
        for (b, of_band) in row.chunks_exact_mut(self.codes.width).enumerate() {
            for (x, value) in of_band.iter_mut().enumerate() {
                *value *= per_band[self.codes.mosaic.map_or(b, |pattern| pattern.band(x, y))];
            }
        }
    }
}

/// The result of a correction, beside the pixels.
#[derive(Clone, Debug)]
pub struct Corrected {
    /// bits per pixel (see [`mask`]), where `--mask` asks for them
    pub mask: Option<Vec<u8>>,
    /// path lengths and shares
    pub facts: FrameFacts,
}

/// Pixels of a row, band after band, with a band that reaches a level.
fn reaching(row: &[f32], bands: usize, level: f32) -> usize {
    let width = row.len() / bands;
    let (first, rest) = row.split_at(width);
    let count = match bands {
        3 => {
            let others = rest[..width].iter().zip(&rest[width..]);
            let reaches = |(a, (b, c)): (&f32, (&f32, &f32))| {
                u32::from((*a >= level) | (*b >= level) | (*c >= level))
            };
            vectorised(
                #[inline(always)]
                || first.iter().zip(others).map(reaches).sum::<u32>(),
            )
        }
        _ => first.iter().map(|v| u32::from(*v >= level)).sum(),
    };
    count as usize
}

/// Counts over the pixels of a frame.
#[derive(Default)]
struct Counts {
    clipped_input: usize,
    clipped_output: usize,
    low_signal: usize,
    signal_samples: usize,
    restored: usize,
}

impl Correction<'_> {
    /// Corrects one frame, row by row from pixel values to light where 1 is white: a mosaic first,
    /// while each pixel is one band, then all bands. `take` receives the rows of the corrected
    /// image in order, band after band; it may change them.
    pub fn apply(&self, frame: &Frame<'_>, mut take: impl FnMut(&mut [f32])) -> Corrected {
        let Frame { codes, view, .. } = *frame;
        let (width, height, bands) = (codes.width, codes.height, codes.bands());
        let is_baseline = self.config.method.is_baseline();
        let white = tone(self.config, self.rendering).white() as f32;
        let is_empirical = self.model.empirical.is_some() && self.config.method == Method::Full;
        let map = (is_empirical && bands > 1).then(|| {
            let balance = |y: usize, row: &mut [f32]| frame.balance_row(y, row);
            let map = LightMap::of(codes, frame.flat_field, balance);
            if frame.range_factor.is_unexplained { map.without_lamp() } else { map }
        });
        let Frame { noise, gain, range_factor, .. } = *frame;
        let light = FrameLight { noise, gain, range_factor, map: map.as_ref() };
        let field = GainField::new(self, view, (width, height), bands, light);
        let mut counts = Counts::default();
        let mut clipped_output = 0;
        let mut finish = |row: &mut [f32]| {
            clipped_output += reaching(row, bands, white);
            take(row);
        };
        let mut mask;
        if is_baseline || frame.rectified.is_some() {
            let mut whole = LinearImage {
                width,
                height,
                bands,
                pixels: Vec::with_capacity(width * height * bands),
            };
            let collect = |row: &mut [f32]| whole.pixels.extend(interleaved(row, bands));
            mask = self.rows(frame, &field, &mut counts, collect);
            baselines::apply(self.config.method, &mut whole, self.means, view.camera_altitude_m());
            if let Some(camera) = frame.rectified {
                whole = rectified(&whole, view.camera, camera);
                mask = mask.map(|mask| mask::rectify(&mask, view.camera, camera));
            }
            // The other way round.
            let row = |pixels: &[f32]| interleaved(pixels, whole.width).collect::<Vec<f32>>();
            let rows = whole.pixels.chunks_exact(whole.width * bands);
            rows.for_each(|pixels| finish(&mut row(pixels)));
        } else {
            mask = self.rows(frame, &field, &mut counts, &mut finish);
        }
        counts.clipped_output = clipped_output;
        Corrected { mask, facts: self.facts(frame, &field, &counts) }
    }

    /// The rows of the frame with the gains applied and a mosaic's colours interpolated; returns
    /// the mask, where it is wanted.
    fn rows(
        &self,
        frame: &Frame<'_>,
        field: &GainField<'_>,
        counts: &mut Counts,
        mut out: impl FnMut(&mut [f32]),
    ) -> Option<Vec<u8>> {
        let Frame { codes, flat_field, .. } = *frame;
        let (width, height, stored) = (codes.width, codes.height, codes.stored_bands());
        let is_baseline = self.config.method.is_baseline();
        // Baselines use no gains: the log does not tell which frames are brighter because of the
        // light.
        let frame_gain = if is_baseline { 1.0 } else { frame.gain };
        let mut gains = GainRows::new(field, codes.mosaic, frame_gain);
        let mut mask = self
            .config
            .mask
            .then(|| mask::ClippingMask::new(width, height, codes.mosaic.is_some()));
        let mut demosaic = codes.mosaic.map(|pattern| Demosaic::new(width, height, pattern));
        let mut highlights = Highlights::new(codes.mosaic, codes.bands());
        let mut shrinkage = Shrinkage::new(field);
        let mut finished = 0;
        let level = field.level();
        let mut finish = |highlights: &mut Highlights, row: &mut [f32]| {
            if !is_baseline {
                highlights.restore(finished, row, level);
                if let Some(shrinkage) = &mut shrinkage {
                    shrinkage.apply(finished, row);
                }
            }
            finished += 1;
            out(row);
        };
        let mut row = vec![0f32; width * stored];
        for y in 0..height {
            codes.linear_bands(y, &mut row);
            if let Some(flat) = flat_field {
                flat.divide_bands(y, codes.mosaic, &mut row);
            }
            if frame.balance != [1.0; 3] && !is_baseline {
                frame.balance_row(y, &mut row);
            }
            let may_reach = flat_field.is_some() || codes.may_reach(y, self.clipped_above);
            let clipped = if may_reach { reaching(&row, stored, self.clipped_above) } else { 0 };
            counts.clipped_input += clipped;
            highlights.push(y, &row, self.clipped_above, clipped > 0);
            if let Some(mask) = &mut mask {
                mask.mark_row(y, &row, self.clipped_above);
            }
            gains.go_to(y);
            let (low, sampled) = gains.low_signal(&row, frame.noise);
            counts.low_signal += low;
            counts.signal_samples += sampled;
            if !is_baseline {
                gains.multiply(&mut row);
            }
            match &mut demosaic {
                Some(demosaic) => demosaic.push(&row, |row| finish(&mut highlights, row)),
                None => finish(&mut highlights, &mut row),
            }
        }
        counts.restored = highlights.restored;
        mask.map(|mask| field.marked(mask.bits))
    }

    fn facts(&self, frame: &Frame<'_>, field: &GainField<'_>, counts: &Counts) -> FrameFacts {
        let pixels = (frame.codes.width * frame.codes.height) as f64;
        let mut facts = FrameFacts {
            camera_altitude_m: frame.view.camera_altitude_m(),
            clipped_input_share: counts.clipped_input as f64 / pixels,
            clipped_output_share: counts.clipped_output as f64 / pixels,
            low_signal_share: counts.low_signal as f64 / counts.signal_samples.max(1) as f64,
            restored_share: counts.restored as f64 / pixels,
            frame_gain: frame.balance.map(|of_band| of_band * frame.gain),
            ..field.facts()
        };
        if self.config.method.is_baseline() {
            (facts.gain_capped_share, facts.mean_gain) = (0.0, f64::NAN);
            facts.frame_gain = [1.0; 3];
        }
        facts
    }
}
