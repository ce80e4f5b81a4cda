//! What pass one collected → one model; a model's strobe and exposure.

use super::mount_check::{mount_check, mount_diagnostics};
use super::pass_one::Collected;
use super::pooled::{Pooled, frame_gains};
use crate::config::{Config, Method, Spreading, Switch};
use crate::coordinates::{Body, Optical, Strobe, Transform};
use crate::correct::{estimate_rendering, rendering_of};
use crate::diagnostics::{Diagnostic, EstimateFact};
use crate::error::{Error, Result};
use crate::estimate::{
    BackscatterFit, Dataset, EmpiricalFit, Estimate, FollowedSetting, FrameSamples, ModelEstimate,
    Mounts, Sample, StrobePlacement, estimate_model, tracks,
};
use crate::geometry::LightPath;
use crate::image::Bands;
use crate::model::limited::without_backscatter;
use crate::model::{
    AttenuationKind, BackscatterFile, BeamPatternFile, FORMAT, ImagingModel, InputFile, LampFile,
    LightSettingFile, ModelFile, RenderingFile, SpreadingModel, StrobeFile,
};
use crate::session::survey::Survey;
use crate::session::{CameraSession, Options};
use crate::vehicle::{Lamp, Lamps, MountFacts, Rig, SettingSeries, StrobeMount, StrobeSource};

/// Samples of all logs → one model.
pub fn model_of(logs: Vec<(&CameraSession, Collected)>, options: &Options) -> Result<ModelFile> {
    let Some((first, _)) = logs.first() else {
        return Err(Error::Usage("no log was given".into()));
    };
    let (first, config) = (*first, &options.config);
    let Pooled { mut frames, pairs, inputs, settings, origins } = Pooled::new(logs)?;
    let tracks = tracks(&frames, &pairs);
    frames.iter_mut().for_each(FrameSamples::drop_keypoints);
    drop(pairs);
    let rig = &first.survey.rig;
    let mounts = Mounts {
        body_from_optical: rig.body_from_optical,
        lamps: rig.strobe.lamps,
        strobe_is_measured: rig.strobe.source.is_some(),
        instrument: rig.body_from_dvl.origin().vector(),
    };
    let found = estimate_model(frames, tracks, &mounts, &settings, &config.estimate)?;
    let white_level = first.survey.white_level;
    let (frames, lamps) = (&found.frames, found.strobe.lamps);
    let empirical = found.judgement.empirical.as_ref();
    let is_full = config.render.method == Method::Full;
    let rendering = match empirical.filter(|_| is_full) {
        Some(fit) => empirical_exposure(frames, fit, rig, (white_level, config)),
        None => exposure(frames, &found.estimate.model, lamps, white_level, config),
    };
    let diagnostics = diagnostics(&found, first, options);
    let not_identified = found.estimate.not_identified.clone();
    let setting = |f: &FollowedSetting| {
        let SettingSeries { topic, name, .. } = first.survey.settings[f.index].clone();
        LightSettingFile { topic, name, law: f.law, reference: f.reference }
    };
    let bands = found.estimate.model.bands;
    let file = ModelFile {
        strobe: Some(strobe_file(&found.strobe, rig)),
        mount_check: found.mounts.as_ref().map(mount_check),
        backscatter: found.backscatter.as_ref().map(|b| backscatter_file(b, bands)),
        frame_gains: frame_gains(&origins, frames, &log_factors(&found)),
        empirical: empirical.map(|fit| fit.model.clone()),
        verdict: found.judgement.verdict.clone(),
        light_settings: found.followed.iter().map(setting).collect(),
        ..file_of(found.estimate, rendering, inputs, config)
    };
    Ok(file.with_diagnostics(diagnostics, not_identified))
}

/// Log of gain and of range factor per frame.
fn log_factors(found: &ModelEstimate) -> Vec<(f64, f64)> {
    let of_frame = |(f, gain): (usize, &f64)| match &found.judgement.empirical {
        Some(fit) => (gain + fit.log_gains[f], fit.log_ranges[f]),
        None => (*gain, 0.0),
    };
    found.log_gains.iter().enumerate().map(of_frame).collect()
}

/// What pass one assumed, and what the log contradicts.
fn diagnostics(found: &ModelEstimate, first: &CameraSession, options: &Options) -> Vec<Diagnostic> {
    let mut diagnostics: Vec<Diagnostic> = Vec::new();
    diagnostics.extend(found.strobe.warning.clone().map(Diagnostic::from));
    let frames = found.log_gains.iter().filter(|g| **g != 0.0).count();
    if frames > 0 {
        diagnostics.push(EstimateFact::DropOuts { frames }.into());
    }
    if let Some(fit) = &found.judgement.empirical {
        let form = fit.model.form.word().into();
        diagnostics.push(EstimateFact::Empirical { form }.into());
    }
    if options.config.estimate.backscatter == Switch::On && found.backscatter.is_none() {
        diagnostics.push(EstimateFact::BackscatterUnknown.into());
    }
    if let Some(mounts) = &found.mounts {
        let Survey { rig, camera_topic, .. } = &first.survey;
        let offset_s = options.rig.time_offset_s.get(camera_topic).copied().unwrap_or(0.0);
        diagnostics.extend(mount_diagnostics(mounts, rig, camera_topic, offset_s));
    }
    diagnostics
}

fn backscatter_file(found: &BackscatterFit, bands: usize) -> BackscatterFile {
    let of = |values: &Bands| values[..bands].to_vec();
    BackscatterFile {
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

/// The same by the empirical model.
fn empirical_exposure(
    frames: &[FrameSamples],
    fit: &EmpiricalFit,
    rig: &Rig,
    (white_level, config): (Option<u16>, &Config),
) -> RenderingFile {
    let camera = Dataset::plain(frames, &[], rig.body_from_optical, rig.strobe.lamps);
    let of_frame = |(f, frame): (usize, &FrameSamples)| {
        let (gain, factor) = (fit.log_gains[f] as f32, fit.log_ranges[f].exp());
        let of_sample = |(_, sample): &(u32, Sample)| {
            let (x, y, range_m) = camera.ray(sample);
            let (log_direct, scattered) = fit.model.light(x, y, range_m * factor);
            let direct = |b: usize| {
                let light = (sample.log_color[b] - gain - log_direct[b] as f32).exp();
                let scattered = (scattered[b] / log_direct[b].exp()) as f32;
                without_backscatter(light, scattered, 1.0).max(1e-9).ln() + log_direct[b] as f32
            };
            (std::array::from_fn(direct), log_direct)
        };
        frame.grid.iter().map(of_sample).collect::<Vec<_>>()
    };
    let samples: Vec<([f32; 3], Bands)> = frames.iter().enumerate().flat_map(of_frame).collect();
    rendering_of(&samples, fit.model.log_level.len(), white_level, &config.render)
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

fn strobe_file(placed: &StrobePlacement, rig: &Rig) -> StrobeFile {
    let facts = MountFacts::of(
        (rig.body_from_optical.inverse() * placed.lamps.body_from_strobe()).isometry(),
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
            .or_else(|| rig.strobe.source.clone())
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
        backscatter: None,
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
