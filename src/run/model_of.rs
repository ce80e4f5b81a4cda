//! What pass one collected → one model; a model's strobe and exposure.

use std::sync::Arc;

use super::log_samples::{LogSamples, SampledLog};
use super::mount_check::{mount_check, mount_diagnostics, replaced, replaced_diagnostics};
use super::pooled::{Pooled, frame_gains, tilts_file};
use crate::config::{Config, Method, Spreading, Switch};
use crate::coordinates::{Body, Optical, Strobe, Transform};
use crate::correct::{estimate_rendering, rendering_of};
use crate::diagnostics::{Diagnostic, EstimateFact, NotIdentified};
use crate::error::Result;
use crate::estimate::{
    BackscatterFit, CameraFit, CameraKnown, CameraTermsFound, Dataset, EmpiricalFit, Estimate,
    FollowedSetting, FrameSamples, ModelEstimate, Mounts, ReadingCurve, Sample, StrobePlacement,
    estimate_model,
};
use crate::geometry::LightPath;
use crate::image::Bands;
use crate::image::response::{ResponseTable, TransferKnown};
use crate::image::transfer::Transfer;
use crate::model::limited::without_backscatter;
use crate::model::{
    AttenuationKind, BackscatterFile, BeamPatternFile, CameraFile, FORMAT, GainLawFile, GainsFile,
    ImagingModel, InputFile, LampFile, LightSettingFile, ModelFile, RangeFactor, RegionLight,
    RenderingFile, ResponseFile, SpreadingModel, StrobeFile, TiltFile, TiltsFile, VignettingFile,
};
use crate::session::Options;
use crate::stats;
use crate::vehicle::{Extrinsics, Lamp, Lamps, MountFacts, Rig, StrobeMount, StrobeSource};

/// Points of a transfer curve, and the first of them beside 0: darker values are not sampled.
const RESPONSE_POINTS: usize = 256;
const RESPONSE_FIRST: usize = 2;
/// Least rise of light from point to point.
const MIN_RISE: f64 = 1e-9;

/// Samples of all logs → one model.
pub fn model_of(logs: Vec<LogSamples>, options: &Options) -> Result<ModelFile> {
    let config = &options.config;
    let Pooled {
        first,
        frames,
        tracks,
        mut inputs,
        diagnostics: of_logs,
        settings,
        origins,
        offsets_s,
    } = Pooled::new(logs)?;
    let extrinsics = &first.extrinsics;
    let mounts = Mounts {
        body_from_optical: extrinsics.body_from_optical,
        lamps: extrinsics.strobe.lamps,
        strobe_is_measured: extrinsics.strobe.source.is_some(),
        instrument: extrinsics.body_from_dvl.origin().vector(),
        camera: camera_known(&first, &frames),
    };
    let found = estimate_model(frames, tracks, &mounts, &settings, &config.estimate)?;
    let frames = &found.frames;
    let empirical = found.judgement.empirical.as_ref();
    let rendering = exposure_of_estimate(&found, extrinsics, (first.white_level, config));
    let mut diagnostics = diagnostics(&found, &first, options);
    diagnostics.extend(of_logs);
    // The cause comes before what it does to the estimate.
    let has_slope = found.tilts.as_ref().is_some_and(|tilts| tilts.is_measured);
    let of_survey = first.not_identified.clone();
    let of_survey = of_survey.filter(|why| !has_slope || *why != NotIdentified::SlopeUnknown);
    let not_identified = of_survey.or_else(|| found.estimate.not_identified.clone());
    let setting = |f: &FollowedSetting| {
        let (topic, name) = first.settings[f.index].clone();
        LightSettingFile { topic, name, law: f.law, reference: f.reference }
    };
    let bands = found.estimate.model.bands;
    attenuation_of_logs(&mut inputs, &found);
    let file = ModelFile {
        strobe: Some(strobe_file(&found.strobe, extrinsics)),
        mount_check: found.mounts.as_ref().map(mount_check),
        geometry: found
            .mounts
            .as_ref()
            .filter(|_| found.replaces_mounts)
            .map(|m| replaced(m, extrinsics, first.camera_offset_s)),
        tilts: found.tilts.as_ref().map(|t| tilts_file(t, (&origins, &offsets_s), frames)),
        backscatter: found.backscatter.as_ref().map(|b| backscatter_file(b, bands)),
        daylight: found.daylight.as_ref().map(|d| d.file(bands)),
        camera: found.camera.as_ref().map(|c| camera_file(c, first.response.as_ref())),
        frame_gains: frame_gains(&origins, frames, &log_factors(&found)),
        residual_light: found.judgement.residual.as_ref().map(|fit| fit.light.clone()),
        empirical: empirical.map(|fit| fit.model.clone()),
        verdict: found.judgement.verdict.clone(),
        light_settings: found.followed.iter().map(setting).collect(),
        ..file_of(found.estimate, rendering, inputs, config)
    };
    diagnostics.extend(file.tilts.as_ref().map(tilts_found));
    Ok(file.with_diagnostics(diagnostics, not_identified))
}

/// What is said of tilts.
pub fn tilts_found(tilts: &TiltsFile) -> Diagnostic {
    let sizes_deg: Vec<f64> = tilts.frames.iter().map(TiltFile::size_deg).collect();
    let largest_deg = sizes_deg.iter().copied().fold(0.0, f64::max);
    EstimateFact::TiltsFound { median_deg: stats::median(&sizes_deg), largest_deg }.into()
}

/// Attenuation of each of several logs, where it differs.
fn attenuation_of_logs(inputs: &mut [InputFile], found: &ModelEstimate) {
    let ImagingModel { over_time, bands, .. } = &found.estimate.model;
    if inputs.len() < 2 {
        return;
    }
    for (number, input) in inputs.iter_mut().enumerate() {
        let first = found.frames.iter().find(|frame| frame.log == number).map(|f| f.stamp);
        let of_bands = |values: Bands| values[..*bands].to_vec();
        input.attenuation_per_m = first.and_then(|t| over_time.at(t)).map(of_bands);
        input.attenuation_std_per_m = first.and_then(|t| over_time.std_at(t)).map(of_bands);
    }
}

/// Log of gain and of range factor per frame.
fn log_factors(found: &ModelEstimate) -> Vec<(Bands, RangeFactor)> {
    let of_frame = |(f, gain): (usize, &Bands)| match &found.judgement.empirical {
        Some(fit) => (std::array::from_fn(|b| gain[b] + fit.log_gains[f][b]), fit.ranges[f]),
        None => (*gain, RangeFactor::default()),
    };
    found.log_gains.iter().enumerate().map(of_frame).collect()
}

/// What pass one assumed, and what the log contradicts.
fn diagnostics(found: &ModelEstimate, first: &SampledLog, options: &Options) -> Vec<Diagnostic> {
    let mut diagnostics: Vec<Diagnostic> = Vec::new();
    diagnostics.extend(found.strobe.warning.clone().map(Diagnostic::from));
    let assumed = first.response.as_ref();
    let summary = |camera: &CameraFit| camera_file(camera, assumed).summary();
    let camera = found.camera.iter().filter(|c| c.found != CameraTermsFound::default());
    diagnostics.extend(camera.map(|c| EstimateFact::CameraFound { summary: summary(c) }.into()));
    let reported = found.reported.iter();
    diagnostics
        .extend(reported.map(|c| EstimateFact::CameraReported { summary: summary(c) }.into()));
    let frames = found.drop_outs;
    if frames > 0 {
        diagnostics.push(EstimateFact::DropOuts { frames }.into());
    }
    if found.judgement.residual.is_some() {
        diagnostics.push(EstimateFact::ResidualLight.into());
    }
    if let Some(fit) = &found.judgement.empirical {
        let form = fit.model.form.word().into();
        diagnostics.push(EstimateFact::Empirical { form }.into());
    }
    if options.config.estimate.backscatter == Switch::On && found.backscatter.is_none() {
        diagnostics.push(EstimateFact::BackscatterUnknown.into());
    }
    if let Some(daylight) = &found.daylight {
        let bands = found.estimate.model.bands;
        let share = daylight.share[..bands].iter().copied().fold(0.0, f64::max);
        diagnostics.push(EstimateFact::DaylightFound { share }.into());
    }
    if let Some(mounts) = &found.mounts {
        let SampledLog { extrinsics, camera_offset_s: offset_s, .. } = first;
        let camera_topic = &first.input.camera_topic;
        diagnostics.extend(if found.replaces_mounts {
            replaced_diagnostics(mounts, camera_topic, *offset_s)
        } else {
            mount_diagnostics(mounts, extrinsics, camera_topic, *offset_s)
        });
    }
    diagnostics
}

/// What is known of the camera before its images are looked at.
fn camera_known(log: &SampledLog, frames: &[FrameSamples]) -> CameraKnown {
    let transfer = match log.transfer {
        TransferKnown::Assumed if frames.iter().any(|f| !f.is_srgb) => TransferKnown::Surely,
        known => known,
    };
    let [flat_field, black_level] = log.flat_field_given;
    CameraKnown { transfer, flat_field, black_level }
}

/// What was found of the camera; `assumed` is the transfer curve that the frames were sampled by.
fn camera_file(found: &CameraFit, assumed: Option<&ResponseTable>) -> CameraFile {
    let CameraTermsFound { gains, vignetting, black_level, .. } = found.found;
    let log_gains = || found.log_gains.iter().map(|g| g[..found.bands].iter().sum::<f64>());
    let (least, most) = log_gains()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), g| (least.min(g), most.max(g)));
    let range_stops = (most - least) / (found.bands as f64 * std::f64::consts::LN_2);
    let mut power = 1.0;
    let coefficients = found.vignetting.map(|v| {
        power /= found.radius.corner_squared;
        v * power
    });
    let corner_loss = 1.0 - found.vignetting.iter().sum::<f64>().exp();
    let law = |[exposure, white_balance]: [f64; 2]| GainLawFile {
        exposure,
        white_balance,
        log_level: found.log_level[..found.bands].to_vec(),
    };
    CameraFile {
        vignetting: vignetting.then_some(VignettingFile { coefficients, corner_loss }),
        black_level: black_level.then(|| found.curve.black_level[..found.bands].to_vec()),
        response: found.changes_reading().then(|| response_file(&found.curve, assumed)),
        gain_law: found.law.map(law),
        gains: gains.then_some(GainsFile { std: found.gain_std, range_stops }),
        residual: found.residual,
    }
}

/// A transfer curve by points, light 1 at full scale: the curve that was found, on top of the one
/// that was assumed (sRGB where there is no table).
fn response_file(curve: &ReadingCurve, assumed: Option<&ResponseTable>) -> ResponseFile {
    let is_named = curve.coefficients.iter().all(|c| *c == 0.0);
    let transfer = curve.transfer.filter(|_| is_named);
    let light = |value: f64| match transfer {
        Some(transfer) => transfer.to_linear(value),
        None => {
            let assumed = assumed
                .map_or_else(|| Transfer::Srgb.to_linear(value), |table| table.to_linear(value));
            curve.light(assumed.max(f64::MIN_POSITIVE).ln()).0.exp()
        }
    };
    let white = light(1.0);
    let mut points = vec![[0.0, 0.0]];
    for i in RESPONSE_FIRST..=RESPONSE_POINTS {
        let value = i as f64 / RESPONSE_POINTS as f64;
        // Increasing, also where the curve goes on below what was sampled.
        let before = points.last().map_or(0.0, |p| p[1]);
        points.push([value, (light(value) / white).min(1.0).max(before + MIN_RISE)]);
    }
    let last = points.last().map_or(1.0, |p| p[1]);
    points.iter_mut().for_each(|p| p[1] /= last.max(1.0));
    let transfer = transfer.map_or_else(|| "fitted".into(), String::from);
    ResponseFile { transfer, points }
}

fn backscatter_file(found: &BackscatterFit, bands: usize) -> BackscatterFile {
    let of = |values: &Bands| values[..bands].to_vec();
    BackscatterFile {
        source: found.backscatter.source,
        strength_per_m: of(&found.backscatter.strength_per_m),
        strength_std_per_m: of(&found.std_per_m),
        attenuation_per_m: of(&found.backscatter.attenuation_per_m),
        shape: found.backscatter.shape,
        median_share: of(&found.share),
        held_out_improvement: found.improvement,
    }
}

/// Exposure and white balance, from the samples' corrected light.
pub fn exposure(
    frames: &[FrameSamples],
    model: &ImagingModel,
    mount: Lamps,
    white_level: Option<u16>,
    config: &Config,
) -> RenderingFile {
    let lit = frames
        .iter()
        .flat_map(|f| f.grid.iter().filter_map(move |(_, s)| Some((s.log_color, s.path(mount)?))));
    let lit: Vec<([f32; 3], LightPath)> = lit.collect();
    estimate_rendering(&lit, model, white_level, &config.render)
}

fn exposure_of_estimate(
    found: &ModelEstimate,
    extrinsics: &Extrinsics,
    (white_level, config): (Option<u16>, &Config),
) -> RenderingFile {
    let ModelEstimate { frames, strobe, judgement, estimate, .. } = found;
    let residual = judgement.residual.as_ref().map(|fit| Arc::new(fit.light.clone()));
    let model = ImagingModel { residual, ..estimate.model.clone() };
    let strobe = StrobeMount { lamps: strobe.lamps, ..extrinsics.strobe.clone() };
    let extrinsics = Extrinsics { strobe, ..extrinsics.clone() };
    exposure_of(frames, (&model, judgement.empirical.as_ref()), &extrinsics, (white_level, config))
}

/// Exposure and white balance of what corrects the frames, by their samples as the method meets
/// them: without the gains of the frames, and without backscatter where the method removes it.
pub fn exposure_of(
    frames: &[FrameSamples],
    (model, empirical): (&ImagingModel, Option<&EmpiricalFit>),
    mounts: &Extrinsics,
    (white_level, config): (Option<u16>, &Config),
) -> RenderingFile {
    let is_full = config.render.method == Method::Full;
    let lamps = mounts.strobe.lamps;
    match (empirical.filter(|_| is_full), model.residual.as_deref().filter(|_| is_full)) {
        (Some(fit), _) => empirical_exposure(frames, fit, mounts, (white_level, config)),
        (None, Some(light)) => {
            let frames = without_residual(frames, light, mounts);
            exposure(&frames, model, lamps, white_level, config)
        }
        (None, None) => exposure(frames, model, lamps, white_level, config),
    }
}

/// Samples without the light that a model leaves.
fn without_residual(
    frames: &[FrameSamples],
    light: &RegionLight,
    mounts: &Extrinsics,
) -> Vec<FrameSamples> {
    let camera = Dataset::plain(frames, &[], mounts.body_from_optical, mounts.strobe.lamps);
    let mut without = frames.to_vec();
    for (_, sample) in without.iter_mut().flat_map(|f| &mut f.grid) {
        let (x, y, range_m) = camera.ray(sample);
        let left = light.log_light(x, y, range_m);
        sample.log_color.iter_mut().zip(left).for_each(|(log, left)| *log -= left as f32);
    }
    without
}

/// The same by the empirical model.
fn empirical_exposure(
    frames: &[FrameSamples],
    fit: &EmpiricalFit,
    mounts: &Extrinsics,
    (white_level, config): (Option<u16>, &Config),
) -> RenderingFile {
    let camera = Dataset::plain(frames, &[], mounts.body_from_optical, mounts.strobe.lamps);
    let of_frame = |(f, frame): (usize, &FrameSamples)| {
        let (gain, factor) = (fit.log_gains[f], fit.ranges[f]);
        let of_sample = |(_, sample): &(u32, Sample)| {
            let (x, y, range_m) = camera.ray(sample);
            let (log_direct, scattered) = fit.model.light(x, y, range_m * factor.at(x, y));
            let direct = |b: usize| {
                let light = (sample.log_color[b] - gain[b] as f32 - log_direct[b] as f32).exp();
                let scattered = (scattered[b] / log_direct[b].exp()) as f32;
                without_backscatter(light, scattered, 1.0).max(1e-9).ln() + log_direct[b] as f32
            };
            (std::array::from_fn(direct), log_direct)
        };
        frame.grid.iter().map(of_sample).collect::<Vec<_>>()
    };
    let samples: Vec<([f32; 3], Bands)> = frames.iter().enumerate().flat_map(of_frame).collect();
    rendering_of(&samples, fit.model.direct.log_level.len(), white_level, &config.render)
}

/// The strobe a model was made with, in this rig; the rig's own where the model says nothing.
pub fn strobe_of(file: &ModelFile, rig: &Rig) -> StrobeMount {
    match &file.strobe {
        Some(s) => {
            let optical_from_strobe: Transform<Optical, Strobe> =
                Transform::from_parts(s.position_in_optical_m, s.rotation_xyzw);
            let first: Transform<Body, Strobe> = rig.body_from_optical * optical_from_strobe;
            let of_lamp = |l: &LampFile| {
                (first * Transform::from_parts(l.offset_m, l.rotation_xyzw), l.share)
            };
            let lamps = Lamps::several(&s.lamps.iter().map(of_lamp).collect::<Vec<_>>())
                .unwrap_or_else(|| Lamps::one(first));
            StrobeMount { lamps, source: Some(s.source.clone()) }
        }
        None => rig.strobe.clone(),
    }
}

fn strobe_file(placed: &StrobePlacement, mounts: &Extrinsics) -> StrobeFile {
    let facts = MountFacts::of(
        (mounts.body_from_optical.inverse() * placed.lamps.body_from_strobe()).isometry(),
    );
    let lamp = |l: &Lamp| LampFile {
        offset_m: l.offset.into(),
        rotation_xyzw: l.rotation.coords.into(),
        share: l.share,
    };
    let lamps = if placed.lamps.lamps().len() > 1 {
        placed.lamps.lamps().iter().map(lamp).collect()
    } else {
        Vec::new()
    };
    StrobeFile {
        lamps,
        position_in_optical_m: facts.translation_m,
        rotation_xyzw: facts.rotation_xyzw.unwrap_or([0.0, 0.0, 0.0, 1.0]),
        source: placed
            .source
            .clone()
            .or_else(|| mounts.strobe.source.clone())
            .unwrap_or(StrobeSource::Camera),
        position_std_m: placed
            .search
            .as_ref()
            .map(|s| s.std_m)
            .filter(|s| s.iter().all(|v| v.is_finite())),
        moved_m: placed.search.as_ref().map(|s| s.moved_m),
    }
}

fn file_of(
    found: Estimate,
    rendering: RenderingFile,
    inputs: Vec<InputFile>,
    config: &Config,
) -> ModelFile {
    let bands = found.model.bands;
    let SpreadingModel { strobe_leg, camera_leg } = found.model.spreading;
    ModelFile {
        format: FORMAT.into(),
        version: 1,
        spreading: config.estimate.spreading,
        spreading_exponents: Some([strobe_leg, camera_leg]),
        incidence: found.model.incidence,
        attenuation_per_m: found.model.attenuation_per_m[..bands].to_vec(),
        attenuation_std_per_m: found.attenuation_std_per_m[..bands]
            .iter()
            .map(|s| s.is_finite().then_some(*s))
            .collect(),
        attenuation_kind: if config.estimate.spreading == Spreading::None {
            AttenuationKind::Effective
        } else {
            AttenuationKind::Physical
        },
        identified: true,
        not_identified_because: None,
        estimator: found.estimator,
        estimators: found.answers,
        beam_pattern: BeamPatternFile::of(&found.model.beam_pattern),
        strobe: None,
        mount_check: None,
        camera: None,
        geometry: None,
        tilts: None,
        backscatter: None,
        daylight: None,
        residual_light: None,
        empirical: None,
        verdict: None,
        frame_gains: Vec::new(),
        light_settings: Vec::new(),
        warnings: Vec::new(),
        diagnostics: Vec::new(),
        segments: found.model.over_time.clone(),
        rendering,
        inputs,
    }
}
