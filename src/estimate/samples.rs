//! Samples of a frame: log light of patches around keypoints and of a coarse grid (paper §IV-B).
//! The pixels are not needed afterwards.
//!
//! Light is averaged in linear values under a Gaussian that covers the same metres of seafloor in
//! every view of a point. Averaged over the same number of pixels instead, the farther view covers
//! more seafloor, and the log of a mean is not the mean of logs (−0.02 per metre in α). So each
//! keypoint is averaged over several footprints of fixed size in metres, and views that are matched
//! later are compared at a level they share. Patches that hold clipped pixels, are near black or
//! reach over the edge are left out. A mosaic is averaged as it is, each band over its own pixels:
//! demosaicing mixes the curvature of green into dim red, and keypoints are where curvature is
//! greatest.
//!
//! A sample does not depend on the strobe's position; light paths are computed from it when needed.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use crate::config::{EstimateConfig, MatchingConfig};
use crate::coordinates::{Body, Direction, Point};
use crate::geometry::{SeafloorPoint, Support, View};
use crate::image::SensorImage;
use crate::solver::Sample;
use crate::units::Stamp;

use super::keypoints::{Keypoint, keypoints};

/// Footprints of a keypoint, from the smallest that it resolves: factor √2 each, for views up to 4×
/// nearer.
const LEVELS: usize = 5;
/// Levels beyond those that the planes need: terrain has steeper slopes.
const SPARE_LEVELS: i32 = 1;
/// Patches are cut at this many standard deviations.
const PATCH_SIGMAS: f64 = 2.5;

/// The seafloor point of a keypoint and its light at several levels.
#[derive(Clone, Debug)]
pub struct KeypointSample {
    /// seafloor point; `log_color` is unused
    pub sample: Sample,
    /// the first level: its footprint is 1 mm × √2^level
    pub first_level: i32,
    /// log c_Λ at each level; NaN where there is none
    pub log_colors: [[f32; 3]; LEVELS],
}

/// All samples of one frame.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct FrameSamples {
    /// index of its log among those of the estimate
    pub log: usize,
    /// index of the frame in the log
    pub frame: usize,
    /// time of its header, clock offset added
    pub stamp: Stamp,
    /// of the plane; on terrain that of a sample may differ
    pub normal: Direction<Body>,
    /// altitude of the camera above the plane (m)
    pub camera_altitude_m: f64,
    /// bands of the image
    pub bands: usize,
    /// keypoints to match
    #[serde(skip)]
    pub keypoints: Vec<Keypoint>,
    /// their image-plane coordinates
    #[serde(skip)]
    pub places: Vec<(f64, f64)>,
    /// their samples
    #[serde(skip)]
    pub samples: Vec<KeypointSample>,
    /// a coarse grid over the frame: index of the cell, and its sample
    pub grid: Vec<(u32, Sample)>,
    /// blocks of that grid that are near black or partly clipped; NaN for a clipped band
    pub dark: Vec<(u32, Sample)>,
    /// mean linear light per band over the frame
    pub mean_light: [f64; 3],
    /// mean linear light per band as the camera gave it: without a flat field
    pub mean_reading: [f64; 3],
    /// whether the image has pixel values of 8 bits
    pub eight_bit: bool,
    /// steps of the pixel values up to full scale
    pub max_value: u16,
    /// whether its transfer curve is assumed to be sRGB
    pub is_srgb: bool,
    /// the plane's distance from the body's origin (m)
    pub distance_m: f64,
    /// whether the plane is assumed level, for want of beams
    pub is_level_assumed: bool,
    /// whether overlapping frames show how it is tilted instead
    pub is_tilt_measured: bool,
    /// whether the vehicle's attitude is known
    pub has_attitude: bool,
    /// planes a little earlier and later, where there are any
    pub planes_around: Option<[(Direction<Body>, f64); 2]>,
}

impl FrameSamples {
    /// A frame of a known seafloor.
    fn without_samples((frame, stamp): (usize, Stamp), view: &View<'_>, bands: usize) -> Self {
        Self {
            log: 0,
            frame,
            stamp,
            normal: view.plane.normal,
            camera_altitude_m: view.camera_altitude_m(),
            bands,
            keypoints: Vec::new(),
            places: Vec::new(),
            samples: Vec::new(),
            grid: Vec::new(),
            dark: Vec::new(),
            mean_light: [0.0; 3],
            mean_reading: [0.0; 3],
            eight_bit: false,
            max_value: u16::MAX,
            is_srgb: false,
            distance_m: view.plane.distance_m,
            is_level_assumed: view.plane.support == Support::AssumedLevel,
            is_tilt_measured: false,
            has_attitude: true,
            planes_around: None,
        }
    }

    /// Frees the keypoints, most of a frame's memory, once they are matched.
    pub fn drop_keypoints(&mut self) {
        (self.keypoints, self.places, self.samples) = Default::default();
    }

    /// The same frame with another grid and without keypoints.
    pub fn with_grid(&self, grid: Vec<(u32, Sample)>) -> Self {
        let (keypoints, places, samples, dark) = Default::default();
        Self { keypoints, places, samples, dark, grid, ..*self }
    }
}

/// Standard deviation of the footprint of a level on the seafloor (m).
fn footprint_m(level: i32) -> f64 {
    1e-3 * 2f64.powf(f64::from(level) / 2.0)
}

/// A pixel is a mean over its square: its share of a Gaussian's variance (px²).
const PIXEL_VARIANCE: f64 = 1.0 / 12.0;

/// Metres of seafloor per pixel along the rows and columns of the image: a circle on the seafloor
/// is seen as an ellipse of this shape and area. Slant range alone is not enough: a pixel off the
/// axis covers a smaller angle, and inclined seafloor is foreshortened.
fn pixel_on_seafloor_m(view: &View<'_>, u: f64, v: f64, hit: &Point<Body>) -> Option<[f64; 2]> {
    let along = |du: f64, dv: f64| {
        Some(view.seafloor_point(u + du, v + dv)?.position.vector() - hit.vector())
    };
    let (across, down) = (along(1.0, 0.0)?, along(0.0, 1.0)?);
    let area = across.cross(&down).norm();
    let aspect = across.norm() / down.norm();
    Some([(area * aspect).sqrt(), (area / aspect).sqrt()])
        .filter(|m| m.iter().all(|m| *m > 0.0 && m.is_finite()))
}

/// The level of a keypoint's smallest footprint, for the size of a pixel on the seafloor.
fn first_level(pixel_m: f64, matching: &MatchingConfig) -> i32 {
    (2.0 * (matching.footprint_px * pixel_m / 1e-3).log2()).ceil() as i32
}

/// Metres of seafloor that the pixel of the coarsest corner covers, times the focal length; it
/// limits the levels of frames that see the same points. Infinite where a corner sees no seafloor.
pub fn coarsest_m(view: &View<'_>) -> f64 {
    let (right, bottom) = (view.camera.width as f64 - 1.0, view.camera.height as f64 - 1.0);
    let corner = |(u, v): (f64, f64)| {
        let [across, down] = pixel_on_seafloor_m(view, u, v, &view.seafloor_point(u, v)?.position)?;
        Some((across * down).sqrt() * view.camera.fx)
    };
    [(0.0, 0.0), (right, 0.0), (0.0, bottom), (right, bottom)]
        .map(|c| corner(c).unwrap_or(f64::INFINITY))
        .into_iter()
        .fold(0.0, f64::max)
}

/// Samples of one frame; with keypoints where `keypoints_up_to`, the largest [`coarsest_m`] of all
/// frames, is given.
pub fn sample_frame(
    (frame, stamp): (usize, Stamp),
    image: &SensorImage,
    view: &View<'_>,
    keypoints_up_to: Option<f64>,
    matching: &MatchingConfig,
    config: &EstimateConfig,
) -> FrameSamples {
    let reduction = matching.reduction(image.light.width, image.light.height);
    let ((grid, dark), mean_light) = grid(image, view, reduction, config);
    let seafloor = FrameSamples::without_samples((frame, stamp), view, image.bands());
    let mut taken = FrameSamples { grid, dark, mean_light, mean_reading: mean_light, ..seafloor };
    let Some(coarsest_m) = keypoints_up_to else { return taken };
    let last_level =
        first_level(coarsest_m / view.camera.fx, matching).saturating_add(SPARE_LEVELS);
    for keypoint in keypoints(image, matching) {
        let Some((x, y)) = view.camera.image_plane(keypoint.u, keypoint.v) else { continue };
        let Some(SeafloorPoint { position: hit, seafloor_to_camera_m, normal }) =
            view.seafloor_point_of_ray(x, y)
        else {
            continue;
        };
        let Some(pixel_m) = pixel_on_seafloor_m(view, keypoint.u, keypoint.v, &hit) else {
            continue;
        };
        let first_level = first_level((pixel_m[0] * pixel_m[1]).sqrt(), matching);
        let sigma_px = |level: i32| {
            pixel_m.map(|m| ((footprint_m(level) / m).powi(2) - PIXEL_VARIANCE).max(0.01).sqrt())
        };
        let pool = |level: i32| pooled(image, keypoint.u, keypoint.v, sigma_px(level), config);
        let at_level = |level: i32| if level <= last_level { pool(level) } else { [f32::NAN; 3] };
        let log_colors = std::array::from_fn(|k| at_level(first_level + k as i32));
        taken.samples.push(KeypointSample {
            sample: Sample { hit, seafloor_to_camera_m, normal, log_color: [f32::NAN; 3] },
            first_level,
            log_colors,
        });
        taken.places.push((x, y));
        taken.keypoints.push(keypoint);
    }
    taken
}

impl KeypointSample {
    /// The sample at a level; `None` where it has no light.
    pub fn at_level(&self, level: i32, bands: usize) -> Option<Sample> {
        let log_color = *self.log_colors.get(usize::try_from(level - self.first_level).ok()?)?;
        log_color[..bands]
            .iter()
            .all(|v| v.is_finite())
            .then_some(Sample { log_color, ..self.sample })
    }
}

/// Sums of light over a part of an image.
#[derive(Default)]
struct Pool {
    /// weighted sum per band
    sum: [f64; 3],
    /// of weights
    weights: [f64; 3],
    /// largest value of any band
    largest: f32,
}

impl Pool {
    /// Weighted mean per band; NaN for a band without a pixel.
    fn mean(&self) -> [f64; 3] {
        std::array::from_fn(|b| self.sum[b] / self.weights[b])
    }

    /// Adds another part.
    fn add(&mut self, part: &Pool) {
        for b in 0..3 {
            self.sum[b] += part.sum[b];
            self.weights[b] += part.weights[b];
        }
        self.largest = self.largest.max(part.largest);
    }
}

/// Rows are summed in single precision, so many at a time, and these sums in double: a whole image
/// has too many pixels for single precision.
const ROWS_AT_ONCE: usize = 64;

/// Sums linear light with separable weights: rows into one row, and then along that.
fn pool(
    image: &SensorImage,
    columns: Range<usize>,
    rows: Range<usize>,
    across: impl Fn(usize) -> f32,
    down: impl Fn(usize) -> f32,
) -> Pool {
    let (light, bands) = (&image.light, image.light.bands);
    let across: Vec<f32> = columns.clone().map(across).collect();
    let mut pooled = Pool::default();
    let mut of_columns = vec![0f32; across.len() * bands];
    // Even and odd rows of a mosaic hold different bands.
    let turns = if image.mosaic.is_some() { 2 } else { 1 };
    for (first, turn) in rows
        .clone()
        .step_by(ROWS_AT_ONCE)
        .flat_map(|first| (0..turns).map(move |turn| (first + turn, turn)))
    {
        of_columns.fill(0.0);
        let mut all_down = 0f32;
        let last = rows.end.min(first - turn + ROWS_AT_ONCE);
        for y in (first..last).step_by(turns) {
            let weight = down(y);
            all_down += weight;
            let start = (y * light.width + columns.start) * bands;
            pooled.largest = pooled.largest.max(add_row(
                &light.pixels[start..start + of_columns.len()],
                weight,
                &mut of_columns,
            ));
        }
        for ((x, pixel), w) in columns.clone().zip(of_columns.chunks_exact(bands)).zip(&across) {
            for (b, value) in pixel.iter().enumerate() {
                let band = image.mosaic.map_or(b, |phase| phase.band(x, first));
                pooled.sum[band] += f64::from(w * value);
                pooled.weights[band] += f64::from(w * all_down);
            }
        }
    }
    pooled
}

/// Adds a row with a weight; returns its largest value.
fn add_row(row: &[f32], weight: f32, sums: &mut [f32]) -> f32 {
    const LANES: usize = 8;
    let ((blocks, rest), (sums, last)) = (row.as_chunks::<LANES>(), sums.as_chunks_mut::<LANES>());
    let mut largest = [0f32; LANES];
    for (block, sums) in blocks.iter().zip(sums) {
        for k in 0..LANES {
            sums[k] += weight * block[k];
            largest[k] = if block[k] > largest[k] { block[k] } else { largest[k] };
        }
    }
    rest.iter().zip(last).for_each(|(value, sum)| *sum += weight * value);
    largest.iter().chain(rest).copied().fold(0.0, f32::max)
}

/// Log of linear light under a Gaussian; NaN over the edge, where a pixel is clipped, or near
/// black.
fn pooled(
    image: &SensorImage,
    u: f64,
    v: f64,
    sigma_px: [f64; 2],
    config: &EstimateConfig,
) -> [f32; 3] {
    let span = |centre: f64, sigma_px: f64, size: usize| {
        let (centre, radius) = (centre.round() as isize, (PATCH_SIGMAS * sigma_px).ceil() as isize);
        (centre >= radius && centre + radius < size as isize)
            .then(|| (centre - radius) as usize..(centre + radius + 1) as usize)
    };
    let (columns, rows) =
        (span(u, sigma_px[0], image.light.width), span(v, sigma_px[1], image.light.height));
    let (Some(columns), Some(rows)) = (columns, rows) else { return [f32::NAN; 3] };
    let falloff = |centre: f64, sigma_px: f64| {
        move |c: usize| (-((c as f64 - centre) / sigma_px).powi(2) / 2.0).exp() as f32
    };
    log_color(
        &pool(image, columns, rows, falloff(u, sigma_px[0]), falloff(v, sigma_px[1])),
        image.bands(),
        config,
    )
}

fn log_color(pool: &Pool, bands: usize, config: &EstimateConfig) -> [f32; 3] {
    let usable = f64::from(pool.largest) < config.clipped_above;
    let mean = pool.mean();
    std::array::from_fn(|b| {
        if b < bands && usable && mean[b] >= config.dark_below {
            (mean[b] as f32).ln()
        } else {
            f32::NAN
        }
    })
}

/// A band of a partly clipped block is left out if its mean is above this share of the clipping
/// level.
const CLIPPED_MEAN: f64 = 0.93;
/// Least light of a dark block (share of full scale).
const LEAST_LIGHT: f64 = 1e-6;

/// Samples of a grid's blocks, and of those that are near black or partly clipped.
type Blocks = (Vec<(u32, Sample)>, Vec<(u32, Sample)>);

/// Samples of a grid's blocks, and the mean light of the whole image.
fn grid(
    image: &SensorImage,
    view: &View<'_>,
    reduction: usize,
    config: &EstimateConfig,
) -> (Blocks, [f64; 3]) {
    // The number of blocks, and so the memory, does not depend on the image size.
    let step = config.grid_step_px * reduction;
    let (width, height, bands) = (image.light.width, image.light.height, image.bands());
    let (columns, rows) = (width / step, height / step);
    let (mut samples, mut dark) = (Vec::with_capacity(columns * rows), Vec::new());
    let mut whole = Pool::default();
    for row in 0..height.div_ceil(step) {
        for column in 0..width.div_ceil(step) {
            let span = |c: usize, size: usize| c * step..((c + 1) * step).min(size);
            let block = pool(image, span(column, width), span(row, height), |_| 1.0, |_| 1.0);
            whole.add(&block);
            let mean = block.mean();
            let is_bright = |v: &f64| *v > CLIPPED_MEAN * config.clipped_above;
            let mut log_color = log_color(&block, bands, config);
            let is_dark = log_color[..bands].iter().any(|v| v.is_nan());
            if column == columns || row == rows || mean[..bands].iter().all(is_bright) {
                continue;
            }
            if is_dark {
                let log = |v: f64| v.max(LEAST_LIGHT).ln() as f32;
                log_color = mean.map(|v| if is_bright(&v) { f32::NAN } else { log(v) });
            }
            let centre = |c: usize| (c * step) as f64 + (step as f64 - 1.0) / 2.0;
            if let Some(SeafloorPoint { position: hit, seafloor_to_camera_m, normal }) =
                view.seafloor_point(centre(column), centre(row))
            {
                let of_kind = if is_dark { &mut dark } else { &mut samples };
                of_kind.push((
                    (row * columns + column) as u32,
                    Sample { hit, seafloor_to_camera_m, normal, log_color },
                ));
            }
        }
    }
    ((samples, dark), whole.mean())
}

#[cfg(test)]
mod tests;
