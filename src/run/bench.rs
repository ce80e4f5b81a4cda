//! Frames one by one, for the products: decoded, sampled, corrected by any method.

use std::collections::BTreeSet;

use super::camera_model::CameraModel;
use super::corrector::Corrector;
use super::prepared_model::Rendering;
use crate::config::{Method, RenderConfig, WhiteBalance};
use crate::correct::{MeanFrames, estimate_rendering};
use crate::error::Result;
use crate::estimate::{FrameSamples, sample_frame};
use crate::geometry::LightPath;
use crate::image::{LinearImage, SensorImage, interleaved};
use crate::model::{ModelFile, RenderingFile};
use crate::parallel::Threads;
use crate::recording::{FrameId, LogIdentity, Message};
use crate::session::{CameraSession, Frame};

/// A camera of a log and its model.
pub struct Bench {
    /// log and survey
    pub session: CameraSession,
    /// the model
    pub model: CameraModel,
    threads: Threads,
}

/// A frame in linear light.
pub struct BenchFrame<'f> {
    /// pixel values and geometry
    pub frame: Frame<'f>,
    /// linear light
    pub image: SensorImage,
    /// the message, for later
    pub message: &'f Message,
}

impl Bench {
    /// Prepares the model for a camera. The log may be a corrected one, made from this source.
    ///
    /// # Errors
    /// The model's beam pattern cannot be read, or the log not.
    pub fn new(
        mut session: CameraSession,
        file: ModelFile,
        source: Option<&LogIdentity>,
        threads: usize,
    ) -> Result<Self> {
        let model = CameraModel::new(&mut session, file, source)?;
        Ok(Self { session, model, threads: Threads::new(threads) })
    }

    /// Runs `work` in parallel over the chosen frames, and passes the results to `sink` in the
    /// order of the file. Frames that cannot be decoded or have no seafloor are left out.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn each<R: Send>(
        &self,
        chosen: &BTreeSet<FrameId>,
        work: impl Fn(&BenchFrame<'_>) -> R + Sync + Send,
        mut sink: impl FnMut(R),
    ) -> Result<()> {
        let work = |message: Message| self.with_frame(&message, &work);
        self.session.for_frames(chosen, &self.threads, work, |result| {
            result.into_iter().for_each(&mut sink);
            Ok(())
        })
    }

    /// Builds a frame from its message and passes it on.
    pub fn with_frame<R>(
        &self,
        message: &Message,
        work: impl FnOnce(&BenchFrame<'_>) -> R,
    ) -> Option<R> {
        let image = self.session.read(message).ok()?;
        let frame = self.session.frame(&image, Vec::new()).ok()?;
        let image = frame.light(Vec::new()).ok()?;
        Some(work(&BenchFrame { frame, image, message }))
    }

    /// Samples of a frame, with keypoints on request.
    pub fn samples(&self, frame: &BenchFrame<'_>, with_keypoints: bool) -> FrameSamples {
        let at = frame.frame.at;
        sample_frame(
            (self.session.survey.frame_number(at.id).unwrap_or_default(), at.stamp),
            &frame.image,
            &frame.frame.view(),
            with_keypoints.then_some(f64::INFINITY),
            &self.session.config.matching,
            &self.session.config.estimate,
        )
    }

    /// Log colors of a frame on a coarse grid, with their light paths.
    pub fn log_colors(&self, frame: &BenchFrame<'_>) -> Vec<([f32; 3], LightPath)> {
        let lamps = self.session.survey.rig.strobe.lamps;
        let samples = self.samples(frame, false);
        let grid = samples.grid.iter();
        grid.filter_map(|(_, s)| Some((s.log_color, s.path(lamps)?))).collect()
    }

    /// Exposure and white balance for a method other than the model's, from log colors.
    pub fn exposure(
        &self,
        log_colors: &[([f32; 3], LightPath)],
        method: Method,
        white_balance: WhiteBalance,
    ) -> RenderingFile {
        let config = RenderConfig { method, white_balance, ..self.session.config.render.clone() };
        estimate_rendering(
            log_colors,
            &self.model.prepared.model,
            self.session.survey.white_level,
            &config,
        )
    }

    /// Corrects a frame by a method of Eq. 15; linear light where 1 is white.
    pub fn corrected(
        &self,
        frame: &BenchFrame<'_>,
        method: Method,
        exposure: &RenderingFile,
    ) -> LinearImage {
        let render = &self.session.config.render;
        let config = RenderConfig { method, mask: false, rectify: false, ..render.clone() };
        let means = MeanFrames::default();
        let rendering = Rendering { config: &config, exposure, means: &means };
        let pixels = &frame.frame.pixels;
        let mut corrected = LinearImage {
            pixels: Vec::with_capacity(pixels.width * pixels.height * pixels.bands()),
            width: pixels.width,
            height: pixels.height,
            bands: pixels.bands(),
        };
        let corrector = Corrector::new(&self.session, &self.model, rendering);
        let bands = corrected.bands;
        corrector.rows(&frame.frame, None, |row| corrected.pixels.extend(interleaved(row, bands)));
        corrected
    }
}
