//! The gain field applied row by row; of a mosaic, each pixel gets the gain of its own band.

use super::gain_field::GainField;
use super::mask;
use super::node_grid::{NodeGrid, RowWalker, between};
use crate::image::demosaic::BayerPattern;
use crate::image::noise::Noise;
use crate::image::vectorised;
use crate::model::limited::{shrink, shrink_row, without_backscatter};

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
    /// median of the corrected seafloor by band
    levels: [f32; 3],
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
            levels: field
                .signal
                .as_ref()
                .map_or([1.0; 3], |s| s.levels(field.correction.rendering)),
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
            let (_, light) = field.gain(x, y);
            for b in 0..self.stored {
                self.scattered_row[b * field.width + x] = light[self.band(x, b)];
            }
        }
    }

    /// Removes backscatter and multiplies by the gains of the current row over the frame's own.
    pub fn multiply(&mut self, light: &mut [f32]) {
        let (stored, y, width) = (self.stored, self.y, self.field.width);
        let per_gain = 1.0 / self.frame_gain as f32;
        let exact = self.exact_pixels(light, per_gain);
        // Of even and odd pixels.
        let levels: [[f32; 2]; 3] =
            std::array::from_fn(|b| [0, 1].map(|x| self.levels[self.band(x, b)]));
        let (above, below, share) = self.gains.around(y);
        if self.scattered_row.is_empty() {
            vectorised(
                #[inline(always)]
                || {
                    for ((v, a), b) in light.iter_mut().zip(above).zip(below) {
                        *v = *v * per_gain * between(*a, *b, share);
                    }
                },
            );
        } else {
            let bands = light.chunks_exact_mut(width).zip(self.scattered_row.chunks_exact(width));
            let gains = above.chunks_exact(width).zip(below.chunks_exact(width));
            for (((light, scattered), (above, below)), levels) in bands.zip(gains).zip(levels) {
                vectorised(
                    #[inline(always)]
                    || {
                        let values = light.iter_mut().zip(scattered).zip(above.iter().zip(below));
                        for (x, ((v, scattered), (a, b))) in values.enumerate() {
                            let (gain, level) = (between(*a, *b, share), levels[x % 2]);
                            *v = without_backscatter(*v * per_gain * gain, scattered * gain, level);
                        }
                    },
                );
            }
        }
        for (x, pixel) in exact {
            (0..stored).for_each(|b| light[b * width + x] = pixel[b]);
        }
    }

    /// Pixels of the current row whose gain is not interpolated, by column.
    fn exact_pixels(&self, light: &[f32], per_gain: f32) -> Vec<(usize, [f32; 3])> {
        let (field, stored, y) = (self.field, self.stored, self.y);
        let exact = |x: usize| {
            let (gain, _) = field.gain(x, y);
            let value = |b: usize| {
                if b < stored {
                    let (band, at) = (self.band(x, b), b * field.width + x);
                    let scattered = self.scattered_row.get(at).copied().unwrap_or(0.0);
                    let corrected = light[at] * per_gain * gain[band];
                    without_backscatter(corrected, scattered * gain[band], self.levels[band])
                } else {
                    0.0
                }
            };
            (x, std::array::from_fn::<f32, 3, _>(value))
        };
        field.uneven_pixels(y).map(exact).collect()
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
                let measured = f64::from(raw[b * field.width + x]);
                // Backscatter is the neighbours', which do not have this frame's gain.
                let scattered = self.scattered_row.get(b * field.width + x).copied().unwrap_or(0.0);
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

/// Reduces the colour of rows where bands are short of signal.
pub struct Shrinkage<'g> {
    field: &'g GainField<'g>,
    walker: RowWalker<'g>,
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
        let (field, levels) = (self.field, &self.levels);
        let (width, bands) = (field.width, field.bands);
        let exact = |x: usize| {
            let (weights, mut pixel) = (field.exact_weights(x, y), [0f32; 3]);
            (0..bands).for_each(|b| pixel[b] = row[b * width + x]);
            // Off the seafloor there is nothing to show.
            if weights[0] >= 0.0 {
                shrink(&mut pixel[..bands], &weights[..bands], levels);
            }
            (x, pixel)
        };
        let exact: Vec<(usize, [f32; 3])> = field.uneven_pixels(y).map(exact).collect();
        let rows = self.walker.around(y);
        if bands == 3 {
            shrink_row(row, rows, levels);
        } else {
            let (above, below, share) = rows;
            for (v, (a, b)) in row.iter_mut().zip(above.iter().zip(below)) {
                let weight = between(*a, *b, share);
                if weight >= 0.0 {
                    shrink(std::slice::from_mut(v), &[weight], levels);
                }
            }
        }
        for (x, pixel) in exact {
            (0..bands).for_each(|b| row[b * width + x] = pixel[b]);
        }
    }
}
