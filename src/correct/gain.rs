//! The factor from raw to corrected light over one frame: exact on a coarse grid, bilinear between.
//!
//! Linear interpolation over h pixels errs by h²/8 of the second derivative, and by h/4 of the slope's step where the
//! pattern's bilinear grid has an edge: at 4 px, 0.2 % at most for a beam that falls to a half within 17°. Cells with a corner off the floor, or
//! over which the gain changes by a tenth (towards the horizon), are evaluated pixel by pixel.

use super::{Correction, FrameFacts, log_removed, mask};
use crate::geometry::{LightPath, View};
use crate::image::SensorImage;
use crate::image::noise::Noise;

/// A cell over which the gain changes by more than this factor is not interpolated.
const STEEP: f32 = 1.1;

/// Gains on the grid's nodes.
pub struct GainGrid<'g> {
    correction: &'g Correction<'g>,
    view: View<'g>,
    step: usize,
    columns: usize,
    rows: usize,
    bands: usize,
    /// `rows × columns × bands`; NaN off the floor
    gains: Vec<f32>,
    /// bits of the mask, by node
    bits: Vec<u8>,
    /// the same as `gains`, of light that the water scattered back; empty where none is modelled
    scattered: Vec<f32>,
    facts: FrameFacts,
}

impl<'g> GainGrid<'g> {
    /// Evaluates the nodes.
    pub fn new(correction: &'g Correction<'g>, view: &View<'g>, width: usize, height: usize, bands: usize) -> Self {
        let step = correction.config.gain_step_px;
        let (columns, rows) = ((width - 1).div_ceil(step) + 1, (height - 1).div_ceil(step) + 1);
        let mut grid = Self {
            correction,
            view: *view,
            step,
            columns,
            rows,
            bands,
            gains: vec![f32::NAN; columns * rows * bands],
            bits: vec![mask::OFF_SURFACE; columns * rows],
            scattered: Vec::new(),
            facts: FrameFacts::default(),
        };
        if correction.glow.is_some() {
            grid.scattered = vec![0.0; columns * rows * bands];
        }
        let (mut shortest, mut longest, mut sum, mut met, mut capped, mut unseen, mut gain_sum) =
            (f64::INFINITY, 0.0f64, 0.0, 0usize, 0usize, 0usize, 0.0);
        for row in 0..rows {
            for column in 0..columns {
                let Some(path) = view.light_path((column * step) as f64, (row * step) as f64) else { continue };
                let (gain, is_capped) = grid.gain(&path);
                let start = (row * columns + column) * bands;
                grid.gains[start..start + bands].copy_from_slice(&gain[..bands]);
                if !grid.scattered.is_empty() {
                    let scattered = grid.scattered((column * step) as f64, (row * step) as f64, &path);
                    grid.scattered[start..start + bands].copy_from_slice(&scattered[..bands]);
                }
                let bits = grid.bits_of(is_capped, &path);
                grid.bits[row * columns + column] = bits;
                met += 1;
                capped += usize::from(is_capped);
                unseen += usize::from(bits & mask::UNSEEN_BEAM != 0);
                (shortest, longest) = (shortest.min(path.length_m()), longest.max(path.length_m()));
                sum += path.length_m();
                gain_sum += f64::from(gain[..bands].iter().sum::<f32>()) / bands as f64;
            }
        }
        let (nodes, met_nodes) = ((columns * rows) as f64, met.max(1) as f64);
        grid.facts = FrameFacts {
            path_length_min_m: if met > 0 { shortest } else { f64::NAN },
            path_length_mean_m: sum / met_nodes,
            path_length_max_m: longest,
            gain_capped_share: capped as f64 / nodes,
            off_surface_share: 1.0 - met as f64 / nodes,
            unseen_beam_share: unseen as f64 / nodes,
            mean_gain: gain_sum / met_nodes,
            ..FrameFacts::default()
        };
        grid
    }

    fn bits_of(&self, is_capped: bool, path: &LightPath) -> u8 {
        let unseen = !path.all_angles().all(|a| self.correction.model.beam_pattern.is_seen(a));
        // A baseline has no gain that could be held.
        let capped = is_capped && !self.correction.config.method.is_baseline();
        (u8::from(capped) * mask::CAPPED) | (u8::from(unseen) * mask::UNSEEN_BEAM)
    }

    /// Adds the bits of every pixel to a mask: those of its cell's corners where they agree, its own elsewhere.
    pub fn mark(&self, mask: &mut [u8], width: usize) {
        for (i, bits) in mask.iter_mut().enumerate() {
            let (x, y) = (i % width, i / width);
            let (row, column) = (y / self.step, x / self.step);
            let node = |row: usize, column: usize| self.bits[row.min(self.rows - 1) * self.columns + column.min(self.columns - 1)];
            let corners = [node(row, column), node(row, column + 1), node(row + 1, column), node(row + 1, column + 1)];
            *bits |= if corners.iter().all(|c| *c == corners[0]) {
                corners[0]
            } else {
                let own = |path: LightPath| self.bits_of(self.gain(&path).1, &path);
                self.view.light_path(x as f64, y as f64).map_or(mask::OFF_SURFACE, own)
            };
        }
    }

    /// Share of the picture that shows the floor with less light than `least_signal_to_noise` times its noise, in any of the
    /// bands a pixel has. Taken at a pixel beside each node, such that a mosaic's bands have their turns. Gains do not
    /// matter: they make the noise as much larger as the light.
    pub fn low_signal_share(&self, raw: &SensorImage, frame_gain: f64, noise: &Noise) -> f64 {
        let light = &raw.light;
        let mut low = 0usize;
        for i in 0..self.columns * self.rows {
            let (column, row) = (i % self.columns, i / self.columns);
            let (x, y) = ((column * self.step + column % 2).min(light.width - 1), (row * self.step + row % 2).min(light.height - 1));
            let is_low = |(b, value): (usize, &f32)| {
                let band = raw.mosaic.map_or(b, |phase| phase.band(x, y));
                let scattered = self.scattered.get(i * self.bands + band).copied().unwrap_or(0.0);
                // Noise is that of the light as it was measured, before the frame's own gain was taken out.
                let std = noise.std(f64::from(*value) * frame_gain) / frame_gain;
                f64::from(*value - scattered) < self.correction.config.least_signal_to_noise * std
            };
            low += usize::from(self.bits[i] & mask::OFF_SURFACE == 0 && light.at(x, y).iter().enumerate().any(is_low));
        }
        low as f64 / (self.columns * self.rows) as f64
    }

    /// Whether a cell has a corner off the floor, or changes too much to be interpolated.
    fn is_steep(&self, row: usize, column: usize) -> bool {
        let at = |row: usize, column: usize| {
            &self.gains[(row.min(self.rows - 1) * self.columns + column.min(self.columns - 1)) * self.bands..][..self.bands]
        };
        let corners = [at(row, column), at(row, column + 1), at(row + 1, column), at(row + 1, column + 1)];
        (0..self.bands).any(|b| {
            let of_band = corners.map(|c| c[b]);
            let (least, most) = of_band.iter().fold((f32::INFINITY, 0f32), |(l, m), v| (l.min(*v), m.max(*v)));
            of_band.iter().any(|v| v.is_nan()) || most > STEEP * least
        })
    }

    /// What the nodes say of the frame: path lengths and shares.
    pub fn facts(&self) -> FrameFacts {
        self.facts
    }

    /// Gain of one way of light per band, and whether the cap holds it. All bands give way together: hue stays.
    fn gain(&self, path: &LightPath) -> ([f32; 3], bool) {
        let rendering = self.correction.rendering;
        let removed: [f64; 3] = std::array::from_fn(|b| {
            if b < self.bands { (-log_removed(self.correction.config.method, self.correction.model, path, b)).exp() } else { 0.0 }
        });
        let most = (0..self.bands).map(|b| removed[b] / rendering.median_correction[b]).fold(0.0, f64::max);
        let held = (self.correction.config.gain_cap / most).min(1.0);
        (std::array::from_fn(|b| if b < self.bands { (removed[b] * held * rendering.gain[b]) as f32 } else { 0.0 }), held < 1.0)
    }

    /// Light that the water scattered into a pixel.
    fn scattered(&self, u: f64, v: f64, path: &LightPath) -> [f32; 3] {
        let ray = self.view.camera.image_plane(u, v);
        let of_ray = |(x, y)| self.correction.glow.map(|(b, table)| b.light(&table.at(x, y, path.seafloor_to_camera_m)));
        ray.and_then(of_ray).map_or([0.0; 3], |light| light.map(|v| v as f32))
    }

    /// Takes off what was scattered back and multiplies by the gains; each pixel of a mosaic by that of its own band.
    pub fn multiply(&self, image: &mut SensorImage) {
        let mosaic = image.mosaic;
        let (width, stored, bands, step) = (image.light.width, image.light.bands, self.bands, self.step);
        let mut line = vec![0f32; self.columns * bands];
        let mut veil = vec![0f32; self.scattered.len().min(self.columns * bands)];
        for (y, pixels) in image.light.pixels.chunks_exact_mut(width * stored).enumerate() {
            let top = (y / step).min(self.rows.saturating_sub(2));
            let share = (y - top * step) as f32 / step as f32;
            let above = &self.gains[top * self.columns * bands..][..self.columns * bands];
            let below = &self.gains[(top + 1).min(self.rows - 1) * self.columns * bands..][..self.columns * bands];
            for ((l, a), b) in line.iter_mut().zip(above).zip(below) {
                *l = a + (b - a) * share;
            }
            if !veil.is_empty() {
                let above = &self.scattered[top * self.columns * bands..][..self.columns * bands];
                let below = &self.scattered[(top + 1).min(self.rows - 1) * self.columns * bands..][..self.columns * bands];
                for ((l, a), b) in veil.iter_mut().zip(above).zip(below) {
                    *l = a + (b - a) * share;
                }
            }
            // Bands of the pixels of a row: all of them, or by turns where there is a mosaic.
            let of_band = |x: usize| mosaic.map_or([0, 1, 2], |phase| [phase.band(x, y); 3]);
            let by_turns = [of_band(0), of_band(1)];
            for (column, cell) in pixels.chunks_mut(step * stored).enumerate() {
                let (left, right) = (&line[column * bands..][..bands], &line[(column + 1).min(self.columns - 1) * bands..][..bands]);
                let first = column * step;
                if self.is_steep(top, column) {
                    for (x, pixel) in cell.chunks_exact_mut(stored).enumerate() {
                        let (u, v) = ((first + x) as f64, y as f64);
                        let of_path = |path| (self.gain(&path).0, self.scattered(u, v, &path));
                        let (gain, scattered) = self.view.light_path(u, v).map_or(([0.0; 3], [0.0; 3]), of_path);
                        pixel.iter_mut().zip(of_band(first + x)).for_each(|(value, band)| *value = (*value - scattered[band]) * gain[band]);
                    }
                    continue;
                }
                if !veil.is_empty() {
                    let (left, right) = (&veil[column * bands..][..bands], &veil[(column + 1).min(self.columns - 1) * bands..][..bands]);
                    for (x, pixel) in cell.chunks_exact_mut(stored).enumerate() {
                        let share = x as f32 / step as f32;
                        for (value, band) in pixel.iter_mut().zip(by_turns[(first + x) % 2]) {
                            *value -= left[band] + (right[band] - left[band]) * share;
                        }
                    }
                }
                for (x, pixel) in cell.chunks_exact_mut(stored).enumerate() {
                    let share = x as f32 / step as f32;
                    for (value, band) in pixel.iter_mut().zip(by_turns[(first + x) % 2]) {
                        *value *= left[band] + (right[band] - left[band]) * share;
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{RenderConfig, Spreading};
    use crate::correct::MeanFrames;
    use crate::geometry::{SeafloorPlane, Support};
    use crate::image::LinearImage;
    use crate::model::{BeamPattern, ImagingModel, Nodes, RenderingFile, SpreadingModel};
    use crate::spaces::{Direction, Transform};
    use crate::vehicle::{Camera, Lamps, Rig, StrobeMount};

    /// The interpolated gain against the exact formula, on a tilted floor, with part of the picture above the horizon.
    #[test]
    fn the_grid_is_within_two_thousandths_of_the_formula() {
        let nodes = Nodes::new(41, 70.0);
        let pattern: Vec<Option<f64>> = (0..41 * 41).map(|i| Some(-4.0 * nodes.angle(i / 41).powi(2) - 2.5 * nodes.angle(i % 41).powi(2))).collect();
        let model = ImagingModel {
            bands: 3,
            attenuation_per_m: [0.5, 0.15, 0.1],
            spreading: SpreadingModel::of(Spreading::Strobe),
            incidence: true,
            beam_pattern: BeamPattern::from_nodes(nodes, &pattern),
            over_time: Default::default(),
            backscatter: None,
        };
        let config = RenderConfig { gain_cap: 1e30, ..RenderConfig::default() };
        let rendering =
            RenderingFile { method: Default::default(), gain: vec![1.0; 3], median_correction: vec![1.0; 3], shoulder_from: None, white_level: None };
        let correction = Correction {
            model: &model,
            rendering: &rendering,
            config: &config,
            glow: None,
            means: &MeanFrames::default(),
            clipped_above: 1.0,
            electrons: Default::default(),
        };
        let camera = Camera::from_field_of_view(643, 451, 55.0);
        for pitch_deg in [0.0, 25.0, 66.0f64] {
            let (sin, cos) = pitch_deg.to_radians().sin_cos();
            let plane = SeafloorPlane {
                normal: Direction::from_vector(nalgebra::Vector3::new(0.1, sin, cos)).expect("a normal"),
                distance_m: 2.0,
                support: Support::LeastSquares,
                hits: 4,
                residual_m: 0.0,
                nearest_ping_s: 0.0,
            };
            let rig = Rig {
                camera,
                body_from_optical: Transform::identity(),
                body_from_dvl: Transform::identity(),
                strobe: StrobeMount { lamps: Lamps::one(Transform::from_parts([-0.8, 0.1, 0.1], [0.0, 0.17, 0.0, 0.985])), source: None },
            };
            let view = View { camera: &camera, rig: &rig, plane: &plane, relief: None };
            let mut image = SensorImage { light: LinearImage::new(643, 451, 3), mosaic: None };
            image.light.pixels.fill(1.0);
            let grid = GainGrid::new(&correction, &view, 643, 451, 3);
            let mut bits = vec![0; 643 * 451];
            grid.mark(&mut bits, 643);
            grid.multiply(&mut image);
            let image = image.light;
            let (mut worst, mut off) = (0f64, 0);
            for y in (0..451).step_by(3) {
                for x in (0..643).step_by(3) {
                    match view.light_path(x as f64, y as f64) {
                        Some(path) if path.length_m() < 30.0 => {
                            let exact = (-model.log_light(&path, 0)).exp();
                            worst = worst.max((f64::from(image.at(x, y)[0]) / exact - 1.0).abs());
                        }
                        Some(_) => {}
                        None => {
                            assert_eq!((image.at(x, y), bits[y * 643 + x]), ([0.0; 3].as_slice(), mask::OFF_SURFACE));
                            off += 1;
                        }
                    }
                }
            }
            assert!(worst < if pitch_deg < 60.0 { 2e-3 } else { 2e-2 }, "{worst} at {pitch_deg}°");
            assert!((off > 0) == (pitch_deg > 60.0), "{off} off the floor at {pitch_deg}°");
        }
    }
}
