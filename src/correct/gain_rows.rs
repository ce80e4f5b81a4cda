//! The gain field applied row by row; of a mosaic, each pixel gets the gain of its own band.

use super::gain_field::GainField;
use super::mask;
use super::node_grid::{RowWalker, between};
use crate::image::demosaic::BayerPattern;
use crate::image::noise::Noise;

/// Signal and noise are compared at so many pixels along a row …
const SIGNAL_SAMPLES_ACROSS: usize = 64;
/// … and no nearer to each other than this (px).
const SIGNAL_SAMPLE_STEP_PX: usize = 16;

/// Gains of one row of pixels after another.
pub struct GainRows<'g> {
    field: &'g GainField<'g>,
    mosaic: Option<BayerPattern>,
    /// current row
    y: usize,
    /// values per pixel as it is stored
    stored: usize,
    /// light of the frame over its neighbours'
    frame_gain: f64,
    gains: RowWalker<'g>,
    scattered: Option<RowWalker<'g>>,
    /// backscatter of the current row; empty where it is not modelled
    scattered_row: Vec<f32>,
}

impl<'g> GainRows<'g> {
    /// Begins above the first row of a frame that got `frame_gain` times its neighbours' light.
    pub fn new(field: &'g GainField<'g>, mosaic: Option<BayerPattern>, frame_gain: f64) -> Self {
        let stored = if mosaic.is_some() { 1 } else { field.bands };
        let walker = |nodes| RowWalker::new(nodes, field.width, mosaic);
        let values = if field.scattered.is_some() { field.width * stored } else { 0 };
        Self {
            field,
            mosaic,
            y: 0,
            stored,
            frame_gain,
            gains: walker(&field.gains),
            scattered: field.scattered.as_ref().map(walker),
            scattered_row: vec![0.0; values],
        }
    }

    /// Band of a pixel's `b`-th stored value: of a mosaic, the pixel's own.
    fn band(&self, x: usize, b: usize) -> usize {
        self.mosaic.map_or(b, |pattern| pattern.band(x, self.y))
    }

    /// Moves to row `y`.
    pub fn go_to(&mut self, y: usize) {
        self.y = y;
        let Some(walker) = &mut self.scattered else { return };
        walker.row(y, &mut self.scattered_row);
        let field = self.field;
        for x in field.uneven_pixels(y) {
            let (u, v) = (x as f64, y as f64);
            let path = field.view.light_path(u, v);
            let light = path.map_or([0.0; 3], |path| field.scattered_at(u, v, &path));
            for b in 0..self.stored {
                self.scattered_row[x * self.stored + b] = light[self.band(x, b)];
            }
        }
    }

    /// Removes backscatter and multiplies by the gains of the current row over the frame's own.
    pub fn multiply(&mut self, light: &mut [f32]) {
        let (field, stored, y) = (self.field, self.stored, self.y);
        let mut per_gain = 1.0 / self.frame_gain as f32;
        if !self.scattered_row.is_empty() {
            let scattered = light.iter_mut().zip(&self.scattered_row);
            scattered.for_each(|(v, scattered)| *v = *v * per_gain - scattered);
            per_gain = 1.0;
        }
        let exact = |x: usize| {
            let path = field.view.light_path(x as f64, y as f64);
            let gain = path.map_or([0.0; 3], |path| field.gain(&path));
            let value = |b: usize| {
                if b < stored {
                    light[x * stored + b] * per_gain * gain[self.band(x, b)]
                } else {
                    0.0
                }
            };
            (x, std::array::from_fn::<f32, 3, _>(value))
        };
        let exact: Vec<(usize, [f32; 3])> = field.uneven_pixels(y).map(exact).collect();
        let (above, below, share) = self.gains.around(y);
        let interpolated = light.iter_mut().zip(above).zip(below);
        interpolated.for_each(|((v, a), b)| *v = *v * per_gain * between(*a, *b, share));
        for (x, pixel) in exact {
            light[x * stored..][..stored].copy_from_slice(&pixel[..stored]);
        }
    }

    /// Samples the current row sparsely: how many pixels show the seafloor with less light than
    /// `least_signal_to_noise` times its noise in any of their bands, and how many were sampled. A
    /// mosaic's bands take turns. Gains do not matter: they scale noise and light by the same
    /// factor.
    pub fn low_signal(&self, raw: &[f32], noise: &Noise) -> (usize, usize) {
        let (field, stored, y) = (self.field, self.stored, self.y);
        let every = (field.width / SIGNAL_SAMPLES_ACROSS).max(SIGNAL_SAMPLE_STEP_PX);
        let row = y / every;
        if y != row * every + row % 2 {
            return (0, 0);
        }
        let (step, columns, rows) = (field.gains.step, field.gains.columns, field.gains.rows);
        let min_signal_to_noise = field.correction.config.least_signal_to_noise;
        let (mut low, mut sampled) = (0, 0);
        for x in (0..field.width / every).map(|column| column * every + column % 2) {
            let is_low = |b: usize| {
                let measured = f64::from(raw[x * stored + b]);
                // Backscatter is the neighbours', which do not have this frame's gain.
                let scattered = self.scattered_row.get(x * stored + b).copied().unwrap_or(0.0);
                let light = measured - self.frame_gain * f64::from(scattered);
                let is_within = |std: f64| light < min_signal_to_noise * std;
                // Most light is far above any noise.
                is_within(noise.max_std(measured)) && is_within(noise.std(measured))
            };
            let node = (y / step).min(rows - 1) * columns + (x / step).min(columns - 1);
            let is_on_surface = field.bits[node] & mask::OFF_SURFACE == 0;
            low += usize::from(is_on_surface && (0..stored).any(is_low));
            sampled += 1;
        }
        (low, sampled)
    }
}
