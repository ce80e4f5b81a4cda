//! The estimators' answers, each ready to be the model, and whether the chosen one can be trusted.

use super::Dataset;
use super::altitude_slope;
use super::angular_bins;
use super::pairs;
use super::samples::FrameSamples;

use crate::config::{EstimateConfig, Spreading};
use crate::diagnostics::{NoAnswer, NotIdentified};
use crate::geometry::LightPath;
use crate::image::Bands;
use crate::model::{
    AttenuationOverTime, BeamGrid, BeamPattern, EstimatorAnswer, ImageAnswer, ImagingModel,
    Removal, ScatterIntegral, SpreadingModel, TimeNode,
};
use crate::solver::{
    JointAnswer, Observation, Sample, ScatterOf, Setup, Track, sample_path, solve,
};
use crate::stats;
use crate::units::Stamp;

/// Samples and grid → an answer, or why there is none.
pub type EstimatorOf = fn(&Dataset<'_>, BeamGrid, &EstimateConfig) -> Result<Candidate, NoAnswer>;

/// One estimator's answer, ready to be the model.
pub struct Candidate {
    pub model: ImagingModel,
    pub std_per_m: Bands,
    pub answer: EstimatorAnswer,
    path_spread_m: Option<f64>,
    /// by how much what all frames get wrong alike widens the standard deviations, at most
    pub widened: f64,
    /// α and its standard deviation from the lower half of the frames [1/m]
    low: Option<(Bands, Bands)>,
}

impl Candidate {
    /// Less sure by what another answer, which knows more, says else.
    pub fn less_sure_by(&mut self, other: &EstimatorAnswer) {
        let (Some(alpha), Some(std)) = (&other.attenuation_per_m, &other.attenuation_std_per_m)
        else {
            return;
        };
        for (b, (alpha, std)) in alpha.iter().zip(std).enumerate() {
            self.std_per_m[b] =
                self.std_per_m[b].hypot(self.model.attenuation_per_m[b] - alpha).hypot(*std);
        }
        self.answer.attenuation_std_per_m = Some(self.std_per_m[..self.model.bands].to_vec());
    }

    fn new(
        model: ImagingModel,
        std_per_m: Bands,
        observations: usize,
        residual: f64,
        details: &[(&str, f64)],
    ) -> Self {
        let bands = model.bands;
        let answer = EstimatorAnswer {
            attenuation_per_m: Some(model.attenuation_per_m[..bands].to_vec()),
            attenuation_std_per_m: Some(std_per_m[..bands].to_vec()),
            observations,
            residual: Some(residual),
            details: details.iter().map(|(k, v)| (String::from(*k), *v)).collect(),
            ..EstimatorAnswer::default()
        };
        Self { model, std_per_m, answer, path_spread_m: None, widened: 1.0, low: None }
    }
}

/// Planes, attitudes and the beam's grid make light wrong by this much, alike in all points of a
/// few seconds: no spread within a log shows it, and it turns into α by how far path lengths
/// spread. By rendered dives [log light].
const COMMON_LOG_ERROR: f64 = 0.004;
/// The same where the ground's relief is followed: heights between the hits are guessed, and ridges
/// come out too gentle.
const RELIEF_LOG_ERROR: f64 = 0.011;
/// An 8-bit picture's mean may be off by this part of a code, and a JPEG's is: what its colours are
/// rounded to is seldom even. Bright light hardly feels it, dark light does.
const COMMON_CODE_ERROR: f64 = 0.1;
/// Rounds of a solve of which only the size of a difference is wanted.
const FEW_ROUNDS: usize = 4;
/// What the form of scattered light may be wrong by, as a share of what it does to α.
const SCATTERING_FORM_ERROR: f64 = 0.1;

/// What α and its differences between bands may be wrong by in a whole log alike [1/m].
fn common_errors(
    data: &Dataset<'_>,
    without_backscatter: Option<Bands>,
    alpha: &Bands,
) -> (Bands, [f64; 2]) {
    let by_codes: Bands =
        std::array::from_fn(|b| if b < data.bands() { code_error_per_m(data, b) } else { 0.0 });
    let by_backscatter: Bands = std::array::from_fn(|b| {
        without_backscatter.map_or(0.0, |w| SCATTERING_FORM_ERROR * (w[b] - alpha[b]))
    });
    let by_geometry = geometry_error_per_m(data);
    let of_band = |b: usize| by_geometry.hypot(by_codes[b]).hypot(by_backscatter[b]);
    // It is nearly the same for all bands.
    let between = |b: usize| {
        (by_geometry / 2.0)
            .hypot(by_codes[b])
            .hypot(by_codes[b + 1])
            .hypot(by_backscatter[b] - by_backscatter[b + 1])
    };
    (std::array::from_fn(of_band), std::array::from_fn(between))
}

/// Errors of so many independent moments, over so wide a spread of path lengths, as an error of α
/// [1/m].
fn geometry_error_per_m(data: &Dataset<'_>) -> f64 {
    let altitudes = || data.frames.iter().map(|f| f.camera_altitude_m);
    let n = data.frames.len().max(1) as f64;
    let mean = altitudes().sum::<f64>() / n;
    // Down and up again.
    let path_std_m = 2.0 * (altitudes().map(|h| (h - mean).powi(2)).sum::<f64>() / n).sqrt();
    let follows_relief =
        |f: &FrameSamples| f.grid.iter().any(|(_, sample)| sample.normal != f.normal);
    let log_error =
        if data.frames.iter().any(follows_relief) { RELIEF_LOG_ERROR } else { COMMON_LOG_ERROR };
    log_error / (path_std_m * (data.moments() as f64).sqrt()).max(1e-9)
}

/// Slope over path length of what a part of a code is in log light: α takes it up [1/m].
fn code_error_per_m(data: &Dataset<'_>, band: usize) -> f64 {
    // The sRGB curve, which is near any gamma: light ∝ code^2.4.
    let log_light = |o: &Observation| {
        COMMON_CODE_ERROR * 2.4 / (255.0 * 1.055)
            * (-f64::from(o.sample.log_color[band]) / 2.4).exp()
    };
    let tracks = data.backscatter.map_or(data.tracks, |(_, raw)| raw);
    let coded = tracks
        .iter()
        .flatten()
        .filter(|o| data.frames.get(o.frame as usize).is_some_and(|f| f.eight_bit));
    let points = coded.filter_map(|o| Some((data.path(o)?.length_m(), log_light(o))));
    let (n, sum_l, sum_e, sum_ll, sum_le) = points
        .fold((0.0, 0.0, 0.0, 0.0, 0.0), |(n, l, e, ll, le), (x, y)| {
            (n + 1.0, l + x, e + y, ll + x * x, le + x * y)
        });
    let variance = sum_ll - sum_l * sum_l / f64::max(n, 1.0);
    if variance > 0.0 { ((sum_le - sum_l * sum_e / n) / variance).abs() } else { 0.0 }
}

pub fn by_joint_solve(
    data: &Dataset<'_>,
    nodes: BeamGrid,
    config: &EstimateConfig,
) -> Result<Candidate, NoAnswer> {
    enough_tracks(data, config)?;
    let spreading = SpreadingModel::of(config.spreading);
    let bands = data.bands();
    let fit = config.spreading == Spreading::Fit;
    let scatter_of = |o: &Observation| {
        data.backscatter.map_or(ScatterIntegral::default(), |(fit, _)| fit.scatter(data, &o.sample))
    };
    let tracks = data.backscatter.map_or(data.tracks, |(_, raw)| raw);
    let setup = Setup {
        scatter: data.backscatter.map(|(fit, _)| (&fit.backscatter, &scatter_of as &ScatterOf<'_>)),
        segments: data.drift.map(|d| &d.grid),
        fit_exponent: fit,
        free_strobe: data.strobe_is_free,
        ..data.setup(nodes, config)
    };
    let mut answer =
        solve(tracks, &setup, data.lamps, &sample_path).ok_or(NoAnswer::Undetermined)?;
    let plain = Setup { scatter: None, rounds: FEW_ROUNDS, ..setup };
    let without_backscatter =
        setup.scatter.and_then(|_| solve(tracks, &plain, data.lamps, &sample_path));
    let (common, between) = common_errors(
        data,
        without_backscatter.map(|a| a.attenuation_per_m),
        &answer.attenuation_per_m,
    );
    let less_sure = less_sure_by(data, tracks, &setup, &answer.std_per_m);
    let alone = answer.std_per_m;
    for b in 0..bands {
        let common = less_sure[b] * common[b];
        answer.std_per_m[b] = answer.std_per_m[b].hypot(common);
        answer.over_time.iter_mut().for_each(|(_, std)| std[b] = std[b].hypot(common));
    }
    let widened = (0..bands).map(|b| answer.std_per_m[b] / alone[b].max(1e-12)).fold(1.0, f64::max);
    answer
        .difference_std_per_m
        .iter_mut()
        .zip(between)
        .for_each(|(s, common)| *s = s.hypot(common));
    let spreading = SpreadingModel {
        strobe_leg: answer.exponent.map_or(spreading.strobe_leg, |e| e.0),
        ..spreading
    };
    let beam_pattern = completed(&answer.beam, data, &answer.attenuation_per_m, spreading, config);
    let over_time = data.drift.map(|d| {
        let node = |(stamp, (alpha, std)): (&Stamp, &(Bands, Bands))| TimeNode {
            stamp_ns: stamp.0,
            attenuation_per_m: alpha[..bands].to_vec(),
            attenuation_std_per_m: std[..bands].to_vec(),
        };
        AttenuationOverTime(d.stamps.iter().zip(&answer.over_time).map(node).collect())
    });
    let backscatter = answer.backscatter.map(|b| b.0);
    let model = ImagingModel {
        over_time: over_time.unwrap_or_default(),
        backscatter,
        ..data.model(answer.attenuation_per_m, spreading, beam_pattern, config)
    };
    let apart = |t: &Track| {
        t.iter().map(|o| o.frame).max().unwrap_or(0) - t.iter().map(|o| o.frame).min().unwrap_or(0)
    };
    let farthest = tracks.iter().map(apart).max().unwrap_or(0);
    let mut details = vec![
        ("tracks", answer.tracks as f64),
        ("longest_track_frames", f64::from(farthest)),
        ("path_spread_m", answer.path_spread_m),
    ];
    if bands == 3 {
        details.push(("red_minus_green_std_per_m", answer.difference_std_per_m[0]));
        details.push(("green_minus_blue_std_per_m", answer.difference_std_per_m[1]));
    }
    if let Some((exponent, std)) = answer.exponent {
        details
            .extend([("spreading_exponent", exponent), ("spreading_exponent_std", std * widened)]);
    }
    let low = low_answer(data, tracks, &setup);
    if let Some(low) = &low {
        let names = ["low_frames_red_per_m", "low_frames_green_per_m", "low_frames_blue_per_m"];
        details.extend(names.iter().zip(low.attenuation_per_m).take(bands).map(|(n, v)| (*n, v)));
    }
    let candidate =
        Candidate::new(model, answer.std_per_m, answer.observations, answer.residual, &details);
    Ok(Candidate {
        path_spread_m: Some(answer.path_spread_m),
        widened,
        low: low.map(|l| (l.attenuation_per_m, l.std_per_m)),
        ..candidate
    })
}

/// What all frames get wrong alike goes with height, as exponent and place do, and so is mistaken
/// for them more easily than what each gets wrong by itself; by rendered dives.
const ALIKE_OVER_SINGLY: f64 = 2.0;

/// With the exponent or the strobe's place free, α is less sure by this factor: of what frames get
/// wrong singly, as the solve itself says, and more so of what all get wrong alike.
fn less_sure_by(
    data: &Dataset<'_>,
    tracks: &[Track],
    setup: &Setup<'_>,
    std_per_m: &Bands,
) -> Bands {
    let held = Setup { fit_exponent: false, free_strobe: false, rounds: FEW_ROUNDS, ..*setup };
    let is_free = setup.fit_exponent || setup.free_strobe;
    let with_held = if is_free { solve(tracks, &held, data.lamps, &sample_path) } else { None };
    std::array::from_fn(|b| {
        with_held
            .as_ref()
            .map_or(1.0, |h| ALIKE_OVER_SINGLY * (std_per_m[b] / h.std_per_m[b]).max(1.0))
    })
}

/// The same solve on the lower half of the frames alone: what scatters back grows with height, and
/// so the two part.
fn low_answer(data: &Dataset<'_>, tracks: &[Track], setup: &Setup<'_>) -> Option<JointAnswer> {
    let altitudes: Vec<f64> = data.frames.iter().map(|f| f.camera_altitude_m).collect();
    let middle = stats::median(&altitudes);
    let low: Vec<Track> = tracks
        .iter()
        .map(|t| {
            t.iter()
                .copied()
                .filter(|o| {
                    data.frames.get(o.frame as usize).is_some_and(|f| f.camera_altitude_m <= middle)
                })
                .collect()
        })
        .filter(|t: &Track| t.len() >= 2)
        .collect();
    solve(&low, setup, data.lamps, &sample_path)
}

/// The solve's beam pattern, with directions that no track saw from Eq. 17, set level where both
/// are known.
pub fn completed(
    beam: &[Option<f64>],
    data: &Dataset<'_>,
    alpha: &Bands,
    spreading: SpreadingModel,
    config: &EstimateConfig,
) -> BeamPattern {
    let nodes = BeamGrid::new(config.beam_nodes, config.beam_limit_deg);
    if data.lamps.lamps().len() > 1 {
        return BeamPattern::from_nodes(nodes, beam);
    }
    let model = data.model(*alpha, spreading, BeamPattern::uniform(nodes), config);
    let bins =
        angular_bins::beam_pattern(data.frames, &model, nodes, &|s| s.path(data.lamps)).by_node();
    let steps: Vec<f64> = beam.iter().zip(&bins).filter_map(|(a, b)| Some((*a)? - (*b)?)).collect();
    let level = stats::median(&steps);
    let values: Vec<Option<f64>> = beam
        .iter()
        .zip(&bins)
        .map(|(a, b)| a.or(b.map(|b| b + level).filter(|v| v.is_finite())))
        .collect();
    BeamPattern::from_nodes(nodes, &values)
}

/// Eq. 16 and 17 know one strobe.
fn one_lamp(data: &Dataset<'_>) -> Result<(), NoAnswer> {
    if data.lamps.lamps().len() == 1 { Ok(()) } else { Err(NoAnswer::SeveralLamps) }
}

fn enough_tracks(data: &Dataset<'_>, config: &EstimateConfig) -> Result<(), NoAnswer> {
    let (tracks, needed) = (data.tracks.len(), config.least_pairs);
    if tracks < needed { Err(NoAnswer::FewTracks { tracks, needed }) } else { Ok(()) }
}

pub fn by_pairs(
    data: &Dataset<'_>,
    nodes: BeamGrid,
    config: &EstimateConfig,
) -> Result<Candidate, NoAnswer> {
    one_lamp(data)?;
    enough_tracks(data, config)?;
    let (spreading, bands) = (SpreadingModel::of(config.spreading), data.bands());
    let mut beam_pattern = BeamPattern::uniform(nodes); // "assume BP ≈ 1", §IV-B
    let path = |o: &Observation| data.path(o);
    let model_of =
        |alpha: Bands, beam: &BeamPattern| data.model(alpha, spreading, beam.clone(), config);
    let pairs = |beam: &BeamPattern| {
        let model = model_of([0.0; 3], beam);
        let known = |p: &LightPath| model.log_radiance(p, Removal::FULL.without_attenuation())[0];
        pairs::attenuation(data.tracks, bands, config.attenuation_floor_per_m, &path, &known)
            .ok_or(NoAnswer::EqualPathLengths)
    };
    let first = pairs(&beam_pattern)?;
    let mut answer = first.clone();
    for _ in 0..config.sweeps {
        let before = answer.attenuation_per_m;
        let model = model_of(before, &beam_pattern);
        beam_pattern =
            angular_bins::beam_pattern(data.frames, &model, nodes, &|s| s.path(data.lamps)); // Eq. 17
        answer = pairs(&beam_pattern)?; // "we also recompute", §IV-C
        if settled(&before, &answer.attenuation_per_m) {
            break;
        }
    }
    let used = answer.by_image.len() as f64;
    let mut details = vec![("images", used)];
    let names = [
        "before_beam_pattern_red_per_m",
        "before_beam_pattern_green_per_m",
        "before_beam_pattern_blue_per_m",
    ];
    details.extend(names.iter().zip(first.attenuation_per_m).take(bands).map(|(n, v)| (*n, v)));
    let model = data.model(answer.attenuation_per_m, spreading, beam_pattern, config);
    let mut candidate =
        Candidate::new(model, answer.std_per_m, answer.pairs, answer.residual, &details);
    candidate.answer.by_image = by_image(data, &first, &answer);
    Ok(candidate)
}

/// More images than this say no more in a figure.
const MOST_IMAGES: usize = 300;

/// What the images say before and after the beam pattern is known, spread evenly where there are
/// many.
fn by_image(
    data: &Dataset<'_>,
    first: &pairs::PairsAnswer,
    last: &pairs::PairsAnswer,
) -> Vec<ImageAnswer> {
    let bands = data.bands();
    let rounded = |alpha: &Bands| alpha[..bands].iter().map(|a| (a * 1e6).round() / 1e6).collect();
    let both = last.by_image.iter().filter_map(|image| {
        let before = first.by_image.iter().find(|i| i.frame == image.frame)?;
        Some(ImageAnswer {
            stamp_ns: data.frames.get(image.frame as usize)?.stamp.0,
            before_beam_pattern_per_m: rounded(&before.attenuation_per_m),
            attenuation_per_m: rounded(&image.attenuation_per_m),
            weight_m2: (image.weight * 1e6).round() / 1e6,
        })
    });
    let all: Vec<ImageAnswer> = both.collect();
    let step = all.len().div_ceil(MOST_IMAGES).max(1);
    all.into_iter().step_by(step).collect()
}

pub fn by_altitude(
    data: &Dataset<'_>,
    nodes: BeamGrid,
    config: &EstimateConfig,
) -> Result<Candidate, NoAnswer> {
    one_lamp(data)?;
    let spread = data.altitude_spread();
    if data.frames.len() < 5 || !data.altitude_varies(config) {
        return Err(NoAnswer::AltitudeRange {
            altitude_ratio: spread,
            frames: data.frames.len(),
            needed_ratio: config.least_altitude_spread,
        });
    }
    let (spreading, bands) = (SpreadingModel::of(config.spreading), data.bands());
    let mut beam_pattern = BeamPattern::uniform(nodes);
    let path = |_: &FrameSamples, s: &Sample| s.path(data.lamps);
    let model_of =
        |alpha: Bands, beam: &BeamPattern| data.model(alpha, spreading, beam.clone(), config);
    let slope = |beam: &BeamPattern| {
        let model = model_of([0.0; 3], beam);
        let known = |p: &LightPath| model.log_radiance(p, Removal::FULL.without_attenuation())[0];
        altitude_slope::attenuation(data.frames, bands, &path, &known)
            .ok_or(NoAnswer::FewSharedCells)
    };
    let mut answer = slope(&beam_pattern)?;
    for _ in 0..config.sweeps {
        let before = answer.attenuation_per_m;
        let model = model_of(before, &beam_pattern);
        beam_pattern =
            angular_bins::beam_pattern(data.frames, &model, nodes, &|s| s.path(data.lamps));
        answer = slope(&beam_pattern)?;
        if settled(&before, &answer.attenuation_per_m) {
            break;
        }
    }
    let mut details = vec![("altitude_spread", spread), ("farthest_m", answer.farthest_m)];
    let names =
        ["channel_means_red_per_m", "channel_means_green_per_m", "channel_means_blue_per_m"];
    details.extend(
        names.iter().zip(answer.effective_by_channel_means_per_m).take(bands).map(|(n, v)| (*n, v)),
    );
    let model = data.model(answer.attenuation_per_m, spreading, beam_pattern, config);
    Ok(Candidate::new(model, answer.std_per_m, answer.observations, answer.residual, &details))
}

fn settled(before: &Bands, after: &Bands) -> bool {
    before.iter().zip(after).all(|(a, b)| (a - b).abs() < 1e-4)
}

/// Fewer show neither scattered light nor changed light for what it is.
pub const LEAST_FRAMES: usize = 12;

/// α of the lower half of the frames may differ from that of all by this much, whatever the noise
/// says [1/m].
const LEAST_PARTING_PER_M: f64 = 0.03;

/// Scattered light that is not modelled may change α by this share.
const UNMODELLED_SHARE: f64 = 0.1;

/// Why the number cannot be trusted, if it cannot.
pub fn not_identified(
    candidate: &Candidate,
    data: &Dataset<'_>,
    config: &EstimateConfig,
) -> Option<NotIdentified> {
    let model = &candidate.model;
    let spread = data.altitude_spread();
    let worst = candidate.std_per_m[..model.bands].iter().copied().fold(0.0, f64::max);
    let least =
        model.attenuation_per_m[..model.bands].iter().copied().fold(f64::INFINITY, f64::min);
    if !data.altitude_varies(config) {
        return Some(NotIdentified::AltitudeConstant { altitude_ratio: spread });
    }
    if let Some(path_spread_m) = candidate.path_spread_m.filter(|p| *p < 0.05) {
        return Some(NotIdentified::PathLengthsEqual { path_spread_m });
    }
    let frames = data.frames.len();
    if frames < LEAST_FRAMES {
        return Some(NotIdentified::FewFrames { frames, needed: LEAST_FRAMES });
    }
    let parted = |with: &Bands| {
        (0..model.bands).find(|b| {
            (with[*b] - model.attenuation_per_m[*b]).abs() > UNMODELLED_SHARE * with[*b].abs()
        })
    };
    if let Some((with, b)) =
        data.unmodelled_backscatter.and_then(|with| Some((with, parted(&with)?)))
    {
        return Some(NotIdentified::BackscatterIgnored {
            attenuation_per_m: model.attenuation_per_m[b],
            with_backscatter_per_m: with[b],
        });
    }
    if let Some((low, low_std)) = &candidate.low {
        for b in 0..model.bands {
            let (all, std) = (model.attenuation_per_m[b], candidate.std_per_m[b].hypot(low_std[b]));
            if (low[b] - all).abs() > LEAST_PARTING_PER_M.max(4.0 * std) {
                return Some(NotIdentified::LowFramesDiffer {
                    attenuation_per_m: all,
                    low_frames_per_m: low[b],
                });
            }
        }
    }
    if least <= 0.0 {
        return Some(NotIdentified::NotPhysical { attenuation_per_m: least });
    }
    (worst > 0.08).then_some(NotIdentified::Uncertain { std_per_m: worst })
}
