//! All that an estimate needs of a log: the samples of pass one, and what the survey says of them.

use serde::{Deserialize, Serialize};

use super::pass_one::{Collected, chosen_frames};
use crate::coordinates::Transform;
use crate::diagnostics::{Diagnostic, EstimateFact, Fact, MountFact, NotIdentified, RangeFact};
use crate::error::{Error, Result};
use crate::estimate::{FrameSamples, Observation, Track, Unlit, tracks};
use crate::image::Container;
use crate::image::response::{ResponseTable, TransferKnown};
use crate::model::InputFile;
use crate::recording::LogIdentity;
use crate::session::{CameraSession, FrameId};
use crate::vehicle::{Extrinsics, SettingSeries};

/// Mounts of one camera or strobe agree within this (m, rad) from log to log.
const SAME_MOUNT: (f64, f64) = (0.01, 0.01);

/// What is known of a log beside its samples.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SampledLog {
    /// the log
    pub input: InputFile,
    /// width and height of an image (px)
    pub image_size: (usize, usize),
    /// file format of its images
    pub container: Container,
    /// mounts
    pub extrinsics: Extrinsics,
    /// what is added to the stamps of the camera (s)
    pub camera_offset_s: f64,
    /// full scale of 16-bit images (DN)
    pub white_level: Option<u16>,
    /// the transfer curve that the images were read by; `None` where it is a named one
    pub response: Option<ResponseTable>,
    /// how the transfer curve is known
    pub transfer: TransferKnown,
    /// whether the rig file has the vignetting, and the black level
    pub flat_field_given: [bool; 2],
    /// topic and name of the settings of camera and strobe
    pub settings: Vec<(String, String)>,
    /// what leaves attenuation undetermined, whatever the estimate says
    pub not_identified: Option<NotIdentified>,
    /// what is to be said of the samples
    pub diagnostics: Vec<Diagnostic>,
}

/// A log as an estimate sees it.
#[derive(Clone, Debug)]
pub struct LogSamples {
    /// what is known beside the samples
    pub log: SampledLog,
    /// samples of the frames, in the order of time
    pub frames: Vec<FrameSamples>,
    /// per frame: its identity in the log
    pub ids: Vec<Option<FrameId>>,
    /// per setting of the log: its value for every frame, NaN where unknown
    pub settings: Vec<Vec<f64>>,
    /// seafloor points seen more than once
    pub tracks: Vec<Track>,
}

impl SampledLog {
    /// What is known of a log whose frames are not sampled yet.
    pub fn of(session: &CameraSession) -> Self {
        let survey = &session.survey;
        let LogIdentity { sha256, index_sha256 } = session.recording.identity();
        Self {
            input: InputFile {
                name: session.file_name(),
                sha256,
                index_sha256,
                camera_topic: survey.camera_topic.clone(),
                dvl_topic: survey.dvl_topic.clone(),
                frames: 0,
                unlit_below: None,
                attenuation_per_m: None,
                attenuation_std_per_m: None,
            },
            image_size: survey.image_size,
            container: survey.container,
            extrinsics: survey.rig.extrinsics(),
            camera_offset_s: survey.camera_offset_s,
            white_level: survey.white_level,
            response: survey.response.clone(),
            transfer: survey.transfer,
            flat_field_given: survey.flat_field_given,
            settings: survey.settings.iter().map(|s| (s.topic.clone(), s.name.clone())).collect(),
            not_identified: undetermined(session),
            diagnostics: Vec::new(),
        }
    }
}

impl LogSamples {
    /// What pass one collected; keypoints end here.
    pub fn new(session: &CameraSession, collected: Collected) -> Self {
        let survey = &session.survey;
        let Collected { mut frames, pairs, unlit, .. } = collected;
        let tracks = tracks(&frames, &pairs);
        frames.iter_mut().for_each(FrameSamples::drop_keypoints);
        let frame_count = frames.len();
        let of_unlit = |Unlit { frames: unlit, ratio, .. }| {
            let fact = EstimateFact::UnlitFrames { frames: unlit, of: unlit + frame_count, ratio };
            Diagnostic::on(&survey.camera_topic, fact)
        };
        let mut log = SampledLog::of(session);
        log.input.frames = frame_count;
        log.input.unlit_below = unlit.map(|unlit| unlit.below);
        log.diagnostics.extend(unlit.map(of_unlit));
        let id = |f: &FrameSamples| survey.frames.get(f.frame).map(|frame| frame.id);
        let values = |series: &SettingSeries| {
            frames.iter().map(|f| series.at(f.stamp).unwrap_or(f64::NAN)).collect()
        };
        let (ids, settings) =
            (frames.iter().map(id).collect(), survey.settings.iter().map(values).collect());
        Self { log, frames, ids, settings, tracks }
    }

    /// With no more than so many frames: windows of neighbours, as pass one chooses them.
    #[must_use]
    pub fn thinned(self, max_frames: usize) -> Self {
        let Self { mut log, frames, ids, settings, tracks } = self;
        if frames.len() <= max_frames {
            return Self { log, frames, ids, settings, tracks };
        }
        let altitudes: Vec<f64> = frames.iter().map(|f| f.camera_altitude_m).collect();
        let chosen = chosen_frames(&altitudes, max_frames);
        let mut number = vec![None; frames.len()];
        chosen.iter().enumerate().for_each(|(new, old)| number[*old] = Some(new as u32));
        let renumbered = |o: Observation| {
            let frame = *number.get(o.frame as usize)?;
            Some(Observation { frame: frame?, ..o })
        };
        let of_chosen = |track: Track| -> Option<Track> {
            let seen: Track = track.into_iter().filter_map(renumbered).collect();
            (seen.len() >= 2).then_some(seen)
        };
        log.input.frames = chosen.len();
        Self {
            ids: chosen.iter().map(|f| ids[*f]).collect(),
            settings: settings.iter().map(|s| chosen.iter().map(|f| s[*f]).collect()).collect(),
            frames: kept(frames, |f| number[f].is_some()),
            tracks: tracks.into_iter().filter_map(of_chosen).collect(),
            log,
        }
    }
}

/// What of the survey leaves attenuation undetermined.
fn undetermined(CameraSession { survey, .. }: &CameraSession) -> Option<NotIdentified> {
    let moves = survey.rig.camera_motion.is_some();
    survey.diagnostics.iter().find_map(|d| match d.fact {
        Fact::RangeFact(RangeFact::EqualBeams { .. }) => Some(NotIdentified::SlopeUnknown),
        Fact::MountFact(MountFact::LampsStay { .. }) if moves => Some(NotIdentified::LampsStay),
        _ => None,
    })
}

/// Those whose number passes.
fn kept<T>(all: Vec<T>, is_kept: impl Fn(usize) -> bool) -> Vec<T> {
    all.into_iter().enumerate().filter(|(n, _)| is_kept(*n)).map(|(_, one)| one).collect()
}

/// Logs of one model must be different logs of the same camera and strobe.
///
/// # Errors
/// That.
pub fn ensure_same_camera(logs: &[&SampledLog]) -> Result<()> {
    for (n, log) in logs.iter().enumerate() {
        for before in &logs[..n] {
            let (a, b) = (&before.input.name, &log.input.name);
            if log.input.identity().is_same(&before.input.identity()) {
                return Err(Error::Usage(format!("{a} and {b} are the same log")));
            }
            let ((w, h), (v, g)) = (log.image_size, before.image_size);
            if (w, h, log.container) != (v, g, before.container) {
                return Err(Error::Usage(format!(
                    "{b} ({w}×{h}) and {a} ({v}×{g}) are of different cameras or image formats; \
                     a model is of one camera and strobe"
                )));
            }
            if let Some(instrument) = other_mount(&log.extrinsics, &before.extrinsics) {
                return Err(Error::Usage(format!(
                    "{a} and {b} have the {instrument} in different places; a model is of one \
                     camera and strobe: if it was not moved, give its mount in a rig file (--rig)"
                )));
            }
        }
    }
    Ok(())
}

/// The instrument whose mount differs.
fn other_mount(a: &Extrinsics, b: &Extrinsics) -> Option<&'static str> {
    let is_other = |apart: nalgebra::Isometry3<f64>| {
        apart.translation.vector.norm() > SAME_MOUNT.0 || apart.rotation.angle() > SAME_MOUNT.1
    };
    let apart = |a: Transform<_, _>, b: Transform<_, _>| a.isometry().inverse() * b.isometry();
    let strobe = a.strobe.lamps.isometry().inverse() * b.strobe.lamps.isometry();
    if is_other(apart(a.body_from_optical, b.body_from_optical)) {
        return Some("camera");
    }
    is_other(strobe).then_some("strobe")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vehicle::{Lamps, StrobeMount};

    fn mounts(camera_x_m: f64, strobe_x_m: f64) -> Extrinsics {
        let at = |x_m: f64| [x_m, 0.0, 0.3];
        let upright = [0.0, 0.0, 0.0, 1.0];
        Extrinsics {
            body_from_optical: Transform::from_parts(at(camera_x_m), upright),
            body_from_dvl: Transform::identity(),
            strobe: StrobeMount {
                lamps: Lamps::one(Transform::from_parts(at(strobe_x_m), upright)),
                source: None,
            },
        }
    }

    #[test]
    fn mounts_of_logs_agree_within_a_centimetre() {
        let of_the_first = mounts(0.1, 0.8);
        assert_eq!(other_mount(&mounts(0.105, 0.795), &of_the_first), None);
        assert_eq!(other_mount(&mounts(0.12, 0.8), &of_the_first), Some("camera"));
        assert_eq!(other_mount(&mounts(0.1, 0.7), &of_the_first), Some("strobe"));
        // a turn in place is another mount too
        let mut turned = of_the_first.clone();
        turned.body_from_optical = Transform::from_parts([0.1, 0.0, 0.3], [0.0, 0.0, 0.1, 0.995]);
        assert_eq!(other_mount(&turned, &of_the_first), Some("camera"));
    }
}
