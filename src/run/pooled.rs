//! Samples of several logs in one: what pass one collected, and where each frame came from.

use super::pass_one::Collected;
use crate::diagnostics::{Diagnostic, EstimateFact};
use crate::error::{Error, Result};
use crate::estimate::{FrameSamples, MatchedPair, TiltFit, Unlit};
use crate::image::Bands;
use crate::model::{FrameGainFile, InputFile, RangeFactor, TiltFile, TiltsFile};
use crate::recording::LogIdentity;
use crate::session::{CameraSession, FrameId};
use crate::stats;
use crate::vehicle::SettingSeries;

/// Samples of all logs.
#[derive(Default)]
pub struct Pooled {
    /// in the order of the logs
    pub frames: Vec<FrameSamples>,
    /// matched keypoints
    pub pairs: Vec<MatchedPair>,
    /// the logs
    pub inputs: Vec<InputFile>,
    /// what is to be said of the logs
    pub diagnostics: Vec<Diagnostic>,
    /// per setting of the first log: its value for every frame, NaN where unknown
    pub settings: Vec<Vec<f64>>,
    /// per log: what is added to the stamps of its camera (s)
    pub offsets_s: Vec<f64>,
    /// per frame: index of its log, and its identity there
    pub origins: Vec<(usize, Option<FrameId>)>,
}

impl Pooled {
    /// Joins the samples of all logs.
    ///
    /// # Errors
    /// A log cannot be read, or there is no frame with a seafloor.
    pub fn new(logs: Vec<(&CameraSession, Collected)>) -> Result<Self> {
        let Some((first, _)) = logs.first() else {
            return Err(Error::Usage("no log was given".into()));
        };
        let first = *first;
        let mut pooled = Self::default();
        pooled.settings.resize(first.survey.settings.len(), Vec::new());
        for (session, collected) in logs {
            pooled.add(first, session, collected)?;
        }
        if pooled.frames.is_empty() {
            first.frames_with_seafloor()?;
            let topic = &first.survey.camera_topic;
            return Err(Error::Data(format!("no image of {topic} can be decoded and used")));
        }
        Ok(pooled)
    }

    fn add(
        &mut self,
        first: &CameraSession,
        session: &CameraSession,
        mut collected: Collected,
    ) -> Result<()> {
        let (log, offset) = (self.inputs.len(), self.frames.len());
        let survey = &session.survey;
        self.offsets_s.push(survey.camera_offset_s);
        let LogIdentity { sha256, index_sha256 } = session.recording.identity();
        self.inputs.push(InputFile {
            name: session.file_name(),
            sha256,
            index_sha256,
            camera_topic: survey.camera_topic.clone(),
            dvl_topic: survey.dvl_topic.clone(),
            frames: collected.frames.len(),
            unlit_below: collected.unlit.map(|unlit| unlit.below),
        });
        self.diagnostics.extend(collected.unlit.map(|Unlit { frames, ratio, .. }| {
            let of = frames + collected.frames.len();
            Diagnostic::on(&survey.camera_topic, EstimateFact::UnlitFrames { frames, of, ratio })
        }));
        for (values, series) in self.settings.iter_mut().zip(&first.survey.settings) {
            let is_same = |s: &&SettingSeries| (&s.topic, &s.name) == (&series.topic, &series.name);
            let same = survey.settings.iter().find(is_same);
            let value = |f: &FrameSamples| same.and_then(|s| s.at(f.stamp)).unwrap_or(f64::NAN);
            values.extend(collected.frames.iter().map(value));
        }
        let id = |f: &FrameSamples| survey.frames.get(f.frame).map(|frame| frame.id);
        self.origins.extend(collected.frames.iter().map(|f| (log, id(f))));
        self.frames.append(&mut collected.frames);
        let pairs = collected.pairs.into_iter();
        self.pairs.extend(pairs.map(|p| MatchedPair { a: p.a + offset, b: p.b + offset, ..p }));
        Ok(())
    }
}

/// Tilts of the frames' planes, for `model.json`.
pub fn tilts_file(
    found: &TiltFit,
    (origins, offsets_s): (&[(usize, Option<FrameId>)], &[f64]),
    frames: &[FrameSamples],
) -> TiltsFile {
    let degrees = |tilt: &[f64; 2]| tilt.map(|t| (t.to_degrees() * 1e6).round() / 1e6);
    let of = |((input, _), (samples, tilt)): (&(usize, _), (&FrameSamples, &[f64; 2]))| TiltFile {
        stamp_ns: samples.stamp.plus_seconds(-offsets_s.get(*input).unwrap_or(&0.0)).0,
        input: *input,
        tilt_deg: degrees(tilt),
    };
    let median = std::array::from_fn(|axis| {
        stats::median(&found.tilts.iter().map(|t| t[axis]).collect::<Vec<_>>())
    });
    let frames = origins.iter().zip(frames.iter().zip(&found.tilts)).map(of).collect();
    TiltsFile { median_deg: degrees(&median), frames }
}

/// Gains of the frames, for `model.json`, where they are not 1. Frames are those that were pooled;
/// `log_gains` are the logs of their gains and of the factors of their slant ranges.
pub fn frame_gains(
    origins: &[(usize, Option<FrameId>)],
    frames: &[FrameSamples],
    log_gains: &[(Bands, RangeFactor)],
) -> Vec<FrameGainFile> {
    let frames = origins.iter().zip(frames).zip(log_gains);
    let uneven =
        frames.filter(|(_, (log_gain, ranges))| *log_gain != [0.0; 3] || !ranges.is_none());
    uneven
        .map(|(((input, frame), samples), (log_gain, ranges))| {
            let bands = &log_gain[..samples.bands];
            let mean = bands.iter().sum::<f64>() / bands.len() as f64;
            let is_even = bands.iter().all(|gain| *gain == bands[0]);
            FrameGainFile {
                frame: *frame,
                input: *input,
                stamp_ns: samples.stamp.0,
                gain: if is_even { bands[0].exp() } else { mean.exp() },
                balance: (!is_even).then(|| log_gain.map(|gain| (gain - mean).exp())),
                range_factor: ranges.log_factor.exp(),
                range_tilt: ranges.log_tilt,
                is_unexplained: ranges.is_unexplained,
            }
        })
        .collect()
}
