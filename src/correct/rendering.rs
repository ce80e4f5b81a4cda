//! Exposure and white balance of a log, from the corrected light of its samples.
//!
//! Estimated per method, since each removes different terms, but never per image: brighter pixels
//! in the output are brighter on the seafloor.

use crate::config::{Look, RenderConfig, WhiteBalance};
use crate::geometry::LightPath;
use crate::image::Bands;
use crate::image::tone::{ContrastCurve, Tone};
use crate::model::{ImagingModel, Removal, RenderingFile};
use crate::stats::{median, quantile};

/// Samples whose correction exceeds the median by more than this factor are ignored: with an
/// oblique camera distant water would otherwise determine the exposure.
const MAX_CORRECTION_RATIO: f64 = 3.0;

/// Estimates exposure and white balance from samples (log light per band, light path).
pub fn estimate_rendering(
    samples: &[([f32; 3], LightPath)],
    model: &ImagingModel,
    white_level: Option<u16>,
    config: &RenderConfig,
) -> RenderingFile {
    let removed = |(color, path): &([f32; 3], LightPath)| {
        (*color, model.log_radiance(path, Removal::of(config.method)))
    };
    let samples: Vec<_> = samples.iter().map(removed).collect();
    rendering_of(&samples, model.bands, white_level, config)
}

/// The same from samples of log light without backscatter, and log light of a white seafloor.
pub fn rendering_of(
    samples: &[([f32; 3], Bands)],
    bands: usize,
    white_level: Option<u16>,
    config: &RenderConfig,
) -> RenderingFile {
    let removed: Vec<Bands> = samples.iter().map(|(_, removed)| *removed).collect();
    let medians: Vec<f64> =
        (0..bands).map(|b| median(&removed.iter().map(|r| -r[b]).collect::<Vec<_>>())).collect();
    let is_near = |r: &Bands| (0..bands).all(|b| -r[b] <= medians[b] + MAX_CORRECTION_RATIO.ln());
    let corrected: Vec<Bands> = samples
        .iter()
        .zip(&removed)
        .filter(|(_, r)| is_near(r))
        .map(|((color, _), r)| {
            std::array::from_fn(|b| if b < bands { f64::from(color[b]) - r[b] } else { f64::NAN })
        })
        .collect();
    let balance: Vec<f64> = match config.white_balance {
        WhiteBalance::None => vec![1.0; bands],
        WhiteBalance::Factors(factors) => factors[..bands].to_vec(),
        WhiteBalance::GreyWorld => {
            let medians: Vec<f64> = (0..bands)
                .map(|b| median(&corrected.iter().map(|c| c[b]).collect::<Vec<_>>()))
                .collect();
            let mean = medians.iter().sum::<f64>() / bands as f64;
            medians.iter().map(|m| (mean - m).exp()).collect()
        }
    };
    let brightest = corrected
        .iter()
        .map(|c| (0..bands).map(|b| c[b] + balance[b].ln()).fold(f64::NEG_INFINITY, f64::max));
    let brightest: Vec<f64> = brightest.collect();
    let highlight = quantile(&brightest, config.highlight_quantile);
    let middle = median(&brightest);
    let exposure = if highlight.is_finite() {
        (config.highlight_level / highlight.exp()).min(config.median_level / middle.exp())
    } else {
        1.0
    };
    let median_correction = medians.iter().map(|m| finite_or_one(m.exp())).collect();
    let gain = match config.method {
        method if method.is_baseline() => vec![1.0; bands],
        _ => balance.iter().map(|w| finite_or_one(w * exposure)).collect(),
    };
    let reflectance = |b: usize| median(&corrected.iter().map(|c| c[b]).collect::<Vec<_>>());
    RenderingFile {
        method: config.method,
        gain,
        median_correction,
        median_reflectance: (0..bands).map(|b| finite_or_one(reflectance(b).exp())).collect(),
        shoulder_from: Some(config.shoulder_from),
        contrast_curve: None,
        white_level,
    }
}

/// The curve that an exposure is shown by.
pub fn tone(config: &RenderConfig, exposure: &RenderingFile) -> Tone {
    let shown = exposure.gain.iter().zip(&exposure.median_reflectance).map(|(g, m)| g * m);
    match config.look {
        // 16 bits are linear.
        _ if config.depth == 16 => Tone::Shoulder { knee: 1.0 },
        // The median of a baseline's output is not known.
        Look::Natural if !config.method.is_baseline() => {
            Tone::Contrast(ContrastCurve::about(shown.sum::<f64>() / exposure.gain.len() as f64))
        }
        _ => Tone::Shoulder { knee: config.shoulder_from },
    }
}

fn finite_or_one(v: f64) -> f64 {
    if v.is_finite() && v > 0.0 { v } else { 1.0 }
}
