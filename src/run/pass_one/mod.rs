//! Pass one over a log: frames → samples → matched keypoints. Frames are decoded in parallel and
//! dropped at once; samples are small and stay. `estimate` makes a model of them.

mod pace;
mod pairs;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Mutex;

use crate::config::{Config, Estimator};
use crate::coordinates::{Body, Direction};
use crate::correct::MeanFrames;
use crate::error::Result;
use crate::estimate::{
    FrameSamples, MatchedPair, PLANES_AROUND_S, Unlit, coarsest_m, sample_frame, two_kinds,
};
use crate::image::LinearImage;
use crate::image::transfer::Transfer;
use crate::parallel::Threads;
use crate::recording::{FrameId, Message};
use crate::session::{CameraSession, Frame, FrameRef, Progress, Step};

use pace::{Pace, altitude_m};
pub use pace::{chosen_frames, share_of_log};

/// What pass one keeps of one log.
#[derive(Default)]
pub struct Collected {
    /// samples of the frames, in order
    pub frames: Vec<FrameSamples>,
    /// frames without the strobe, which are left out
    pub unlit: Option<Unlit>,
    /// matched keypoints
    pub pairs: Vec<MatchedPair>,
    /// mean frames, where the method needs them
    pub means: MeanFrames,
    /// whether all frames of the log were used
    pub is_all: bool,
}

/// Pass one over one log.
#[derive(Clone, Copy)]
pub struct PassOne<'p> {
    /// log and survey
    pub session: &'p CameraSession,
    /// the settings; for a quick pass not those of the session
    pub config: &'p Config,
    /// limit of the frames; 0 for none
    pub max_frames: usize,
    /// where it runs
    pub threads: &'p Threads,
    /// whom it reports to
    pub progress: &'p dyn Progress,
}

/// Frames in a row that are examined for two kinds.
const PROBED_FRAMES: usize = 12;

/// Memory that frames reuse.
#[derive(Default)]
struct Buffers {
    pixels: Vec<u8>,
    light: Vec<f32>,
}

/// Samples of a frame; its image and the camera's altitude (m) where the method needs mean frames.
type Sampled = (FrameSamples, Option<(LinearImage, f64)>);

impl PassOne<'_> {
    /// Samples the chosen frames and matches them.
    ///
    /// # Errors
    /// The log cannot be read. A frame that cannot be used is left out; pass two counts it.
    pub fn collect(&self) -> Result<Collected> {
        let Self { session, config, threads, progress, .. } = *self;
        if self.max_frames == 0 {
            let is_all = session.survey.frames.is_empty();
            return Ok(Collected { is_all, ..Collected::default() });
        }
        let mut pace = Pace::of(session, self.max_frames);
        if pace.step.is_multiple_of(2) && self.has_two_kinds()? {
            pace = pace.odd();
        }
        let (chosen, coarsest_m) = self.choose(pace);
        let mut collected = Collected {
            is_all: chosen.len() == session.survey.frames.len(),
            ..Collected::default()
        };
        progress.begin(Step::Estimate, chosen.len());
        let with_keypoints = config.estimate.estimator != Estimator::Altitude;
        let sampler =
            Sampler { session, config, keypoints_up_to: with_keypoints.then_some(coarsest_m) };
        // As many as there are threads, and no longer than this pass.
        let spare: Mutex<Vec<Buffers>> = Mutex::default();
        let ids = chosen.keys().copied().collect();
        let work = |message: Message| {
            let mut buffers =
                spare.lock().map(|mut spare| spare.pop()).ok().flatten().unwrap_or_default();
            let number = *chosen.get(&message.id)?;
            let sampled = sampler.sample(number, &message, &mut buffers)?;
            if let Ok(mut spare) = spare.lock() {
                spare.push(buffers);
            }
            Some(sampled)
        };
        session.for_frames(&ids, threads, work, |sampled| {
            if let Some((samples, image)) = sampled {
                collected.frames.push(samples);
                if let Some((image, camera_altitude_m)) = image {
                    collected.means.add(config.render.method, &image, camera_altitude_m);
                }
            }
            progress.advance(1);
            Ok(())
        })?;
        progress.end();
        // They come in the order of the file; neighbours are neighbours in time.
        collected.frames.sort_by_key(|samples| samples.frame);
        collected.unlit = Unlit::among(&collected.frames);
        if let Some(unlit) = collected.unlit {
            collected.frames.retain(|samples| !unlit.has(samples));
        }
        if with_keypoints {
            let run = (threads, progress);
            collected.pairs = pairs::matched(&collected.frames, session, config, pace, run)?;
        }
        Ok(collected)
    }

    /// Whether frames that follow each other are of two kinds, lit by the strobe and not.
    fn has_two_kinds(&self) -> Result<bool> {
        let frames = &self.session.survey.frames;
        let ids = frames.iter().skip(frames.len() / 2).take(PROBED_FRAMES).map(|f| f.id).collect();
        let brightness = |message: Message| {
            let image = self.session.read(&message).ok()?;
            let frame = self.session.frame(&image, Vec::new()).ok()?;
            Some((image.at.stamp, frame.pixels.brightness()))
        };
        let mut known = Vec::new();
        self.session.for_frames(&ids, self.threads, brightness, |found| {
            known.extend(found);
            Ok(())
        })?;
        known.sort_by_key(|(stamp, _)| *stamp);
        Ok(two_kinds(&known.iter().map(|(_, light)| *light).collect::<Vec<_>>()).is_some())
    }

    /// The chosen frames with their numbers; and the metres of seafloor, times the focal length,
    /// that the coarsest pixel of any of them sees.
    fn choose(&self, pace: Pace) -> (BTreeMap<FrameId, usize>, f64) {
        let Self { session, .. } = *self;
        let considered: Vec<&FrameRef> = session.survey.frames.iter().step_by(pace.step).collect();
        let altitudes: Vec<f64> =
            considered.iter().map(|frame| altitude_m(session, frame)).collect();
        let chosen: BTreeSet<usize> = chosen_frames(&altitudes, self.max_frames);
        let planes = chosen.iter().filter_map(|i| session.seafloor(considered[*i].stamp).ok());
        let coarsest_m =
            planes.map(|plane| coarsest_m(&session.flat_view(&plane))).fold(0.0, f64::max);
        (chosen.into_iter().map(|i| (considered[i].id, i * pace.step)).collect(), coarsest_m)
    }
}

/// Takes samples of frames.
struct Sampler<'s> {
    session: &'s CameraSession,
    config: &'s Config,
    /// with keypoints, up to this footprint; see [`coarsest_m`]
    keypoints_up_to: Option<f64>,
}

impl Sampler<'_> {
    fn sample(&self, number: usize, message: &Message, buffers: &mut Buffers) -> Option<Sampled> {
        let Self { session, config, keypoints_up_to } = *self;
        let image = session.read(message).ok()?;
        let frame = session.frame(&image, std::mem::take(&mut buffers.pixels)).ok()?;
        let light = frame.light(std::mem::take(&mut buffers.light)).ok()?;
        let of = (number, frame.at.stamp);
        let (matching, estimate) = (&config.matching, &config.estimate);
        let mut sampled =
            sample_frame(of, &light, &frame.view(), keypoints_up_to, matching, estimate);
        sampled.eight_bit = frame.pixels.coding.bits <= 8;
        sampled.max_value = frame.pixels.coding.max_value(session.response().white_level);
        sampled.mean_reading = frame.pixels.mean_light();
        sampled.is_srgb = frame.pixels.coding.transfer == Transfer::Srgb;
        sampled.has_attitude = self.session.survey.attitude_topic.is_some();
        sampled.planes_around = self.planes_around(&frame);
        let wants_image = config.render.method.needs_mean_frames();
        let altitude_m = frame.view().camera_altitude_m();
        buffers.pixels = frame.pixels.into_buffer();
        if wants_image {
            return Some((sampled, Some((light.into_demosaiced(), altitude_m))));
        }
        buffers.light = light.light.pixels;
        Some((sampled, None))
    }

    /// The planes a moment before and after a frame.
    fn planes_around(&self, frame: &Frame<'_>) -> Option<[(Direction<Body>, f64); 2]> {
        let at = |offset_s: f64| {
            let plane = self.session.seafloor(frame.at.stamp.plus_seconds(offset_s)).ok()?;
            Some((plane.normal, plane.distance_m))
        };
        Some([at(-PLANES_AROUND_S)?, at(PLANES_AROUND_S)?])
    }
}
