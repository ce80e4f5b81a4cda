//! Pass one: samples → imaging model (paper §IV-B, IV-C).
//!
//! Samples are taken from images once ([`sample_frame`]), matched and joined to `tracks`;
//! from then on only samples count, so that estimators run in moments in a test. `sequence`:
//! recorded exposures and drop-outs are divided out, the strobe is located, backscatter is
//! separated, the camera is calibrated (`self_calibration`), and then the estimators of `methods`
//! run side by side; `quality` gives how far the answer can be trusted, `verdict` whether the
//! correction helps.

mod angular_bins;
mod backscatter;
mod camera_fit;
mod dataset;
mod daylight;
mod descriptor;
mod drift;
mod explanation;
mod exposure;
mod frame_gains;
mod keypoints;
mod matching;
mod methods;
mod mount_search;
mod other_light;
mod plane_adjustment;
mod quality;
mod residual_fit;
mod samples;
mod self_calibration;
mod sequence;
mod strobe_search;
mod tilt_search;
mod tracks;
mod unlit;
mod verdict;
mod verdict_figures;

use std::collections::BTreeMap;
use std::sync::OnceLock;

use nalgebra::Vector3;

pub use crate::solver::camera::ReadingCurve;
pub use crate::solver::terms::geometry::PLANES_AROUND_S;
pub use crate::solver::{Observation, Sample, Track};
pub use backscatter::BackscatterFit;
pub use camera_fit::{CameraFit, CameraTermsFound};
pub use dataset::Dataset;
pub use daylight::DaylightFit;
pub use exposure::FollowedSetting;
pub use matching::{Matchable, MatchedPair, matches};
pub use methods::empirical::EmpiricalFit;
pub use mount_search::MountFit;
pub use samples::{FrameSamples, coarsest_m, sample_frame};
pub use self_calibration::CameraKnown;
pub use sequence::estimate_model;
pub use strobe_search::{StrobeFit, StrobePlacement};
pub use tilt_search::TiltFit;
pub use tracks::tracks;
pub use unlit::{Unlit, two_kinds};
pub use verdict::Judgement;

use crate::config::{EstimateConfig, Estimator};
use crate::coordinates::{Body, Optical, Transform};
use crate::diagnostics::NotIdentified;
use crate::error::{Error, Result};
use crate::image::Bands;
use crate::model::{
    Backscatter, BeamGrid, BeamPattern, EstimatorAnswer, ImagingModel, ScatterTable, SpreadingModel,
};
use crate::parallel::par_map;
use crate::stats;
use crate::vehicle::Lamps;
use methods::empirical::Regions;
use methods::{Candidate, Method, altitude, joint, pairs};
use quality::identifiability::{not_identified, uncertain};

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
    /// Where no estimator answers: only an empirical model can correct the frames.
    fn without_attenuation(
        data: &Dataset<'_>,
        config: &EstimateConfig,
        answers: BTreeMap<Estimator, EstimatorAnswer>,
        reason: String,
    ) -> Self {
        let grid = BeamGrid::new(config.beam_nodes, config.beam_limit_deg);
        let spreading = SpreadingModel::of(config.spreading);
        let model = data.model([0.0; 3], spreading, BeamPattern::uniform(grid), config);
        Self {
            model,
            attenuation_std_per_m: [f64::INFINITY; 3],
            estimator: Estimator::Empirical,
            answers,
            not_identified: Some(NotIdentified::NoAnswers { reason }),
            inflation: 1.0,
        }
    }

    /// Adds errors of α (1/m) to the standard deviations.
    fn widen(&mut self, errors_per_m: &Bands) {
        let bands = self.model.bands;
        for (b, error) in errors_per_m[..bands].iter().enumerate() {
            self.attenuation_std_per_m[b] = self.attenuation_std_per_m[b].hypot(*error);
            for node in &mut self.model.over_time.0 {
                node.attenuation_std_per_m[b] = node.attenuation_std_per_m[b].hypot(*error);
            }
        }
        if let Some(answer) = self.answers.get_mut(&self.estimator) {
            answer.attenuation_std_per_m = Some(self.attenuation_std_per_m[..bands].to_vec());
        }
        let reason = uncertain(&self.attenuation_std_per_m[..bands]);
        self.not_identified = self.not_identified.take().or(reason);
    }

    /// Whether there is a model to correct frames with.
    ///
    /// # Errors
    /// [`Error::NotEstimated`] if not.
    fn ensure_corrects(&self, judgement: &Judgement) -> Result<()> {
        match &self.not_identified {
            Some(NotIdentified::NoAnswers { reason }) if judgement.empirical.is_none() => {
                Err(not_estimated(reason.clone()))
            }
            _ => Ok(()),
        }
    }

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
        let residual = OnceLock::new();
        let case =
            verdict::Case { data, regions, model, estimator, is_identified, config, residual };
        let judgement = case.judge();
        if judgement.residual.is_some() {
            // Light that the model does not explain looks like water that changes.
            self.model.over_time = Default::default();
            self.not_identified.get_or_insert(NotIdentified::LightLeft);
        }
        if judgement.empirical.is_some() {
            self.estimator = Estimator::Empirical;
            self.not_identified.get_or_insert(NotIdentified::EmpiricalBetter);
        }
        judgement
    }
}

/// Mounts as pass one needs them, and what is known of the camera.
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
    /// what is known of the camera
    pub camera: CameraKnown,
}

/// The result of pass one.
pub struct ModelEstimate {
    /// the model and its uncertainty
    pub estimate: Estimate,
    /// position of the strobe
    pub strobe: StrobePlacement,
    /// backscatter
    pub backscatter: Option<BackscatterFit>,
    /// daylight
    pub daylight: Option<DaylightFit>,
    /// recorded settings that the frames' light follows
    pub followed: Vec<FollowedSetting>,
    /// per frame and band: log of its light over that of the others, 0 but for drop-outs and what
    /// the camera did
    pub log_gains: Vec<Bands>,
    /// frames whose light stands out from their neighbours'
    pub drop_outs: usize,
    /// what was found of the camera and is applied
    pub camera: Option<CameraFit>,
    /// what was found and is not, as the settings ask
    pub reported: Option<CameraFit>,
    /// tilts of planes that were assumed level
    pub tilts: Option<TiltFit>,
    /// clock and mount of the range instrument that fit better than those given
    pub mounts: Option<MountFit>,
    /// whether they explain the log so much better that they are to be used
    pub replaces_mounts: bool,
    /// the samples that the model was estimated from: gains and backscatter removed
    pub frames: Vec<FrameSamples>,
    /// whether the correction helps, and the empirical model where another does not
    pub judgement: Judgement,
}

impl ModelEstimate {
    /// Whether residual light leaves less of the light without the camera's gains than another
    /// estimate takes these to be. Gains by a law (automatic exposure) are the camera's.
    fn needs_no_gains_of(&self, other: &Self) -> bool {
        let is_random = |c: &&CameraFit| c.found.gains && c.law.is_none();
        let gains = other.camera.as_ref().filter(is_random).map(CameraFit::common_gains);
        let size = gains.map_or(0.0, |gains| stats::robust_std(&gains));
        self.judgement.residual.as_ref().is_some_and(|fit| fit.spread < size)
    }
}

/// Frames as a given model needs them: the frames' gains and backscatter removed.
pub fn samples_for_model(
    mut frames: Vec<FrameSamples>,
    log_gains: &[Bands],
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
        let reason = no_answers(order, &answers);
        return match config.estimator {
            Estimator::Auto | Estimator::Empirical => {
                Ok(Estimate::without_attenuation(data, config, answers, reason))
            }
            _ => Err(not_estimated(reason)),
        };
    };
    // The others model neither backscatter nor drop-outs, and with many tracks the joint solve
    // fails for a reason.
    let is_fallback = config.estimator == Estimator::Auto && estimator != Estimator::Joint;
    let joint_failure = || {
        let joint = answers.get(&Estimator::Joint)?;
        joint.note.clone().filter(|_| is_fallback && data.tracks.len() >= config.least_pairs)
    };
    let not_identified = not_identified(&candidate, data, config)
        .or_else(|| joint_failure().map(|reason| NotIdentified::JointFailed { reason }))
        .or_else(|| {
            let (tracks, needed) = (data.tracks.len(), config.least_pairs);
            let is_alone = is_fallback && estimator == Estimator::Altitude;
            is_alone.then_some(NotIdentified::NoOverlap { tracks, needed })
        });
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
fn no_answers(order: &[Estimator], answers: &BTreeMap<Estimator, EstimatorAnswer>) -> String {
    let reason = |n: &Estimator| Some(format!("{}: {}", n.word(), answers.get(n)?.note.as_ref()?));
    order.iter().filter_map(reason).collect::<Vec<_>>().join("; ")
}

fn not_estimated(reason: String) -> Error {
    Error::NotEstimated {
        reason,
        remedy: "use a model from another part of the dive or from another dive of the same water \
                 and strobe: --model MODEL.json"
            .into(),
    }
}
