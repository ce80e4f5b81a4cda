//! The factor from raw to corrected light over one frame, by as few evaluations of the formula as
//! 0.1 % allows.
//!
//! ```text
//! exact, every few dozen pixels      θ, φ, what the water and the way took, light scattered back: smooth in the pixel
//!   bilinear, on nodes in between    log BP(θ, φ) looked up: it has edges where its own bilinear grid has nodes
//!     bilinear, on pixels            the gain, rows of it at a time
//! ```
//!
//! Over h pixels linear interpolation errs by h²/8 of the second derivative, and by h/4 of the
//! slope's step where the pattern has an edge; from the pattern's own first and second differences
//! follows the step that keeps both below `render.gain_error`, but at the roughest twentieth of the
//! pattern, its noisy rim: two or three times that there. Where a corner is off the floor, or the
//! gain changes much over a cell (towards the horizon), the formula is evaluated node by node, and
//! pixel by pixel.

use super::nodes::{Nodes, Walk, between};
use super::{Correction, FrameFacts, mask};
use crate::geometry::{LightPath, StrobeAngles, View};
use crate::image::demosaic::BayerPattern;
use crate::image::noise::Noise;
use crate::model::{BeamPattern, Removal};

/// More is darkness in any case, and would be no number where it meets the cap.
const MOST_LOG_GAIN: f32 = 60.0;

/// A cell over which the gain changes by more than this factor is not interpolated.
const STEEP: f32 = 1.1;
/// The same for θ, φ and the logarithm of what the way took, between nodes where they are exact.
const STEEP_SMOOTH: f32 = 0.25;
/// Exact nodes lie this far apart, seen from the camera [rad]: over that, 1/8 of the square of it
/// times the second derivative of the smooth parts (6 at most) is 0.02 %.
const SMOOTH_RAD: f64 = 0.016;
/// Signal and noise are compared at so many pixels along a row, and no nearer to each other than
/// this [px].
const LOOKED_AT_ACROSS: usize = 64;
const LOOKED_AT_EVERY_PX: usize = 16;
/// Nodes are never farther apart [px].
const LARGEST_STEP_PX: usize = 32;
/// Least slope of the logarithm of what is divided out, beside the beam's [1/rad].
const SLOPE_OF_WAY: f64 = 3.0;

/// Gains on the grid's nodes.
pub struct GainGrid<'g> {
    correction: &'g Correction<'g>,
    view: View<'g>,
    width: usize,
    bands: usize,
    /// NaN off the floor
    gains: Nodes,
    /// light that the water scattered back, where it is modelled
    scattered: Option<Nodes>,
    /// bits of the mask, by node
    bits: Vec<u8>,
    /// cells that are not interpolated
    uneven: Vec<bool>,
    /// one over the log's median correction, by band; 0 for bands that are not
    over_median: [f32; 3],
    /// the rendering's gain, by band
    shown: [f32; 3],
    facts: FrameFacts,
}

/// Pixels from node to node such that interpolation errs by no more than `error`, for a strobe that
/// sees a pixel under 1/`px_per_rad`.
fn step_px(beam: &BeamPattern, roughness: (f64, f64), px_per_rad: f64, error: f64) -> usize {
    let nodes = beam.nodes();
    let spacing_rad = 2.0 * nodes.limit_rad / (nodes.count - 1) as f64;
    let (first, second) = roughness;
    // Half of the error for the edges of either axis: h/4 · second / spacing.
    let edges = 2.0 * error * px_per_rad * spacing_rad / second.max(1e-9);
    // e^x between nodes: (h · slope)² / 8.
    let slope = first / spacing_rad + SLOPE_OF_WAY;
    let curve = (4.0 * error).sqrt() * px_per_rad / slope;
    (edges.min(curve).min(SMOOTH_RAD * px_per_rad).floor() as usize).clamp(1, LARGEST_STEP_PX)
}

/// Path lengths and shares, summed up.
#[derive(Default)]
struct Sums {
    paths: usize,
    path_m: f64,
    shortest_m: Option<f64>,
    longest_m: f64,
    capped: usize,
    unseen: usize,
    met: usize,
    gain: f64,
}

impl Sums {
    fn path(&mut self, path: &LightPath) {
        let length_m = path.length_m();
        self.paths += 1;
        self.path_m += length_m;
        self.shortest_m = Some(self.shortest_m.map_or(length_m, |s| s.min(length_m)));
        self.longest_m = self.longest_m.max(length_m);
    }
}

impl<'g> GainGrid<'g> {
    /// Evaluates the nodes.
    pub fn new(
        correction: &'g Correction<'g>,
        view: &View<'g>,
        width: usize,
        height: usize,
        bands: usize,
    ) -> Self {
        let middle = view.light_path(width as f64 / 2.0, height as f64 / 2.0);
        let nearer =
            middle.map_or(1.0, |p| (p.strobe_to_seafloor_m / p.seafloor_to_camera_m).min(1.0));
        let step = step_px(
            &correction.model.beam_pattern,
            correction.roughness,
            view.camera.fx * nearer,
            correction.config.gain_error,
        );
        let size = (width, height);
        let gains = Nodes::new(size, step, bands, f32::NAN);
        let nodes = gains.columns * gains.rows;
        let scattered = correction.glow.map(|_| Nodes::new(size, step, bands, 0.0));
        let rendering = correction.rendering;
        let of_band = |value: &dyn Fn(usize) -> f64| {
            std::array::from_fn(|b| if b < bands { value(b) as f32 } else { 0.0 })
        };
        let mut grid = Self {
            correction,
            view: *view,
            width,
            bands,
            gains,
            scattered,
            bits: vec![mask::OFF_SURFACE; nodes],
            uneven: Vec::new(),
            over_median: of_band(&|b| 1.0 / rendering.median_correction[b]),
            shown: of_band(&|b| rendering.gain[b]),
            facts: FrameFacts::default(),
        };
        let mut sums = Sums::default();
        let every = ((SMOOTH_RAD * view.camera.fx * nearer / step as f64) as usize).max(1);
        // Several lamps have angles each, and relief has edges of its own: there every node is
        // exact.
        if every > 1 && view.terrain.is_none() && view.rig.strobe.lamps.lamps().len() == 1 {
            grid.fill_between(every, &mut sums);
        } else {
            (0..nodes).for_each(|i| grid.fill_exactly(i, true, &mut sums));
        }
        let cells = |i: usize| (i / grid.gains.columns, i % grid.gains.columns);
        let is_steep = |(least, most): (f32, f32)| most > STEEP * least;
        grid.uneven = (0..nodes)
            .map(cells)
            .map(|(r, c)| (0..bands).any(|b| grid.gains.range(r, c, b).is_none_or(is_steep)))
            .collect();
        let met = sums.met.max(1) as f64;
        grid.facts = FrameFacts {
            path_length_min_m: sums.shortest_m.unwrap_or(f64::NAN),
            path_length_mean_m: sums.path_m / sums.paths.max(1) as f64,
            path_length_max_m: sums.longest_m,
            gain_capped_share: sums.capped as f64 / nodes as f64,
            off_surface_share: 1.0 - sums.met as f64 / nodes as f64,
            unseen_beam_share: sums.unseen as f64 / nodes as f64,
            mean_gain: sums.gain / met,
            ..FrameFacts::default()
        };
        grid
    }

    /// One node by the formula.
    fn fill_exactly(&mut self, node: usize, counts_path: bool, sums: &mut Sums) {
        let (row, column) = (node / self.gains.columns, node % self.gains.columns);
        let (u, v) = ((column * self.gains.step) as f64, (row * self.gains.step) as f64);
        let Some(path) = self.view.light_path(u, v) else { return };
        if counts_path {
            sums.path(&path);
        }
        let (gain, is_capped, is_seen) = self.gain(&path);
        let light = self.scattered_at(u, v, &path);
        self.set(node, gain, light, is_capped, is_seen, sums);
    }

    fn set(
        &mut self,
        node: usize,
        gain: [f32; 3],
        scattered: [f32; 3],
        is_capped: bool,
        is_seen: bool,
        sums: &mut Sums,
    ) {
        let (row, column) = (node / self.gains.columns, node % self.gains.columns);
        self.gains.at_mut(row, column).copy_from_slice(&gain[..self.bands]);
        if let Some(nodes) = &mut self.scattered {
            nodes.at_mut(row, column).copy_from_slice(&scattered[..self.bands]);
        }
        self.bits[node] = self.bits_of(is_capped, is_seen);
        sums.met += 1;
        sums.capped += usize::from(is_capped);
        sums.unseen += usize::from(!is_seen);
        sums.gain += f64::from(gain[..self.bands].iter().sum::<f32>()) / self.bands as f64;
    }

    /// All nodes, from exact ones `every` so many nodes.
    fn fill_between(&mut self, every: usize, sums: &mut Sums) {
        let Correction { config, model, .. } = *self.correction;
        let removal = Removal::of(config.method);
        let (columns, rows, bands, step) =
            (self.gains.columns, self.gains.rows, self.bands, self.gains.step);
        // θ, φ, log of what the way took per band, scattered light per band
        let fields = 2 + 2 * bands;
        let mut smooth = Nodes::new((columns, rows), every, fields, f32::NAN);
        for row in 0..smooth.rows {
            for column in 0..smooth.columns {
                let (u, v) = ((column * every * step) as f64, (row * every * step) as f64);
                let Some(path) = self.view.light_path(u, v) else { continue };
                sums.path(&path);
                let light = self.scattered_at(u, v, &path);
                let node = smooth.at_mut(row, column);
                (node[0], node[1]) = (path.angles.theta_rad as f32, path.angles.phi_rad as f32);
                let by_way = model.log_radiance(&path, removal.without_beam());
                for b in 0..bands {
                    node[2 + b] = by_way[b] as f32;
                    node[2 + bands + b] = light[b];
                }
            }
        }
        let by_beam = if removal.beam { 1.0 } else { 0.0 };
        let is_smooth = |row, column| {
            (0..fields).all(|f| {
                smooth
                    .range(row, column, f)
                    .is_some_and(|(l, m)| f >= 2 + bands || m - l <= STEEP_SMOOTH)
            })
        };
        let mut walk = Walk::new(&smooth, columns, None);
        let mut line = vec![0f32; columns * fields];
        let mut cells = Vec::new();
        for row in 0..rows {
            walk.row(row, &mut line);
            if row % every == 0 {
                cells = (0..smooth.columns).map(|column| is_smooth(row / every, column)).collect();
            }
            for (column, at) in line.chunks_exact(fields).enumerate() {
                let node = row * columns + column;
                if !cells[column / every] {
                    self.fill_exactly(node, false, sums);
                    continue;
                }
                let angles =
                    StrobeAngles { theta_rad: f64::from(at[0]), phi_rad: f64::from(at[1]) };
                let (log_beam, seen) = model.beam_pattern.read(angles);
                let log_beam = by_beam * log_beam as f32;
                let removed = std::array::from_fn(|b| {
                    if b < bands { (-log_beam - at[2 + b]).min(MOST_LOG_GAIN).exp() } else { 0.0 }
                });
                let light =
                    std::array::from_fn(|b| if b < bands { at[2 + bands + b] } else { 0.0 });
                let (gain, is_capped) = self.held(removed);
                self.set(node, gain, light, is_capped, seen, sums);
            }
        }
    }

    fn bits_of(&self, is_capped: bool, is_seen: bool) -> u8 {
        // A baseline has no gain that could be held.
        let capped = is_capped && !self.correction.config.method.is_baseline();
        (u8::from(capped) * mask::CAPPED) | (u8::from(!is_seen) * mask::UNSEEN_BEAM)
    }

    /// Adds the bits of every pixel to a mask: those of its cell's corners where they agree, its
    /// own elsewhere.
    pub fn mark(&self, mask: &mut [u8]) {
        let Nodes { step, columns, rows, .. } = self.gains;
        for (i, bits) in mask.iter_mut().enumerate() {
            let (x, y) = (i % self.width, i / self.width);
            let node = |row: usize, column: usize| {
                self.bits[row.min(rows - 1) * columns + column.min(columns - 1)]
            };
            let (row, column) = (y / step, x / step);
            let corners = [
                node(row, column),
                node(row, column + 1),
                node(row + 1, column),
                node(row + 1, column + 1),
            ];
            *bits |= if corners.iter().all(|c| *c == corners[0]) {
                corners[0]
            } else {
                let own = |path: LightPath| {
                    let (_, is_capped, is_seen) = self.gain(&path);
                    self.bits_of(is_capped, is_seen)
                };
                self.view.light_path(x as f64, y as f64).map_or(mask::OFF_SURFACE, own)
            };
        }
    }

    /// What the nodes say of the frame: path lengths and shares.
    pub fn facts(&self) -> FrameFacts {
        self.facts
    }

    /// Gain of one way of light per band, whether the cap holds it, and whether its directions in
    /// the beam were seen.
    fn gain(&self, path: &LightPath) -> ([f32; 3], bool, bool) {
        let Correction { model, config, .. } = *self.correction;
        let removed = model.log_radiance(path, Removal::of(config.method));
        let is_seen = path.all_angles().all(|a| model.beam_pattern.is_seen(a));
        let (gain, is_capped) = self.held(std::array::from_fn(|b| {
            if b < self.bands { (-removed[b] as f32).min(MOST_LOG_GAIN).exp() } else { 0.0 }
        }));
        (gain, is_capped, is_seen)
    }

    /// What is to be multiplied by, held at the cap and rendered. All bands give way together: hue
    /// stays.
    fn held(&self, removed: [f32; 3]) -> ([f32; 3], bool) {
        let most = removed.iter().zip(self.over_median).fold(0f32, |most, (r, m)| most.max(r * m));
        let held = (self.correction.config.gain_cap as f32 / most).min(1.0);
        (std::array::from_fn(|b| removed[b] * held * self.shown[b]), held < 1.0)
    }

    /// Light that the water scattered into a pixel.
    fn scattered_at(&self, u: f64, v: f64, path: &LightPath) -> [f32; 3] {
        let Some((backscatter, table)) = self.correction.glow else { return [0.0; 3] };
        let of_ray = |(x, y)| backscatter.light(&table.at(x, y, path.seafloor_to_camera_m));
        self.view
            .camera
            .image_plane(u, v)
            .map(of_ray)
            .map_or([0.0; 3], |light| light.map(|v| v as f32))
    }

    /// Pixels of a row whose gain is not interpolated.
    fn uneven_pixels(&self, y: usize) -> impl Iterator<Item = usize> {
        let Nodes { step, columns, rows, .. } = self.gains;
        let cells = &self.uneven[(y / step).min(rows - 1) * columns..][..columns];
        let columns = cells.iter().enumerate().filter(|(_, uneven)| **uneven);
        columns.flat_map(move |(column, _)| column * step..((column + 1) * step).min(self.width))
    }

    /// To walk down the rows of a picture with, which got `frame_gain` times its neighbours' light.
    pub fn rows(&'g self, mosaic: Option<BayerPattern>, frame_gain: f64) -> GainRows<'g> {
        let stored = if mosaic.is_some() { 1 } else { self.bands };
        let walk = |nodes| Walk::new(nodes, self.width, mosaic);
        GainRows {
            grid: self,
            mosaic,
            y: 0,
            stored,
            frame_gain,
            gains: walk(&self.gains),
            scattered: self.scattered.as_ref().map(walk),
            veil: vec![0.0; if self.scattered.is_some() { self.width * stored } else { 0 }],
        }
    }
}

/// Which band the value of a pixel is: of a mosaic, its own.
fn band(mosaic: Option<BayerPattern>, x: usize, y: usize, stored: usize) -> usize {
    mosaic.map_or(stored, |phase| phase.band(x, y))
}

/// Gains of one row of pixels after another; of a mosaic, each pixel's is that of its own band.
pub struct GainRows<'g> {
    grid: &'g GainGrid<'g>,
    mosaic: Option<BayerPattern>,
    /// the row gone to
    y: usize,
    /// values per pixel as it is stored
    stored: usize,
    /// light the picture got over its neighbours'
    frame_gain: f64,
    gains: Walk<'g>,
    scattered: Option<Walk<'g>>,
    veil: Vec<f32>,
}

impl GainRows<'_> {
    /// Goes to row `y`.
    pub fn go_to(&mut self, y: usize) {
        self.y = y;
        let Some(walk) = &mut self.scattered else { return };
        walk.row(y, &mut self.veil);
        for x in self.grid.uneven_pixels(y) {
            let (u, v) = (x as f64, y as f64);
            let light = self
                .grid
                .view
                .light_path(u, v)
                .map_or([0.0; 3], |path| self.grid.scattered_at(u, v, &path));
            self.veil[x * self.stored..][..self.stored]
                .iter_mut()
                .enumerate()
                .for_each(|(b, veil)| *veil = light[band(self.mosaic, x, y, b)]);
        }
    }

    /// Takes off what was scattered back and multiplies by the gains of the row gone to, and by
    /// what makes up for the frame's own.
    pub fn multiply(&mut self, light: &mut [f32]) {
        let (grid, stored, y) = (self.grid, self.stored, self.y);
        let mut per_gain = 1.0 / self.frame_gain as f32;
        if !self.veil.is_empty() {
            light.iter_mut().zip(&self.veil).for_each(|(v, veil)| *v = *v * per_gain - veil);
            per_gain = 1.0;
        }
        let exactly = |x: usize| {
            let gain = grid
                .view
                .light_path(x as f64, y as f64)
                .map_or([0.0; 3], |path| grid.gain(&path).0);
            let value = |b: usize| {
                if b < stored {
                    light[x * stored + b] * per_gain * gain[band(self.mosaic, x, y, b)]
                } else {
                    0.0
                }
            };
            (x, std::array::from_fn::<f32, 3, _>(value))
        };
        let exact: Vec<(usize, [f32; 3])> = grid.uneven_pixels(y).map(exactly).collect();
        let (above, below, share) = self.gains.around(y);
        light
            .iter_mut()
            .zip(above)
            .zip(below)
            .for_each(|((v, a), b)| *v = *v * per_gain * between(*a, *b, share));
        exact
            .into_iter()
            .for_each(|(x, pixel)| light[x * stored..][..stored].copy_from_slice(&pixel[..stored]));
    }

    /// Of one row in so many, looks at one pixel in so many: how many show the floor with less
    /// light than `least_signal_to_noise` times its noise, in any of the bands a pixel has; and how
    /// many were looked at. A mosaic's bands have their turns. Gains do not matter: they make the
    /// noise as much larger as the light.
    pub fn low_signal(&self, y: usize, raw: &[f32], noise: &Noise) -> (usize, usize) {
        let every = (self.grid.width / LOOKED_AT_ACROSS).max(LOOKED_AT_EVERY_PX);
        let row = y / every;
        if y != row * every + row % 2 {
            return (0, 0);
        }
        let (grid, stored) = (self.grid, self.stored);
        let (step, columns, rows) = (grid.gains.step, grid.gains.columns, grid.gains.rows);
        let (mut low, mut looked) = (0, 0);
        for x in (0..grid.width / every).map(|column| column * every + column % 2) {
            let is_low = |b: usize| {
                let measured = f64::from(raw[x * stored + b]);
                // The veil is the neighbours', who have no such gain.
                let light = measured
                    - self.frame_gain
                        * f64::from(self.veil.get(x * stored + b).copied().unwrap_or(0.0));
                let is_within =
                    |std: f64| light < grid.correction.config.least_signal_to_noise * std;
                // Most light is far above any noise.
                is_within(noise.max_std(measured)) && is_within(noise.std(measured))
            };
            let bits = grid.bits[(y / step).min(rows - 1) * columns + (x / step).min(columns - 1)];
            low += usize::from(bits & mask::OFF_SURFACE == 0 && (0..stored).any(is_low));
            looked += 1;
        }
        (low, looked)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{RenderConfig, Spreading};
    use crate::coordinates::{Direction, Transform};
    use crate::correct::MeanFrames;
    use crate::geometry::{SeafloorPlane, Support};
    use crate::image::LinearImage;
    use crate::model::{BeamGrid, BeamPattern, ImagingModel, RenderingFile, SpreadingModel};
    use crate::vehicle::{Camera, Lamps, Rig, StrobeMount};

    /// The interpolated gain against the exact formula, on a tilted floor, with part of the picture
    /// above the horizon.
    #[test]
    fn the_grid_is_within_a_thousandth_of_the_formula() {
        let nodes = BeamGrid::new(41, 70.0);
        let pattern: Vec<Option<f64>> = (0..41 * 41)
            .map(|i| Some(-4.0 * nodes.angle(i / 41).powi(2) - 2.5 * nodes.angle(i % 41).powi(2)))
            .collect();
        let model = ImagingModel {
            bands: 3,
            attenuation_per_m: [0.5, 0.15, 0.1],
            spreading: SpreadingModel::of(Spreading::Strobe),
            incidence: true,
            beam_pattern: BeamPattern::from_nodes(nodes, &pattern).refined(8),
            over_time: Default::default(),
            backscatter: None,
        };
        let config = RenderConfig { gain_cap: 1e30, ..RenderConfig::default() };
        let rendering = RenderingFile {
            method: Default::default(),
            gain: vec![1.0; 3],
            median_correction: vec![1.0; 3],
            shoulder_from: None,
            white_level: None,
        };
        let correction = Correction {
            model: &model,
            rendering: &rendering,
            config: &config,
            glow: None,
            means: &MeanFrames::default(),
            clipped_above: 1.0,
            roughness: model.beam_pattern.roughness(0.05),
            electrons: Default::default(),
        };
        for (times, pitch_deg) in [(1, 0.0), (1, 25.0), (1, 66.0), (4, 0.0), (4, 25.0f64)] {
            let (width, height) = (643 * times, 451 * times);
            let camera = Camera::from_field_of_view(width, height, 55.0);
            let (sin, cos) = pitch_deg.to_radians().sin_cos();
            let plane = SeafloorPlane {
                normal: Direction::from_vector(nalgebra::Vector3::new(0.1, sin, cos))
                    .expect("a normal"),
                distance_m: 2.0,
                support: Support::LeastSquares,
                returns: 4,
                residual_m: 0.0,
                nearest_ping_s: 0.0,
            };
            let rig = Rig {
                camera,
                body_from_optical: Transform::identity(),
                body_from_dvl: Transform::identity(),
                strobe: StrobeMount {
                    lamps: Lamps::one(Transform::from_parts(
                        [-0.8, 0.1, 0.1],
                        [0.0, 0.17, 0.0, 0.985],
                    )),
                    source: None,
                },
            };
            let view = View { camera: &camera, rig: &rig, plane: &plane, terrain: None };
            let mut image = LinearImage::new(width, height, 3);
            // A frame that got more light than its neighbours comes out as they do.
            let frame_gain = 1.25;
            image.pixels.fill(frame_gain as f32);
            let grid = GainGrid::new(&correction, &view, width, height, 3);
            let mut bits = vec![0; width * height];
            grid.mark(&mut bits);
            let mut rows = grid.rows(None, frame_gain);
            for (y, row) in image.pixels.chunks_exact_mut(3 * width).enumerate() {
                rows.go_to(y);
                rows.multiply(row);
            }
            let (mut worst, mut off) = (0f64, 0);
            for y in (0..height).step_by(3 * times - 1) {
                for x in (0..width).step_by(3 * times - 1) {
                    match view.light_path(x as f64, y as f64) {
                        Some(path) if path.length_m() < 30.0 => {
                            let exact = (-model.log_radiance(&path, Removal::FULL)[0]).exp();
                            worst = worst.max((f64::from(image.at(x, y)[0]) / exact - 1.0).abs());
                        }
                        Some(_) => {}
                        None => {
                            assert_eq!(
                                (image.at(x, y), bits[y * width + x]),
                                ([0.0; 3].as_slice(), mask::OFF_SURFACE)
                            );
                            off += 1;
                        }
                    }
                }
            }
            assert!(worst < if pitch_deg < 60.0 { 1e-3 } else { 4e-3 }, "{worst} at {pitch_deg}°");
            assert!((off > 0) == (pitch_deg > 60.0), "{off} off the floor at {pitch_deg}°");
        }
    }
}
