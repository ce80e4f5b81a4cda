//! Attenuation from one point seen twice (paper §IV-B, Eq. 16, Fig. 8).
//!
//! ```text
//! α_Λ = (y_Λ,1 − y_Λ,2) / (ℓ_2 − ℓ_1)          y = log c freed of what is known: beam pattern, spreading, cos γ   Eq. 16
//! ```
//!
//! A pair says the more, the more its path lengths differ: the values of one image are averaged
//! with weights (ℓ_2 − ℓ_1)², which is least squares through the origin, and large misfits count
//! less. The log's answer is the weighted mean over images; the paper leaves out images below a
//! floor (a setting here). Before the beam pattern is known the answer is only a starting value:
//! path length and strobe angle are correlated (Fig. 8, top).

use super::SamplePath;

use crate::image::Bands;
use crate::solver::Track;
use crate::stats;

/// What one image says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImageAttenuation {
    /// index into the frames' samples
    pub frame: u32,
    /// α [1/m] per band
    pub attenuation_per_m: Bands,
    /// sum of squared differences of path length [m²]
    pub weight: f64,
}

/// The answer of all pairs.
#[derive(Clone, Debug, Default)]
pub struct PairsAnswer {
    /// α [1/m] per band
    pub attenuation_per_m: Bands,
    /// spread of the images' answers over √images [1/m]
    pub std_per_m: Bands,
    /// pairs used
    pub pairs: usize,
    /// robust spread of what is left over [log light]
    pub residual: f64,
    /// Fig. 8's points
    pub by_image: Vec<ImageAttenuation>,
}

/// Eq. 16 over all pairs within the tracks; `free` is log c without what is known.
pub fn attenuation(
    tracks: &[Track],
    bands: usize,
    floor_per_m: f64,
    paths: &SamplePath<'_>,
    free: &dyn Fn(&crate::geometry::LightPath) -> f64,
) -> Option<PairsAnswer> {
    // (frame, ℓ_2 − ℓ_1, y_1 − y_2 per band)
    let mut pairs: Vec<(u32, f64, [f64; 3])> = Vec::new();
    for track in tracks {
        let views: Vec<_> =
            track.iter().filter_map(|o| Some((o.frame, paths(o)?, o.sample.log_color))).collect();
        for (i, (frame, path_1, color_1)) in views.iter().enumerate() {
            for (_, path_2, color_2) in &views[i + 1..] {
                let known = free(path_1) - free(path_2);
                let y = std::array::from_fn(|b| {
                    if b < bands { f64::from(color_1[b] - color_2[b]) - known } else { 0.0 }
                });
                pairs.push((*frame, path_2.length_m() - path_1.length_m(), y));
            }
        }
    }
    if pairs.len() < 3 {
        return None;
    }
    // an image's pairs stand together, as Fig. 8 wants them
    pairs.sort_by_key(|(frame, ..)| *frame);
    let mut answer = PairsAnswer { pairs: pairs.len(), ..PairsAnswer::default() };
    let mut weights = vec![1.0; pairs.len()];
    for _ in 0..8 {
        for b in 0..bands {
            let (num, den) = pairs
                .iter()
                .zip(&weights)
                .fold((0.0, 0.0), |(n, d), ((_, dl, y), w)| (n + w * dl * y[b], d + w * dl * dl));
            if den < 1e-9 {
                return None;
            }
            answer.attenuation_per_m[b] = num / den;
        }
        let misfit = |(_, dl, y): &(u32, f64, [f64; 3])| {
            (0..bands).map(|b| (y[b] - answer.attenuation_per_m[b] * dl).abs()).sum::<f64>()
                / bands as f64
        };
        let misfits: Vec<f64> = pairs.iter().map(misfit).collect();
        answer.residual = stats::robust_std(&misfits);
        weights = misfits.iter().map(|e| stats::cauchy_weight(*e, answer.residual)).collect();
    }
    // Per image, and the mean over images that are not below the floor.
    let mut start = 0;
    while start < pairs.len() {
        let frame = pairs[start].0;
        let end = start + pairs[start..].iter().take_while(|p| p.0 == frame).count();
        let weight: f64 = (start..end).map(|i| weights[i] * pairs[i].1.powi(2)).sum();
        if weight > 1e-6 {
            let attenuation_per_m = std::array::from_fn(|b| {
                (start..end).map(|i| weights[i] * pairs[i].1 * pairs[i].2[b]).sum::<f64>() / weight
            }); // Eq. 16
            answer.by_image.push(ImageAttenuation { frame, attenuation_per_m, weight });
        }
        start = end;
    }
    for b in 0..bands {
        let kept: Vec<&ImageAttenuation> = answer
            .by_image
            .iter()
            .filter(|i| floor_per_m <= 0.0 || i.attenuation_per_m[b] >= floor_per_m)
            .collect();
        let total: f64 = kept.iter().map(|i| i.weight).sum();
        if total <= 0.0 {
            return None;
        }
        let mean = kept.iter().map(|i| i.weight * i.attenuation_per_m[b]).sum::<f64>() / total;
        let variance =
            kept.iter().map(|i| (i.weight * (i.attenuation_per_m[b] - mean)).powi(2)).sum::<f64>()
                / total.powi(2);
        answer.attenuation_per_m[b] = mean;
        answer.std_per_m[b] = variance.sqrt();
    }
    Some(answer)
}
