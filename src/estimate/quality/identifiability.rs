//! Whether a log determines the attenuation.

use crate::config::EstimateConfig;
use crate::diagnostics::NotIdentified;
use crate::estimate::Dataset;
use crate::estimate::methods::Candidate;
use crate::image::Bands;

/// With fewer frames neither backscatter nor changes of the light can be recognised.
pub const MIN_FRAMES: usize = 12;
/// Smallest difference of path length within the tracks \[m\].
const MIN_PATH_SPREAD_M: f64 = 0.05;
/// α of the lower half of the frames may differ from that of all by this much, whatever the noise
/// \[1/m\].
const MIN_DIFFERENCE_PER_M: f64 = 0.03;
/// Backscatter that is not modelled may change α by this share.
const UNMODELLED_SHARE: f64 = 0.1;
/// Largest standard deviation of α \[1/m\].
const MAX_STD_PER_M: f64 = 0.08;

/// Why the attenuation is not identified; `None` where it is.
pub fn not_identified(
    candidate: &Candidate,
    data: &Dataset<'_>,
    config: &EstimateConfig,
) -> Option<NotIdentified> {
    if !data.altitude_varies(config) {
        return Some(NotIdentified::AltitudeConstant { altitude_ratio: data.altitude_spread() });
    }
    if let Some(path_spread_m) = candidate.path_spread_m.filter(|p| *p < MIN_PATH_SPREAD_M) {
        return Some(NotIdentified::PathLengthsEqual { path_spread_m });
    }
    let frames = data.frames.len();
    if frames < MIN_FRAMES {
        return Some(NotIdentified::FewFrames { frames, needed: MIN_FRAMES });
    }
    let model = &candidate.model;
    let alpha = &model.attenuation_per_m[..model.bands];
    if let Some(with) = data.unmodelled_backscatter
        && let Some(reason) = backscatter_ignored(alpha, &with)
    {
        return Some(reason);
    }
    if let Some(reason) = low_frames_differ(candidate) {
        return Some(reason);
    }
    let lowest = alpha.iter().copied().fold(f64::INFINITY, f64::min);
    if lowest <= 0.0 {
        return Some(NotIdentified::NotPhysical { attenuation_per_m: lowest });
    }
    let worst = candidate.std_per_m[..model.bands].iter().copied().fold(0.0, f64::max);
    (worst > MAX_STD_PER_M).then_some(NotIdentified::Uncertain { std_per_m: worst })
}

fn backscatter_ignored(alpha: &[f64], with: &Bands) -> Option<NotIdentified> {
    let differs =
        |(alpha, with): &(&f64, &f64)| (**with - **alpha).abs() > UNMODELLED_SHARE * with.abs();
    alpha.iter().zip(with).find(differs).map(|(alpha, with)| NotIdentified::BackscatterIgnored {
        attenuation_per_m: *alpha,
        with_backscatter_per_m: *with,
    })
}

fn low_frames_differ(candidate: &Candidate) -> Option<NotIdentified> {
    let (low, low_std) = candidate.low_frames.as_ref()?;
    (0..candidate.model.bands).find_map(|b| {
        let all = candidate.model.attenuation_per_m[b];
        let std = candidate.std_per_m[b].hypot(low_std[b]);
        let differs = (low[b] - all).abs() > MIN_DIFFERENCE_PER_M.max(4.0 * std);
        differs.then_some(NotIdentified::LowFramesDiffer {
            attenuation_per_m: all,
            low_frames_per_m: low[b],
        })
    })
}
