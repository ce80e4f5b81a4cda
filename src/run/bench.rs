//! Frames on the bench: one camera of a log, its frames decoded and corrected singly and in any
//! way. Pages, sheets and mosaics look at frames so; a run does not.

use std::collections::BTreeSet;

use super::model_of::strobe_of;
use super::{BEAM_REFINED, BEAM_ROUGHEST, glow_table};
use crate::config::{Config, Method, WhiteBalance};
use crate::correct::{Correction, Frame, MeanFrames, estimate_rendering};
use crate::error::{Error, Result};
use crate::estimate::{FrameSamples, sample_frame};
use crate::geometry::{LightPath, SeafloorPlane, Terrain, View};
use crate::image::decode::{CameraResponse, PixelValues, decode, read_pixels};
use crate::image::noise::Noise;
use crate::image::{LinearImage, SensorImage};
use crate::messages::Kind;
use crate::model::{ImagingModel, ModelFile, RenderingFile, ScatterTable};
use crate::parallel::Threads;
use crate::recording::Message;
use crate::session::Prepared;
use crate::session::chosen_frames::for_frames;
use crate::units::Stamp;
use crate::vehicle::Camera;

/// A camera of a log and the model its frames are corrected with.
pub struct Bench {
    /// the log and what it means; the strobe is the model's
    pub log: Prepared,
    /// the model
    pub file: ModelFile,
    /// the choices
    pub config: Config,
    model: ImagingModel,
    /// the same with a finer beam pattern, and how rough that is
    fine: (ImagingModel, (f64, f64)),
    threads: Threads,
}

/// One frame: light, and where it was taken.
pub struct BenchFrame {
    /// which of the camera's, in the order of the file
    pub index: usize,
    /// when
    pub stamp: Stamp,
    /// log time [ns]
    pub log_time: u64,
    /// linear light
    pub image: SensorImage,
    /// as it lies in the log
    message: Message,
    /// the camera at this picture's size
    pub camera: Camera,
    /// the floor below
    pub plane: SeafloorPlane,
    /// heights over it
    pub terrain: Option<Terrain>,
}

impl Bench {
    /// Brings log and model together.
    ///
    /// # Errors
    /// The model's beam pattern cannot be read.
    pub fn new(mut log: Prepared, file: ModelFile, config: Config, threads: usize) -> Result<Self> {
        log.survey.rig.strobe = strobe_of(&file, &log.survey.rig);
        log.survey.white_level =
            config.light.white_level.or(file.rendering.white_level).or(log.survey.white_level);
        let model = file.imaging_model().map_err(Error::Usage)?;
        let fine = ImagingModel {
            beam_pattern: model.beam_pattern.refined(BEAM_REFINED),
            ..model.clone()
        };
        let roughness = fine.beam_pattern.roughness(BEAM_ROUGHEST);
        Ok(Self {
            log,
            file,
            config,
            model,
            fine: (fine, roughness),
            threads: Threads::new(threads),
        })
    }

    /// Does some work on each of the chosen frames, on all cores, and hands on what comes of it in
    /// the order of the frames. Frames that cannot be decoded or have no floor are left out.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn each<R: Send>(
        &self,
        chosen: &BTreeSet<usize>,
        work: impl Fn(BenchFrame) -> R + Sync + Send,
        mut sink: impl FnMut(R),
    ) -> Result<()> {
        let work = |(index, message): (usize, Message)| self.frame(index, &message).map(&work);
        for_frames(
            &self.log.recording,
            &self.log.survey.frames,
            chosen,
            &self.threads,
            work,
            |result| {
                result.into_iter().for_each(&mut sink);
                Ok(())
            },
        )
    }

    fn frame(&self, index: usize, message: &Message) -> Option<BenchFrame> {
        let survey = &self.log.survey;
        let decoder = self.log.scan.decoders.get(&message.channel)?;
        let value = decoder.read(message.data()).ok()?;
        let Kind::Image(read) = decoder.message_type.kind else { return None };
        let mut picture = decode(&read(&value).ok()?, self.light()).ok()?;
        survey.flat_field.as_ref().map_or(Ok(()), |flat| flat.divide(&mut picture.image)).ok()?;
        let stamp = survey.frames.get(index)?.stamp;
        let plane = survey.pings.seafloor(stamp, &survey.rig, &self.config.seafloor).ok()?;
        let terrain = survey.pings.terrain(stamp, &plane, &survey.rig);
        let camera =
            survey.rig.camera.scaled_to(picture.image.light.width, picture.image.light.height)?;
        Some(BenchFrame {
            index,
            stamp,
            log_time: message.log_time,
            image: picture.image,
            message: message.clone(),
            camera,
            plane,
            terrain,
        })
    }

    fn light(&self) -> CameraResponse<'_> {
        let survey = &self.log.survey;
        CameraResponse {
            transfer: self.config.light.transfer,
            white_level: survey.white_level,
            response: survey.response.as_ref(),
        }
    }

    /// A frame's geometry.
    pub fn view<'f>(&'f self, frame: &'f BenchFrame) -> View<'f> {
        View {
            camera: &frame.camera,
            rig: &self.log.survey.rig,
            plane: &frame.plane,
            terrain: frame.terrain.as_ref(),
        }
    }

    /// A frame's samples, with keypoints where they are wanted.
    pub fn samples(&self, frame: &BenchFrame, with_keypoints: bool) -> FrameSamples {
        let of = (frame.index, frame.stamp);
        sample_frame(
            of,
            &frame.image,
            &self.view(frame),
            with_keypoints.then_some(f64::INFINITY),
            &self.config.matching,
            &self.config.estimate,
        )
    }

    /// Log colours over a coarse grid of a frame, and the light's way to each.
    pub fn lit(&self, frame: &BenchFrame) -> Vec<([f32; 3], LightPath)> {
        let lamps = self.log.survey.rig.strobe.lamps;
        self.samples(frame, false)
            .grid
            .iter()
            .filter_map(|(_, s)| Some((s.log_color, s.path(lamps)?)))
            .collect()
    }

    /// Exposure and white balance for a method that is not the model's own, from some frames'
    /// grids.
    pub fn rendering(
        &self,
        lit: &[([f32; 3], LightPath)],
        method: Method,
        white_balance: WhiteBalance,
    ) -> RenderingFile {
        let mut config = self.config.render.clone();
        (config.method, config.white_balance) = (method, white_balance);
        estimate_rendering(lit, &self.model, self.log.survey.white_level, &config)
    }

    /// What the water scatters back, ray by ray, for a method that takes it off: made once for many
    /// frames.
    pub fn glow(&self, method: Method) -> Option<ScatterTable> {
        glow_table(&self.model, &self.log.survey.rig, method)
    }

    /// A frame corrected: light where 1 is white.
    pub fn corrected(
        &self,
        frame: &BenchFrame,
        method: Method,
        rendering: &RenderingFile,
        glow: Option<&ScatterTable>,
    ) -> LinearImage {
        let (fine, roughness) = &self.fine;
        let now = fine.at(frame.stamp);
        let mut config = self.config.render.clone();
        (config.method, config.mask, config.rectify) = (method, false, false);
        let correction = Correction {
            model: &now,
            roughness: *roughness,
            rendering,
            config: &config,
            glow: now.backscatter.as_ref().zip(glow),
            means: &MeanFrames::default(),
            clipped_above: self.config.estimate.clipped_above as f32,
            electrons: self.log.survey.electrons,
        };
        let mut out = LinearImage::new(
            frame.image.light.width,
            frame.image.light.height,
            frame.image.bands(),
        );
        let mut pixels = Vec::with_capacity(out.pixels.len());
        // The frame has been decoded once, so it can be again; otherwise it stays black.
        let _decoded_before = self.with_codes(&frame.message, |codes| {
            let noise = Noise::of(&codes.coding, self.light(), self.log.survey.electrons);
            let (view, gain) =
                (self.view(frame), self.log.survey.frame_gain(&self.file, frame.stamp));
            let flat_field = self.log.survey.flat_field.as_ref();
            let frame =
                Frame { codes, flat_field, view: &view, gain, noise: &noise, rectified: None };
            correction.apply(&frame, |row| pixels.extend_from_slice(row));
        });
        if pixels.len() == out.pixels.len() {
            out.pixels = pixels;
        }
        out
    }

    fn with_codes(&self, message: &Message, work: impl FnOnce(&PixelValues<'_>)) -> Option<()> {
        let decoder = self.log.scan.decoders.get(&message.channel)?;
        let value = decoder.read(message.data()).ok()?;
        let Kind::Image(read) = decoder.message_type.kind else { return None };
        work(&read_pixels(&read(&value).ok()?, self.light()).ok()?);
        Some(())
    }
}
