//! Pixel grid of the mosaic, and the projection of frames onto it.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use nalgebra::{Isometry3, Vector3};

use crate::error::Result;
use crate::geometry::{SeafloorPlane, SeafloorPoint, View};
use crate::image::LinearImage;
use crate::products::display::downscale;
use crate::products::dive::ImageSource;
use crate::recording::FrameId;
use crate::session::Frame;
use crate::stats::median;
use crate::units::Stamp;
use crate::vehicle::{Camera, Rig};

/// Maximum size of a strip, in all and along its longer side (px).
const MAX_PIXELS: f64 = 4e6;
const MAX_SIDE_PX: f64 = 5000.0;
/// Seafloor farther from the camera is left out; an oblique camera sees up to the horizon
/// (altitudes).
const REACH: f64 = 2.2;
/// Minimum vertical component of a seafloor normal; steeper planes are not projected.
const MIN_VERTICAL: f64 = 0.2;
/// Intervals of the pixel grid per side that determines the extent of a frame.
const INTERVALS: usize = 12;

/// A frame with its pose.
#[derive(Clone, Copy, Debug)]
pub struct PlacedFrame {
    /// index of its record in [`CameraLog::frames`](crate::products::dive::CameraLog::frames)
    pub record: usize,
    /// log time (ns)
    pub log_time: u64,
    /// time of the image
    pub stamp: Stamp,
    /// pose in a world with z up (m)
    pub world_from_body: Isometry3<f64>,
    /// seafloor plane in body space
    pub plane: SeafloorPlane,
}

/// Pixels of the mosaic ⇄ world coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// world x of the left edge, world y of the upper one (m)
    pub corner: [f64; 2],
    /// (m)
    pub m_per_px: f64,
    /// (px)
    pub width: usize,
    /// (px)
    pub height: usize,
}

impl Grid {
    /// The grid that contains all frames, at their resolution where the size permits.
    pub fn around(frames: &[PlacedFrame], rig: &Rig) -> Self {
        let (mut low, mut high, mut resolutions) =
            ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2], Vec::new());
        for frame in frames {
            let view = View { camera: &rig.camera, rig, plane: &frame.plane, terrain: None };
            let altitude_m = view.camera_altitude_m();
            resolutions.push(altitude_m / rig.camera.fx);
            for point in outline(&view) {
                if point.seafloor_to_camera_m <= REACH * altitude_m {
                    let p = frame.world_from_body * nalgebra::Point3::from(point.position.vector());
                    (low, high) =
                        ([low[0].min(p.x), low[1].min(p.y)], [high[0].max(p.x), high[1].max(p.y)]);
                }
            }
        }
        let size = [(high[0] - low[0]).max(0.01), (high[1] - low[1]).max(0.01)];
        let finest = if resolutions.is_empty() { 0.01 } else { median(&resolutions) }.max(1e-5);
        let m_per_px = finest
            .max((size[0] * size[1] / MAX_PIXELS).sqrt())
            .max(size[0].max(size[1]) / MAX_SIDE_PX);
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

    /// Pixel of world coordinates (m); the centre of the upper left pixel is (0, 0).
    pub fn pixel(&self, [x, y]: [f64; 2]) -> (f64, f64) {
        ((x - self.corner[0]) / self.m_per_px - 0.5, (self.corner[1] - y) / self.m_per_px - 0.5)
    }

    /// World coordinates of a pixel's centre (m).
    fn world(&self, column: usize, row: usize) -> [f64; 2] {
        [
            self.corner[0] + (column as f64 + 0.5) * self.m_per_px,
            self.corner[1] - (row as f64 + 0.5) * self.m_per_px,
        ]
    }
}

/// All frames projected onto the grid, in linear light.
pub struct Strip {
    /// black without a frame
    pub image: LinearImage,
    /// number of each pixel's frame, from 1; 0 without one
    pub frame_numbers: Vec<u32>,
}

/// A frame projected onto a rectangle of the grid; `None` where it does not show the seafloor.
struct Patch {
    number: u32,
    left: usize,
    top: usize,
    width: usize,
    light: Vec<Option<[f32; 3]>>,
}

impl Strip {
    /// Projects the frames of a camera in time order.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn project(
        ImageSource { bench, records }: &ImageSource,
        grid: &Grid,
        placed: &[PlacedFrame],
    ) -> Result<Self> {
        let by_record: BTreeMap<usize, usize> =
            placed.iter().enumerate().map(|(i, l)| (l.record, i)).collect();
        let number = |(id, record): (&FrameId, &usize)| Some((*id, *by_record.get(record)?));
        let numbers: BTreeMap<FrameId, usize> = records.iter().filter_map(number).collect();
        let chosen: BTreeSet<FrameId> = numbers.keys().copied().collect();
        let bands = bench.model.file.attenuation_per_m.len();
        let mut strip = Self {
            image: LinearImage::new(grid.width, grid.height, bands),
            frame_numbers: vec![0; grid.width * grid.height],
        };
        bench.each(
            &chosen,
            |frame| {
                let number = numbers.get(&frame.frame.at.id).copied()?;
                let projection = Projection { grid, placed: placed.get(number)? };
                let light = frame.image.clone().into_demosaiced();
                projection.patch(number as u32 + 1, &frame.frame, &light)
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
            self.frame_numbers[at] = patch.number;
        }
    }

    /// Number of pixels covered by a frame.
    pub fn covered(&self) -> usize {
        self.frame_numbers.iter().filter(|f| **f > 0).count()
    }
}

/// Orthogonal projection of one frame.
struct Projection<'p> {
    grid: &'p Grid,
    placed: &'p PlacedFrame,
}

impl Projection<'_> {
    fn patch(&self, number: u32, frame: &Frame<'_>, light: &LinearImage) -> Option<Patch> {
        let (grid, plane) = (self.grid, &self.placed.plane);
        let view = frame.view();
        let altitude_m = view.camera_altitude_m();
        // Where the grid is coarser than the frame, the frame is downscaled first.
        let block = ((grid.m_per_px * frame.camera.fx / altitude_m) as usize).max(1);
        let longest = light.width.max(light.height);
        let small = downscale(light, longest.div_ceil(block));
        let block = (longest as f64 / small.width.max(small.height) as f64).floor().max(1.0);
        let pose = self.placed.world_from_body;
        let (normal, distance) = (pose.rotation * plane.normal.vector(), plane.distance_m);
        if normal.z > -MIN_VERTICAL {
            return None;
        }
        let max_tan2 = max_tan2(&frame.camera);
        let origin = pose.translation.vector;
        let rig = view.rig;
        let optical_from_world = rig.body_from_optical.inverse().isometry() * pose.inverse();
        let sample = |[x, y]: [f64; 2]| -> Option<[f32; 3]> {
            let (dx, dy) = (x - origin.x, y - origin.y);
            let z = origin.z + (distance - normal.x * dx - normal.y * dy) / normal.z;
            let p = optical_from_world * nalgebra::Point3::from(Vector3::new(x, y, z));
            if p.z <= 0.0 || p.coords.norm() > REACH * altitude_m {
                return None;
            }
            let (a, b) = (p.x / p.z, p.y / p.z);
            // Beyond the edge a distortion model may fold back into the image.
            if a * a + b * b > max_tan2 {
                return None;
            }
            let (u, v) = frame.camera.pixel(a, b);
            bilinear(&small, (u + 0.5) / block - 0.5, (v + 0.5) / block - 0.5)
        };
        let (columns, rows) = self.extent(frame);
        let (left, top, width) = (columns.start, rows.start, columns.len());
        let light = rows
            .flat_map(|row| columns.clone().map(move |column| (column, row)))
            .map(|(column, row)| sample(grid.world(column, row)))
            .collect();
        (width > 0).then_some(Patch { number, left, top, width, light })
    }

    /// Columns and rows of the grid that a frame covers.
    fn extent(&self, frame: &Frame<'_>) -> (Range<usize>, Range<usize>) {
        let (grid, view) = (self.grid, frame.view());
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for point in outline(&view) {
            let p = self.placed.world_from_body * nalgebra::Point3::from(point.position.vector());
            let (x, y) = grid.pixel([p.x, p.y]);
            (low, high) = ([low[0].min(x), low[1].min(y)], [high[0].max(x), high[1].max(y)]);
        }
        let clamped =
            |v: f64, max: usize| if v.is_nan() { 0 } else { v.clamp(0.0, max as f64) as usize };
        (
            clamped(low[0] - 2.0, grid.width)..clamped(high[0] + 3.0, grid.width),
            clamped(low[1] - 2.0, grid.height)..clamped(high[1] + 3.0, grid.height),
        )
    }
}

/// Seafloor points of a pixel grid that spans the image.
fn outline<'v>(view: &'v View<'_>) -> impl Iterator<Item = SeafloorPoint> + 'v {
    let at = |i: usize, n: usize| i as f64 / INTERVALS as f64 * (n - 1) as f64;
    let nodes = (0..=INTERVALS).flat_map(|i| (0..=INTERVALS).map(move |j| (i, j)));
    nodes.filter_map(move |(i, j)| {
        view.seafloor_point(at(i, view.camera.width), at(j, view.camera.height))
    })
}

/// Largest squared tangent of the angle to the optical axis at the image's edge, with a margin of 2
/// %.
fn max_tan2(camera: &Camera) -> f64 {
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
