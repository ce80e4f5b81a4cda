//! Samples of several logs in one, and where each frame came from.

use super::log_samples::{LogSamples, SampledLog};
use crate::diagnostics::Diagnostic;
use crate::error::{Error, Result};
use crate::estimate::{FrameSamples, Observation, TiltFit, Track};
use crate::geometry::PlaneChange;
use crate::image::Bands;
use crate::model::{FrameGainFile, InputFile, RangeFactor, TiltFile, TiltsFile, rounded};
use crate::session::FrameId;
use crate::stats;

/// Samples of all logs.
pub struct Pooled {
    /// what is known of the first log
    pub first: SampledLog,
    /// in the order of the logs
    pub frames: Vec<FrameSamples>,
    /// seafloor points seen more than once
    pub tracks: Vec<Track>,
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
    /// There is none.
    pub fn new(logs: Vec<LogSamples>) -> Result<Self> {
        let Some(first) = logs.first().map(|first| first.log.clone()) else {
            return Err(Error::Usage("no log was given".into()));
        };
        let mut pooled = Self {
            settings: vec![Vec::new(); first.settings.len()],
            first,
            frames: Vec::new(),
            tracks: Vec::new(),
            inputs: Vec::new(),
            diagnostics: Vec::new(),
            offsets_s: Vec::new(),
            origins: Vec::new(),
        };
        logs.into_iter().for_each(|log| pooled.add(log));
        Ok(pooled)
    }

    fn add(&mut self, LogSamples { log, mut frames, ids, settings, tracks }: LogSamples) {
        let (number, offset) = (self.inputs.len(), self.frames.len() as u32);
        self.offsets_s.push(log.camera_offset_s);
        self.diagnostics.extend(log.diagnostics);
        for (values, of) in self.settings.iter_mut().zip(&self.first.settings) {
            match log.settings.iter().position(|name| name == of) {
                Some(same) => values.extend(&settings[same]),
                None => values.extend(frames.iter().map(|_| f64::NAN)),
            }
        }
        self.origins.extend(ids.into_iter().map(|id| (number, id)));
        frames.iter_mut().for_each(|frame| frame.log = number);
        self.frames.append(&mut frames);
        let moved = |o: Observation| Observation { frame: o.frame + offset, ..o };
        self.tracks.extend(tracks.into_iter().map(|t| t.into_iter().map(moved).collect::<Track>()));
        self.inputs.push(log.input);
    }
}

/// What the frames' planes are off by, for `model.json`.
pub fn tilts_file(
    found: &TiltFit,
    (origins, offsets_s): (&[(usize, Option<FrameId>)], &[f64]),
    frames: &[FrameSamples],
) -> TiltsFile {
    let degrees = |tilt: &[f64; 2]| tilt.map(|t| rounded(t.to_degrees()));
    let of =
        |((input, _), (samples, plane)): (&(usize, _), (&FrameSamples, &PlaneChange))| TiltFile {
            stamp_ns: samples.stamp.plus_seconds(-offsets_s.get(*input).unwrap_or(&0.0)).0,
            input: *input,
            tilt_deg: degrees(&plane.tilt),
            altitude_factor: rounded(plane.log_scale.exp()),
        };
    let median = std::array::from_fn(|axis| {
        stats::median(&found.planes.iter().map(|p| p.tilt[axis]).collect::<Vec<_>>())
    });
    let frames = origins.iter().zip(frames.iter().zip(&found.planes)).map(of).collect();
    TiltsFile { median_deg: degrees(&median), frames, is_measured: found.is_measured }
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
