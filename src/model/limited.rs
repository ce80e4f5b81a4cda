//! Light near its noise: weights of bands by their signal, and colours limited by them
//! (equations: `correct/signal.rs`).

use crate::image::vectorised;

/// Standard deviation of the backscatter of an empirical model, as a share of it.
pub const EMPIRICAL_BACKSCATTER_ERROR: f64 = 0.1;
/// Least light without backscatter, as a share of the light times its direct share.
const FLOOR: f32 = 0.3;
/// Width of the transition to it, as a share of the backscatter.
const SOFTNESS: f32 = 0.05;
/// Weights above this count as 1.
const FULL_WEIGHT: f64 = 0.995;

/// No sum of weights is so small, unless all are 0.
const TINY: f32 = 1e-12;

/// w of a band.
pub fn weight(signal: f64, noise: f64, least_ratio: f64) -> f64 {
    let (signal, noise) = (signal * signal, (least_ratio * noise).powi(2));
    (signal / (signal + noise) / FULL_WEIGHT).min(1.0)
}

/// Corrected light without backscatter: of corrected light, of its backscatter and of the level of
/// a median seafloor, all multiplied by the same gain.
///
/// The floor is soft, and a share of what the light would be if backscatter were dimmed as much as
/// the seafloor: where a lamp failed there is less light than backscatter should give, and the
/// pixel is neither black nor tinted.
#[inline(always)]
pub fn without_backscatter(light: f32, scattered: f32, level: f32) -> f32 {
    let positive = if light > 0.0 { light } else { 0.0 };
    let floor = FLOOR * positive * level / (level + scattered);
    let (above, width) = (light - scattered - floor, SOFTNESS * scattered);
    let direct = floor + 0.5 * (above + (above * above + width * width).sqrt());
    if scattered <= 0.0 { light } else { direct }
}

/// y' of one pixel. `levels`: M per band.
pub fn shrink(pixel: &mut [f32], weights: &[f32], levels: &[f32; 3]) {
    let most = weights.iter().copied().fold(0f32, f32::max);
    let (mut sum, mut total) = (0.0, 0.0);
    for (b, (v, w)) in pixel.iter().zip(weights).enumerate() {
        sum += w * v / levels[b];
        total += w;
    }
    let luminance = if total > 0.0 { sum / total } else { 0.0 };
    for (b, (v, w)) in pixel.iter_mut().zip(weights).enumerate() {
        *v = w * *v + levels[b] * ((most - w) * luminance + 1.0 - most);
    }
}

/// Two rows of weights, and how far a row lies from the first to the second.
pub type WeightRows<'w> = (&'w [f32], &'w [f32], f32);

#[inline(always)]
fn thirds(row: &[f32]) -> [&[f32]; 3] {
    let width = row.len() / 3;
    [0, 1, 2].map(|b| &row[b * width..][..width])
}

/// y' of a row of three bands, one after another, by weights between those of two rows. Pixels
/// whose first weight is negative, off the seafloor, stay as they are.
pub fn shrink_row(row: &mut [f32], weights: WeightRows<'_>, levels: &[f32; 3]) {
    vectorised(
        #[inline(always)]
        || shrink_bands(row, weights, levels),
    );
}

#[inline(always)]
fn shrink_bands(row: &mut [f32], (above, below, share): WeightRows<'_>, levels: &[f32; 3]) {
    let width = row.len() / 3;
    let per_level = levels.map(|level| 1.0 / level);
    let (red, rest) = row.split_at_mut(width);
    let (green, blue) = rest.split_at_mut(width);
    let ([a0, a1, a2], [b0, b1, b2]) = (thirds(above), thirds(below));
    let above = a0.iter().zip(a1).zip(a2);
    let below = b0.iter().zip(b1).zip(b2);
    // Without branches and indices, so that the loop vectorises.
    for ((((red, green), blue), above), below) in
        red.iter_mut().zip(green).zip(blue).zip(above).zip(below)
    {
        let (((a0, a1), a2), ((b0, b1), b2)) = (above, below);
        let w = [a0 + (b0 - a0) * share, a1 + (b1 - a1) * share, a2 + (b2 - a2) * share];
        let v = [*red, *green, *blue];
        let most = if w[0] > w[1] { w[0] } else { w[1] };
        let most = if most > w[2] { most } else { w[2] };
        let total = w[0] + w[1] + w[2];
        let sum =
            w[0] * v[0] * per_level[0] + w[1] * v[1] * per_level[1] + w[2] * v[2] * per_level[2];
        let luminance = sum / if total > TINY { total } else { TINY };
        let shrunk = |b: usize| {
            let value = w[b] * v[b] + levels[b] * ((most - w[b]) * luminance + 1.0 - most);
            if w[0] >= 0.0 { value } else { v[b] }
        };
        (*red, *green, *blue) = (shrunk(0), shrunk(1), shrunk(2));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_is_shrunk_as_its_pixels_are() {
        let (width, levels) = (37, [0.2, 0.3, 0.25]);
        let value = |i: usize, k: usize| ((i * k) % 101) as f32 / 100.0;
        let mut row: Vec<f32> = (0..3 * width).map(|i| value(i, 37)).collect();
        let mut above: Vec<f32> = (0..3 * width).map(|i| value(i, 61)).collect();
        let mut below: Vec<f32> = (0..3 * width).map(|i| value(i, 17)).collect();
        for b in 0..3 {
            (above[b * width + 5], below[b * width + 5]) = (-1.0, -1.0);
            (above[b * width + 6], below[b * width + 6]) = (0.0, 0.0);
            (above[b * width + 7], below[b * width + 7]) = (1.0, 1.0);
        }
        let before = row.clone();
        shrink_row(&mut row, (&above, &below, 0.25), &levels);
        for x in 0..width {
            let of = |row: &[f32]| [0, 1, 2].map(|b| row[b * width + x]);
            let (mut expected, above, below) = (of(&before), of(&above), of(&below));
            let weights: [f32; 3] =
                std::array::from_fn(|b| above[b] + (below[b] - above[b]) * 0.25);
            if weights[0] >= 0.0 {
                shrink(&mut expected, &weights, &levels);
            }
            let near = of(&row).iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-5);
            assert!(near, "{x}: {:?} {expected:?}", of(&row));
        }
        assert_eq!([row[5], row[width + 7]], [before[5], before[width + 7]]);
    }

    #[test]
    fn backscatter_is_subtracted_down_to_a_floor() {
        // Far above the floor it is a subtraction.
        assert!((without_backscatter(0.5, 0.1, 0.4) - 0.4).abs() < 1e-4);
        // Less light than backscatter: a lamp failed, and all bands keep their proportion.
        let dim = |level: f32, scattered: f32| {
            without_backscatter(0.2 * (level + scattered), scattered, level) / level
        };
        let (far, near) = (dim(0.01, 0.1), dim(0.1, 0.1));
        assert!((far / near - 1.0).abs() < 0.25 && far > 0.05, "{far} {near}");
        // Noise about the backscatter is neither cut nor amplified.
        let (low, high) =
            (without_backscatter(0.09, 0.1, 0.4), without_backscatter(0.11, 0.1, 0.4));
        assert!(low > 0.0 && high > low, "{low} {high}");
    }
}
