//! Whether a log determines the attenuation.

use crate::config::EstimateConfig;
use crate::diagnostics::NotIdentified;
use crate::estimate::methods::Candidate;
use crate::estimate::{CameraTermsFound, Dataset};
use crate::image::Bands;

/// With fewer frames neither backscatter nor changes of the light can be recognised.
pub const MIN_FRAMES: usize = 12;
/// Smallest difference of path length within the tracks (m).
const MIN_PATH_SPREAD_M: f64 = 0.05;
/// α of the lower half of the frames may differ from that of all by this much, whatever the noise
/// (1/m).
const MIN_DIFFERENCE_PER_M: f64 = 0.03;
/// Largest error common to regions of frames (log light).
const MAX_SYSTEMATIC: f64 = 0.0065;
/// Backscatter that is not modelled may change α by this share.
const UNMODELLED_SHARE: f64 = 0.1;
/// Largest standard deviation of α (1/m).
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
    if data.drift.is_some_and(|drift| drift.stamps.is_empty()) {
        return Some(NotIdentified::LogsDiffer);
    }
    if is_tilt_ambiguous(data) {
        return Some(NotIdentified::TiltsAmbiguous);
    }
    if may_lamps_differ(data) {
        return Some(NotIdentified::LampsMayDiffer { lamps: data.lamps.lamps().len() });
    }
    let model = &candidate.model;
    let alpha = &model.attenuation_per_m[..model.bands];
    if let Some(with) = data.unmodelled_backscatter
        && let Some(reason) = backscatter_ignored(alpha, &with)
    {
        return Some(reason);
    }
    if candidate.systematic > MAX_SYSTEMATIC {
        return Some(NotIdentified::Misfit { systematic: candidate.systematic });
    }
    if let Some(reason) = low_frames_differ(candidate) {
        return Some(reason);
    }
    let lowest = alpha.iter().copied().fold(f64::INFINITY, f64::min);
    if lowest <= 0.0 {
        return Some(NotIdentified::NotPhysical { attenuation_per_m: lowest });
    }
    uncertain(&candidate.std_per_m[..model.bands])
}

/// Whether standard deviations of α (1/m) are too large for it to be identified.
pub fn uncertain(std_per_m: &[f64]) -> Option<NotIdentified> {
    let worst = std_per_m.iter().copied().fold(0.0, f64::max);
    (worst > MAX_STD_PER_M).then_some(NotIdentified::Uncertain { std_per_m: worst })
}

/// Whether tilts of all frames are not measured by sensors, nor gains or the strobe's position:
/// what is left of their errors stands in for one another.
fn is_tilt_ambiguous(data: &Dataset<'_>) -> bool {
    let has_attitude = data.frames.iter().any(|f| f.has_attitude || !f.is_level_assumed);
    let found = data.camera.map(|camera| camera.found).unwrap_or_default();
    let is_unknown = [found.gains || found.law, data.strobe_is_free];
    // Overlapping frames leave little of the tilts; over a seafloor that is no plane they leave
    // what looks like gains without a law.
    let is_measured = data.frames.iter().all(|f| f.is_tilt_measured);
    let has_other_gains = found.gains && !found.law;
    let is_left = !is_measured || has_other_gains || is_unknown == [true; 2];
    !has_attitude && is_unknown.contains(&true) && is_left
}

/// Whether several lamps, for which one beam pattern is fitted, leave what looks like a fault of
/// the camera: it may be the difference of their patterns.
fn may_lamps_differ(data: &Dataset<'_>) -> bool {
    let is_suspect = |found: CameraTermsFound| found.gains || found.law || found.vignetting;
    data.lamps.lamps().len() > 1 && data.camera.is_some_and(|camera| is_suspect(camera.found))
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::coordinates::Transform;
    use crate::estimate::samples::FrameSamples;
    use crate::model::{BeamGrid, BeamPattern, EstimatorAnswer, ImagingModel, SpreadingModel};
    use crate::vehicle::Lamps;

    fn candidate(alpha: Bands, std_per_m: Bands) -> Candidate {
        let model = ImagingModel {
            bands: 3,
            attenuation_per_m: alpha,
            over_time: Default::default(),
            spreading: SpreadingModel { strobe_leg: 2.0, camera_leg: 0.0 },
            incidence: true,
            beam_pattern: BeamPattern::uniform(BeamGrid::new(9, 60.0)),
            backscatter: None,
            daylight: None,
            residual: None,
            empirical: None,
        };
        Candidate {
            model,
            std_per_m,
            answer: EstimatorAnswer::default(),
            path_spread_m: Some(0.4),
            systematic: 0.003,
            inflation: 1.0,
            low_frames: Some((alpha, std_per_m)),
        }
    }

    /// The reason for frames at these altitudes, after `change` to a candidate without fault.
    fn reason(altitudes_m: &[f64], change: impl Fn(&mut Candidate)) -> Option<NotIdentified> {
        let frames: Vec<FrameSamples> = altitudes_m
            .iter()
            .enumerate()
            .map(|(i, altitude_m)| FrameSamples::of_level_seafloor(i, *altitude_m))
            .collect();
        let lamps = Lamps::one(Transform::identity());
        let data = Dataset::plain(&frames, &[], Transform::identity(), lamps);
        let mut candidate = candidate([0.45, 0.14, 0.1], [0.004; 3]);
        change(&mut candidate);
        not_identified(&candidate, &data, &EstimateConfig::default())
    }

    fn swinging() -> Vec<f64> {
        (0..30).map(|i| 2.2 + 0.7 * (0.5 * f64::from(i)).sin()).collect()
    }

    #[test]
    fn a_candidate_without_fault_is_identified() {
        assert_eq!(reason(&swinging(), |_| ()), None);
    }

    #[test]
    fn each_fault_is_the_reason() {
        use NotIdentified as N;
        let of = |change: &dyn Fn(&mut Candidate)| reason(&swinging(), change);
        assert!(matches!(reason(&[2.0; 30], |_| ()), Some(N::AltitudeConstant { .. })));
        assert!(matches!(
            of(&|c| c.path_spread_m = Some(0.04)),
            Some(N::PathLengthsEqual { path_spread_m }) if path_spread_m == 0.04
        ));
        assert!(matches!(
            reason(&swinging()[..11], |_| ()),
            Some(N::FewFrames { frames: 11, needed: MIN_FRAMES })
        ));
        assert!(matches!(
            of(&|c| c.low_frames = Some(([0.45, 0.10, 0.1], [0.004; 3]))),
            Some(N::LowFramesDiffer { low_frames_per_m, .. }) if low_frames_per_m == 0.10
        ));
        assert!(matches!(
            of(&|c| c.systematic = 0.013),
            Some(N::Misfit { systematic }) if systematic == 0.013
        ));
        // The same difference within four standard deviations is none.
        assert_eq!(of(&|c| c.low_frames = Some(([0.45, 0.10, 0.1], [0.02; 3]))), None);
        assert!(matches!(
            of(&|c| (c.model.attenuation_per_m[2], c.low_frames) = (-0.01, None)),
            Some(N::NotPhysical { attenuation_per_m }) if attenuation_per_m == -0.01
        ));
        assert!(matches!(
            of(&|c| c.std_per_m[1] = 0.081),
            Some(N::Uncertain { std_per_m }) if std_per_m == 0.081
        ));
    }

    #[test]
    fn backscatter_that_the_settings_exclude_counts_from_a_tenth_of_attenuation() {
        assert!(backscatter_ignored(&[0.45, 0.14, 0.1], &[0.49, 0.14, 0.1]).is_none());
        let reason = backscatter_ignored(&[0.45, 0.14, 0.1], &[0.49, 0.17, 0.1]);
        assert!(matches!(
            reason,
            Some(NotIdentified::BackscatterIgnored { attenuation_per_m, .. })
                if attenuation_per_m == 0.14
        ));
    }
}
