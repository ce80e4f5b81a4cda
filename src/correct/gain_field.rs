//! The gain from raw to corrected light over one frame, with as few evaluations of Eq. 15 as
//! `render.gain_error` allows.
//!
//! ```text
//! exact, every few dozen pixels      θ, φ, all parts of Eq. 15 but BP, backscatter: smooth over the image
//!   bilinear, on nodes in between    log BP(θ, φ) looked up: it has edges where its own bilinear grid has nodes
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
use super::{Correction, FrameFacts, mask};
use crate::geometry::{LightPath, StrobeAngles, View};
use crate::image::Bands;
use crate::model::{BeamPattern, Removal};

/// Larger log gains make no difference to the eye, and would overflow before the cap applies.
const MAX_LOG_GAIN: f32 = 60.0;
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
    /// bits of the mask, by node
    pub(super) bits: Vec<u8>,
    removal: Removal,
    /// cells that are not interpolated
    uneven: Vec<bool>,
    /// one over the log's median correction, by band; 0 for bands that do not exist
    per_median: [f32; 3],
    /// the rendering's gain, by band
    rendering_gain: [f32; 3],
    facts: FrameFacts,
}

/// What Eq. 15 gives at one point.
struct Node {
    gain: [f32; 3],
    scattered: [f32; 3],
    is_capped: bool,
    is_seen: bool,
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
    capped: usize,
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
            gain_capped_share: self.capped as f64 / nodes as f64,
            off_surface_share: 1.0 - self.on_surface as f64 / nodes as f64,
            unseen_beam_share: self.unseen as f64 / nodes as f64,
            mean_gain: self.gain / self.on_surface.max(1) as f64,
            ..FrameFacts::default()
        }
    }
}

impl<'g> GainField<'g> {
    /// Evaluates the nodes over an image of `size` pixels.
    pub fn new(
        correction: &'g Correction<'g>,
        view: &View<'g>,
        size: (usize, usize),
        bands: usize,
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
        let of_band = |value: &dyn Fn(usize) -> f64| {
            std::array::from_fn(|b| if b < bands { value(b) as f32 } else { 0.0 })
        };
        let mut field = Self {
            correction,
            view: *view,
            width: size.0,
            bands,
            gains,
            scattered: correction.glow.map(|_| NodeGrid::new(size, step, bands, 0.0)),
            bits: vec![mask::OFF_SURFACE; nodes],
            removal: Removal::of(correction.config.method),
            uneven: Vec::new(),
            per_median: of_band(&|b| 1.0 / rendering.median_correction[b]),
            rendering_gain: of_band(&|b| rendering.gain[b]),
            facts: FrameFacts::default(),
        };
        let mut sums = Sums::default();
        let every = ((SMOOTH_RAD * px_per_rad / step as f64) as usize).max(1);
        // Several lamps have angles each, and relief has edges of its own: there every node is
        // exact.
        if every > 1 && view.terrain.is_none() && view.rig.strobe.lamps.lamps().len() == 1 {
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
        let (gain, is_capped, is_seen) = self.gain(&path);
        let scattered = self.scattered_at(u, v, &path);
        self.set(node, &Node { gain, scattered, is_capped, is_seen }, sums);
    }

    fn set(&mut self, index: usize, node: &Node, sums: &mut Sums) {
        let (row, column) = (index / self.gains.columns, index % self.gains.columns);
        self.gains.at_mut(row, column).copy_from_slice(&node.gain[..self.bands]);
        if let Some(nodes) = &mut self.scattered {
            nodes.at_mut(row, column).copy_from_slice(&node.scattered[..self.bands]);
        }
        self.bits[index] = self.bits_of(node.is_capped, node.is_seen);
        sums.on_surface += 1;
        sums.capped += usize::from(node.is_capped);
        sums.unseen += usize::from(!node.is_seen);
        sums.gain += f64::from(node.gain[..self.bands].iter().sum::<f32>()) / self.bands as f64;
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
                let scattered = self.scattered_at(u, v, &path);
                let node = smooth.at_mut(row, column);
                (node[0], node[1]) = (path.angles.theta_rad as f32, path.angles.phi_rad as f32);
                let parts = self.removal.without_beam();
                let log_radiance = self.correction.model.log_radiance(&path, parts);
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
            for (column, parts) in line.chunks_exact(fields).enumerate() {
                let node = row * columns + column;
                if cells[column / every] {
                    let values = self.interpolated(parts);
                    self.set(node, &values, sums);
                } else {
                    self.fill_exact(node, false, sums);
                }
            }
        }
    }

    /// A node from its smooth parts: only the beam pattern is looked up.
    fn interpolated(&self, parts: &[f32]) -> Node {
        let bands = self.bands;
        let angles = StrobeAngles { theta_rad: f64::from(parts[0]), phi_rad: f64::from(parts[1]) };
        let (log_beam, is_seen) = self.correction.model.beam_pattern.read(angles);
        let log_beam = if self.removal.beam { log_beam as f32 } else { 0.0 };
        let (gain, is_capped) = self.capped(std::array::from_fn(|b| {
            if b < bands { (-log_beam - parts[2 + b]).min(MAX_LOG_GAIN).exp() } else { 0.0 }
        }));
        let scattered = std::array::from_fn(|b| if b < bands { parts[2 + bands + b] } else { 0.0 });
        Node { gain, scattered, is_capped, is_seen }
    }

    fn bits_of(&self, is_capped: bool, is_seen: bool) -> u8 {
        // A baseline has no gain that could be capped.
        let capped = is_capped && !self.correction.config.method.is_baseline();
        (u8::from(capped) * mask::CAPPED) | (u8::from(!is_seen) * mask::UNSEEN_BEAM)
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
                let own = |path: LightPath| {
                    let (_, is_capped, is_seen) = self.gain(&path);
                    self.bits_of(is_capped, is_seen)
                };
                self.view.light_path(x as f64, y as f64).map_or(mask::OFF_SURFACE, own)
            };
        }
    }

    /// Path lengths and shares over the nodes.
    pub fn facts(&self) -> FrameFacts {
        self.facts
    }

    /// Gain of one light path per band, whether it is capped, and whether pass one has seen its
    /// directions in the beam.
    pub(super) fn gain(&self, path: &LightPath) -> ([f32; 3], bool, bool) {
        let model = self.correction.model;
        let removed: Bands = model.log_radiance(path, self.removal);
        let is_seen = path.all_angles().all(|a| model.beam_pattern.is_seen(a));
        let (gain, is_capped) = self.capped(std::array::from_fn(|b| {
            if b < self.bands { (-removed[b] as f32).min(MAX_LOG_GAIN).exp() } else { 0.0 }
        }));
        (gain, is_capped, is_seen)
    }

    /// The factor per band, capped and rendered. All bands are capped by the same factor: hue
    /// stays.
    fn capped(&self, factor: [f32; 3]) -> ([f32; 3], bool) {
        let max = factor.iter().zip(self.per_median).fold(0f32, |max, (f, m)| max.max(f * m));
        let cap = (self.correction.config.gain_cap as f32 / max).min(1.0);
        (std::array::from_fn(|b| factor[b] * cap * self.rendering_gain[b]), cap < 1.0)
    }

    /// Backscatter of a pixel.
    pub(super) fn scattered_at(&self, u: f64, v: f64, path: &LightPath) -> [f32; 3] {
        let Some((backscatter, table)) = self.correction.glow else { return [0.0; 3] };
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
mod tests {
    use super::*;
    use crate::config::{RenderConfig, Spreading};
    use crate::coordinates::{Direction, Transform};
    use crate::correct::MeanFrames;
    use crate::correct::gain_rows::GainRows;
    use crate::geometry::{SeafloorPlane, Support};
    use crate::image::LinearImage;
    use crate::model::{BeamGrid, BeamPattern, ImagingModel, RenderingFile, SpreadingModel};
    use crate::vehicle::{Camera, Lamps, Rig, StrobeMount};

    /// The interpolated gain against the exact formula, on a tilted seafloor, with part of the
    /// image above the horizon.
    #[test]
    fn the_interpolated_field_agrees_with_the_exact_model() {
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
            let field = GainField::new(&correction, &view, (width, height), 3);
            let mut bits = vec![0; width * height];
            field.mark(&mut bits);
            let mut rows = GainRows::new(&field, None, frame_gain);
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
            assert!((off > 0) == (pitch_deg > 60.0), "{off} off the seafloor at {pitch_deg}°");
        }
    }
}
