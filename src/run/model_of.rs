//! What pass one collected → one model, and a model's strobe and exposure as the rest of the
//! run wants them.

use super::mount_check::{mount_check, mount_diagnostics};
use super::pass_one::Collected;
use crate::config::{Config, Spreading, Switch};
use crate::coordinates::{Body, Optical, Strobe, Transform};
use crate::correct::estimate_rendering;
use crate::diagnostics::{Diagnostic, EstimateFact};
use crate::error::{Error, Result};
use crate::estimate::{
    BackscatterFit, Estimate, FollowedSetting, FrameSamples, MatchedPair, Mounts, StrobePlacement,
    estimate_model, tracks,
};
use crate::geometry::LightPath;
use crate::image::Bands;
use crate::model::{
    AttenuationKind, BackscatterFile, BeamPatternFile, FORMAT, FrameGainFile, ImagingModel,
    InputFile, LampFile, LightSettingFile, ModelFile, RenderingFile, SpreadingModel, StrobeFile,
};
use crate::session::{Options, Prepared};
use crate::vehicle::{Lamp, Lamps, MountFacts, Rig, SettingSeries, StrobeMount, StrobeSource};

/// Samples of all logs → one model.
pub fn model_of(logs: Vec<(&Prepared, Collected)>, options: &Options) -> Result<ModelFile> {
    let Some((first, _)) = logs.first() else {
        return Err(Error::Usage("no log was given".into()));
    };
    let first = *first;
    let (mut frames, mut pairs, mut inputs) = (Vec::new(), Vec::new(), Vec::new());
    let mut settings: Vec<Vec<f64>> = vec![Vec::new(); first.survey.settings.len()];
    for (log, mut collected) in logs {
        let offset = frames.len();
        inputs.push(InputFile {
            name: log
                .recording
                .path()
                .file_name()
                .map(|n| n.to_string_lossy().into_owned())
                .unwrap_or_default(),
            sha256: log.recording.sha256()?.into(),
            camera_topic: log.survey.camera_topic.clone(),
            dvl_topic: log.survey.dvl_topic.clone(),
            frames: collected.frames.len(),
        });
        for (values, series) in settings.iter_mut().zip(&first.survey.settings) {
            let same = log
                .survey
                .settings
                .iter()
                .find(|s| (&s.topic, &s.name) == (&series.topic, &series.name));
            values.extend(
                collected
                    .frames
                    .iter()
                    .map(|f| same.and_then(|s| s.at(f.stamp)).unwrap_or(f64::NAN)),
            );
        }
        frames.append(&mut collected.frames);
        pairs.extend(collected.pairs.into_iter().map(|p| MatchedPair {
            a: p.a + offset,
            b: p.b + offset,
            ..p
        }));
    }
    if frames.is_empty() {
        let reason = match first.survey.frames.len() {
            0 => "the camera has no pictures".to_string(),
            n => format!("none of {n} pictures has a seafloor below it and can be decoded"),
        };
        return Err(Error::NotEstimated {
            reason,
            remedy: "`unwater inspect` says what is missing".into(),
        });
    }
    let config = &options.config;
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
    let mount = found.strobe.lamps;
    let rendering =
        shown(&found.frames, &found.estimate.model, mount, first.survey.white_level, config);
    let uneven = found.frames.iter().zip(&found.log_gains).filter(|(_, g)| **g != 0.0);
    let frame_gains: Vec<FrameGainFile> =
        uneven.map(|(f, g)| FrameGainFile { stamp_ns: f.stamp.0, gain: g.exp() }).collect();
    let mut diagnostics: Vec<Diagnostic> = Vec::new();
    diagnostics.extend(found.strobe.warning.clone().map(Diagnostic::from));
    if !frame_gains.is_empty() {
        diagnostics.push(EstimateFact::DropOuts { frames: frame_gains.len() }.into());
    }
    let camera_topic = &first.survey.camera_topic;
    let offset_s = options.rig.time_offset_s.get(camera_topic).copied().unwrap_or(0.0);
    if config.estimate.backscatter == Switch::On && found.backscatter.is_none() {
        diagnostics.push(EstimateFact::BackscatterUnknown.into());
    }
    let mount_check = found.mounts.map(|found| {
        diagnostics.extend(mount_diagnostics(&found, rig, camera_topic, offset_s));
        mount_check(&found)
    });
    let light_setting = |f: &FollowedSetting| {
        let SettingSeries { topic, name, .. } = &first.survey.settings[f.index];
        LightSettingFile {
            topic: topic.clone(),
            name: name.clone(),
            law: f.law,
            reference: f.reference,
        }
    };
    let light_settings = found.followed.iter().map(light_setting).collect();
    let strobe = Some(strobe_file(&found.strobe, rig));
    let backscatter =
        found.backscatter.as_ref().map(|b| backscatter_file(b, found.estimate.model.bands));
    let not_identified = found.estimate.not_identified.clone();
    let file = ModelFile {
        strobe,
        mount_check,
        backscatter,
        frame_gains,
        light_settings,
        ..file_of(found.estimate, rendering, inputs, config)
    };
    Ok(file.with_diagnostics(diagnostics, not_identified))
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
pub fn shown(
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
        frame_gains: Vec::new(),
        light_settings: Vec::new(),
        warnings: Vec::new(),
        diagnostics: Vec::new(),
        segments: found.model.over_time.clone(),
        rendering,
        inputs,
    }
}
