//! Keypoints of two overlapping frames → pairs that one homography explains (paper §IV-B, Fig. 7).
//!
//! Nearest descriptors by Lowe's ratio, then RANSAC on undistorted image-plane coordinates (a plane
//! seen from two places is related by a homography). Seeded by the frames' numbers: the same pairs
//! every time.

use nalgebra::{SMatrix, SVector};

use super::descriptor::Descriptor;
use super::keypoints::Keypoint;
use crate::config::MatchingConfig;
use crate::image::vectorised;

type Homography = [f64; 9];

/// What matching needs of one frame.
pub struct Matchable<'f> {
    /// its keypoints
    pub keypoints: &'f [Keypoint],
    /// their image-plane coordinates x/z, y/z
    pub places: &'f [(f64, f64)],
}

/// Keypoints of two frames that are the same points of seafloor.
#[derive(Clone, Debug, PartialEq)]
pub struct MatchedPair {
    /// index of one frame's samples
    pub a: usize,
    /// of the other's
    pub b: usize,
    /// indices of keypoints in both
    pub keypoints: Vec<(u32, u32)>,
}

/// Indices of keypoints that are the same point of seafloor; `inlier` is in image-plane units.
pub fn matches(
    a: &Matchable<'_>,
    b: &Matchable<'_>,
    config: &MatchingConfig,
    inlier: f64,
    seed: u64,
) -> Vec<(u32, u32)> {
    let candidates = nearest(a.keypoints, b.keypoints, config.ratio);
    if candidates.len() < config.least_inliers {
        return Vec::new();
    }
    let places: Vec<[f64; 4]> = candidates
        .iter()
        .map(|(i, j)| [a.places[*i as usize], b.places[*j as usize]])
        .map(|[p, q]| [p.0, p.1, q.0, q.1])
        .collect();
    let mut inliers = ransac(&places, inlier, seed);
    for _ in 0..2 {
        if inliers.len() < config.least_inliers {
            return Vec::new();
        }
        let kept: Vec<[f64; 4]> = inliers.iter().map(|i| places[*i]).collect();
        let Some(h) = homography(&kept) else { return Vec::new() };
        inliers = (0..places.len()).filter(|i| misfit(&h, &places[*i]) < inlier).collect();
    }
    inliers.into_iter().map(|i| candidates[i]).collect()
}

/// Nearest descriptors by ratio; each keypoint of `b` at most once, to its best suitor.
fn nearest(a: &[Keypoint], b: &[Keypoint], ratio: f64) -> Vec<(u32, u32)> {
    let norms: Vec<i32> = b.iter().map(|k| dot(&k.descriptor, &k.descriptor)).collect();
    let mut products = vec![0; b.len()];
    let mut suitor: Vec<Option<(i32, u32)>> = vec![None; b.len()];
    for (i, k) in a.iter().enumerate() {
        let norm = dot(&k.descriptor, &k.descriptor);
        let (mut best, mut second, mut at) = (i32::MAX, i32::MAX, 0);
        vectorised(
            #[inline(always)]
            || {
                let others = products.iter_mut().zip(b);
                others
                    .for_each(|(product, other)| *product = dot(&k.descriptor, &other.descriptor));
            },
        );
        for (j, product) in products.iter().enumerate() {
            let distance = norm + norms[j] - 2 * product;
            if distance < best {
                (second, best, at) = (best, distance, j);
            } else if distance < second {
                second = distance;
            }
        }
        if f64::from(best) < ratio * ratio * f64::from(second)
            && suitor[at].is_none_or(|(d, _)| best < d)
        {
            suitor[at] = Some((best, i as u32));
        }
    }
    let mut pairs: Vec<(u32, u32)> =
        suitor.iter().enumerate().filter_map(|(j, s)| Some((s.as_ref()?.1, j as u32))).collect();
    pairs.sort_unstable();
    pairs
}

/// Sixteen products at a time: so written, two of them and their sum are one instruction.
#[inline(always)]
fn dot(p: &Descriptor, q: &Descriptor) -> i32 {
    let mut sums = [0; 16];
    for (p, q) in p.as_chunks::<16>().0.iter().zip(q.as_chunks::<16>().0) {
        let products: [i32; 16] = std::array::from_fn(|k| i32::from(p[k]) * i32::from(q[k]));
        sums.iter_mut().zip(products).for_each(|(sum, product)| *sum += product);
    }
    sums.iter().sum()
}

/// Distance between the second place and the first one carried over.
fn misfit(h: &Homography, p: &[f64; 4]) -> f64 {
    let w = h[6] * p[0] + h[7] * p[1] + h[8];
    let (x, y) = ((h[0] * p[0] + h[1] * p[1] + h[2]) / w, (h[3] * p[0] + h[4] * p[1] + h[5]) / w);
    if w.abs() < 1e-9 { f64::INFINITY } else { (x - p[2]).hypot(y - p[3]) }
}

/// Least squares with h₉ = 1; image-plane coordinates are near 1, so the equations are well scaled.
fn homography(places: &[[f64; 4]]) -> Option<Homography> {
    let mut normal = SMatrix::<f64, 8, 8>::zeros();
    let mut right = SVector::<f64, 8>::zeros();
    for [x, y, u, v] in places {
        for (row, value) in [
            ([*x, *y, 1.0, 0.0, 0.0, 0.0, -u * x, -u * y], *u),
            ([0.0, 0.0, 0.0, *x, *y, 1.0, -v * x, -v * y], *v),
        ] {
            let row = SVector::<f64, 8>::from(row);
            normal += row * row.transpose();
            right += row * value;
        }
    }
    let h = if places.len() == 4 {
        normal.lu().solve(&right)?
    } else {
        normal.cholesky()?.solve(&right)
    };
    h.iter().all(|v| v.is_finite()).then(|| [h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], 1.0])
}

fn ransac(places: &[[f64; 4]], inlier: f64, seed: u64) -> Vec<usize> {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let mut draw = |n: usize| {
        // xorshift64*: any generator does; this one is four lines and never changes
        state ^= state >> 12;
        state ^= state << 25;
        state ^= state >> 27;
        ((state.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33) as usize) % n
    };
    let mut best: Vec<usize> = Vec::new();
    let (mut round, mut rounds) = (0, 2000usize);
    while round < rounds {
        round += 1;
        let four: [usize; 4] = std::array::from_fn(|_| draw(places.len()));
        if (0..4).any(|k| four[..k].contains(&four[k])) {
            continue;
        }
        let Some(h) = homography(&four.map(|i| places[i])) else { continue };
        let inliers: Vec<usize> =
            (0..places.len()).filter(|i| misfit(&h, &places[*i]) < inlier).collect();
        if inliers.len() > best.len() {
            let share = (inliers.len() as f64 / places.len() as f64).clamp(0.01, 0.999);
            rounds =
                rounds.min(((0.0005f64).ln() / (1.0 - share.powi(4)).ln()).ceil() as usize + 20);
            best = inliers;
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_homography_is_found_among_strays() {
        let truth: Homography = [1.02, 0.05, 0.1, -0.04, 0.98, -0.05, 0.02, -0.01, 1.0];
        let mut places = Vec::new();
        for i in 0..60 {
            let (x, y) = (f64::from(i * 37 % 61) / 61.0 - 0.5, f64::from(i * 23 % 59) / 59.0 - 0.5);
            let w = truth[6] * x + truth[7] * y + 1.0;
            let (u, v) = (
                (truth[0] * x + truth[1] * y + truth[2]) / w,
                (truth[3] * x + truth[4] * y + truth[5]) / w,
            );
            places.push(if i % 3 == 0 { [x, y, -u, v + 0.3] } else { [x, y, u, v] });
        }
        assert_eq!(ransac(&places, 0.003, 7).len(), 40);
    }
}
