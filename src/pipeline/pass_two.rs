//! Pass two over a log: every message is copied, every frame corrected, all of it written in order.

use std::collections::BTreeMap;

use crate::config::{Config, ImageFormat, Method};
use crate::correct::{Corrected, Correction, FrameFacts};
use crate::error::Result;
use crate::geometry::{NoSeafloor, SeafloorPlane, View};
use crate::image::decode::{Light, decode};
use crate::image::transfer::SrgbTable;
use crate::image::{Container, LinearImage, encode};
use crate::messages::output::{self, OutputType};
use crate::messages::{Heading, Kind, heading};
use crate::model::{ImagingModel, LightSettingFile, ModelFile};
use crate::recording::{Entry, Message, NewChannel, Output, Recording, Window};
use crate::report::{Reason, Report};
use crate::units::Stamp;

use super::ordered_map::{Threads, ordered_map};
use super::scan::Scan;
use super::survey::Survey;
use super::{Progress, Step};

mod frame_messages;
mod tally;

use tally::Tally;

/// Bytes of messages in a batch, at most; frames are bounded by the number of threads as well.
const BATCH_BYTES: usize = 32 << 20;

/// The corrected pictures' topic: the `image…` element becomes `image_corrected`, `/compressed` comes last.
pub fn corrected_topic(camera_topic: &str, compressed: bool) -> String {
    let base = camera_topic.strip_suffix("/compressed").unwrap_or(camera_topic);
    let mut elements: Vec<&str> = base.split('/').collect();
    match elements.iter().rposition(|e| e.starts_with("image")) {
        Some(at) => elements[at] = "image_corrected",
        None => elements.push("image_corrected"),
    }
    elements.join("/") + if compressed { "/compressed" } else { "" }
}

/// The container corrected pictures go out in.
pub fn output_container(source: Container, config: &Config) -> Container {
    let jpeg = Container::Jpeg { subsampled: matches!(source, Container::Jpeg { subsampled: true }) };
    let deep = config.render.depth == 16;
    match (config.render.image_format, source) {
        (ImageFormat::Raw, _) | (ImageFormat::Same, Container::Raw) => Container::Raw,
        (ImageFormat::Png, _) | (ImageFormat::Auto | ImageFormat::Same, Container::Png) => Container::Png,
        (ImageFormat::Auto | ImageFormat::Same, _) if deep => Container::Png,
        (ImageFormat::Jpeg | ImageFormat::Auto | ImageFormat::Same, _) => jpeg,
    }
}

/// The channels that are added.
struct Added {
    corrected: NewChannel,
    camera_info: Option<NewChannel>,
    attenuation: NewChannel,
    seafloor: NewChannel,
    beam_pattern: NewChannel,
    beam_picture: NewChannel,
    frame: NewChannel,
    log: NewChannel,
    plot_attenuation: NewChannel,
    plot_altitude: NewChannel,
    plot_residual: NewChannel,
}

/// A frame after the work on it.
struct Done {
    message: Message,
    heading: Heading,
    plane: Option<SeafloorPlane>,
    result: std::result::Result<(Vec<u8>, FrameFacts), Reason>,
}

enum Item {
    Other(Message),
    Frame(usize, Message),
    Damaged,
}

enum Outcome {
    Other(Message),
    Frame(Box<Done>),
    Damaged,
}

/// Everything pass two works with.
pub struct PassTwo<'p> {
    /// the log
    pub recording: &'p Recording,
    /// its scan
    pub scan: &'p Scan,
    /// its survey
    pub survey: &'p Survey,
    /// the stretch that is written
    pub window: Window,
    /// the choices
    pub config: &'p Config,
    /// the model as a file
    pub file: &'p ModelFile,
    /// the model
    pub model: &'p ImagingModel,
    /// how frames are corrected
    pub correction: Correction<'p>,
    /// the input's fingerprint
    pub source_sha256: &'p str,
    /// the rig, as a rig file's text
    pub rig_toml: &'p str,
    /// topics that are kept, where the user narrows them
    pub only: Option<regex::Regex>,
}

impl PassTwo<'_> {
    /// Writes the corrected log and returns the account of it.
    ///
    /// # Errors
    /// Writing failed.
    pub fn run(&self, mut out: Output, threads: &Threads, progress: &dyn Progress) -> Result<Report> {
        let container = output_container(self.survey.container, self.config);
        let mut report = self.empty_report(container);
        let kept = self.copy_declarations(&mut out, &mut report)?;
        let added = self.add_channels(&mut out, container)?;
        let srgb = SrgbTable::new();

        progress.begin(Step::Correct, self.survey.frames.len());
        let mut next_frame = 0;
        let items = self.recording.messages(self.window).map(|entry| match entry {
            Entry::Message(m) if self.survey.camera_channels.contains(&m.channel) => {
                next_frame += 1;
                Item::Frame(next_frame - 1, m)
            }
            Entry::Message(m) => Item::Other(m),
            Entry::Damaged(_) => Item::Damaged, // the scan has listed it
        });
        let frame_weight = BATCH_BYTES / (2 * threads.count());
        let weigh = |item: &Item| match item {
            Item::Frame(_, m) => frame_weight.max(m.data().len()),
            Item::Other(m) => m.data().len() + 64,
            Item::Damaged => 0,
        };
        let work = |item| match item {
            Item::Other(m) => Outcome::Other(m),
            Item::Damaged => Outcome::Damaged,
            Item::Frame(index, m) => Outcome::Frame(Box::new(self.frame(index, m, container, &srgb))),
        };
        let mut tally = Tally::default();
        ordered_map(items, BATCH_BYTES, weigh, threads, work, |outcome| -> Result<()> {
            match outcome {
                Outcome::Damaged => {}
                Outcome::Other(m) => {
                    if kept.get(&m.channel).copied().unwrap_or(false) {
                        out.copy(&m)?;
                        report.messages_copied += 1;
                    }
                }
                Outcome::Frame(done) => {
                    let keep = match kept.get(&done.message.channel) {
                        Some(true) => true,
                        // `--drop-raw` leaves out what has a corrected twin; a frame without one is all there is of it.
                        Some(false) if self.config.output.drop_raw && done.result.is_err() => {
                            self.copy_channel(&mut out, done.message.channel)?;
                            true
                        }
                        _ => false,
                    };
                    if keep {
                        out.copy(&done.message)?;
                        report.messages_copied += 1;
                    }
                    tally.count(&done);
                    report.messages_added += self.write_frame(&mut out, &added, &done, report.frames == 0, &tally)?;
                    report.frames += 1;
                    progress.advance(1);
                }
            }
            Ok(())
        })?;
        progress.end();
        tally.into_report(&mut report);
        self.finish(out, &mut report)?;
        Ok(report)
    }

    fn empty_report(&self, container: Container) -> Report {
        Report {
            version: env!("CARGO_PKG_VERSION").into(),
            source: self.recording.path().file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default(),
            camera_topic: self.survey.camera_topic.clone(),
            corrected_topic: corrected_topic(&self.survey.camera_topic, container != Container::Raw),
            dvl_topic: self.survey.dvl_topic.clone(),
            method: method_name(self.config.render.method).into(),
            remarks: self.survey.remarks.clone(),
            warnings: self
                .survey
                .warnings
                .iter()
                .chain(&self.file.warnings)
                .cloned()
                .chain(self.file.not_identified_because.iter().map(|why| format!("attenuation is not identified: {why}")))
                .collect(),
            damage: self.scan.damage.iter().cloned().chain(self.scan.homeless_damage()).collect(),
            ..Report::default()
        }
    }

    /// Copies every schema and every channel that is kept; says which channels those are.
    fn copy_declarations(&self, out: &mut Output, report: &mut Report) -> Result<BTreeMap<u16, bool>> {
        for (id, schema) in &self.recording.schemas {
            out.copy_schema(*id, schema)?;
        }
        let mut kept = BTreeMap::new();
        for (id, channel) in &self.recording.channels {
            let raw = self.config.output.drop_raw && self.survey.camera_channels.contains(id);
            let keep = !raw && self.only.as_ref().is_none_or(|only| only.is_match(&channel.topic));
            kept.insert(*id, keep);
            if keep {
                if channel.schema_id != 0 && !self.recording.schemas.contains_key(&channel.schema_id) {
                    report
                        .warnings
                        .push(format!("{}: its schema {} is nowhere in the log; the channel is kept without one", channel.topic, channel.schema_id));
                }
                self.copy_channel(out, *id)?;
            }
        }
        Ok(kept)
    }

    fn copy_channel(&self, out: &mut Output, id: u16) -> Result<()> {
        let Some(channel) = self.recording.channels.get(&id) else { return Ok(()) };
        let schema_id = if self.recording.schemas.contains_key(&channel.schema_id) { channel.schema_id } else { 0 };
        out.copy_channel(id, &crate::recording::Channel { schema_id, ..channel.clone() })
    }

    fn add_channels(&self, out: &mut Output, container: Container) -> Result<Added> {
        let mut add = |topic: &str, kind: OutputType| out.add_channel(topic, kind.name, kind.schema);
        let compressed = container != Container::Raw;
        let corrected = corrected_topic(&self.survey.camera_topic, compressed);
        Ok(Added {
            corrected: add(&corrected, if compressed { output::COMPRESSED_IMAGE } else { output::IMAGE })?,
            camera_info: if self.config.render.rectify {
                Some(add(&(corrected_topic(&self.survey.camera_topic, false) + "/camera_info"), output::CAMERA_INFO)?)
            } else {
                None
            },
            attenuation: add("/unwater/attenuation", output::ATTENUATION)?,
            seafloor: add("/unwater/seafloor", output::SEAFLOOR)?,
            beam_pattern: add("/unwater/beam_pattern", output::BEAM_PATTERN)?,
            beam_picture: add("/unwater/beam_pattern/picture/compressed", output::COMPRESSED_IMAGE)?,
            frame: add("/unwater/frame", output::FRAME)?,
            log: add("/unwater/log", output::LOG)?,
            plot_attenuation: add("/unwater/plot/attenuation_per_m", output::MULTI_ARRAY)?,
            plot_altitude: add("/unwater/plot/camera_altitude_m", output::MULTI_ARRAY)?,
            plot_residual: add("/unwater/plot/seafloor_residual_m", output::MULTI_ARRAY)?,
        })
    }

    /// One frame, on whichever core: decode, find its plane, correct, encode.
    fn frame(&self, index: usize, message: Message, container: Container, srgb: &SrgbTable) -> Done {
        let mut said = Heading::default();
        let mut plane = None;
        let result = (|| {
            let decoder = self.scan.decoders.get(&message.channel).ok_or_else(|| Reason::Undecodable("its channel is not read".into()))?;
            let value = decoder.read(message.data()).map_err(Reason::Undecodable)?;
            said = heading(&value);
            let Kind::Picture(read) = decoder.message_type.kind else { return Err(Reason::Undecodable("no picture".into())) };
            let light = Light { transfer: self.config.light.transfer, white_level: self.survey.white_level };
            let mut picture = read(&value).and_then(|p| decode(&p, light)).map_err(Reason::Undecodable)?;
            self.survey.flat_field.as_ref().map_or(Ok(()), |flat| flat.divide(&mut picture.image)).map_err(|_sizes| Reason::WrongSize)?;
            let stamp = self.survey.frames.get(index).map_or(message.logged(), |f| f.stamp);
            let found = self.survey.pings.seafloor(stamp, &self.survey.rig, &self.config.seafloor).map_err(|e| match e {
                NoSeafloor::NoPing { .. } => Reason::NoPing,
                NoSeafloor::NoReturn => Reason::NoReturn,
                NoSeafloor::Impossible => Reason::ImpossiblePlane,
            })?;
            plane = Some(found);
            let camera = self.survey.rig.camera.scaled_to(picture.image.light.width, picture.image.light.height).ok_or(Reason::WrongSize)?;
            let (coding, bands) = (picture.coding, picture.image.bands());
            if bands != self.model.bands {
                return Err(Reason::Undecodable(format!("it has {bands} bands, the model {}", self.model.bands)));
            }
            let view = View { camera: &camera, rig: &self.survey.rig, plane: &found };
            let now = self.model.at(stamp);
            let Corrected { image, facts } = Correction { model: &now, ..self.correction }.apply(
                picture.image,
                &view,
                self.frame_gain(stamp),
                self.config.render.rectify.then(|| camera.rectified()).as_ref(),
            );
            if facts.off_surface_share >= 1.0 {
                return Err(Reason::OffSurface);
            }
            let subsampled = coding.container == Container::Jpeg { subsampled: true };
            Ok((self.encoded(&said, &image, container, subsampled, srgb).map_err(Reason::Unencodable)?, facts))
        })();
        Done { message, heading: said, plane, result }
    }

    /// Light of a frame over others: by its settings, and where pass one saw it stand out from its neighbours.
    fn frame_gain(&self, stamp: Stamp) -> f64 {
        let by_setting = |s: &LightSettingFile| {
            let series = self.survey.settings.iter().find(|series| (&series.topic, &series.name) == (&s.topic, &s.name))?;
            Some(s.log_gain(series.at(stamp)?))
        };
        let set: f64 = self.file.light_settings.iter().filter_map(by_setting).sum::<f64>().exp();
        set * self.file.frame_gains.iter().find(|g| g.stamp_ns == stamp.0).map_or(1.0, |g| g.gain)
    }

    fn encoded(
        &self,
        heading: &Heading,
        image: &LinearImage,
        container: Container,
        subsampled: bool,
        srgb: &SrgbTable,
    ) -> std::result::Result<Vec<u8>, String> {
        let LinearImage { width, height, bands, .. } = *image;
        let deep = self.config.render.depth == 16;
        let samples: Vec<u8> = if deep {
            image.pixels.iter().flat_map(|v| ((v.clamp(0.0, 1.0) * 65535.0).round() as u16).to_ne_bytes()).collect()
        } else {
            image.pixels.iter().map(|v| srgb.code(*v)).collect()
        };
        Ok(match container {
            Container::Jpeg { .. } => {
                output::compressed_image(heading, "jpeg", &encode::jpeg(&samples, width, height, bands, self.config.render.jpeg_quality, subsampled)?)
            }
            Container::Png => output::compressed_image(heading, "png", &encode::png(&samples, width, height, bands, self.config.render.depth)?),
            Container::Raw => {
                let encoding = match (bands, deep) {
                    (1, false) => "mono8",
                    (1, true) => "mono16",
                    (_, false) => "rgb8",
                    (_, true) => "rgb16",
                };
                let samples: Vec<u8> =
                    if deep && cfg!(target_endian = "big") { samples.chunks_exact(2).flat_map(|c| [c[1], c[0]]).collect() } else { samples };
                output::image(heading, width, height, encoding, samples.len() / height.max(1), &samples)
            }
        })
    }

    /// Attachments and metadata: the input's, then ours.
    fn finish(&self, mut out: Output, report: &mut Report) -> Result<()> {
        for attachment in self.recording.attachments() {
            match attachment {
                Ok(attachment) => out.attach(&attachment)?,
                Err(damage) => report.damage.push(damage),
            }
        }
        for record in &self.recording.metadata {
            out.metadata(record)?;
        }
        let (first, last) = self.scan.span.unwrap_or_default();
        let model_json = self.file.to_json();
        let config_toml = self.config.to_commented_toml();
        let texts = [
            ("model.json", "application/json", model_json.clone()),
            ("report.json", "application/json", report.to_json()),
            ("unwater.toml", "application/toml", config_toml.clone()),
            ("rig.toml", "application/toml", self.rig_toml.into()),
        ];
        for (name, media_type, text) in texts {
            out.attach(&mcap::Attachment {
                log_time: last,
                create_time: first,
                name: name.into(),
                media_type: media_type.into(),
                data: text.into_bytes().into(),
            })?;
        }
        let facts = [
            ("version", report.version.clone()),
            ("camera_topic", report.camera_topic.clone()),
            ("corrected_topic", report.corrected_topic.clone()),
            ("dvl_topic", report.dvl_topic.clone()),
            ("method", report.method.clone()),
            ("model_sha256", super::sha256(model_json.as_bytes())),
            ("source", report.source.clone()),
            ("source_sha256", self.source_sha256.into()),
            ("configuration", config_toml),
        ];
        let metadata = facts.into_iter().map(|(k, v)| (k.into(), v)).collect();
        out.metadata(&mcap::records::Metadata { name: "unwater".into(), metadata })?;
        out.finish()
    }
}

/// The word of a method as the command line has it.
pub fn method_name(method: Method) -> &'static str {
    match method {
        Method::Full => "full",
        Method::Attenuation => "attenuation",
        Method::BeamPattern => "beam-pattern",
        Method::FrameAverage => "frame-average",
    }
}

#[cfg(test)]
mod tests {
    use super::corrected_topic;

    #[test]
    fn topics_follow_image_transport() {
        assert_eq!(corrected_topic("/camera/image_raw", false), "/camera/image_corrected");
        assert_eq!(corrected_topic("/camera/image_raw", true), "/camera/image_corrected/compressed");
        assert_eq!(corrected_topic("/camera/image_color/compressed", true), "/camera/image_corrected/compressed");
        assert_eq!(corrected_topic("/stereo/left", true), "/stereo/left/image_corrected/compressed");
    }
}
