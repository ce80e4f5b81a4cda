//! How images of one dive agree on the same seafloor, measured with the truth: every frame's pose
//! and the seafloor are known, so a point is found in all frames that see it, without keypoints and
//! without the estimator.
#![allow(dead_code)]

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
use unwater::image::LinearImage;

use super::colour::{delta_e, lab};
use super::evenness::Evenness;
use super::judge::{blocks, median};
use super::render::{Dive, FrameTruth, Truth};

/// Spacing of the points on the seafloor (m).
const POINT_STEP_M: f64 = 0.06;
/// A point is a Gaussian patch of the seafloor, of one size in metres from every altitude: this
/// standard deviation (m) ...
const POINT_SIGMA_M: f64 = 0.012;
/// ... and out to here.
const POINT_REACH_M: f64 = 0.5 * POINT_STEP_M;
/// A point seen in fewer frames does not count.
const LEAST_VIEWS: usize = 4;
/// Where the renderer has the camera in the vehicle (m).
const CAMERA_IN_BASE: [f64; 3] = [0.34, -0.10, -0.12];
/// Raw light above this share of full scale is clipped: no method is judged there.
const CLIPPED: f32 = 0.985;

/// Where one point lies in one frame: pixels and their weights.
struct Sample {
    frame: usize,
    point: usize,
    weights: Vec<(usize, f32)>,
}

/// The seafloor of a dive, point by point.
pub struct Ground {
    samples: Vec<Sample>,
    points: usize,
    /// by frame and block: whether any pixel is clipped in the raw image
    clipped: Vec<Vec<bool>>,
}

/// How a series of images agrees on it.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct Shown {
    /// median over the points of the standard deviation of log light over the frames, per band
    pub scatter: Vec<f64>,
    /// the same over the spread of the points' means: contrast that was lost does not help
    pub scatter_over_spread: Vec<f64>,
    /// ΔE00 to the true reflectance after one gain per band for the whole log, of 4×4-pixel means:
    /// median
    pub delta_e_median: f64,
    /// 95th percentile
    pub delta_e_95: f64,
    #[serde(flatten)]
    pub evenness: Evenness,
}

impl Ground {
    /// Finds every point in every frame. The seafloor is a plane, the lens has no distortion.
    pub fn of(dive: &Dive, truth: &Truth, raw: &[LinearImage]) -> Self {
        let seen: Vec<Vec<[f64; 2]>> =
            truth.frames.iter().map(|frame| ground(dive, frame)).collect();
        let low =
            |axis: usize| seen.iter().flatten().map(|p| p[axis]).fold(f64::INFINITY, f64::min);
        let high =
            |axis: usize| seen.iter().flatten().map(|p| p[axis]).fold(f64::NEG_INFINITY, f64::max);
        let corner = [low(0), low(1)];
        let across = ((high(0) - corner[0]) / POINT_STEP_M) as usize + 2;
        let points = across * (((high(1) - corner[1]) / POINT_STEP_M) as usize + 2);
        let mut samples = Vec::new();
        for (frame, (places, raw)) in seen.iter().zip(raw).enumerate() {
            let mut of_point: Vec<Vec<(usize, f32)>> = vec![Vec::new(); points];
            let mut is_cut = vec![false; points];
            for (i, place) in places.iter().enumerate() {
                let cell: [f64; 2] =
                    std::array::from_fn(|k| ((place[k] - corner[k]) / POINT_STEP_M).round());
                let off = (0..2)
                    .map(|k| (place[k] - corner[k] - cell[k] * POINT_STEP_M).powi(2))
                    .sum::<f64>();
                if off > POINT_REACH_M.powi(2) {
                    continue;
                }
                let point = cell[1] as usize * across + cell[0] as usize;
                of_point[point].push((i, (-0.5 * off / POINT_SIGMA_M.powi(2)).exp() as f32));
                let (x, y) = (i % dive.width, i / dive.width);
                let at_edge = x < 2 || y < 2 || x + 3 > dive.width || y + 3 > dive.height;
                is_cut[point] |= at_edge || raw.at(x, y).iter().any(|v| *v >= CLIPPED);
            }
            for (point, mut weights) in of_point.into_iter().enumerate() {
                if !weights.is_empty() && !is_cut[point] {
                    let sum: f32 = weights.iter().map(|(_, w)| w).sum();
                    weights.iter_mut().for_each(|(_, w)| *w /= sum);
                    samples.push(Sample { frame, point, weights });
                }
            }
        }
        let is_clipped = |raw: &LinearImage| {
            let clipped = |x: usize, y: usize| {
                f64::from(u8::from(raw.at(x, y).iter().any(|v| *v >= CLIPPED)))
            };
            blocks(dive.width, dive.height, clipped).iter().map(|share| *share > 0.0).collect()
        };
        Self { samples, points, clipped: raw.iter().map(is_clipped).collect() }
    }

    /// How images agree.
    pub fn shown(&self, dive: &Dive, truth: &Truth, images: &[LinearImage]) -> Shown {
        let bands = images[0].bands;
        // Over ridges a point of the plane is no point of the seafloor.
        let flat = if dive.relief_m == 0.0 { 1.0 } else { f64::NAN };
        let per_band = (0..bands)
            .map(|b| self.spreads(|frame, pixel| images[frame].pixels[pixel * bands + b]));
        let per_band: Vec<(f64, f64)> =
            per_band.map(|(within, between)| (flat * within, between)).collect();
        let (delta_e_median, delta_e_95) =
            if bands == 3 { self.delta_e(dive, truth, images) } else { (f64::NAN, f64::NAN) };
        Shown {
            scatter: per_band.iter().map(|(within, _)| *within).collect(),
            scatter_over_spread: per_band
                .iter()
                .map(|(within, between)| within / between)
                .collect(),
            delta_e_median,
            delta_e_95,
            evenness: Evenness::of(dive, truth, images, &self.clipped),
        }
    }

    /// The same of the true reflectance: the least that can be measured this way.
    pub fn floor(&self, truth: &Truth) -> Vec<(f64, f64)> {
        (0..3)
            .map(|b| self.spreads(|frame, pixel| truth.frames[frame].reflectance[pixel][b]))
            .collect()
    }

    /// Spread of log light at a point over frames (median over points), and of points' means.
    fn spreads(&self, light: impl Fn(usize, usize) -> f32) -> (f64, f64) {
        let mut logs: Vec<Vec<f64>> = vec![Vec::new(); self.points];
        for sight in &self.samples {
            let mean: f32 =
                sight.weights.iter().map(|(pixel, w)| w * light(sight.frame, *pixel)).sum();
            if mean > 0.0 {
                logs[sight.point].push(f64::from(mean).ln());
            }
        }
        let seen = logs.iter().filter(|l| l.len() >= LEAST_VIEWS);
        let (mut within, means): (Vec<f64>, Vec<f64>) =
            seen.map(|l| (deviation(l), l.iter().sum::<f64>() / l.len() as f64)).unzip();
        if within.is_empty() {
            (f64::NAN, f64::NAN)
        } else {
            (median(&mut within), deviation(&means))
        }
    }

    fn delta_e(&self, dive: &Dive, truth: &Truth, images: &[LinearImage]) -> (f64, f64) {
        let (mut is, mut expected): (Vec<[f64; 3]>, Vec<[f64; 3]>) = (Vec::new(), Vec::new());
        for ((image, frame), clipped) in images.iter().zip(&truth.frames).zip(&self.clipped) {
            let of = |at: &dyn Fn(usize, usize, usize) -> f32| {
                let [r, g, b] = [0, 1, 2]
                    .map(|band| blocks(dive.width, dive.height, |x, y| f64::from(at(x, y, band))));
                r.into_iter().zip(g).zip(b).map(|((r, g), b)| [r, g, b]).collect::<Vec<_>>()
            };
            let shown = of(&|x, y, band| image.at(x, y)[band]);
            let real = of(&|x, y, band| frame.reflectance[y * dive.width + x][band]);
            let judged = shown.into_iter().zip(real).zip(clipped).filter(|(_, clipped)| !**clipped);
            judged.for_each(|((i, o), _)| {
                is.push(i);
                expected.push(o);
            });
        }
        let gain = [0, 1, 2].map(|b| {
            let mut ratios: Vec<f64> = is
                .iter()
                .zip(&expected)
                .filter(|(i, _)| i[b] > 0.0)
                .map(|(i, o)| o[b] / i[b])
                .collect();
            median(&mut ratios)
        });
        let scaled = |i: &[f64; 3]| [0, 1, 2].map(|b| i[b] * gain[b]);
        let mut errors: Vec<f64> =
            is.iter().zip(&expected).map(|(i, o)| delta_e(lab(scaled(i)), lab(*o))).collect();
        let high = errors.len() * 95 / 100;
        let high = *errors.select_nth_unstable_by(high, f64::total_cmp).1;
        (median(&mut errors), high)
    }
}

/// Seafloor point of each pixel of a frame.
fn ground(dive: &Dive, frame: &FrameTruth) -> Vec<[f64; 2]> {
    assert_eq!(dive.distortion, [0.0; 5], "points are found through a lens without distortion");
    let [x, y, z, w] = frame.orientation_xyzw;
    let world_from_base = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
    // The camera looks straight down, image up is forward: right = −y, down = −x, ahead = −z of the
    // vehicle.
    let base_from_optical = Matrix3::new(0.0, -1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, -1.0);
    let camera = Vector3::from(frame.position) + world_from_base * Vector3::from(CAMERA_IN_BASE);
    let turn = world_from_base.to_rotation_matrix().into_inner() * base_from_optical;
    let normal = Vector3::from(frame.plane_normal_in_optical);
    let (cx, cy) = (0.5 * (dive.width as f64 - 1.0), 0.5 * (dive.height as f64 - 1.0));
    let place = |i: usize| {
        let ray = Vector3::new(
            ((i % dive.width) as f64 - cx) / dive.focal_px,
            ((i / dive.width) as f64 - cy) / dive.focal_px,
            1.0,
        );
        let at = camera + turn * ray * (frame.plane_distance_m / normal.dot(&ray));
        [at.x, at.y]
    };
    (0..dive.width * dive.height).map(place).collect()
}

/// Standard deviation of a sample.
fn deviation(values: &[f64]) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (values.len() as f64 - 1.0)).sqrt()
}
