//! The gain from raw to corrected light over one frame, with as few evaluations of Eq. 15 as
//! `render.gain_error` allows.
//!
//! ```text
//! exact, every few dozen pixels      θ, φ, all parts of Eq. 15 but BP, backscatter: smooth
//!   bilinear, on nodes in between    log BP(θ, φ) looked up: it has edges where its grid has nodes
//!     bilinear, on pixels            the gain, row by row
//! ```
//!
//! Over h pixels linear interpolation errs by h²/8 of the second derivative, and by h/4 of the
//! slope's step where the pattern has an edge; from the pattern's own first and second differences
//! follows the spacing of nodes that keeps both below `render.gain_error`, except at the roughest
//! twentieth of the pattern, its noisy rim: two or three times that there. Where a corner is off
//! the seafloor, or the gain changes much over a cell (towards the horizon), Eq. 15 is evaluated
//! node by node, and pixel by pixel.

use super::node_grid::{NodeGrid, RowWalker};
use super::signal::{FrameLight, Signal, is_limited};
use super::{Correction, FrameFacts, mask};
use crate::config::Method;
use crate::geometry::{LightPath, StrobeAngles, View};
use crate::image::Bands;
use crate::model::{BeamPattern, EmpiricalModel, RangeFactor, RegionLight, Removal};

/// Larger log gains belong to light without any signal.
const MAX_LOG_GAIN: f32 = 30.0;
/// A cell over which the gain changes by more than this factor is not interpolated.
const STEEP: f32 = 1.1;
/// The same for θ, φ and log radiance without beam, between nodes where they are exact.
const STEEP_SMOOTH: f32 = 0.25;
/// Exact nodes lie this far apart, seen from the camera (rad): over that, 1/8 of the square of it
/// times the second derivative of the smooth parts (6 at most) is 0.02 %.
const SMOOTH_RAD: f64 = 0.016;
/// Largest distance between nodes (px).
const MAX_STEP_PX: usize = 32;
/// Smallest slope of log radiance without beam (1/rad).
const SMOOTH_SLOPE: f64 = 3.0;

/// Gains on the nodes of a grid over the frame.
pub struct GainField<'g> {
    pub(super) correction: &'g Correction<'g>,
    pub(super) view: View<'g>,
    pub(super) width: usize,
    pub(super) bands: usize,
    /// NaN off the seafloor
    pub(super) gains: NodeGrid,
    /// backscatter, where it is modelled
    pub(super) scattered: Option<NodeGrid>,
    /// weights of the bands by their signal, where the method has a gain; −1 off the seafloor
    pub(super) weights: Option<NodeGrid>,
    /// signal and noise of the frame, where the method has a gain
    pub(super) signal: Option<Signal<'g>>,
    /// bits of the mask, by node
    pub(super) bits: Vec<u8>,
    /// beside the model of Eq. 15
    residual: Option<&'g RegionLight>,
    /// instead of it
    empirical: Option<&'g EmpiricalModel>,
    range_factor: RangeFactor,
    removal: Removal,
    /// cells that are not interpolated
    uneven: Vec<bool>,
    /// the rendering's gain, by band; 0 for bands that do not exist
    rendering_gain: [f32; 3],
    facts: FrameFacts,
}

/// What Eq. 15 gives at one point.
pub(super) struct Evaluated {
    /// factor of the light, without exposure
    pub factor: [f32; 3],
    /// backscatter
    pub scattered: [f32; 3],
    /// whether pass one has seen its directions in the beam
    pub is_seen: bool,
}

/// Distance between nodes (px) for which interpolation errs by no more than `error`, for a strobe
/// that sees a pixel under 1/`px_per_rad`.
fn step_px(beam: &BeamPattern, roughness: (f64, f64), px_per_rad: f64, error: f64) -> usize {
    let grid = beam.nodes();
    let spacing_rad = 2.0 * grid.limit_rad / (grid.count - 1) as f64;
    let (first, second) = roughness;
    // Half of the error for the edges of either axis: h/4 · second / spacing.
    let edges = 2.0 * error * px_per_rad * spacing_rad / second.max(1e-9);
    // e^x between nodes: (h · slope)² / 8.
    let slope = first / spacing_rad + SMOOTH_SLOPE;
    let curve = (4.0 * error).sqrt() * px_per_rad / slope;
    (edges.min(curve).min(SMOOTH_RAD * px_per_rad).floor() as usize).clamp(1, MAX_STEP_PX)
}

/// Sums over the nodes.
#[derive(Default)]
struct Sums {
    paths: usize,
    path_m: f64,
    shortest_m: Option<f64>,
    longest_m: f64,
    limited: usize,
    unseen: usize,
    on_surface: usize,
    gain: f64,
}

impl Sums {
    fn add_path(&mut self, path: &LightPath) {
        let length_m = path.length_m();
        self.paths += 1;
        self.path_m += length_m;
        self.shortest_m = Some(self.shortest_m.map_or(length_m, |s| s.min(length_m)));
        self.longest_m = self.longest_m.max(length_m);
    }

    fn facts(&self, nodes: usize) -> FrameFacts {
        FrameFacts {
            path_length_min_m: self.shortest_m.unwrap_or(f64::NAN),
            path_length_mean_m: self.path_m / self.paths.max(1) as f64,
            path_length_max_m: self.longest_m,
            gain_capped_share: self.limited as f64 / nodes as f64,
            off_surface_share: 1.0 - self.on_surface as f64 / nodes as f64,
            unseen_beam_share: self.unseen as f64 / nodes as f64,
            mean_gain: self.gain / self.on_surface.max(1) as f64,
            ..FrameFacts::default()
        }
    }
}

impl<'g> GainField<'g> {
    /// Evaluates the nodes over an image of `size` pixels, of a frame with this light.
    pub fn new(
        correction: &'g Correction<'g>,
        view: &View<'g>,
        size: (usize, usize),
        bands: usize,
        light: FrameLight<'g>,
    ) -> Self {
        let middle = view.light_path(size.0 as f64 / 2.0, size.1 as f64 / 2.0);
        let nearer =
            middle.map_or(1.0, |p| (p.strobe_to_seafloor_m / p.seafloor_to_camera_m).min(1.0));
        let px_per_rad = view.camera.fx * nearer;
        let error = correction.config.gain_error;
        let beam = &correction.model.beam_pattern;
        let step = step_px(beam, correction.roughness, px_per_rad, error);
        let gains = NodeGrid::new(size, step, bands, f32::NAN);
        let nodes = gains.columns * gains.rows;
        let rendering = correction.rendering;
        let has_gain = !correction.config.method.is_baseline();
        let is_full = correction.config.method == Method::Full;
        let empirical = correction.model.empirical.as_deref().filter(|_| is_full);
        let has_backscatter = correction.backscatter.is_some() || empirical.is_some();
        let least_ratio = correction.config.gain_signal_to_noise;
        let of_band = |value: &dyn Fn(usize) -> f64| {
            std::array::from_fn(|b| if b < bands { value(b) as f32 } else { 0.0 })
        };
        let mut field = Self {
            correction,
            view: *view,
            width: size.0,
            bands,
            gains,
            scattered: has_backscatter.then(|| NodeGrid::new(size, step, bands, 0.0)),
            residual: correction.model.residual.as_deref().filter(|_| is_full),
            empirical,
            range_factor: light.range_factor,
            weights: has_gain.then(|| NodeGrid::new(size, step, bands, -1.0)),
            signal: has_gain
                .then(|| Signal::new(rendering, bands, least_ratio, empirical.is_some(), light)),
            bits: vec![mask::OFF_SURFACE; nodes],
            removal: Removal::of(correction.config.method),
            uneven: Vec::new(),
            rendering_gain: of_band(&|b| rendering.gain[b]),
            facts: FrameFacts::default(),
        };
        let mut sums = Sums::default();
        let every = ((SMOOTH_RAD * px_per_rad / step as f64) as usize).max(1);
        // Several lamps have angles each, daylight is a sum, and relief has edges of its own: there
        // every node is exact.
        let has_several = view.rig.strobe.lamps.lamps().len() > 1;
        let is_product = !has_several && correction.model.daylight.is_none();
        if every > 1 && view.terrain.is_none() && is_product {
            field.fill_interpolated(every, &mut sums);
        } else {
            (0..nodes).for_each(|node| field.fill_exact(node, true, &mut sums));
        }
        field.uneven = field.uneven_cells();
        field.facts = sums.facts(nodes);
        field
    }

    fn uneven_cells(&self) -> Vec<bool> {
        let is_steep = |(min, max): (f32, f32)| max > STEEP * min;
        let cell = |node: usize| (node / self.gains.columns, node % self.gains.columns);
        let is_uneven = |(row, column): (usize, usize)| {
            (0..self.bands).any(|b| self.gains.range(row, column, b).is_none_or(is_steep))
        };
        (0..self.bits.len()).map(|node| is_uneven(cell(node))).collect()
    }

    /// Evaluates one node exactly.
    fn fill_exact(&mut self, node: usize, counts_path: bool, sums: &mut Sums) {
        let (row, column) = (node / self.gains.columns, node % self.gains.columns);
        let (u, v) = ((column * self.gains.step) as f64, (row * self.gains.step) as f64);
        let Some(path) = self.view.light_path(u, v) else { return };
        if counts_path {
            sums.add_path(&path);
        }
        self.set(node, &self.evaluated((u, v), &path), sums);
    }

    fn set(&mut self, index: usize, node: &Evaluated, sums: &mut Sums) {
        let (row, column) = (index / self.gains.columns, index % self.gains.columns);
        let gain = self.rendered(node.factor);
        self.gains.at_mut(row, column).copy_from_slice(&gain[..self.bands]);
        if let Some(nodes) = &mut self.scattered {
            nodes.at_mut(row, column).copy_from_slice(&node.scattered[..self.bands]);
        }
        let at = ((column * self.gains.step) as f64, (row * self.gains.step) as f64);
        let weights = self.signal.map_or([1.0; 3], |s| s.weights(at, node.factor, node.scattered));
        let weights = &weights[..self.bands];
        if let Some(nodes) = &mut self.weights {
            nodes.at_mut(row, column).copy_from_slice(weights);
        }
        self.bits[index] = self.bits_of(weights, node.is_seen);
        sums.on_surface += 1;
        sums.limited += usize::from(is_limited(weights));
        sums.unseen += usize::from(!node.is_seen);
        sums.gain += f64::from(gain[..self.bands].iter().sum::<f32>()) / self.bands as f64;
    }

    /// θ, φ, log radiance without beam per band, backscatter per band: exact on every `every`-th
    /// node.
    fn smooth_parts(&self, every: usize, sums: &mut Sums) -> NodeGrid {
        let (bands, step) = (self.bands, self.gains.step);
        let size = (self.gains.columns, self.gains.rows);
        let mut smooth = NodeGrid::new(size, every, 2 + 2 * bands, f32::NAN);
        for row in 0..smooth.rows {
            for column in 0..smooth.columns {
                let (u, v) = ((column * every * step) as f64, (row * every * step) as f64);
                let Some(path) = self.view.light_path(u, v) else { continue };
                sums.add_path(&path);
                let parts = self.removal.without_beam();
                let (log_radiance, scattered) = self.parts((u, v), &path, parts);
                let node = smooth.at_mut(row, column);
                (node[0], node[1]) = (path.angles.theta_rad as f32, path.angles.phi_rad as f32);
                for b in 0..bands {
                    node[2 + b] = log_radiance[b] as f32;
                    node[2 + bands + b] = scattered[b];
                }
            }
        }
        smooth
    }

    /// All nodes, from exact ones `every` so many nodes.
    fn fill_interpolated(&mut self, every: usize, sums: &mut Sums) {
        let (columns, rows, bands) = (self.gains.columns, self.gains.rows, self.bands);
        let smooth = self.smooth_parts(every, sums);
        let fields = smooth.bands;
        let is_smooth = |row, column| {
            (0..fields).all(|f| {
                let range = smooth.range(row, column, f);
                range.is_some_and(|(min, max)| f >= 2 + bands || max - min <= STEEP_SMOOTH)
            })
        };
        let mut walker = RowWalker::new(&smooth, columns, None);
        let mut line = vec![0f32; columns * fields];
        let mut cells = Vec::new();
        for row in 0..rows {
            walker.row(row, &mut line);
            if row % every == 0 {
                cells = (0..smooth.columns).map(|column| is_smooth(row / every, column)).collect();
            }
            for column in 0..columns {
                let node = row * columns + column;
                if cells[column / every] {
                    let values = self.interpolated(|part| line[part * columns + column]);
                    self.set(node, &values, sums);
                } else {
                    self.fill_exact(node, false, sums);
                }
            }
        }
    }

    /// A node from its smooth parts: only the beam pattern is looked up.
    fn interpolated(&self, part: impl Fn(usize) -> f32) -> Evaluated {
        let bands = self.bands;
        let angles = StrobeAngles { theta_rad: f64::from(part(0)), phi_rad: f64::from(part(1)) };
        let (log_beam, is_seen) = self.correction.model.beam_pattern.read(angles);
        let has_beam = self.removal.beam && self.empirical.is_none();
        let is_seen = is_seen || self.empirical.is_some();
        let log_beam = if has_beam { log_beam as f32 } else { 0.0 };
        let factor = std::array::from_fn(|b| {
            if b < bands { (-log_beam - part(2 + b)).min(MAX_LOG_GAIN).exp() } else { 0.0 }
        });
        let scattered = std::array::from_fn(|b| if b < bands { part(2 + bands + b) } else { 0.0 });
        Evaluated { factor, scattered, is_seen }
    }

    /// Weights of one pixel, exact; −1 off the seafloor.
    pub(super) fn exact_weights(&self, x: usize, y: usize) -> [f32; 3] {
        let (u, v) = (x as f64, y as f64);
        let Some(signal) = &self.signal else { return [1.0; 3] };
        self.view.light_path(u, v).map_or([-1.0; 3], |path| {
            let Evaluated { factor, scattered, .. } = self.evaluated((u, v), &path);
            signal.weights((u, v), factor, scattered)
        })
    }

    /// Bits of a pixel with these weights.
    pub(super) fn bits_of(&self, weights: &[f32], is_seen: bool) -> u8 {
        // A baseline has no gain that could be limited.
        let limited = is_limited(weights) && !self.correction.config.method.is_baseline();
        (u8::from(limited) * mask::CAPPED) | (u8::from(!is_seen) * mask::UNSEEN_BEAM)
    }

    /// The brightest band of the median corrected seafloor (share of white).
    pub(super) fn level(&self) -> f32 {
        let levels = self.signal.as_ref().map(|s| s.levels(self.correction.rendering));
        levels.map_or(0.0, |levels| levels.into_iter().fold(0.0, f32::max))
    }

    /// A mask with its bits.
    pub(super) fn marked(&self, mut mask: Vec<u8>) -> Vec<u8> {
        self.mark(&mut mask);
        mask
    }

    /// Adds the bits of every pixel to a mask: those of its cell's corners where they agree, its
    /// own elsewhere.
    pub fn mark(&self, mask: &mut [u8]) {
        let NodeGrid { step, columns, rows, .. } = self.gains;
        let node = |row: usize, column: usize| {
            self.bits[row.min(rows - 1) * columns + column.min(columns - 1)]
        };
        for (i, bits) in mask.iter_mut().enumerate() {
            let (x, y) = (i % self.width, i / self.width);
            let (row, column) = (y / step, x / step);
            let corners = [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(r, c)| node(row + r, column + c));
            *bits |= if corners.iter().all(|c| *c == corners[0]) {
                corners[0]
            } else {
                let (u, v) = (x as f64, y as f64);
                let own = |path: LightPath| {
                    let Evaluated { factor, scattered, is_seen } = self.evaluated((u, v), &path);
                    let weights =
                        self.signal.map_or([1.0; 3], |s| s.weights((u, v), factor, scattered));
                    self.bits_of(&weights[..self.bands], is_seen)
                };
                self.view.light_path(u, v).map_or(mask::OFF_SURFACE, own)
            };
        }
    }

    /// Path lengths and shares over the nodes.
    pub fn facts(&self) -> FrameFacts {
        self.facts
    }

    /// Log radiance of the parts and backscatter of one pixel.
    fn parts(&self, (u, v): (f64, f64), path: &LightPath, parts: Removal) -> (Bands, [f32; 3]) {
        let Some(empirical) = self.empirical else {
            let mut radiance = self.correction.model.log_radiance(path, parts);
            if let Some(residual) = self.residual {
                let (x, y) = self.view.camera.image_plane(u, v).unwrap_or((0.0, 0.0));
                let left = residual.log_light(x, y, path.seafloor_to_camera_m);
                radiance.iter_mut().zip(left).for_each(|(sum, left)| *sum += left);
            }
            return (radiance, self.scattered_at(u, v, path));
        };
        let (x, y) = self.view.camera.image_plane(u, v).unwrap_or((0.0, 0.0));
        let range_m = path.seafloor_to_camera_m * self.range_factor.at(x, y);
        let (log_direct, scattered) = empirical.light(x, y, range_m);
        (log_direct, scattered.map(|light| light as f32))
    }

    /// Factor and backscatter of one pixel.
    pub(super) fn evaluated(&self, at: (f64, f64), path: &LightPath) -> Evaluated {
        let (removed, scattered) = self.parts(at, path, self.removal);
        let beam = &self.correction.model.beam_pattern;
        let is_seen = self.empirical.is_some() || path.all_angles().all(|a| beam.is_seen(a));
        let factor = |b: usize| {
            if b < self.bands { (-removed[b] as f32).min(MAX_LOG_GAIN).exp() } else { 0.0 }
        };
        Evaluated { factor: std::array::from_fn(factor), scattered, is_seen }
    }

    /// Gain per band and backscatter of one pixel; none off the seafloor.
    pub(super) fn gain(&self, x: usize, y: usize) -> ([f32; 3], [f32; 3]) {
        let at = (x as f64, y as f64);
        self.view.light_path(at.0, at.1).map_or(([0.0; 3], [0.0; 3]), |path| {
            let Evaluated { factor, scattered, .. } = self.evaluated(at, &path);
            (self.rendered(factor), scattered)
        })
    }

    /// Factors with exposure and white balance.
    fn rendered(&self, factor: [f32; 3]) -> [f32; 3] {
        std::array::from_fn(|b| factor[b] * self.rendering_gain[b])
    }

    /// Backscatter of a pixel.
    fn scattered_at(&self, u: f64, v: f64, path: &LightPath) -> [f32; 3] {
        let Some((backscatter, table)) = self.correction.backscatter else { return [0.0; 3] };
        let of_ray = |(x, y)| backscatter.light(&table.at(x, y, path.seafloor_to_camera_m));
        let ray = self.view.camera.image_plane(u, v);
        ray.map(of_ray).map_or([0.0; 3], |light| light.map(|v| v as f32))
    }

    /// Pixels of a row whose gain is evaluated exactly.
    pub(super) fn uneven_pixels(&self, y: usize) -> impl Iterator<Item = usize> {
        let NodeGrid { step, columns, rows, .. } = self.gains;
        let cells = &self.uneven[(y / step).min(rows - 1) * columns..][..columns];
        let columns = cells.iter().enumerate().filter(|(_, uneven)| **uneven);
        columns.flat_map(move |(column, _)| column * step..((column + 1) * step).min(self.width))
    }
}

#[cfg(test)]
mod tests;
