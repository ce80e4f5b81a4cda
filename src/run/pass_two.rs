//! Pass two over a log: every message is copied, every frame corrected, all of it written in order.

use std::collections::BTreeMap;

use crate::config::{Config, ImageFormat, Method};
use crate::correct::FrameFacts;
use crate::diagnostics::{Diagnostic, LogFact, Reason};
use crate::error::Result;
use crate::geometry::SeafloorPlane;
use crate::image::Container;
use crate::image::transfer::{Shoulder, SrgbTable};
use crate::messages::Header;
use crate::parallel::{Job, Threads};
use crate::recording::{
    Block, Message, NewAttachment, NewChannel, Output, OutputFile, Piece, Recording, Window,
};
use crate::report::Report;

use crate::session::{Progress, Step};

mod blocks;
mod frame_messages;
mod of_camera;
mod scene;
mod tally;

pub use blocks::FRAMES_PER_CORE;
use blocks::{Frame, Item, Outcome, UNDER_WAY};
pub use of_camera::OfCamera;
use tally::Tally;

/// Chunks under way before and after the work on frames, for each core [byte].
pub const CHUNKS_PER_CORE: usize = 8 << 20;

/// The corrected pictures' topic: the `image…` element becomes `image_corrected`, `/compressed`
/// comes last.
pub fn corrected_topic(camera_topic: &str, compressed: bool) -> String {
    let base = camera_topic.strip_suffix("/compressed").unwrap_or(camera_topic);
    let mut elements: Vec<&str> = base.split('/').collect();
    match elements.iter().rposition(|e| e.starts_with("image")) {
        Some(at) => elements[at] = "image_corrected",
        None => elements.push("image_corrected"),
    }
    elements.join("/") + if compressed { "/compressed" } else { "" }
}

/// What tells a camera from others in names: its topic without the pictures' own element.
pub fn place_of(camera_topic: &str) -> String {
    let base = camera_topic.strip_suffix("/compressed").unwrap_or(camera_topic);
    let elements: Vec<&str> = base.split('/').filter(|e| !e.is_empty()).collect();
    let camera: Vec<&str> = elements.iter().copied().filter(|e| !e.starts_with("image")).collect();
    let told: String =
        if camera.is_empty() { elements } else { camera }.iter().map(|e| format!("/{e}")).collect();
    told
}

/// The container corrected pictures go out in.
pub fn output_container(source: Container, config: &Config) -> Container {
    let jpeg =
        Container::Jpeg { subsampled: matches!(source, Container::Jpeg { subsampled: true }) };
    let deep = config.render.depth == 16;
    match (config.render.image_format, source) {
        (ImageFormat::Raw, _) | (ImageFormat::Same, Container::Raw) => Container::Raw,
        (ImageFormat::Png, _) | (ImageFormat::Auto | ImageFormat::Same, Container::Png) => {
            Container::Png
        }
        (ImageFormat::Auto | ImageFormat::Same, _) if deep => Container::Png,
        (ImageFormat::Jpeg | ImageFormat::Auto | ImageFormat::Same, _) => jpeg,
    }
}

/// The channels that are added.
struct Added {
    corrected: NewChannel,
    camera_info: Option<NewChannel>,
    mask: Option<NewChannel>,
    attenuation: NewChannel,
    seafloor: NewChannel,
    cloud: Option<NewChannel>,
    transform: NewChannel,
    strobe: NewChannel,
    strobe_beam: NewChannel,
    raw_preview: Option<NewChannel>,
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
    header: Header,
    plane: Option<SeafloorPlane>,
    /// the raw picture for the eye
    preview: Option<Vec<u8>>,
    result: std::result::Result<Shown, Reason>,
}

/// What goes out of a corrected frame.
struct Shown {
    /// the picture's message
    picture: Vec<u8>,
    /// the mask's
    mask: Option<Vec<u8>>,
    /// the seafloor's, for 3-D panels
    cloud: Option<Vec<u8>>,
    facts: FrameFacts,
}

/// Everything pass two works with.
pub struct PassTwo<'p> {
    /// the log
    pub recording: &'p Recording,
    /// the stretch that is written
    pub window: Window,
    /// the choices
    pub config: &'p Config,
    /// the cameras that are corrected: one, mostly
    pub cameras: Vec<OfCamera<'p>>,
    /// the input's fingerprint
    pub source_sha256: &'p str,
    /// topics that are kept, where the user narrows them
    pub only: Option<regex::Regex>,
    /// cameras that cannot be corrected, and why
    pub left_out: Vec<Diagnostic>,
}

/// What is known of a camera while the log is written.
struct Account {
    added: Added,
    tally: Tally,
    report: Report,
}

impl PassTwo<'_> {
    /// Writes the corrected log and returns the account of it, camera by camera.
    ///
    /// # Errors
    /// Reading or writing failed.
    pub fn run(
        &self,
        mut out: Output,
        mut file: OutputFile,
        threads: &Threads,
        progress: &dyn Progress,
    ) -> Result<Vec<Report>> {
        let mut diagnostics = Vec::new();
        let kept = self.copy_declarations(&mut out, &mut diagnostics);
        let account = |camera: &OfCamera<'_>, out: &mut Output| -> Result<Account> {
            Ok(Account {
                added: camera.add_channels(out)?,
                tally: Tally::default(),
                report: camera.empty_report(self.recording),
            })
        };
        let mut accounts = self
            .cameras
            .iter()
            .map(|camera| account(camera, &mut out))
            .collect::<Result<Vec<_>>>()?;
        let srgb = SrgbTable::new(Shoulder { knee: self.config.render.shoulder_from });

        progress.begin(Step::Correct, self.cameras.iter().map(|c| c.survey.frames.len()).sum());
        let mut copied = 0;
        let mut next_frame = vec![0; self.cameras.len()];
        // Three stages, each on all cores and in order: blocks are read, frames are corrected,
        // pieces of the output are packed.
        let read = |block: &Block| self.items(block, &kept);
        let correct = |frame: Frame| self.worked(frame, &srgb);
        let pack = |piece: Piece| Ok(piece.into_bytes());
        let chunks = threads.count() * CHUNKS_PER_CORE;
        threads.scope(|scope| {
            let blocks =
                self.recording.blocks().iter().filter(|block| block.may_overlap(self.window));
            // Two at least, however large: one is read while the other is worked on.
            let blocks =
                blocks.map(|block| (block.memory_bytes().min(chunks / 2), Job::Work(block)));
            let items = scope
                .in_order(blocks, chunks, &read)
                .flat_map(|items| items.unwrap_or_else(|e| vec![Item::Failed(e)]));
            let frames = items.map(|item| self.job(item, &mut next_frame, threads.count()));
            let mut outcomes = scope.in_order(frames, UNDER_WAY, &correct).fuse();
            let pieces = std::iter::from_fn(|| {
                loop {
                    if let Some(piece) = out.next_piece() {
                        return Some((piece.memory_bytes().min(chunks / 2), Job::Work(piece)));
                    }
                    match outcomes.next() {
                        Some(Outcome::Failed(error)) => return Some((0, Job::Done(Err(error)))),
                        Some(outcome) => {
                            copied += self.take(outcome, &kept, &mut out, &mut accounts, progress)
                        }
                        None => {
                            out.flush();
                            let last = out.next_piece()?;
                            return Some((0, Job::Work(last)));
                        }
                    }
                }
            });
            scope.in_order(pieces, chunks, &pack).try_for_each(|piece| file.put(piece?))
        })?;
        progress.end();
        let finished = |Account { tally, mut report, .. }: Account| {
            tally.into_report(&mut report);
            report
        };
        let mut reports: Vec<Report> = accounts.into_iter().map(finished).collect();
        if let (Some(report), Some(camera)) = (reports.first_mut(), self.cameras.first()) {
            // What is said of the log as a whole stands with the first camera.
            report.messages_copied = copied;
            report.diagnostics.extend(diagnostics);
            report.damage =
                camera.scan.damage.iter().cloned().chain(camera.scan.homeless_damage()).collect();
            report.diagnostics.extend(self.left_out.iter().cloned());
        }
        self.finish(&out, file, &mut reports)?;
        Ok(reports)
    }

    /// Copies every schema and every channel that is kept; says which channels those are.
    fn copy_declarations(
        &self,
        out: &mut Output,
        diagnostics: &mut Vec<Diagnostic>,
    ) -> BTreeMap<u16, bool> {
        for (id, schema) in &self.recording.schemas {
            out.copy_schema(*id, schema);
        }
        let mut kept = BTreeMap::new();
        for (id, channel) in &self.recording.channels {
            let raw = self.config.output.drop_raw
                && self.cameras.iter().any(|c| c.survey.camera_channels.contains(id));
            let keep = !raw && self.only.as_ref().is_none_or(|only| only.is_match(&channel.topic));
            kept.insert(*id, keep);
            if keep {
                if channel.schema_id != 0
                    && !self.recording.schemas.contains_key(&channel.schema_id)
                {
                    let fact = LogFact::SchemaMissing { schema_id: channel.schema_id };
                    diagnostics.push(Diagnostic::on(&channel.topic, fact));
                }
                self.copy_channel(out, *id);
            }
        }
        kept
    }

    fn copy_channel(&self, out: &mut Output, id: u16) {
        let Some(channel) = self.recording.channels.get(&id) else { return };
        let schema_id = if self.recording.schemas.contains_key(&channel.schema_id) {
            channel.schema_id
        } else {
            0
        };
        out.copy_channel(id, &crate::recording::Channel { schema_id, ..channel.clone() });
    }

    /// Puts what is done into the output; how many messages of the input that are.
    fn take(
        &self,
        outcome: Outcome,
        kept: &BTreeMap<u16, bool>,
        out: &mut Output,
        accounts: &mut [Account],
        progress: &dyn Progress,
    ) -> u64 {
        let mut copied = 0;
        match outcome {
            Outcome::Failed(_) => {}
            Outcome::Chunk(chunk) => {
                copied = chunk.messages.len() as u64;
                out.copy_chunk(chunk);
            }
            Outcome::Other(message) => {
                out.copy_message(&message);
                copied = 1;
            }
            Outcome::Frame { camera, done, in_chunk } => {
                let is_kept = kept.get(&done.message.channel).copied();
                // `--drop-raw` leaves out what has a corrected twin; a frame without one is all
                // there is of it.
                let spared =
                    is_kept == Some(false) && self.config.output.drop_raw && done.result.is_err();
                if spared {
                    self.copy_channel(out, done.message.channel);
                }
                if !in_chunk && (is_kept == Some(true) || spared) {
                    out.copy_message(&done.message);
                    copied = 1;
                }
                let Account { added, tally, report } = &mut accounts[camera];
                tally.count(&done);
                report.messages_added +=
                    self.cameras[camera].write_frame(out, added, &done, report.frames == 0, tally);
                report.frames += 1;
                progress.advance(1);
            }
        }
        copied
    }

    /// Attachments and metadata: the input's, then ours. Those of all but the first camera have its
    /// place before their names.
    fn finish(&self, out: &Output, mut file: OutputFile, reports: &mut [Report]) -> Result<()> {
        for attachment in self.recording.attachments() {
            match attachment {
                Ok(attachment) => file.copy_attachment(self.recording, &attachment)?,
                Err(damage) => {
                    reports.iter_mut().take(1).for_each(|r| r.damage.push(damage.clone()))
                }
            }
        }
        reports.iter_mut().for_each(Report::count_damage);
        for record in &self.recording.metadata {
            file.metadata(&record.name, &record.metadata)?;
        }
        for (camera, report) in self.cameras.iter().zip(reports) {
            let (first, last) = camera.scan.span.unwrap_or_default();
            let model_json = camera.file.to_json();
            let config_toml = self.config.to_commented_toml();
            let mut texts = vec![
                ("model.json", "application/json", model_json.clone()),
                ("report.json", "application/json", report.to_json()),
                ("unwater.toml", "application/toml", config_toml.clone()),
                ("rig.toml", "application/toml", camera.rig_toml.into()),
            ];
            // The settings are those of the whole run.
            texts.retain(|(name, ..)| camera.place.is_empty() || *name != "unwater.toml");
            for (name, media_type, text) in texts {
                let name = format!("{}/{name}", camera.place);
                let name = name.trim_start_matches('/');
                file.attach(&NewAttachment {
                    log_time: last,
                    create_time: first,
                    name,
                    media_type,
                    data: text.as_bytes(),
                })?;
            }
            let facts = [
                ("version", report.version.clone()),
                ("camera_topic", report.camera_topic.clone()),
                ("corrected_topic", report.corrected_topic.clone()),
                ("dvl_topic", report.dvl_topic.clone()),
                ("method", report.method.clone()),
                ("model_sha256", crate::session::sha256(model_json.as_bytes())),
                ("source", report.source.clone()),
                ("source_sha256", self.source_sha256.into()),
                ("configuration", config_toml),
            ];
            let pairs = facts.into_iter().map(|(k, v)| (k.into(), v)).collect();
            file.metadata(&format!("unwater{}", camera.place), &pairs)?;
        }
        file.finish(out.declarations())
    }
}

/// The word of a method as the command line has it.
pub fn method_name(method: Method) -> &'static str {
    match method {
        Method::Full => "full",
        Method::Attenuation => "attenuation",
        Method::BeamPattern => "beam-pattern",
        Method::FrameAverage => "frame-average",
        Method::RangeAverage => "range-average",
        Method::GreyWorld => "grey-world",
        Method::WhitePatch => "white-patch",
        Method::Homomorphic => "homomorphic",
        Method::HomomorphicSurface => "homomorphic-surface",
        Method::Ahe => "ahe",
    }
}

#[cfg(test)]
mod tests {
    use super::corrected_topic;

    #[test]
    fn topics_follow_image_transport() {
        assert_eq!(corrected_topic("/camera/image_raw", false), "/camera/image_corrected");
        assert_eq!(
            corrected_topic("/camera/image_raw", true),
            "/camera/image_corrected/compressed"
        );
        assert_eq!(
            corrected_topic("/camera/image_color/compressed", true),
            "/camera/image_corrected/compressed"
        );
        assert_eq!(
            corrected_topic("/stereo/left", true),
            "/stereo/left/image_corrected/compressed"
        );
    }
}
