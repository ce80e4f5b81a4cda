//! Light near its noise: weights of bands by their signal, and colours limited by them
//! (equations: `correct/signal.rs`).

/// Standard deviation of the backscatter of an empirical model, as a share of it.
pub const EMPIRICAL_BACKSCATTER_ERROR: f64 = 0.1;
/// Least light without backscatter, as a share of the light times its direct share.
const FLOOR: f32 = 0.3;
/// Width of the transition to it, as a share of the backscatter.
const SOFTNESS: f32 = 0.05;
/// Weights above this count as 1.
const FULL_WEIGHT: f64 = 0.995;

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
pub fn without_backscatter(light: f32, scattered: f32, level: f32) -> f32 {
    if scattered <= 0.0 {
        return light;
    }
    let floor = FLOOR * light.max(0.0) * level / (level + scattered);
    let (above, width) = (light - scattered - floor, SOFTNESS * scattered);
    floor + 0.5 * (above + (above * above + width * width).sqrt())
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

#[cfg(test)]
mod tests {
    use super::*;

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
