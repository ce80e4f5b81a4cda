//! Attenuation from one point seen twice (paper §IV-B, Eq. 16, Fig. 8).
//!
//! ```text
//! α_Λ = (y_Λ,1 − y_Λ,2) / (ℓ_2 − ℓ_1)   y = log c without beam pattern, spreading, cos γ   Eq. 16
//! ```
//!
//! A pair weighs more, the more its path lengths differ: the values of one image are averaged with
//! weights (ℓ_2 − ℓ_1)², which is least squares through the origin, with robust weights. The log's
//! answer is the weighted mean over images; the paper leaves out images below a floor (a setting
//! here). Before the beam pattern is known the answer is only a starting value: path length and
//! strobe angle are correlated (Fig. 8, top).

use super::{Candidate, Sweeps, enough_tracks, one_lamp};
use crate::config::EstimateConfig;
use crate::diagnostics::NoAnswer;
use crate::estimate::Dataset;
use crate::geometry::LightPath;
use crate::image::Bands;
use crate::model::{BeamGrid, ImageAnswer};
use crate::stats;

/// Reweightings.
const ROUNDS: usize = 8;
/// More images than this are not shown in a figure.
const MAX_IMAGES: usize = 300;

/// The estimate of one image.
#[derive(Clone, Copy, Debug, PartialEq)]
struct ImageAttenuation {
    /// index into the frames' samples
    frame: u32,
    /// α (1/m) per band
    attenuation_per_m: Bands,
    /// sum of squared differences of path length (m²)
    weight: f64,
}

/// The estimate of all pairs.
#[derive(Clone, Debug, Default)]
struct PairsAnswer {
    /// α (1/m) per band
    attenuation_per_m: Bands,
    /// spread of the images' estimates over √images (1/m)
    std_per_m: Bands,
    /// pairs used
    pairs: usize,
    /// robust spread of the residuals (log light)
    residual: f64,
    /// Fig. 8's points
    by_image: Vec<ImageAttenuation>,
}

/// Two observations of one point.
struct Pair {
    frame: u32,
    /// ℓ_2 − ℓ_1 (m)
    length_m: f64,
    /// y_1 − y_2 per band
    y: Bands,
}

/// Eq. 16 and 17 in sweeps.
///
/// # Errors
/// Several lamps, too few tracks, or path lengths that do not differ.
pub fn estimate(
    data: &Dataset<'_>,
    grid: BeamGrid,
    config: &EstimateConfig,
) -> Result<Candidate, NoAnswer> {
    one_lamp(data)?;
    enough_tracks(data, config)?;
    let sweeps = Sweeps {
        data,
        grid,
        config,
        estimate: &|known| {
            attenuation(data, config.attenuation_floor_per_m, known)
                .ok_or(NoAnswer::EqualPathLengths)
        },
        attenuation_per_m: |answer| answer.attenuation_per_m,
    };
    let (first, answer, beam_pattern) = sweeps.run()?;
    let names = [
        "before_beam_pattern_red_per_m",
        "before_beam_pattern_green_per_m",
        "before_beam_pattern_blue_per_m",
    ];
    let mut details = vec![("images", answer.by_image.len() as f64)];
    details.extend(names.into_iter().zip(first.attenuation_per_m).take(data.bands()));
    let model = data.model_by(answer.attenuation_per_m, beam_pattern, config);
    let fit = (answer.pairs, answer.residual);
    let mut candidate = Candidate::new(model, answer.std_per_m, fit, &details);
    candidate.answer.by_image = by_image(data, &first, &answer);
    Ok(candidate)
}

/// The images' estimates before and after the beam pattern is known, thinned out evenly where there
/// are many.
fn by_image(data: &Dataset<'_>, first: &PairsAnswer, last: &PairsAnswer) -> Vec<ImageAnswer> {
    let bands = data.bands();
    let micro = |v: f64| (v * 1e6).round() / 1e6;
    let rounded = |alpha: &Bands| alpha[..bands].iter().map(|a| micro(*a)).collect();
    let both = last.by_image.iter().filter_map(|image| {
        let before = first.by_image.iter().find(|i| i.frame == image.frame)?;
        Some(ImageAnswer {
            stamp_ns: data.frames.get(image.frame as usize)?.stamp.0,
            before_beam_pattern_per_m: rounded(&before.attenuation_per_m),
            attenuation_per_m: rounded(&image.attenuation_per_m),
            weight_m2: micro(image.weight),
        })
    });
    let all: Vec<ImageAnswer> = both.collect();
    let step = all.len().div_ceil(MAX_IMAGES).max(1);
    all.into_iter().step_by(step).collect()
}

/// Eq. 16 over all pairs within the tracks; `known` is log radiance without attenuation.
fn attenuation(
    data: &Dataset<'_>,
    floor_per_m: f64,
    known: &dyn Fn(&LightPath) -> f64,
) -> Option<PairsAnswer> {
    let bands = data.bands();
    let pairs = pairs(data, known);
    if pairs.len() < 3 {
        return None;
    }
    let mut answer = PairsAnswer { pairs: pairs.len(), ..PairsAnswer::default() };
    let mut weights = vec![1.0; pairs.len()];
    for _ in 0..ROUNDS {
        for b in 0..bands {
            let weighted = pairs.iter().zip(&weights);
            let (num, den) = weighted.fold((0.0, 0.0), |(n, d), (p, w)| {
                (n + w * p.length_m * p.y[b], d + w * p.length_m * p.length_m)
            });
            if den < 1e-9 {
                return None;
            }
            answer.attenuation_per_m[b] = num / den;
        }
        let residual = |p: &Pair| {
            let of_band = |b: usize| (p.y[b] - answer.attenuation_per_m[b] * p.length_m).abs();
            (0..bands).map(of_band).sum::<f64>() / bands as f64
        };
        let residuals: Vec<f64> = pairs.iter().map(residual).collect();
        answer.residual = stats::robust_std(&residuals);
        weights = residuals.iter().map(|e| stats::cauchy_weight(*e, answer.residual)).collect();
    }
    answer.by_image = images(&pairs, &weights);
    for b in 0..bands {
        let kept = answer
            .by_image
            .iter()
            .filter(|i| floor_per_m <= 0.0 || i.attenuation_per_m[b] >= floor_per_m);
        let (mean, std) = weighted_mean(kept.map(|i| (i.attenuation_per_m[b], i.weight)))?;
        (answer.attenuation_per_m[b], answer.std_per_m[b]) = (mean, std);
    }
    Some(answer)
}

/// All pairs within the tracks, those of one image together.
fn pairs(data: &Dataset<'_>, known: &dyn Fn(&LightPath) -> f64) -> Vec<Pair> {
    let bands = data.bands();
    let mut pairs = Vec::new();
    for track in data.tracks {
        let views: Vec<_> = track
            .iter()
            .filter_map(|o| Some((o.frame, data.path(o)?, o.sample.log_color)))
            .collect();
        for (i, (frame, path_1, color_1)) in views.iter().enumerate() {
            for (_, path_2, color_2) in &views[i + 1..] {
                let known = known(path_1) - known(path_2);
                let y = std::array::from_fn(|b| {
                    if b < bands { f64::from(color_1[b] - color_2[b]) - known } else { 0.0 }
                });
                let length_m = path_2.length_m() - path_1.length_m();
                pairs.push(Pair { frame: *frame, length_m, y });
            }
        }
    }
    pairs.sort_by_key(|p| p.frame);
    pairs
}

/// Eq. 16 image by image.
fn images(pairs: &[Pair], weights: &[f64]) -> Vec<ImageAttenuation> {
    let mut images = Vec::new();
    let mut start = 0;
    for of_image in pairs.chunk_by(|a, b| a.frame == b.frame) {
        let weights = &weights[start..start + of_image.len()];
        start += of_image.len();
        let weighted = || of_image.iter().zip(weights);
        let weight: f64 = weighted().map(|(p, w)| w * p.length_m.powi(2)).sum();
        if weight > 1e-6 {
            let attenuation_per_m = std::array::from_fn(|b| {
                weighted().map(|(p, w)| w * p.length_m * p.y[b]).sum::<f64>() / weight
            }); // Eq. 16
            images.push(ImageAttenuation { frame: of_image[0].frame, attenuation_per_m, weight });
        }
    }
    images
}

/// Mean of (value, weight), and its standard deviation from their spread.
fn weighted_mean(values: impl Iterator<Item = (f64, f64)> + Clone) -> Option<(f64, f64)> {
    let total: f64 = values.clone().map(|(_, w)| w).sum();
    if total <= 0.0 {
        return None;
    }
    let mean = values.clone().map(|(v, w)| w * v).sum::<f64>() / total;
    let variance = values.map(|(v, w)| (w * (v - mean)).powi(2)).sum::<f64>() / total.powi(2);
    Some((mean, variance.sqrt()))
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::coordinates::{Direction, Point, Transform};
    use crate::estimate::samples::FrameSamples;
    use crate::solver::{Observation, Sample, Track};
    use crate::vehicle::Lamps;

    const ALPHA: Bands = [0.45, 0.14, 0.1];

    fn lamps() -> Lamps {
        Lamps::one(Transform::from_parts([-0.8, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]))
    }

    /// What is known beside attenuation: spreading of the strobe's light.
    fn known(path: &LightPath) -> f64 {
        -2.0 * path.strobe_to_seafloor_m.ln()
    }

    /// A point seen from two altitudes in consecutive frames; `error` is added to the first view.
    fn track(i: u32, altitudes_m: [f64; 2], error: f64) -> Track {
        let view = |k: usize| {
            let hit = Point::from_vector(Vector3::new(0.1 * f64::from(i % 5), 0.0, altitudes_m[k]));
            let mut sample = Sample {
                hit,
                seafloor_to_camera_m: hit.vector().norm(),
                normal: Direction::from_vector(Vector3::z()).expect("a direction"),
                log_color: [0.0; 3],
            };
            let path = sample.path(lamps()).expect("a path");
            let log_radiance = |b: usize| known(&path) - ALPHA[b] * path.length_m() - 1.0;
            let error = if k == 0 { error } else { 0.0 };
            sample.log_color = std::array::from_fn(|b| (log_radiance(b) + error) as f32);
            Observation { frame: i / 5 + k as u32, sample }
        };
        vec![view(0), view(1)]
    }

    fn solved(tracks: &[Track], min_per_m: f64) -> Option<PairsAnswer> {
        let frames = [FrameSamples::of_level_seafloor(0, 2.0)];
        let data = Dataset::plain(&frames, tracks, Transform::identity(), lamps());
        attenuation(&data, min_per_m, &known)
    }

    fn tracks(error: impl Fn(u32) -> f64) -> Vec<Track> {
        let altitudes = |i: u32| [1.5 + 0.02 * f64::from(i % 13), 2.4];
        (0..60).map(|i| track(i, altitudes(i), error(i))).collect()
    }

    #[test]
    fn exact_pairs_give_the_exact_attenuation() {
        let answer = solved(&tracks(|_| 0.0), 0.0).expect("an answer");
        assert_eq!((answer.pairs, answer.by_image.len()), (60, 12));
        for (b, alpha) in ALPHA.iter().enumerate() {
            assert!((answer.attenuation_per_m[b] - alpha).abs() < 1e-6, "{answer:?}");
            assert!(answer.std_per_m[b] < 1e-6);
        }
    }

    #[test]
    fn false_matches_are_given_little_weight() {
        // One match in ten is wrong by a factor of e.
        let noise = |i: u32| 0.01 * f64::from(i * 7 % 5) - 0.02;
        let error = |i: u32| if i % 10 == 3 { 1.0 } else { noise(i) };
        let answer = solved(&tracks(error), 0.0).expect("an answer");
        for (b, alpha) in ALPHA.iter().enumerate() {
            assert!((answer.attenuation_per_m[b] - alpha).abs() < 0.01, "{answer:?}");
        }
        assert!(answer.residual < 0.05, "{}", answer.residual);
    }

    #[test]
    fn images_below_the_minimum_are_left_out() {
        // In every third image the second view is brighter than it should be.
        let noise = |i: u32| 0.05 * f64::from(i * 7 % 5) - 0.1;
        let error = |i: u32| noise(i) - if (i / 5).is_multiple_of(3) { 0.15 } else { 0.0 };
        let blue = |min_per_m| solved(&tracks(error), min_per_m).map(|a| a.attenuation_per_m[2]);
        let (all, some) = (blue(0.0).expect("an answer"), blue(0.05).expect("an answer"));
        assert!(all < some - 0.01 && (some - ALPHA[2]).abs() < 0.02, "{all} {some}");
        assert_eq!(blue(0.2), None);
    }

    #[test]
    fn too_few_pairs_and_equal_path_lengths_give_no_answer() {
        assert!(solved(&tracks(|_| 0.0)[..2], 0.0).is_none());
        let level: Vec<Track> = (0..60).map(|i| track(i, [2.0, 2.0], 0.0)).collect();
        assert!(solved(&level, 0.0).is_none());
    }
}
