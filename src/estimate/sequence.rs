//! The sequence of pass one over samples: recorded settings, strobe, drop-outs, backscatter and
//! daylight, the camera, then the estimators.
//!
//! What is off in a log (strobe, clock, backscatter, camera) looks the same in the residual: the
//! log is explained without faults of the camera; where that leaves uneven gains, they compete with
//! it by their cost (`self_calibration`), and the cheaper explanation is taken.

use super::backscatter::BackscatterFit;
use super::camera_fit::CameraFit;
use super::explanation::{Explanation, Samples, uniform};
use super::methods::empirical::Regions;
use super::mount_search::{MountFit, check_mounts};
use super::other_light::{other_light, without_backscatter};
use super::quality::doubt;
use super::quality::identifiability::MIN_FRAMES;
use super::samples::FrameSamples;
use super::self_calibration::{Calibration, calibrate, cost_with};
use super::strobe_search::{StrobePlacement, place_strobe};
use super::tilt_search::TiltFit;
use super::{
    Dataset, Estimate, FollowedSetting, ModelEstimate, Mounts, daylight, drift, estimate, exposure,
    frame_gains, tilt_search,
};
use crate::config::{EstimateConfig, SelfCalibration, StrobePosition, Switch};
use crate::error::Result;
use crate::image::response::TransferKnown;
use crate::model::{BeamGrid, ScatterSource};
use crate::parallel::join;
use crate::solver::{Track, sample_path};
use crate::vehicle::Lamps;

/// Times that strobe and backscatter are estimated in turn: each is more certain with the other
/// known.
const TURNS: usize = 3;
/// A strobe that moves less between turns is final (m).
const SETTLED_M: f64 = 0.01;
/// A strobe that moves further asks for the camera to be found again (m).
const MOVED_M: f64 = 0.03;
/// Terms of the camera are used where they lower the cost by this.
const LEAST_DECREASE: f64 = 0.05;

/// The samples, those without recorded gains and drop-outs, the latter, and their explanation.
type OverPlanes = (Samples, Samples, Vec<f64>, Explanation);

/// Settings and mounts of one estimate.
#[derive(Clone, Copy)]
struct Given<'g> {
    mounts: &'g Mounts,
    config: &'g EstimateConfig,
}

/// Samples → model. `settings` are recorded settings of camera and strobe, each a number per frame.
///
/// # Errors
/// [`Error::NotEstimated`](crate::error::Error::NotEstimated) where the chosen estimator, or all,
/// cannot answer.
pub fn estimate_model(
    frames: Vec<FrameSamples>,
    tracks: Vec<Track>,
    mounts: &Mounts,
    settings: &[Vec<f64>],
    config: &EstimateConfig,
) -> Result<ModelEstimate> {
    let given = Given { mounts, config };
    let mut raw = Samples { frames, tracks };
    let mut followed = exposure::followed(&raw.frames, &raw.tracks, settings);
    let (mut samples, mut log_gains) = given.followed(&raw, &followed, settings);
    let mut explained = given.explained(samples.clone(), None);
    let tilted = given.tilted(&raw, (&followed, settings), &explained);
    let tilts = tilted.map(|(found, over_tilted)| {
        (raw, samples, log_gains, explained) = over_tilted;
        found
    });
    let (mut reported, mut plain) = (None, None);
    if config.self_calibration != SelfCalibration::Off && config.estimator.may_be_joint() {
        let mut calibrated = given.calibrated(&samples, &explained);
        // Gains that came to light may be those that a channel records.
        let camera = calibrated.as_ref().and_then(|c| c.camera.as_ref());
        let explaining = camera.map_or_else(Vec::new, |camera| {
            let mut gains = camera.common_gains();
            for setting in &followed {
                let known = setting.log_gains(&settings[setting.index]);
                gains.iter_mut().zip(known).for_each(|(gain, known)| *gain += known);
            }
            exposure::explaining(&gains, settings)
        });
        if !explaining.is_empty() {
            followed = explaining;
            (samples, log_gains) = given.followed(&raw, &followed, settings);
            explained = given.explained(samples.clone(), None);
            calibrated = given.calibrated(&samples, &explained);
        }
        match config.self_calibration {
            SelfCalibration::Auto => {
                plain = calibrated.as_ref().and(Some(explained.clone()));
                explained = calibrated.unwrap_or(explained);
            }
            _ => reported = calibrated.and_then(|c| c.camera),
        }
    }
    let found = (followed, log_gains);
    let estimate = finish(explained, found.clone(), given)?;
    let is_empirical = estimate.judgement.empirical.is_some();
    // A clock or mount that came to light has no rival in what it left before.
    let has_rival =
        is_empirical || (estimate.camera.is_some() && !estimate.judgement.is_physical());
    let estimate = match plain.filter(|_| has_rival) {
        // An empirical model without the gains of a solve that it replaces may be better: these
        // drift along a log that does not determine attenuation. A physical model without faults of
        // the camera that came to light is none.
        Some(plain) => match finish(plain, found, given) {
            Ok(simpler) if simpler.needs_no_gains_of(&estimate) => simpler,
            Ok(simpler) if !simpler.judgement.is_physical() => better(estimate, simpler),
            _ => estimate,
        },
        None => estimate,
    };
    Ok(ModelEstimate { reported, tilts, ..estimate })
}

/// The estimate whose judgement is better, the second if they are equal.
fn better(a: ModelEstimate, b: ModelEstimate) -> ModelEstimate {
    if a.judgement.score() < b.judgement.score() { a } else { b }
}

impl Given<'_> {
    /// Samples without the gains of recorded settings and of frames that stand out, and the latter.
    /// Seen from the wrong position a frame at the dive's edge seems to have got another light: the
    /// strobe comes first.
    fn followed(
        &self,
        raw: &Samples,
        followed: &[FollowedSetting],
        settings: &[Vec<f64>],
    ) -> (Samples, Vec<f64>) {
        let mut samples = raw.clone();
        samples.follow(followed, settings);
        let strobe = self.placed(&samples, None);
        let data = samples.data(self.mounts, strobe.lamps, None);
        let log_gains = frame_gains::uneven_light(&data, self.config);
        if log_gains.iter().any(|g| *g != 0.0) {
            samples.remove_gains(&uniform(&log_gains));
        }
        (samples, log_gains)
    }

    /// Tilts of planes that are assumed level, and all over tilted planes, if that is cheaper.
    fn tilted(
        &self,
        raw: &Samples,
        (followed, settings): (&[FollowedSetting], &[Vec<f64>]),
        level: &Explanation,
    ) -> Option<(TiltFit, OverPlanes)> {
        let Self { mounts, config } = *self;
        let mut samples = raw.clone();
        samples.follow(followed, settings);
        let data = samples.data(mounts, mounts.lamps, None);
        let found = tilt_search::find(&data, mounts, config)?;
        let (frames, tracks) = found.applied_to(&raw.frames, &raw.tracks, mounts);
        let tilted = Samples { frames, tracks };
        let (samples, gains) = self.followed(&tilted, followed, settings);
        let explained = self.explained(samples.clone(), None);
        // Beside backscatter, daylight and the strobe's position those by light may not be needed.
        let are_needed = found.is_measured || self.cost(&explained) < self.cost(level);
        are_needed.then_some((found, (tilted, samples, gains, explained)))
    }

    fn placed(&self, samples: &Samples, camera: Option<&CameraFit>) -> StrobePlacement {
        let data = samples.data(self.mounts, self.mounts.lamps, camera);
        place_strobe(&data, self.mounts.strobe_is_measured, None, self.config)
    }

    /// Strobe and backscatter of samples, faults of the camera given.
    fn explained(&self, mut raw: Samples, camera: Option<CameraFit>) -> Explanation {
        if let Some(camera) = &camera {
            camera.remove_from(&mut raw.frames, &mut raw.tracks);
        }
        let strobe = self.placed(&raw, camera.as_ref());
        let is_contradicted = self.mounts.strobe_is_measured && strobe.source.is_some();
        let kept = is_contradicted.then(|| StrobePlacement::kept(self.mounts.lamps));
        let is_auto = self.config.self_calibration == SelfCalibration::Auto;
        let moved = strobe.moved().filter(|_| self.mounts.strobe_is_measured && is_auto);
        let mut explained = Explanation::new(raw, strobe, camera);
        let given = kept.map(|strobe| Explanation { strobe, ..explained.clone() });
        let moved = moved.map(|strobe| Explanation { strobe, ..explained.clone() });
        self.separate_light(&mut explained);
        if let Some(mut moved) = moved.filter(|_| explained.direct.is_some()) {
            // What looks like other light may be a strobe that is elsewhere.
            self.separate_light(&mut moved);
            let is_near = || self.cost(&moved) < self.cost(&explained) + LEAST_DECREASE;
            explained.rival = (moved.direct.is_none() && is_near()).then_some(moved.strobe.lamps);
        }
        let Some(mut given) = given else { return explained };
        // Backscatter and daylight pull the strobe away, too.
        self.separate_light(&mut given);
        if given.direct.is_none() || self.cost(&given) > self.cost(&explained) {
            return explained;
        }
        given
    }

    /// The cost of an explanation, infinite where there is no solve.
    fn cost(&self, explained: &Explanation) -> f64 {
        let direct = explained.direct.as_ref().unwrap_or(&explained.raw);
        let data = direct.data(self.mounts, explained.strobe.lamps, None);
        cost_with(&data, &sample_path, self.config).unwrap_or(f64::INFINITY)
    }

    /// Strobe, and light that is not the strobe's alone, estimated in turn.
    fn separate_light(&self, found: &mut Explanation) {
        let Self { mounts, config } = *self;
        let camera = found.camera.as_ref();
        let given = found.raw.data(mounts, mounts.lamps, camera);
        if !given.is_informative(config) {
            return;
        }
        let grid = BeamGrid::new(config.beam_nodes, config.beam_limit_deg);
        let is_searched = config.strobe_position != StrobePosition::Fixed
            && (!mounts.strobe_is_measured || config.strobe_position != StrobePosition::Auto);
        for _ in 0..TURNS {
            let placed = Dataset { lamps: found.strobe.lamps, ..given };
            let is_placed = found.strobe.warning.is_none() || found.strobe.source.is_some();
            let setup = given.setup(grid, config);
            let (mut backscatter, daylight) = other_light(&placed, &setup, is_placed);
            if config.backscatter == Switch::Off {
                found.unmodelled = backscatter.take().map(|fit| fit.attenuation_per_m);
            }
            if backscatter.is_none() && daylight.is_none() {
                // What was found with the strobe elsewhere does not hold where it is now.
                (found.backscatter, found.daylight, found.direct) = (None, None, None);
                break;
            }
            let (frames, tracks) = without_backscatter(&placed, backscatter.as_ref());
            let lit = Samples { frames, tracks };
            let before = found.strobe.lamps;
            let start = is_searched.then_some(before);
            // Daylight gives way to a strobe that moves: both are unknown at once.
            let daylight_share = daylight.as_ref().map(|fit| daylight::begun(&fit.share));
            let data = Dataset { daylight_share, ..lit.data(mounts, mounts.lamps, camera) };
            let next = place_strobe(&data, mounts.strobe_is_measured, start, config);
            // A position that cannot be found again stays what it was.
            if next.source.is_some() || found.strobe.source.is_none() {
                found.strobe = next;
            }
            let under_strobe = daylight.as_ref().map(|fit| {
                let (frames, tracks) = fit.removed_from(&lit.data(mounts, before, camera));
                Samples { frames, tracks }
            });
            found.direct = Some(under_strobe.unwrap_or(lit));
            (found.backscatter, found.daylight) = (backscatter, daylight);
            if found.strobe.lamps.distance_m(before) < SETTLED_M {
                break;
            }
        }
    }

    /// The explanation with the camera's faults, or with another clock or mount, where that is
    /// cheaper than the plain one.
    fn calibrated(&self, samples: &Samples, plain: &Explanation) -> Option<Explanation> {
        let Self { mounts, config } = *self;
        if samples.tracks.len() < config.least_pairs || samples.frames.len() < MIN_FRAMES {
            return None;
        }
        let direct = plain.direct.as_ref().unwrap_or(&plain.raw);
        let mut best = self.calibration(direct, plain.strobe.lamps)?;
        let least = best.cost_without;
        // What is added to the light evenly may be added by the camera.
        let is_even = |fit: &BackscatterFit| fit.backscatter.source == ScatterSource::Uniform;
        let is_even = plain.backscatter.as_ref().is_some_and(is_even);
        let is_moved = plain.strobe.lamps.distance_m(mounts.lamps) > MOVED_M;
        let has_rival = (is_moved && mounts.strobe_is_measured) || plain.direct.is_some();
        let is_fine = best.camera.is_none() && best.is_quiet && !is_even;
        if is_fine && !has_rival {
            return None;
        }
        // A clock or mount that is off is mistaken for another strobe or for daylight, too.
        let given = has_rival
            .then(|| Explanation::new(samples.clone(), StrobePlacement::kept(mounts.lamps), None));
        let explained = given.iter().chain((!is_fine).then_some(plain));
        let geometry = explained.filter_map(|explained| self.clock_and_mount(explained));
        let geometry = geometry.min_by(|a, b| a.1.total_cmp(&b.1));
        if given.is_some() && !is_fine {
            let of_given = self.calibration(samples, mounts.lamps);
            best = of_given.into_iter().fold(best, |a, b| if b.cost < a.cost { b } else { a });
        }
        let cheapest = best.cost.min(least);
        if let Some((found, _)) = geometry.filter(|(_, cost)| *cost < cheapest - LEAST_DECREASE) {
            return Some(found);
        }
        if is_fine {
            return None;
        }
        // A fitted curve stays unknown in the solve; uneven gains are part of any explanation.
        let is_fitted = mounts.camera.transfer == TransferKnown::Fitted;
        let is_uneven = best.camera.as_ref()?.found.gains;
        let is_rival = is_even && best.camera.as_ref()?.found.black_level;
        let decrease = if is_rival { 0.0 } else { LEAST_DECREASE };
        if best.cost > least - decrease && !is_fitted && !is_uneven {
            return None;
        }
        let explained = self.explained(samples.clone(), best.camera.clone());
        if explained.strobe.lamps.distance_m(best.camera.as_ref()?.lamps) < MOVED_M {
            return Some(explained);
        }
        // The strobe and the camera were both off.
        match self.calibration(samples, explained.strobe.lamps) {
            Some(next) if next.cost < best.cost - LEAST_DECREASE => {
                Some(self.explained(samples.clone(), next.camera))
            }
            _ => Some(explained),
        }
    }

    fn calibration(&self, samples: &Samples, lamps: Lamps) -> Option<Calibration> {
        let Self { mounts, config } = *self;
        let data = samples.data(mounts, lamps, None);
        let can_tell = data.is_informative(config);
        with_drift(&data, can_tell, config, &|data| calibrate(data, mounts.camera, config))
    }

    /// The explanation with clock and mount that contradict the given ones, and its cost.
    fn clock_and_mount(&self, explained: &Explanation) -> Option<(Explanation, f64)> {
        let Self { mounts, config } = *self;
        let direct = explained.direct.as_ref().unwrap_or(&explained.raw);
        let data = direct.data(mounts, explained.strobe.lamps, None);
        let found = check_mounts(&data, mounts.instrument, config)?;
        if !found.contradicts_clock() && !found.contradicts_mount() {
            return None;
        }
        let planes = data.plane_tracks();
        let shifted = found.shifted(&planes, mounts);
        let cost = cost_with(&data, &|o, lamps| shifted.path(o, lamps), config)?;
        Some((Explanation { mounts: Some(found), ..explained.clone() }, cost))
    }
}

/// Work on samples with the nodes of α in time, where the water changes.
fn with_drift<R>(
    data: &Dataset<'_>,
    can_tell: bool,
    config: &EstimateConfig,
    work: &dyn Fn(&Dataset<'_>) -> R,
) -> R {
    let grid = BeamGrid::new(config.beam_nodes, config.beam_limit_deg);
    let is_sought = config.drift != Switch::Off && can_tell;
    let drift = if is_sought { drift::find(data, &data.setup(grid, config)) } else { None };
    work(&Dataset { drift: drift.as_ref(), ..*data })
}

/// The estimators, and clock and mount by them, unless known.
fn checked(
    data: &Dataset<'_>,
    known: Option<MountFit>,
    can_tell: bool,
    Given { mounts, config }: Given<'_>,
) -> (Option<MountFit>, Result<Estimate>) {
    let estimated = || with_drift(data, can_tell, config, &|data| estimate(data, config));
    let check = || known.or_else(|| check_mounts(data, mounts.instrument, config));
    let (found, estimated) = join(check, estimated);
    let Some(is_not_level) = found.and_then(|fit| fit.contradicts_level()) else {
        return (found, estimated);
    };
    // What the slope leaves looks like water that changes.
    let judged = estimate(data, config).map(|estimate| Estimate {
        not_identified: estimate.not_identified.or(Some(is_not_level)),
        ..estimate
    });
    (found, judged)
}

/// The estimators on an explained log.
fn finish(
    explained: Explanation,
    (followed, drop_outs): (Vec<FollowedSetting>, Vec<f64>),
    given: Given<'_>,
) -> Result<ModelEstimate> {
    let Given { mounts, config } = given;
    let (known, unmodelled, rival) = (explained.mounts, explained.unmodelled, explained.rival);
    let Explanation { mut raw, direct, mut strobe, backscatter, daylight, camera, .. } = explained;
    let can_tell = raw.data(mounts, mounts.lamps, None).is_informative(config);
    let regions = Regions::of(&raw.frames, mounts.body_from_optical);
    let direct = direct.unwrap_or_else(|| Samples {
        frames: std::mem::take(&mut raw.frames),
        tracks: raw.tracks.clone(),
    });
    let data = Dataset {
        strobe_is_free: strobe.source.is_some() || (!mounts.strobe_is_measured && can_tell),
        backscatter: backscatter.as_ref(),
        daylight: daylight.as_ref(),
        raw_tracks: Some(&raw.tracks),
        tilts: tilt_search::stds(&direct.frames).map(|stds| (mounts.instrument, stds)),
        unmodelled_backscatter: unmodelled,
        ..direct.data(mounts, strobe.lamps, camera.as_ref())
    };
    let replaces_mounts = known.is_some() && config.self_calibration == SelfCalibration::Auto;
    let (mount_fit, estimated) = checked(&data, known, can_tell, given);
    let mut estimate = estimated?;
    let kept = mount_fit.as_ref().filter(|_| !replaces_mounts);
    estimate.widen(&doubt::by_geometry(&data, &strobe, kept, (mounts, config)));
    estimate.widen(&doubt::by_rival(&data, rival, &estimate.model, config));
    estimate.widen(&doubt::by_camera(&data, config));
    let judgement = estimate.judge(&data, regions.as_ref(), config);
    estimate.ensure_corrects(&judgement)?;
    if let Some(search) = strobe.search.as_mut().filter(|_| strobe.source.is_some()) {
        search.std_m = search.std_m.map(|std| std * estimate.inflation);
    }
    let backscatter = backscatter.map(|fit| fit.of_model(&estimate.model));
    // Daylight is part of the model that corrects.
    let frames = if daylight.is_some() {
        without_backscatter(&raw.data(mounts, strobe.lamps, None), backscatter.as_ref()).0
    } else {
        direct.frames
    };
    let of_camera = |f: usize| camera.as_ref().map_or([0.0; 3], |c| c.log_gains[f]);
    let log_gain = |(f, gain): (usize, &f64)| of_camera(f).map(|of_camera| of_camera + gain);
    Ok(ModelEstimate {
        daylight: daylight.map(|fit| fit.of_model(&estimate.model)),
        estimate,
        strobe,
        backscatter,
        followed,
        log_gains: drop_outs.iter().enumerate().map(log_gain).collect(),
        drop_outs: drop_outs.iter().filter(|g| **g != 0.0).count(),
        camera,
        reported: None,
        tilts: None,
        mounts: mount_fit,
        replaces_mounts,
        frames,
        judgement,
    })
}
