//! Pixels of the mosaic ⇄ metres of the seafloor, and frames laid onto them.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Vector3;

use super::Laid;
use crate::error::Result;
use crate::geometry::View;
use crate::image::LinearImage;
use crate::products::pictures::downscale;
use crate::run::bench::{Bench, BenchFrame};
use crate::vehicle::{Camera, Rig};

/// Pixels of a strip, at most, and of its longer side.
const MOST_PIXELS: f64 = 4e6;
const LONGEST: f64 = 5000.0;
/// The floor farther off than so many altitudes is left out: an oblique camera sees to the horizon.
const REACH: f64 = 2.2;
/// Pixels along a frame's edge whose places say how far the mosaic reaches.
const EDGE: usize = 12;

/// Where pixels lie on the ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// world x of the left edge, world y of the upper one [m]
    pub corner: [f64; 2],
    /// [m]
    pub m_per_px: f64,
    /// [px]
    pub width: usize,
    /// [px]
    pub height: usize,
}

impl Grid {
    /// The grid that holds all frames, as fine as they are if it does not get too large.
    pub fn around(laid: &[Laid], rig: &Rig) -> Self {
        let (mut low, mut high, mut finest) =
            ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2], Vec::new());
        for frame in laid {
            let view = View { camera: &rig.camera, rig, plane: &frame.plane, terrain: None };
            let altitude_m = view.camera_altitude_m();
            finest.push(altitude_m / rig.camera.fx);
            let at = |i: usize, n: usize| i as f64 / EDGE as f64 * (n - 1) as f64;
            let places = (0..=EDGE).flat_map(|i| (0..=EDGE).map(move |j| (i, j)));
            for (i, j) in places {
                let Some(sighted) =
                    view.seafloor_point(at(i, rig.camera.width), at(j, rig.camera.height))
                else {
                    continue;
                };
                if sighted.seafloor_to_camera_m <= REACH * altitude_m {
                    let p =
                        frame.world_from_body * nalgebra::Point3::from(sighted.position.vector());
                    (low, high) =
                        ([low[0].min(p.x), low[1].min(p.y)], [high[0].max(p.x), high[1].max(p.y)]);
                }
            }
        }
        finest.sort_by(f64::total_cmp);
        let size = [(high[0] - low[0]).max(0.01), (high[1] - low[1]).max(0.01)];
        let finest = finest.get(finest.len() / 2).copied().unwrap_or(0.01).max(1e-5);
        let m_per_px = finest
            .max((size[0] * size[1] / MOST_PIXELS).sqrt())
            .max(size[0].max(size[1]) / LONGEST);
        let pixels = |length: f64| {
            if length.is_finite() { (length / m_per_px).ceil().max(1.0) as usize } else { 1 }
        };
        Self {
            corner: [low[0], high[1]],
            m_per_px,
            width: pixels(size[0]),
            height: pixels(size[1]),
        }
    }

    /// Pixel of a place of the world; the centre of the upper left pixel is (0, 0).
    pub fn pixel(&self, [x, y]: [f64; 2]) -> (f64, f64) {
        ((x - self.corner[0]) / self.m_per_px - 0.5, (self.corner[1] - y) / self.m_per_px - 0.5)
    }

    fn place(&self, column: usize, row: usize) -> [f64; 2] {
        [
            self.corner[0] + (column as f64 + 0.5) * self.m_per_px,
            self.corner[1] - (row as f64 + 0.5) * self.m_per_px,
        ]
    }
}

/// A stretch of seafloor in linear light.
pub struct Strip {
    /// light; black where no frame lies
    pub image: LinearImage,
    /// which frame a pixel is from, counted from 1; 0 where none is
    pub from: Vec<u32>,
}

/// What a frame covers: a rectangle of the grid, and light in it where the frame shows the floor.
struct Patch {
    number: u32,
    left: usize,
    top: usize,
    width: usize,
    light: Vec<Option<[f32; 3]>>,
}

impl Strip {
    /// Lays a camera's frames down in time order.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn of(
        bench: &Bench,
        grid: &Grid,
        laid: &[Laid],
        light: fn(&BenchFrame) -> LinearImage,
    ) -> Result<Self> {
        let numbers: BTreeMap<u64, usize> =
            laid.iter().enumerate().map(|(i, l)| (l.log_time, i)).collect();
        let number_of =
            |logged: i64| u64::try_from(logged).ok().and_then(|t| numbers.get(&t)).copied();
        let chosen: BTreeSet<usize> = bench
            .log
            .survey
            .frames
            .iter()
            .enumerate()
            .filter(|(_, f)| number_of(f.logged.0).is_some())
            .map(|(i, _)| i)
            .collect();
        let bands = bench.file.attenuation_per_m.len();
        let mut strip = Self {
            image: LinearImage::new(grid.width, grid.height, bands),
            from: vec![0; grid.width * grid.height],
        };
        bench.each(
            &chosen,
            |frame| {
                let number = numbers.get(&frame.log_time).copied()?;
                patch(bench, grid, laid.get(number)?, number as u32 + 1, &frame, light(&frame))
            },
            |patch| patch.into_iter().for_each(|p| strip.put(&p)),
        )?;
        Ok(strip)
    }

    fn put(&mut self, patch: &Patch) {
        for (i, light) in patch.light.iter().enumerate() {
            let Some(light) = light else { continue };
            let at =
                (patch.top + i / patch.width) * self.image.width + patch.left + i % patch.width;
            let bands = self.image.bands;
            self.image.pixels[at * bands..(at + 1) * bands].copy_from_slice(&light[..bands]);
            self.from[at] = patch.number;
        }
    }

    /// Pixels that a frame lies on.
    pub fn covered(&self) -> usize {
        self.from.iter().filter(|f| **f > 0).count()
    }
}

/// A frame seen from straight above.
fn patch(
    bench: &Bench,
    grid: &Grid,
    laid: &Laid,
    number: u32,
    frame: &BenchFrame,
    light: LinearImage,
) -> Option<Patch> {
    let rig = &bench.log.survey.rig;
    let view = bench.view(frame);
    let altitude_m = view.camera_altitude_m();
    // Where pixels of the mosaic are coarser, the frame is averaged down to them first.
    let block = ((grid.m_per_px * frame.camera.fx / altitude_m) as usize).max(1);
    let longest = light.width.max(light.height);
    let small = downscale(&light, longest.div_ceil(block));
    let block = (longest as f64 / small.width.max(small.height) as f64).floor().max(1.0);
    let (pose, normal, distance) = (
        laid.world_from_body,
        laid.world_from_body.rotation * laid.plane.normal.vector(),
        laid.plane.distance_m,
    );
    if normal.z > -0.2 {
        return None;
    }
    let widest = widest(&frame.camera);
    let origin = pose.translation.vector;
    let optical_from_world = rig.body_from_optical.inverse().isometry() * pose.inverse();
    let sample = |[x, y]: [f64; 2]| -> Option<[f32; 3]> {
        let (dx, dy) = (x - origin.x, y - origin.y);
        let z = origin.z + (distance - normal.x * dx - normal.y * dy) / normal.z;
        let p = optical_from_world * nalgebra::Point3::from(Vector3::new(x, y, z));
        if p.z <= 0.0 || p.coords.norm() > REACH * altitude_m {
            return None;
        }
        let (a, b) = (p.x / p.z, p.y / p.z);
        // Beyond its edge a lens model may fold back into the picture.
        if a * a + b * b > widest {
            return None;
        }
        let (u, v) = frame.camera.pixel(a, b);
        bilinear(&small, (u + 0.5) / block - 0.5, (v + 0.5) / block - 0.5)
    };
    let (mut low, mut high) =
        ((f64::INFINITY, f64::INFINITY), (f64::NEG_INFINITY, f64::NEG_INFINITY));
    for k in 0..=EDGE * EDGE + 2 * EDGE {
        let (i, j) = (k % (EDGE + 1), k / (EDGE + 1));
        let at = |i: usize, n: usize| i as f64 / EDGE as f64 * (n - 1) as f64;
        let Some(sighted) =
            view.seafloor_point(at(i, frame.camera.width), at(j, frame.camera.height))
        else {
            continue;
        };
        let p = pose * nalgebra::Point3::from(sighted.position.vector());
        let (x, y) = grid.pixel([p.x, p.y]);
        (low, high) = ((low.0.min(x), low.1.min(y)), (high.0.max(x), high.1.max(y)));
    }
    let held =
        |v: f64, most: usize| if v.is_nan() { 0 } else { v.clamp(0.0, most as f64) as usize };
    let (left, top) = (held(low.0 - 2.0, grid.width), held(low.1 - 2.0, grid.height));
    let (right, bottom) = (held(high.0 + 3.0, grid.width), held(high.1 + 3.0, grid.height));
    let width = right.saturating_sub(left);
    let light = (top..bottom)
        .flat_map(|row| (left..right).map(move |column| (column, row)))
        .map(|(column, row)| sample(grid.place(column, row)))
        .collect();
    (width > 0).then_some(Patch { number, left, top, width, light })
}

/// Largest squared tangent of the angle off the axis at the picture's edge.
fn widest(camera: &Camera) -> f64 {
    let (w, h) = ((camera.width - 1) as f64, (camera.height - 1) as f64);
    let edge = (0..=8)
        .map(|k| f64::from(k) / 8.0)
        .flat_map(|t| [(t * w, 0.0), (t * w, h), (0.0, t * h), (w, t * h)]);
    1.02 * edge
        .filter_map(|(u, v)| camera.image_plane(u, v))
        .map(|(x, y)| x * x + y * y)
        .fold(0.0, f64::max)
}

fn bilinear(image: &LinearImage, u: f64, v: f64) -> Option<[f32; 3]> {
    if !(u >= 0.0 && v >= 0.0 && u <= (image.width - 1) as f64 && v <= (image.height - 1) as f64) {
        return None;
    }
    let (i, j) = (u as usize, v as usize);
    let (k, l) = ((i + 1).min(image.width - 1), (j + 1).min(image.height - 1));
    let (a, b) = ((u - i as f64) as f32, (v - j as f64) as f32);
    let (p, q, r, s) = (image.at(i, j), image.at(k, j), image.at(i, l), image.at(k, l));
    Some(std::array::from_fn(|band| {
        let n = band.min(image.bands - 1);
        (1.0 - b) * ((1.0 - a) * p[n] + a * q[n]) + b * ((1.0 - a) * r[n] + a * s[n])
    }))
}
