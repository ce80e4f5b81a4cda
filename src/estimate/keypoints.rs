//! Keypoints with sub-pixel position, scale and orientation, and a descriptor to match them (paper
//! §IV-B, reference 39).
//!
//! Differences of Gaussians (Lowe, IJCV 2004) of the logarithm of light, in which contrast does not
//! depend on the brightness of the beam. The image is reduced first, as light is averaged over
//! several pixels anyway. In: linear light. Out: positions in pixels of the full image. Sums have a
//! fixed order: results do not depend on threads.

use super::descriptor::Descriptor;
use crate::config::MatchingConfig;
use crate::image::SensorImage;

/// One keypoint.
#[derive(Clone, Debug)]
pub struct Keypoint {
    /// column in the full image (px)
    pub u: f64,
    /// row (px)
    pub v: f64,
    /// strength (log light)
    pub response: f32,
    /// for matching
    pub descriptor: Descriptor,
}

const SCALES: usize = 3;
const SIGMA: f32 = 1.6;
/// blur that the reduced image is assumed to have (px)
const INPUT_SIGMA: f32 = 0.6;
const EDGE_RATIO: f32 = 10.0;
const BORDER: usize = 6;
/// keypoints are spread over this many cells, to cover the whole beam
const CELLS: (usize, usize) = (8, 6);

/// One level of the scale-space pyramid.
pub(super) struct Plane {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) data: Vec<f32>,
}

impl Plane {
    fn at(&self, x: usize, y: usize) -> f32 {
        self.data[y * self.width + x]
    }
}

/// An extremum without descriptor.
struct Extremum {
    octave: usize,
    level: usize,
    /// column and row in its octave (px)
    u: f32,
    v: f32,
    sigma: f32,
    response: f32,
}

/// Finds at most `config.keypoints_per_frame` keypoints, strongest first, spread over the image.
pub fn keypoints(image: &SensorImage, config: &MatchingConfig) -> Vec<Keypoint> {
    let reduction = config.reduction(image.light.width, image.light.height);
    let base = log_light(image, reduction);
    let shift = if image.mosaic.is_some() { 0.5 } else { 0.0 };
    let mut rows = Vec::with_capacity(base.data.len());
    let mut next = blurred(&base, (SIGMA * SIGMA - INPUT_SIGMA * INPUT_SIGMA).sqrt(), &mut rows);
    let mut found = Vec::new();
    let mut octaves: Vec<Vec<Plane>> = Vec::new();
    while next.width.min(next.height) > 4 * BORDER {
        let ratio = 2f32.powf(1.0 / SCALES as f32);
        let mut levels = vec![next];
        for k in 1..SCALES + 3 {
            let sigma = SIGMA * ratio.powi(k as i32 - 1) * (ratio * ratio - 1.0).sqrt();
            levels.push(blurred(&levels[k - 1], sigma, &mut rows));
        }
        let differences: Vec<Plane> = levels
            .windows(2)
            .map(|w| Plane {
                width: w[0].width,
                height: w[0].height,
                data: w[1].data.iter().zip(&w[0].data).map(|(b, a)| b - a).collect(),
            })
            .collect();
        extrema(&differences, octaves.len(), config.contrast_threshold as f32, &mut found);
        next = halved(&levels[SCALES]);
        octaves.push(levels);
    }
    let keypoint = |e: Extremum| {
        // An octave has every second pixel (0 stays 0); a reduced pixel is the mean of a block (0
        // becomes its centre).
        let halvings = f64::from(1u32 << e.octave);
        let full = |c: f32| (f64::from(c) * halvings + 0.5) * reduction as f64 - 0.5 + shift;
        (full(e.u), full(e.v), e)
    };
    let kept = spread(found.into_iter().map(keypoint).collect(), image, config.keypoints_per_frame);
    // Descriptors are costly: only of those that are kept.
    let described = |(u, v, e): (f64, f64, Extremum)| {
        let level = &octaves[e.octave][e.level];
        let angle = level.orientation(e.u, e.v, e.sigma);
        Keypoint {
            u,
            v,
            response: e.response,
            descriptor: level.descriptor(e.u, e.v, e.sigma, angle),
        }
    };
    kept.into_iter().map(described).collect()
}

/// Mean of the bands, reduced by an integer factor, in logarithm.
fn log_light(image: &SensorImage, factor: usize) -> Plane {
    let light = &image.light;
    let (width, height) = (light.width / factor, light.height / factor);
    let mut data = vec![0f32; width * height];
    // Of a mosaic, every 2×2 window holds one red, two green, one blue: blocks reach one pixel
    // further there.
    let reach = factor + usize::from(image.mosaic.is_some());
    let scale = 1.0 / (reach * reach * light.bands) as f32;
    let mut sums = vec![0f32; light.width * light.bands];
    for (y, row) in data.chunks_exact_mut(width).enumerate() {
        sums.fill(0.0);
        for dy in 0..reach {
            let line =
                &light.pixels[(y * factor + dy).min(light.height - 1) * sums.len()..][..sums.len()];
            sums.iter_mut().zip(line).for_each(|(sum, v)| *sum += v);
        }
        for (x, out) in row.iter_mut().enumerate() {
            let first = x * factor * light.bands;
            let sum: f32 = sums[first..(first + reach * light.bands).min(sums.len())].iter().sum();
            *out = (sum * scale + 1e-3).ln();
        }
    }
    Plane { width, height, data }
}

/// Separable Gaussian, edges repeated. `rows` is working memory.
fn blurred(plane: &Plane, sigma: f32, rows: &mut Vec<f32>) -> Plane {
    let radius = (3.0 * sigma).ceil() as usize;
    let mut kernel: Vec<f32> =
        (0..=radius).map(|i| (-((i * i) as f32) / (2.0 * sigma * sigma)).exp()).collect();
    let sum = kernel[0] + 2.0 * kernel[1..].iter().sum::<f32>();
    kernel.iter_mut().for_each(|k| *k /= sum);
    let (w, h) = (plane.width, plane.height);
    rows.clear();
    let mut padded = vec![0f32; w + 2 * radius];
    for source in plane.data.chunks_exact(w) {
        padded[..radius].fill(source[0]);
        padded[radius..radius + w].copy_from_slice(source);
        padded[radius + w..].fill(source[w - 1]);
        weighted(
            source,
            &kernel,
            |i| (&padded[radius - i..][..w], &padded[radius + i..][..w]),
            rows,
        );
    }
    let mut data = Vec::with_capacity(w * h);
    for y in 0..h {
        let row = |y: usize| &rows[y * w..][..w];
        weighted(
            row(y),
            &kernel,
            |i| (row(y.saturating_sub(i)), row((y + i).min(h - 1))),
            &mut data,
        );
    }
    Plane { width: w, height: h, data }
}

/// Appends a line convolved with a symmetric kernel; `beside` returns the lines i steps to either
/// side of it.
fn weighted<'l>(
    line: &[f32],
    kernel: &[f32],
    beside: impl Fn(usize) -> (&'l [f32], &'l [f32]),
    to: &mut Vec<f32>,
) {
    let start = to.len();
    to.extend(line.iter().map(|s| s * kernel[0]));
    let out = &mut to[start..];
    for (i, k) in kernel.iter().enumerate().skip(1) {
        let (a, b) = beside(i);
        for ((o, a), b) in out.iter_mut().zip(a).zip(b) {
            *o += k * (a + b);
        }
    }
}

fn halved(plane: &Plane) -> Plane {
    let (width, height) = (plane.width / 2, plane.height / 2);
    let data = (0..height).flat_map(|y| (0..width).map(move |x| plane.at(2 * x, 2 * y))).collect();
    Plane { width, height, data }
}

fn extrema(differences: &[Plane], octave: usize, threshold: f32, found: &mut Vec<Extremum>) {
    let (w, h) = (differences[0].width, differences[0].height);
    let mut stands_out = vec![false; w];
    for s in 1..=SCALES {
        for y in BORDER..h - BORDER {
            beyond_neighbours(&differences[s], y, 0.5 * threshold, &mut stands_out);
            for x in BORDER..w - BORDER {
                if !stands_out[x]
                    || !is_extreme(
                        [&differences[s - 1], &differences[s + 1]],
                        x,
                        y,
                        differences[s].at(x, y),
                    )
                {
                    continue;
                }
                if let Some((u, v, response, scale)) = refined(differences, s, x, y)
                    && response >= threshold
                {
                    found.push(Extremum {
                        octave,
                        level: s,
                        u,
                        v,
                        sigma: SIGMA * 2f32.powf(scale / SCALES as f32),
                        response,
                    });
                }
            }
        }
    }
}

/// Which pixels of a row exceed the threshold and all eight neighbours; without branches, as hardly
/// any does.
fn beyond_neighbours(plane: &Plane, y: usize, threshold: f32, stands_out: &mut [bool]) {
    let w = plane.width;
    let row = |y: usize| &plane.data[y * w..][..w];
    let (above, here, below, inner) = (row(y - 1), row(y), row(y + 1), &mut stands_out[1..w - 1]);
    let (more, less) =
        (|a: f32, b: f32| if a > b { a } else { b }, |a: f32, b: f32| if a < b { a } else { b });
    for (x, out) in inner.iter_mut().enumerate() {
        let around = [
            above[x],
            above[x + 1],
            above[x + 2],
            here[x],
            here[x + 2],
            below[x],
            below[x + 1],
            below[x + 2],
        ];
        let (most, least) =
            (around.into_iter().fold(around[0], more), around.into_iter().fold(around[0], less));
        let value = here[x + 1];
        *out = ((value >= threshold) & (value > most)) | ((value <= -threshold) & (value < least));
    }
}

/// Whether it exceeds the nine pixels of both neighbours in scale, too.
fn is_extreme(scales: [&Plane; 2], x: usize, y: usize, value: f32) -> bool {
    let beats = |o: f32| if value > 0.0 { value > o } else { value < o };
    scales.iter().all(|plane| {
        (y - 1..=y + 1)
            .all(|j| plane.data[j * plane.width + x - 1..][..3].iter().copied().all(beats))
    })
}

/// Quadratic fit around an extremum: column, row, |value|, scale; `None` where it does not converge
/// or lies on an edge.
fn refined(d: &[Plane], s: usize, x: usize, y: usize) -> Option<(f32, f32, f32, f32)> {
    let (mut s, mut x, mut y) = (s, x, y);
    for _ in 0..4 {
        let at = |ds: isize, dy: isize, dx: isize| {
            d[(s as isize + ds) as usize].at((x as isize + dx) as usize, (y as isize + dy) as usize)
        };
        let c = at(0, 0, 0);
        let g = nalgebra::Vector3::new(
            at(0, 0, 1) - at(0, 0, -1),
            at(0, 1, 0) - at(0, -1, 0),
            at(1, 0, 0) - at(-1, 0, 0),
        ) * 0.5;
        let (xx, yy, ss) = (
            at(0, 0, 1) + at(0, 0, -1) - 2.0 * c,
            at(0, 1, 0) + at(0, -1, 0) - 2.0 * c,
            at(1, 0, 0) + at(-1, 0, 0) - 2.0 * c,
        );
        let xy = 0.25 * (at(0, 1, 1) - at(0, 1, -1) - at(0, -1, 1) + at(0, -1, -1));
        let xs = 0.25 * (at(1, 0, 1) - at(1, 0, -1) - at(-1, 0, 1) + at(-1, 0, -1));
        let ys = 0.25 * (at(1, 1, 0) - at(1, -1, 0) - at(-1, 1, 0) + at(-1, -1, 0));
        let step = -(nalgebra::Matrix3::new(xx, xy, xs, xy, yy, ys, xs, ys, ss).try_inverse()? * g);
        if step.amax() < 0.6 {
            let (trace, det) = (xx + yy, xx * yy - xy * xy);
            let edge = det <= 0.0 || trace * trace * EDGE_RATIO >= (EDGE_RATIO + 1.0).powi(2) * det;
            let response = (c + 0.5 * g.dot(&step)).abs();
            return (!edge).then_some((
                x as f32 + step.x,
                y as f32 + step.y,
                response,
                s as f32 + step.z,
            ));
        }
        let moved = |c: usize, d: f32, n: usize| {
            c.checked_add_signed(d.round() as isize).filter(|c| (BORDER..n - BORDER).contains(c))
        };
        (x, y) = (moved(x, step.x, d[0].width)?, moved(y, step.y, d[0].height)?);
        s = s.checked_add_signed(step.z.round() as isize).filter(|s| (1..=SCALES).contains(s))?;
    }
    None
}

/// The strongest extrema of each cell first, then the strongest of all, up to `max`.
fn spread(
    mut found: Vec<(f64, f64, Extremum)>,
    image: &SensorImage,
    max: usize,
) -> Vec<(f64, f64, Extremum)> {
    found.sort_by(|a, b| {
        b.2.response.total_cmp(&a.2.response).then(a.1.total_cmp(&b.1)).then(a.0.total_cmp(&b.0))
    });
    let quota = max.div_ceil(CELLS.0 * CELLS.1);
    let mut filled = vec![0usize; CELLS.0 * CELLS.1];
    let cell = |(u, v, _): &(f64, f64, Extremum)| {
        let index = |c: f64, n: usize, cells: usize| {
            ((c.max(0.0) / n as f64 * cells as f64) as usize).min(cells - 1)
        };
        index(*v, image.light.height, CELLS.1) * CELLS.0 + index(*u, image.light.width, CELLS.0)
    };
    let (mut kept, rest): (Vec<_>, Vec<_>) = found.into_iter().partition(|k| {
        let count = &mut filled[cell(k)];
        *count += 1;
        *count <= quota
    });
    let left = max.saturating_sub(kept.len());
    kept.extend(rest.into_iter().take(left));
    kept.truncate(max);
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::LinearImage;

    /// Blobs at known positions, seen by a camera that is rotated, shifted and dimmed.
    fn seen(turn: f64, shift: (f64, f64), gain: f32) -> SensorImage {
        let mut image = LinearImage::new(320, 240, 3);
        let (sin, cos) = turn.sin_cos();
        for y in 0..240 {
            for x in 0..320 {
                let (px, py) = (x as f64 - 160.0 - shift.0, y as f64 - 120.0 - shift.1);
                let (wx, wy) = (cos * px + sin * py, cos * py - sin * px);
                let mut light = 0.3;
                for k in 0..160i32 {
                    let place = |m: i32, n: f64| (f64::from((k * m) % 163) / 163.0 - 0.5) * n;
                    let (bx, by, r) = (place(37, 300.0), place(61, 220.0), 2.5 + f64::from(k % 5));
                    light *= 1.0
                        + 0.3
                            * (-((wx - bx).powi(2) + (wy - by).powi(2)) / (2.0 * r * r)).exp()
                            * if k % 2 == 0 { 1.0 } else { -1.0 };
                }
                image.pixels[(y * 320 + x) * 3..][..3].fill(gain * light as f32);
            }
        }
        SensorImage { light: image, mosaic: None }
    }

    #[test]
    fn the_same_points_are_found_turned_shifted_and_dimmed() {
        let config = MatchingConfig::default();
        let (turn, shift) = (0.3, (7.3, -4.6));
        let (a, b) = (
            keypoints(&seen(0.0, (0.0, 0.0), 1.0), &config),
            keypoints(&seen(turn, shift, 0.2), &config),
        );
        assert!(a.len() >= 30 && b.len() >= 30, "{} and {}", a.len(), b.len());
        let (sin, cos) = f64::sin_cos(turn);
        let mut errors = Vec::new();
        for k in &a {
            let (x, y) = (k.u - 160.0, k.v - 120.0);
            let (u, v) = (cos * x - sin * y + 160.0 + shift.0, sin * x + cos * y + 120.0 + shift.1);
            let distance = |d: &Keypoint| {
                k.descriptor
                    .iter()
                    .zip(&d.descriptor)
                    .map(|(a, b)| i32::from(a - b).pow(2))
                    .sum::<i32>()
            };
            let mut by_distance: Vec<(i32, &Keypoint)> =
                b.iter().map(|d| (distance(d), d)).collect();
            by_distance.sort_by_key(|(distance, _)| *distance);
            // Lowe's ratio, as matching applies it.
            if f64::from(by_distance[0].0) < 0.64 * f64::from(by_distance[1].0) {
                errors.push((by_distance[0].1.u - u).hypot(by_distance[0].1.v - v));
            }
        }
        let good = errors.iter().filter(|e| **e < 0.5).count();
        assert!(
            good >= 20 && good * 10 >= errors.len() * 7,
            "{good} of {} within half a pixel: {errors:.1?}",
            errors.len()
        );
    }
}
