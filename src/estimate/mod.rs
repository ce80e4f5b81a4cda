//! Pass one: samples → imaging model (paper §IV-B, IV-C).
//!
//! Samples are taken from images once ([`sample_frame`]), matched and joined to `tracks`;
//! from then on only samples count, so that estimators run in moments in a test. The sequence:
//! recorded exposures and drop-outs are divided out, the strobe is located, backscatter is
//! separated, and then the estimators of `methods` run side by side; `quality` tells how far the
//! answer can be trusted.

mod angular_bins;
mod backscatter;
mod dataset;
mod descriptor;
mod drift;
mod exposure;
mod frame_gains;
mod keypoints;
mod matching;
mod methods;
mod mount_search;
mod quality;
mod samples;
mod strobe_search;
mod tracks;
mod verdict;

use std::collections::BTreeMap;

use nalgebra::Vector3;

pub use crate::solver::terms::geometry::PLANES_AROUND_S;
pub use crate::solver::{Observation, Sample, Track};
pub use backscatter::BackscatterFit;
pub use dataset::Dataset;
pub use exposure::FollowedSetting;
pub use matching::{Matchable, MatchedPair, matches};
pub use methods::empirical::EmpiricalFit;
pub use mount_search::MountFit;
pub use samples::{FrameSamples, coarsest_m, sample_frame};
pub use strobe_search::{StrobeFit, StrobePlacement};
pub use tracks::tracks;
pub use verdict::Judgement;

use crate::config::{EstimateConfig, Estimator, StrobePosition, Switch};
use crate::coordinates::{Body, Optical, Transform};
use crate::diagnostics::NotIdentified;
use crate::error::{Error, Result};
use crate::image::Bands;
use crate::model::{Backscatter, BeamGrid, EstimatorAnswer, ImagingModel, ScatterTable};
use crate::parallel::{join, par_map};
use crate::vehicle::Lamps;
use methods::empirical::Regions;
use methods::{Candidate, Method, altitude, joint, pairs};
use mount_search::check_mounts;
use quality::identifiability::not_identified;
use strobe_search::place_strobe;

/// The chosen estimator's model, and all estimators' answers.
#[derive(Clone, Debug)]
pub struct Estimate {
    /// the model
    pub model: ImagingModel,
    /// standard deviation of α (1/m)
    pub attenuation_std_per_m: Bands,
    /// the estimator that the model comes from
    pub estimator: Estimator,
    /// every estimator's answer
    pub answers: BTreeMap<Estimator, EstimatorAnswer>,
    /// why the attenuation is not identified; `None` where it is
    pub not_identified: Option<NotIdentified>,
    /// largest factor by which common-mode errors widen the standard deviations of the solve
    pub inflation: f64,
}

impl Estimate {
    /// Compares the model with raw light and simpler corrections. Where an empirical model is
    /// better, attenuation is not identified.
    fn judge(
        &mut self,
        data: &Dataset<'_>,
        regions: Option<&Regions>,
        config: &EstimateConfig,
    ) -> Judgement {
        let (model, estimator) = (&self.model, self.estimator);
        let is_identified = self.not_identified.is_none();
        let case = verdict::Case { data, regions, model, estimator, is_identified, config };
        let judgement = case.judge();
        if judgement.empirical.is_some() {
            self.estimator = Estimator::Empirical;
            self.not_identified.get_or_insert(NotIdentified::EmpiricalBetter);
        }
        judgement
    }
}

/// Mounts as pass one needs them.
#[derive(Clone, Copy, Debug)]
pub struct Mounts {
    /// the camera's
    pub body_from_optical: Transform<Body, Optical>,
    /// the strobe's
    pub lamps: Lamps,
    /// whether the strobe's is measured; a guess otherwise
    pub strobe_is_measured: bool,
    /// position of the range instrument in the body (m)
    pub instrument: Vector3<f64>,
}

/// The result of pass one.
pub struct ModelEstimate {
    /// the model and its uncertainty
    pub estimate: Estimate,
    /// position of the strobe
    pub strobe: StrobePlacement,
    /// backscatter
    pub backscatter: Option<BackscatterFit>,
    /// recorded settings that the frames' light follows
    pub followed: Vec<FollowedSetting>,
    /// per frame: log of its light over its neighbours', 0 but for drop-outs
    pub log_gains: Vec<f64>,
    /// clock and mount of the range instrument that fit better than those given
    pub mounts: Option<MountFit>,
    /// the samples that the model was estimated from: gains and backscatter removed
    pub frames: Vec<FrameSamples>,
    /// whether the correction helps, and the empirical model where another does not
    pub judgement: Judgement,
}

/// Times that strobe and backscatter are estimated in turn: each is more certain with the other
/// known.
const TURNS: usize = 3;
/// A strobe that moves less between turns is final (m).
const SETTLED_M: f64 = 0.01;

/// Samples and tracks, owned.
struct Samples {
    frames: Vec<FrameSamples>,
    tracks: Vec<Track>,
}

impl Samples {
    fn data(&self, mounts: &Mounts, lamps: Lamps) -> Dataset<'_> {
        Dataset::plain(&self.frames, &self.tracks, mounts.body_from_optical, lamps)
    }

    fn remove_gains(&mut self, log_gains: &[f64]) {
        frame_gains::remove_gains(&mut self.frames, &mut self.tracks, log_gains);
    }
}

/// Samples → model. `settings` are recorded settings of camera and strobe, each a number per frame.
///
/// # Errors
/// [`Error::NotEstimated`] where the chosen estimator, or all, cannot answer.
pub fn estimate_model(
    frames: Vec<FrameSamples>,
    tracks: Vec<Track>,
    mounts: &Mounts,
    settings: &[Vec<f64>],
    config: &EstimateConfig,
) -> Result<ModelEstimate> {
    let mut raw = Samples { frames, tracks };
    let followed = exposure::followed(&raw.frames, &raw.tracks, settings);
    for setting in &followed {
        raw.remove_gains(&setting.log_gains(&settings[setting.index]));
    }
    // Seen from the wrong position a frame at the dive's edge seems to have got another light: the
    // strobe comes first.
    let placed = |samples: &Samples| {
        let data = samples.data(mounts, mounts.lamps);
        place_strobe(&data, mounts.strobe_is_measured, None, config)
    };
    let mut strobe = placed(&raw);
    let log_gains = frame_gains::uneven_light(&raw.data(mounts, strobe.lamps), config);
    if log_gains.iter().any(|g| *g != 0.0) {
        raw.remove_gains(&log_gains);
        strobe = placed(&raw);
    }
    let can_tell = raw.data(mounts, mounts.lamps).is_informative(config);
    let regions = Regions::of(&raw.frames, mounts.body_from_optical);
    let Separation { mut strobe, backscatter, direct, unmodelled } =
        separate_backscatter(&raw, strobe, mounts, config);
    let direct = direct.unwrap_or_else(|| Samples {
        frames: std::mem::take(&mut raw.frames),
        tracks: raw.tracks.clone(),
    });
    let data = Dataset {
        strobe_is_free: strobe.source.is_some() || (!mounts.strobe_is_measured && can_tell),
        backscatter: backscatter.as_ref().map(|b| (b, raw.tracks.as_slice())),
        unmodelled_backscatter: unmodelled,
        ..direct.data(mounts, strobe.lamps)
    };
    let estimated = || {
        let grid = BeamGrid::new(config.beam_nodes, config.beam_limit_deg);
        let seeks_drift = config.drift != Switch::Off && can_tell;
        let drift = if seeks_drift { drift::find(&data, &data.setup(grid, config)) } else { None };
        estimate(&Dataset { drift: drift.as_ref(), ..data }, config)
    };
    let (mount_fit, estimate) = join(|| check_mounts(&data, mounts.instrument, config), estimated);
    let mut estimate = estimate?;
    let judgement = estimate.judge(&data, regions.as_ref(), config);
    if let Some(search) = strobe.search.as_mut().filter(|_| strobe.source.is_some()) {
        search.std_m = search.std_m.map(|std| std * estimate.inflation);
    }
    let backscatter = backscatter.map(|mut fit| {
        fit.backscatter = estimate.model.backscatter.unwrap_or(fit.backscatter);
        fit
    });
    let frames = direct.frames;
    Ok(ModelEstimate {
        estimate,
        strobe,
        backscatter,
        followed,
        log_gains,
        mounts: mount_fit,
        frames,
        judgement,
    })
}

/// Strobe and backscatter, estimated in turn.
struct Separation {
    strobe: StrobePlacement,
    backscatter: Option<BackscatterFit>,
    /// the samples without backscatter
    direct: Option<Samples>,
    /// α with backscatter modelled, where the settings exclude it (1/m)
    unmodelled: Option<Bands>,
}

fn separate_backscatter(
    raw: &Samples,
    strobe: StrobePlacement,
    mounts: &Mounts,
    config: &EstimateConfig,
) -> Separation {
    let given = raw.data(mounts, mounts.lamps);
    let mut found = Separation { strobe, backscatter: None, direct: None, unmodelled: None };
    if !given.is_informative(config) {
        return found;
    }
    let grid = BeamGrid::new(config.beam_nodes, config.beam_limit_deg);
    let is_searched = config.strobe_position != StrobePosition::Fixed
        && (!mounts.strobe_is_measured || config.strobe_position != StrobePosition::Auto);
    for _ in 0..TURNS {
        let placed = Dataset { lamps: found.strobe.lamps, ..given };
        let Some(fit) = backscatter::find(&placed, &given.setup(grid, config)) else {
            // What was found with the strobe elsewhere does not hold where it is now.
            (found.backscatter, found.direct) = (None, None);
            break;
        };
        if config.backscatter == Switch::Off {
            found.unmodelled = Some(fit.attenuation_per_m);
            break;
        }
        let (frames, tracks) = fit.removed_from(&placed);
        let direct = Samples { frames, tracks };
        let before = found.strobe.lamps;
        let start = is_searched.then_some(before);
        let data = direct.data(mounts, mounts.lamps);
        let next = place_strobe(&data, mounts.strobe_is_measured, start, config);
        // A position that cannot be found again stays what it was.
        if next.source.is_some() || found.strobe.source.is_none() {
            found.strobe = next;
        }
        let moved = found.strobe.lamps.origin().vector() - before.origin().vector();
        (found.backscatter, found.direct) = (Some(fit), Some(direct));
        if moved.norm() < SETTLED_M {
            break;
        }
    }
    found
}

/// Frames as a given model needs them: the frames' gains and backscatter removed.
pub fn samples_for_model(
    mut frames: Vec<FrameSamples>,
    log_gains: &[f64],
    body_from_optical: Transform<Body, Optical>,
    lamps: Lamps,
    scatter: Option<(&Backscatter, &ScatterTable)>,
) -> Vec<FrameSamples> {
    frame_gains::remove_gains(&mut frames, &mut [], log_gains);
    let Some((backscatter, table)) = scatter else { return frames };
    let data = Dataset::plain(&frames, &[], body_from_optical, lamps);
    backscatter::remove_from_frames(&data, |sample| {
        let (x, y, s) = data.ray(sample);
        backscatter.light(&table.at(x, y, s))
    })
}

/// Runs the estimators and chooses among them.
///
/// # Errors
/// [`Error::NotEstimated`] where the chosen one, or all, cannot answer.
fn estimate(data: &Dataset<'_>, config: &EstimateConfig) -> Result<Estimate> {
    let grid = BeamGrid::new(config.beam_nodes, config.beam_limit_deg);
    let methods: Vec<(Estimator, Method)> = vec![
        (Estimator::Joint, joint::estimate),
        (Estimator::Pairs, pairs::estimate),
        (Estimator::Altitude, altitude::estimate),
    ];
    let mut found: BTreeMap<Estimator, Candidate> = BTreeMap::new();
    let mut answers = BTreeMap::new();
    for (name, answer) in par_map(methods, |(name, run)| (name, run(data, grid, config))) {
        match answer {
            Ok(mut candidate) => {
                // The paper's estimators take the seafloor's own pattern for the beam's: the joint
                // solve shows by how much.
                if let Some(joint) = answers.get(&Estimator::Joint) {
                    candidate.inflate_by(joint);
                }
                answers.insert(name, candidate.answer.clone());
                found.insert(name, candidate);
            }
            Err(why) => {
                answers.insert(name, EstimatorAnswer::none(why));
            }
        }
    }
    let order: &[Estimator] = match &config.estimator {
        Estimator::Auto | Estimator::Empirical => {
            &[Estimator::Joint, Estimator::Pairs, Estimator::Altitude]
        }
        one => std::slice::from_ref(one),
    };
    let Some((estimator, candidate)) = order.iter().find_map(|name| found.remove_entry(name))
    else {
        return Err(no_estimate(order, &answers));
    };
    // The others model neither backscatter nor drop-outs, and with many tracks the joint solve
    // fails for a reason.
    let is_fallback = config.estimator == Estimator::Auto && estimator != Estimator::Joint;
    let joint_failure = || {
        let joint = answers.get(&Estimator::Joint)?;
        joint.note.clone().filter(|_| is_fallback && data.tracks.len() >= config.least_pairs)
    };
    let not_identified = not_identified(&candidate, data, config)
        .or_else(|| joint_failure().map(|reason| NotIdentified::JointFailed { reason }));
    Ok(Estimate {
        model: candidate.model,
        attenuation_std_per_m: candidate.std_per_m,
        estimator,
        answers,
        not_identified,
        inflation: candidate.inflation,
    })
}

/// Why no estimator has an answer.
fn no_estimate(order: &[Estimator], answers: &BTreeMap<Estimator, EstimatorAnswer>) -> Error {
    let reason = |n: &Estimator| Some(format!("{}: {}", n.word(), answers.get(n)?.note.as_ref()?));
    Error::NotEstimated {
        reason: order.iter().filter_map(reason).collect::<Vec<_>>().join("; "),
        remedy: "use a model from another part of the dive or from another dive of the same water \
                 and strobe: --model MODEL.json"
            .into(),
    }
}
