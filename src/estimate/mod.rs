//! Pass one: samples → imaging model (paper §IV-B, IV-C).
//!
//! Three estimators of the attenuation stand side by side and all answer where the log allows: *joint* (the
//! default), the paper's *pairs* (Eq. 16) and *altitude* slope (Fig. 6); the latter two with the beam pattern from
//! angular bins (Eq. 17), in sweeps: "we also recompute the attenuation coefficients" (§IV-C). They see samples
//! only, never a picture, so they run in moments in a test. What pass two does with the model does not live here.

mod altitude_slope;
mod angular_bins;
mod frame_gains;
mod joint;
mod keypoints;
mod matching;
mod pairs;
pub mod robust;
mod samples;
mod strobe_search;
mod tracks;

use std::collections::BTreeMap;

pub use matching::{Matchable, MatchedPair, matches};
pub use samples::{FrameSamples, Sight, samples};
pub use strobe_search::{FoundStrobe, search_strobe};
pub use tracks::{Observation, Track, tracks};

use crate::config::{EstimateConfig, Estimator, Spreading, StrobePosition};
use crate::error::{Error, Result};
use crate::geometry::LightPath;
use crate::image::Bands;
use crate::model::{BeamPattern, EstimatorAnswer, ImagingModel, Nodes, SpreadingModel, log_geometry};
use crate::spaces::{Body, Strobe, Transform};

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
    pub estimator: &'static str,
    /// every estimator's answer, by name
    pub answers: BTreeMap<String, EstimatorAnswer>,
    /// why the attenuation is not identified, if it is not
    pub not_identified_because: Option<String>,
}

/// Everything known of the log when estimation begins.
pub struct Samples<'s> {
    /// samples of the frames
    pub frames: &'s [FrameSamples],
    /// points seen more than once
    pub tracks: &'s [Track],
    /// where the light sits
    pub body_from_strobe: Transform<Body, Strobe>,
    /// whether that came from these samples themselves
    pub strobe_is_found: bool,
}

impl Samples<'_> {
    fn path(&self, o: &Observation) -> Option<LightPath> {
        self.path_from(o, self.body_from_strobe)
    }

    fn path_from(&self, o: &Observation, body_from_strobe: Transform<Body, Strobe>) -> Option<LightPath> {
        o.sight.path(self.frames.get(o.frame as usize)?.normal, body_from_strobe)
    }

    fn bands(&self) -> usize {
        self.frames.iter().map(|f| f.bands).max().unwrap_or(1)
    }

    fn altitude_spread(&self) -> f64 {
        let altitudes: Vec<f64> = self.frames.iter().map(|f| f.camera_altitude_m).collect();
        robust::quantile(&altitudes, 0.95) / robust::quantile(&altitudes, 0.05)
    }

    fn altitude_varies(&self, config: &EstimateConfig) -> bool {
        self.altitude_spread() >= config.least_altitude_spread
    }
}

/// Runs the estimators and chooses among them.
///
/// # Errors
/// [`Error::NotEstimated`] where the chosen one, or all, cannot answer.
pub fn estimate(samples: &Samples<'_>, config: &EstimateConfig) -> Result<Estimate> {
    let nodes = Nodes::new(config.beam_nodes, config.beam_limit_deg);
    let mut found: BTreeMap<&'static str, Candidate> = BTreeMap::new();
    let mut answers = BTreeMap::new();
    let estimators: [(&str, EstimatorOf); 3] = [("joint", by_joint_solve), ("pairs", by_pairs), ("altitude", by_altitude)];
    for (name, run) in estimators {
        match run(samples, nodes, config) {
            Ok(candidate) => {
                answers.insert(name.into(), candidate.answer.clone());
                found.insert(name, candidate);
            }
            Err(note) => {
                answers.insert(name.into(), EstimatorAnswer { note: Some(note), ..EstimatorAnswer::default() });
            }
        }
    }
    let order: &[&'static str] = match config.estimator {
        Estimator::Auto => &["joint", "pairs", "altitude"],
        Estimator::Joint => &["joint"],
        Estimator::Pairs => &["pairs"],
        Estimator::Altitude => &["altitude"],
    };
    let chosen = order.iter().find_map(|name| found.remove_entry(name));
    let Some((estimator, candidate)) = chosen else {
        let reason = order.iter().filter_map(|n| Some(format!("{n}: {}", answers.get(*n)?.note.as_ref()?))).collect::<Vec<_>>().join("; ");
        let remedy = "use a model from another stretch or dive of the same water and strobe: --model MODEL.json".into();
        return Err(Error::NotEstimated { reason, remedy });
    };
    let not_identified_because = not_identified(&candidate, samples, config);
    Ok(Estimate { model: candidate.model, attenuation_std_per_m: candidate.std_per_m, estimator, answers, not_identified_because })
}

/// Where the light is taken to sit, and how that came about.
#[derive(Clone, Debug)]
pub struct PlacedStrobe {
    /// its mount
    pub body_from_strobe: Transform<Body, Strobe>,
    /// `found` or `refined`, where it was searched for and taken
    pub source: Option<&'static str>,
    /// the search, where there was one
    pub search: Option<FoundStrobe>,
    /// what the user must know
    pub warning: Option<String>,
}

/// Log gains of the frames that got another amount of light than their neighbours; 0 for all others.
///
/// Where frames do not overlap there is no telling, and all are 0.
pub fn uneven_light(samples: &Samples<'_>, config: &EstimateConfig) -> Vec<f64> {
    let none = vec![0.0; samples.frames.len()];
    let quick = EstimateConfig {
        rounds: 6,
        spreading: if config.spreading == Spreading::Fit { Spreading::Strobe } else { config.spreading },
        ..config.clone()
    };
    match by_joint_solve(samples, Nodes::new(config.beam_nodes, config.beam_limit_deg), &quick) {
        Ok(candidate) => frame_gains::frame_gains(samples, &candidate.model),
        Err(_) => none,
    }
}

/// Takes gains out of the samples, so that all frames are lit alike.
pub fn set_right(frames: &mut [FrameSamples], tracks: &mut [Track], log_gains: &[f64]) {
    for (frame, gain) in frames.iter_mut().zip(log_gains).filter(|(_, g)| **g != 0.0) {
        frame.grid.iter_mut().for_each(|(_, sight)| sight.log_color.iter_mut().for_each(|v| *v -= *gain as f32));
        frame.mean_light.iter_mut().for_each(|v| *v /= gain.exp());
    }
    for o in tracks.iter_mut().flatten() {
        let gain = log_gains[o.frame as usize] as f32;
        o.sight.log_color.iter_mut().for_each(|v| *v -= gain);
    }
}

/// A place that moved less than this, or less than three standard deviations, does not contradict the given one [m].
const CONTRADICTION_M: f64 = 0.06;
/// A place less sure than this is not found [m].
const UNSURE_M: f64 = 0.15;

/// Finds, refines or checks the strobe's place. `is_known` says whether `samples.body_from_strobe` is a measured pose;
/// where it is not, it is the camera's.
pub fn place_strobe(samples: &Samples<'_>, is_known: bool, config: &EstimateConfig) -> PlacedStrobe {
    let start = samples.body_from_strobe;
    let kept = |warning: Option<String>, search| PlacedStrobe { body_from_strobe: start, source: None, search, warning };
    let choice = match (config.strobe_position, is_known) {
        (StrobePosition::Auto, false) => StrobePosition::Find,
        (chosen, _) => chosen,
    };
    let at_camera = "where the strobe sits is not known, and the log cannot tell: the light is taken to sit at the camera, which biases attenuation; write [strobe.mount] into a rig file";
    let unknown = || (!is_known).then(|| String::from(at_camera));
    // From one height the pattern takes up any place of the strobe.
    let cannot_tell = samples.tracks.len() < config.least_pairs || !samples.altitude_varies(config);
    if choice == StrobePosition::Fixed || cannot_tell {
        return kept(unknown(), None);
    }
    // Fewer rounds hold three numbers as well. A coarser pattern does not: its edges pull the place by centimetres.
    let nodes = Nodes::new(config.beam_nodes, config.beam_limit_deg);
    let spreading = SpreadingModel::of(config.spreading);
    let setting = joint::Setting {
        frames: samples.frames.len(),
        bands: samples.bands(),
        nodes,
        spreading,
        fit_exponent: false,
        free_strobe: false,
        rounds: 5,
        config,
    };
    let found = search_strobe(samples.tracks, &setting, start, choice == StrobePosition::Find, &|o, mount| samples.path_from(o, mount));
    let Some(found) = found else { return kept(unknown(), None) };
    let std = found.std_m.iter().map(|s| s * s).sum::<f64>().sqrt();
    let is_sure = std.is_finite() && std < UNSURE_M;
    let take = |source| PlacedStrobe { body_from_strobe: found.body_from_strobe, source: Some(source), search: Some(found.clone()), warning: None };
    match choice {
        StrobePosition::Find if is_sure => take("found"),
        StrobePosition::Refine if is_sure => take("refined"),
        StrobePosition::Find | StrobePosition::Refine => kept(unknown(), Some(found)),
        _ if is_sure && found.moved_m > CONTRADICTION_M.max(3.0 * std) && found.residual[1] < 0.9 * found.residual[0] => {
            let p = found.body_from_strobe.origin().vector();
            let sentence = format!(
                "the log contradicts the strobe's given place: it fits better {:.2} m away, at [{:.3}, {:.3}, {:.3}] in the vehicle (± {std:.3} m; residual {:.4} instead of {:.4}); use it with --strobe-position refine",
                found.moved_m, p.x, p.y, p.z, found.residual[1], found.residual[0]
            );
            kept(Some(sentence), Some(found))
        }
        _ => kept(None, Some(found)),
    }
}

/// Samples and grid → an answer, or a sentence why there is none.
type EstimatorOf = fn(&Samples<'_>, Nodes, &EstimateConfig) -> std::result::Result<Candidate, String>;

/// One estimator's answer, ready to be the model.
struct Candidate {
    model: ImagingModel,
    std_per_m: Bands,
    answer: EstimatorAnswer,
    path_spread_m: Option<f64>,
    /// α and its standard deviation from the lower half of the frames [1/m]
    low: Option<(Bands, Bands)>,
}

impl Candidate {
    fn new(model: ImagingModel, std_per_m: Bands, observations: usize, residual: f64, details: &[(&str, f64)]) -> Self {
        let bands = model.bands;
        let answer = EstimatorAnswer {
            attenuation_per_m: Some(model.attenuation_per_m[..bands].to_vec()),
            attenuation_std_per_m: Some(std_per_m[..bands].to_vec()),
            observations,
            residual: Some(residual),
            details: details.iter().map(|(k, v)| (String::from(*k), *v)).collect(),
            note: None,
        };
        Self { model, std_per_m, answer, path_spread_m: None, low: None }
    }
}

fn by_joint_solve(samples: &Samples<'_>, nodes: Nodes, config: &EstimateConfig) -> std::result::Result<Candidate, String> {
    if samples.tracks.len() < config.least_pairs {
        return Err(format!("{} points seen more than once; {} are needed", samples.tracks.len(), config.least_pairs));
    }
    let spreading = SpreadingModel::of(config.spreading);
    let bands = samples.bands();
    let fit = config.spreading == Spreading::Fit;
    let setting = joint::Setting {
        frames: samples.frames.len(),
        bands,
        nodes,
        spreading,
        fit_exponent: fit,
        free_strobe: samples.strobe_is_found,
        rounds: config.rounds,
        config,
    };
    let answer = joint::solve(samples.tracks, &setting, samples.body_from_strobe, &|o, mount| samples.path_from(o, mount))
        .ok_or("the points seen more than once do not hold the unknowns")?;
    let spreading = SpreadingModel { strobe_leg: answer.exponent.map_or(spreading.strobe_leg, |e| e.0), ..spreading };
    let beam_pattern = completed(&answer.beam, samples, nodes, &answer.attenuation_per_m, spreading, config);
    let model = ImagingModel { bands, attenuation_per_m: answer.attenuation_per_m, spreading, incidence: config.incidence, beam_pattern };
    let mut details = vec![("tracks", answer.tracks as f64), ("path_spread_m", answer.path_spread_m)];
    if bands == 3 {
        details.push(("red_minus_green_std_per_m", answer.difference_std_per_m[0]));
        details.push(("green_minus_blue_std_per_m", answer.difference_std_per_m[1]));
    }
    if let Some((exponent, std)) = answer.exponent {
        details.extend([("spreading_exponent", exponent), ("spreading_exponent_std", std)]);
    }
    let low = low_answer(samples, &setting);
    if let Some(low) = &low {
        let names = ["low_frames_red_per_m", "low_frames_green_per_m", "low_frames_blue_per_m"];
        details.extend(names.iter().zip(low.attenuation_per_m).take(bands).map(|(n, v)| (*n, v)));
    }
    let candidate = Candidate::new(model, answer.std_per_m, answer.observations, answer.residual, &details);
    Ok(Candidate { path_spread_m: Some(answer.path_spread_m), low: low.map(|l| (l.attenuation_per_m, l.std_per_m)), ..candidate })
}

/// The same solve on the lower half of the frames alone: what scatters back grows with height, and so the two part.
fn low_answer(samples: &Samples<'_>, setting: &joint::Setting<'_>) -> Option<joint::JointAnswer> {
    let altitudes: Vec<f64> = samples.frames.iter().map(|f| f.camera_altitude_m).collect();
    let middle = robust::median(&altitudes);
    let low: Vec<Track> = samples
        .tracks
        .iter()
        .map(|t| t.iter().copied().filter(|o| samples.frames.get(o.frame as usize).is_some_and(|f| f.camera_altitude_m <= middle)).collect())
        .filter(|t: &Track| t.len() >= 2)
        .collect();
    joint::solve(&low, setting, samples.body_from_strobe, &|o, mount| samples.path_from(o, mount))
}

/// The solve's beam pattern, with directions that no track saw from Eq. 17, set level where both are known.
fn completed(
    beam: &[Option<f64>],
    samples: &Samples<'_>,
    nodes: Nodes,
    alpha: &Bands,
    spreading: SpreadingModel,
    config: &EstimateConfig,
) -> BeamPattern {
    let bins =
        angular_bins::beam_pattern(samples.frames, nodes, alpha, spreading, config.incidence, &|f, s| s.path(f.normal, samples.body_from_strobe))
            .by_node();
    let steps: Vec<f64> = beam.iter().zip(&bins).filter_map(|(a, b)| Some((*a)? - (*b)?)).collect();
    let level = robust::median(&steps);
    let values: Vec<Option<f64>> = beam.iter().zip(&bins).map(|(a, b)| a.or(b.map(|b| b + level).filter(|v| v.is_finite()))).collect();
    BeamPattern::from_nodes(nodes, &values)
}

fn by_pairs(samples: &Samples<'_>, nodes: Nodes, config: &EstimateConfig) -> std::result::Result<Candidate, String> {
    if samples.tracks.len() < config.least_pairs {
        return Err(format!("{} points seen more than once; {} are needed", samples.tracks.len(), config.least_pairs));
    }
    let (spreading, bands) = (SpreadingModel::of(config.spreading), samples.bands());
    let mut beam_pattern = BeamPattern::uniform(nodes); // "assume BP ≈ 1", §IV-B
    let path = |o: &Observation| samples.path(o);
    let pairs = |beam: &BeamPattern| {
        let known = |p: &LightPath| log_geometry(spreading, config.incidence, p) + beam.log_gain(p.angles);
        pairs::attenuation(samples.tracks, bands, config.attenuation_floor_per_m, &path, &known)
            .ok_or_else(|| String::from("path lengths do not differ within the pairs"))
    };
    let first = pairs(&beam_pattern)?;
    let mut answer = first.clone();
    for _ in 0..config.sweeps {
        let before = answer.attenuation_per_m;
        beam_pattern = angular_bins::beam_pattern(samples.frames, nodes, &before, spreading, config.incidence, &|f, s| {
            s.path(f.normal, samples.body_from_strobe)
        }); // Eq. 17
        answer = pairs(&beam_pattern)?; // "we also recompute", §IV-C
        if settled(&before, &answer.attenuation_per_m) {
            break;
        }
    }
    let used = answer.by_image.len() as f64;
    let mut details = vec![("images", used)];
    let names = ["before_beam_pattern_red_per_m", "before_beam_pattern_green_per_m", "before_beam_pattern_blue_per_m"];
    details.extend(names.iter().zip(first.attenuation_per_m).take(bands).map(|(n, v)| (*n, v)));
    let model = ImagingModel { bands, attenuation_per_m: answer.attenuation_per_m, spreading, incidence: config.incidence, beam_pattern };
    Ok(Candidate::new(model, answer.std_per_m, answer.pairs, answer.residual, &details))
}

fn by_altitude(samples: &Samples<'_>, nodes: Nodes, config: &EstimateConfig) -> std::result::Result<Candidate, String> {
    let spread = samples.altitude_spread();
    if samples.frames.len() < 5 || !samples.altitude_varies(config) {
        return Err(format!(
            "the highest altitude is {spread:.2} times the lowest over {} frames; {:.2} times is needed",
            samples.frames.len(),
            config.least_altitude_spread
        ));
    }
    let (spreading, bands) = (SpreadingModel::of(config.spreading), samples.bands());
    let mut beam_pattern = BeamPattern::uniform(nodes);
    let path = |f: &FrameSamples, s: &Sight| s.path(f.normal, samples.body_from_strobe);
    let slope = |beam: &BeamPattern| {
        let known = |p: &LightPath| log_geometry(spreading, config.incidence, p) + beam.log_gain(p.angles);
        altitude_slope::attenuation(samples.frames, bands, &path, &known)
            .ok_or_else(|| String::from("too few frames share a part of the picture that is lit"))
    };
    let mut answer = slope(&beam_pattern)?;
    for _ in 0..config.sweeps {
        let before = answer.attenuation_per_m;
        beam_pattern = angular_bins::beam_pattern(samples.frames, nodes, &before, spreading, config.incidence, &path);
        answer = slope(&beam_pattern)?;
        if settled(&before, &answer.attenuation_per_m) {
            break;
        }
    }
    let mut details = vec![("altitude_spread", spread), ("farthest_m", answer.farthest_m)];
    let names = ["channel_means_red_per_m", "channel_means_green_per_m", "channel_means_blue_per_m"];
    details.extend(names.iter().zip(answer.effective_by_channel_means_per_m).take(bands).map(|(n, v)| (*n, v)));
    let model = ImagingModel { bands, attenuation_per_m: answer.attenuation_per_m, spreading, incidence: config.incidence, beam_pattern };
    Ok(Candidate::new(model, answer.std_per_m, answer.observations, answer.residual, &details))
}

fn settled(before: &Bands, after: &Bands) -> bool {
    before.iter().zip(after).all(|(a, b)| (a - b).abs() < 1e-4)
}

/// α of the lower half of the frames may differ from that of all by this much, whatever the noise says [1/m].
const LEAST_PARTING_PER_M: f64 = 0.03;

/// Why the number cannot be trusted, if it cannot.
fn not_identified(candidate: &Candidate, samples: &Samples<'_>, config: &EstimateConfig) -> Option<String> {
    let model = &candidate.model;
    let spread = samples.altitude_spread();
    let worst = candidate.std_per_m[..model.bands].iter().copied().fold(0.0, f64::max);
    let least = model.attenuation_per_m[..model.bands].iter().copied().fold(f64::INFINITY, f64::min);
    if !samples.altitude_varies(config) {
        return Some(format!("altitude hardly varies (the highest is {spread:.2} times the lowest)"));
    }
    if candidate.path_spread_m.is_some_and(|p| p < 0.05) {
        return Some(format!(
            "points are seen from nearly the same distance (path lengths differ by {:.3} m)",
            candidate.path_spread_m.unwrap_or_default()
        ));
    }
    if let Some((low, low_std)) = &candidate.low {
        for b in 0..model.bands {
            let (all, std) = (model.attenuation_per_m[b], candidate.std_per_m[b].hypot(low_std[b]));
            if (low[b] - all).abs() > LEAST_PARTING_PER_M.max(4.0 * std) {
                return Some(format!(
                    "the lower half of the frames alone says {:.3} per metre where all say {all:.3}: light that the water scatters back is not modelled, or the light changed",
                    low[b]
                ));
            }
        }
    }
    if least <= 0.0 {
        return Some(format!("an attenuation of {least:.3} per metre is not physical: altitude and light cannot be told apart in this log"));
    }
    (worst > 0.08).then(|| format!("the estimate is uncertain by {worst:.2} per metre"))
}
