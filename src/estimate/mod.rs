//! Pass one: samples → imaging model (paper §IV-B, IV-C).
//!
//! Three estimators of the attenuation stand side by side and all answer where the log allows:
//! *joint* (the default), the paper's *pairs* (Eq. 16) and *altitude* slope (Fig. 6); the latter
//! two with the beam pattern from angular bins (Eq. 17), in sweeps: "we also recompute the
//! attenuation coefficients" (§IV-C). They see samples only, never a picture, so they run in
//! moments in a test. What pass two does with the model does not live here.

mod altitude_slope;
mod angular_bins;
mod backscatter;
mod candidates;
mod drift;
mod frame_gains;
mod held_out;
mod keypoints;
mod light_settings;
mod matching;
mod mount_search;
mod pairs;
mod samples;
mod strobe_search;
mod tracks;

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Vector3;

pub use crate::solver::terms::geometry::PLANES_AROUND_S;
pub use crate::solver::{Observation, Sample, Track};
pub use backscatter::BackscatterFit;
pub use light_settings::FollowedSetting;
pub use matching::{Matchable, MatchedPair, matches};
pub use mount_search::MountFit;
pub use samples::{FrameSamples, coarsest_m, samples};
pub use strobe_search::{StrobeFit, StrobePlacement};
pub use tracks::tracks;

use crate::config::{EstimateConfig, Estimator, StrobePosition, Switch};
use crate::coordinates::{Body, Optical, Transform};
use crate::diagnostics::NotIdentified;
use crate::error::{Error, Result};
use crate::geometry::LightPath;
use crate::image::Bands;
use crate::model::{
    Backscatter, BeamGrid, BeamPattern, EstimatorAnswer, ImagingModel, ScatterTable, SpreadingModel,
};
use crate::parallel::{join, par_map};
use crate::solver::{Independence, Setup};
use crate::stats;
use crate::vehicle::Lamps;
use candidates::{Candidate, EstimatorOf, by_altitude, by_joint_solve, by_pairs, not_identified};
use drift::DriftFit;
use mount_search::check_mounts;

/// The light path of an observation, for the strobe mount in hand.
pub type SamplePath<'f> = dyn Fn(&Observation) -> Option<LightPath> + 'f;

/// What pass one found.
#[derive(Clone, Debug)]
pub struct Estimate {
    /// the model
    pub model: ImagingModel,
    /// standard deviation of α [1/m]
    pub attenuation_std_per_m: Bands,
    /// which estimator's answer the model holds
    pub estimator: Estimator,
    /// every estimator's answer, by name
    pub answers: BTreeMap<Estimator, EstimatorAnswer>,
    /// why the attenuation is not identified, if it is not
    pub not_identified: Option<NotIdentified>,
    /// by how much standard deviations of the solve itself are too narrow, as all frames get some
    /// things wrong alike
    pub widened: f64,
}

/// Everything known of the log at a stage of the estimation.
#[derive(Clone, Copy)]
pub struct Dataset<'s> {
    /// samples of the frames
    pub frames: &'s [FrameSamples],
    /// points seen more than once
    pub tracks: &'s [Track],
    /// where the camera sits
    pub body_from_optical: Transform<Body, Optical>,
    /// where the light sits
    pub lamps: Lamps,
    /// whether nobody measured that: it came from these samples themselves, or is a guess
    pub strobe_is_free: bool,
    /// what the water scatters back, which has been taken off the colours, and the tracks before it
    /// was
    pub backscatter: Option<(&'s BackscatterFit, &'s [Track])>,
    /// nodes of α in time
    pub drift: Option<&'s DriftFit>,
    /// α if what the water scatters back were modelled, where it is there and is not to be [1/m]
    pub unmodelled_backscatter: Option<Bands>,
}

impl<'s> Dataset<'s> {
    fn plain(
        frames: &'s [FrameSamples],
        tracks: &'s [Track],
        body_from_optical: Transform<Body, Optical>,
        lamps: Lamps,
    ) -> Self {
        Self {
            frames,
            tracks,
            body_from_optical,
            lamps,
            strobe_is_free: false,
            backscatter: None,
            drift: None,
            unmodelled_backscatter: None,
        }
    }

    /// A sample's ray: x/z, y/z in the image plane, and ℓ_s [m].
    fn ray(&self, sample: &Sample) -> (f64, f64, f64) {
        let hit = (self.body_from_optical.inverse() * sample.hit).vector();
        (hit.x / hit.z, hit.y / hit.z, sample.seafloor_to_camera_m)
    }

    /// Moments of the frames that have pings of their own: frames nearer than [`PINGS_SHARED_S`]
    /// get the same things wrong.
    fn moments(&self) -> usize {
        self.frames
            .iter()
            .map(|f| (f.stamp.0 as f64 * 1e-9 / PINGS_SHARED_S) as i64)
            .collect::<BTreeSet<_>>()
            .len()
    }

    /// The joint solve with attenuation and beam pattern as its only unknowns.
    fn setup<'c>(&self, grid: BeamGrid, config: &'c EstimateConfig) -> Setup<'c> {
        let spreading = SpreadingModel::of(config.spreading);
        Setup {
            independence: Independence { frames: self.frames.len(), moments: self.moments() },
            bands: self.bands(),
            grid,
            spreading,
            fit_exponent: false,
            free_strobe: false,
            scatter: None,
            segments: None,
            rounds: config.rounds,
            config,
        }
    }

    fn model(
        &self,
        attenuation_per_m: Bands,
        spreading: SpreadingModel,
        beam_pattern: BeamPattern,
        config: &EstimateConfig,
    ) -> ImagingModel {
        ImagingModel {
            bands: self.bands(),
            attenuation_per_m,
            over_time: Default::default(),
            spreading,
            incidence: config.incidence,
            beam_pattern,
            backscatter: self.backscatter.map(|(fit, _)| fit.backscatter),
        }
    }

    fn path(&self, o: &Observation) -> Option<LightPath> {
        self.path_from(o, self.lamps)
    }

    fn path_from(&self, o: &Observation, lamps: Lamps) -> Option<LightPath> {
        o.sample.path(lamps)
    }

    fn bands(&self) -> usize {
        self.frames.iter().map(|f| f.bands).max().unwrap_or(1)
    }

    fn altitude_spread(&self) -> f64 {
        let altitudes: Vec<f64> = self.frames.iter().map(|f| f.camera_altitude_m).collect();
        stats::quantile(&altitudes, 0.95) / stats::quantile(&altitudes, 0.05)
    }

    fn altitude_varies(&self, config: &EstimateConfig) -> bool {
        self.altitude_spread() >= config.least_altitude_spread
    }
}

/// All that pass one makes of a log's samples.
pub struct Understood {
    /// the model and how sure it is
    pub estimate: Estimate,
    /// where the light sits
    pub strobe: StrobePlacement,
    /// what the water scatters back
    pub backscatter: Option<BackscatterFit>,
    /// settings that the frames' light follows
    pub followed: Vec<FollowedSetting>,
    /// per frame: log of its light over its neighbours', 0 but for drop-outs
    pub log_gains: Vec<f64>,
    /// what fits better than the camera's clock and the instrument's mount as given
    pub mounts: Option<MountFit>,
    /// the samples as the model saw them: evenly lit, freed of what was scattered back
    pub frames: Vec<FrameSamples>,
}

/// Times that strobe and backscatter are sought in turn: each is seen better with the other known.
const TURNS: usize = 3;
/// Frames nearer than this share their pings [s].
const PINGS_SHARED_S: f64 = 2.5;

/// Samples → model: the strobe is placed, frames lit unevenly are set right, what the water
/// scatters back is taken off, and then attenuation and beam pattern are estimated. `given` is the
/// strobe's mount, and whether it was measured; `settings` are what camera and strobe were set to,
/// each a number per frame; `instrument` is where the range instrument sits in the body [m].
///
/// # Errors
/// [`Error::NotEstimated`] where the chosen estimator, or all, cannot answer.
pub fn understand(
    mut frames: Vec<FrameSamples>,
    mut tracks: Vec<Track>,
    body_from_optical: Transform<Body, Optical>,
    given: (Lamps, bool),
    settings: &[Vec<f64>],
    instrument: Vector3<f64>,
    config: &EstimateConfig,
) -> Result<Understood> {
    let followed = light_settings::followed(&frames, &tracks, settings);
    for setting in &followed {
        let log_gain = |v: &f64| {
            setting
                .law
                .log_light(*v)
                .zip(setting.law.log_light(setting.reference))
                .map_or(0.0, |(v, r)| v - r)
        };
        let log_gains: Vec<f64> = settings[setting.index].iter().map(log_gain).collect();
        frame_gains::remove_gains(&mut frames, &mut tracks, &log_gains);
    }
    // Seen from the wrong place a frame at the dive's edge looks as if it had got another light:
    // the strobe comes first.
    let placed = |frames: &[FrameSamples], tracks: &[Track]| {
        strobe_search::place_strobe(
            &Dataset::plain(frames, tracks, body_from_optical, given.0),
            given.1,
            None,
            config,
        )
    };
    let mut strobe = placed(&frames, &tracks);
    let log_gains = frame_gains::uneven_light(
        &Dataset::plain(&frames, &tracks, body_from_optical, strobe.lamps),
        config,
    );
    if log_gains.iter().any(|g| *g != 0.0) {
        frame_gains::remove_gains(&mut frames, &mut tracks, &log_gains);
        strobe = placed(&frames, &tracks);
    }

    let lit = Dataset::plain(&frames, &tracks, body_from_optical, given.0);
    let nodes = BeamGrid::new(config.beam_nodes, config.beam_limit_deg);
    let can_tell = lit.altitude_varies(config) && tracks.len() >= config.least_pairs;
    let moves = config.strobe_position != StrobePosition::Fixed
        && (!given.1 || config.strobe_position != StrobePosition::Auto);
    let mut backscatter = None;
    let mut freed: Option<(Vec<FrameSamples>, Vec<Track>)> = None;
    let mut unmodelled = None;
    for _ in 0..TURNS {
        if !can_tell {
            break;
        }
        let placed = Dataset { lamps: strobe.lamps, ..lit };
        let Some(found) = backscatter::find(&placed, &lit.setup(nodes, config)) else {
            // What was found with the strobe elsewhere does not hold where it is now.
            (backscatter, freed) = (None, None);
            break;
        };
        if config.backscatter == Switch::Off {
            unmodelled = Some(found.attenuation_per_m);
            break;
        }
        let off = found.removed_from(&placed);
        let before = strobe.lamps.origin().vector();
        let begun = moves.then_some(strobe.lamps);
        let anew = strobe_search::place_strobe(
            &Dataset::plain(&off.0, &off.1, body_from_optical, given.0),
            given.1,
            begun,
            config,
        );
        // A place that cannot be found once more stays what it was.
        if anew.source.is_some() || strobe.source.is_none() {
            strobe = anew;
        }
        let moved = (strobe.lamps.origin().vector() - before).norm();
        (backscatter, freed) = (Some(found), Some(off));
        if moved < 0.01 {
            break;
        }
    }
    let raw_tracks = tracks;
    let (frames, tracks) = freed.unwrap_or_else(|| (frames, raw_tracks.clone()));
    let mut all = Dataset::plain(&frames, &tracks, body_from_optical, strobe.lamps);
    (all.strobe_is_free, all.backscatter) = (
        strobe.source.is_some() || (!given.1 && can_tell),
        backscatter.as_ref().map(|b| (b, raw_tracks.as_slice())),
    );
    all.unmodelled_backscatter = unmodelled;
    let estimated = || {
        let drift = if config.drift == Switch::Off || !can_tell {
            None
        } else {
            drift::find(&all, &all.setup(nodes, config))
        };
        estimate(&Dataset { drift: drift.as_ref(), ..all }, config)
    };
    let (mounts, estimate) = join(|| check_mounts(&all, instrument, config), estimated);
    let estimate = estimate?;
    if let Some(search) = strobe.search.as_mut().filter(|_| strobe.source.is_some()) {
        search.std_m = search.std_m.map(|std| std * estimate.widened);
    }
    let backscatter = backscatter.map(|mut found| {
        found.backscatter = estimate.model.backscatter.unwrap_or(found.backscatter);
        found
    });
    Ok(Understood { estimate, strobe, backscatter, followed, log_gains, mounts, frames })
}

/// Frames as a model that is given takes them: their light set right by `log_gains`, and freed of
/// what is scattered back.
pub fn as_modelled(
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
    let nodes = BeamGrid::new(config.beam_nodes, config.beam_limit_deg);
    let mut found: BTreeMap<Estimator, Candidate> = BTreeMap::new();
    let mut answers = BTreeMap::new();
    let estimators: [(Estimator, EstimatorOf); 3] = [
        (Estimator::Joint, by_joint_solve),
        (Estimator::Pairs, by_pairs),
        (Estimator::Altitude, by_altitude),
    ];
    let said: Vec<_> = par_map(estimators.to_vec(), |(name, run)| (name, run(data, nodes, config)));
    for (name, said) in said {
        match said {
            Ok(mut candidate) => {
                // The paper's estimators take the seafloor's own pattern for the beam's: the joint
                // solve shows by how much.
                if let Some(joint) = answers.get(&Estimator::Joint) {
                    candidate.less_sure_by(joint);
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
        Estimator::Auto => &[Estimator::Joint, Estimator::Pairs, Estimator::Altitude],
        one => std::slice::from_ref(one),
    };
    let chosen = order.iter().find_map(|name| found.remove_entry(name));
    let Some((estimator, candidate)) = chosen else {
        let reason = order
            .iter()
            .filter_map(|n| Some(format!("{}: {}", n.word(), answers.get(n)?.note.as_ref()?)))
            .collect::<Vec<_>>()
            .join("; ");
        let remedy = "use a model from another stretch or dive of the same water and strobe: \
                      --model MODEL.json"
            .into();
        return Err(Error::NotEstimated { reason, remedy });
    };
    // The others know of neither scattered light nor drop-outs, and where points abound the joint
    // solve fails for a reason.
    let without_joint = || {
        let joint = answers.get(&Estimator::Joint)?;
        joint.note.clone().filter(|_| data.tracks.len() >= config.least_pairs)
    };
    let stands_in = if config.estimator == Estimator::Auto && estimator != Estimator::Joint {
        without_joint()
    } else {
        None
    };
    let not_identified = not_identified(&candidate, data, config)
        .or(stands_in.map(|reason| NotIdentified::JointFailed { reason }));
    Ok(Estimate {
        model: candidate.model,
        attenuation_std_per_m: candidate.std_per_m,
        estimator,
        answers,
        not_identified,
        widened: candidate.widened,
    })
}
