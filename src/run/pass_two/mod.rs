//! Pass two over a log: every message is copied, every frame corrected, all of it written in order.

mod attachments;
mod blocks;
mod input;
mod record;
mod tally;
mod worker;

use crate::diagnostics::{Diagnostic, Reason};
use crate::error::Result;
use crate::parallel::{Job, Threads};
use crate::recording::{Block, FrameId, NewChannel, Output, OutputFile, Piece};
use crate::report::Report;
use crate::session::{Progress, Step};

use super::camera_output::{CameraOutput, FrameOutput};
use super::topics::{Channels, FrameContext};
pub use blocks::FRAMES_PER_THREAD;
use blocks::{CameraMessage, IN_FLIGHT, Item, Outcome, job};
pub use input::Input;
pub use record::{CameraRecord, SHARD_RECORD, ShardRecord};
use tally::Tally;

/// Bytes of chunks in flight before and after the work on frames, for each thread.
pub const CHUNKS_PER_THREAD: usize = 8 << 20;

/// The log while it is written.
struct Writer<'p> {
    input: &'p Input<'p>,
    out: Output,
    /// per camera
    accounts: Vec<Account>,
    /// messages of the input so far
    copied: u64,
    progress: &'p dyn Progress,
}

/// A camera while the log is written.
struct Account {
    channels: Channels,
    tally: Tally,
    report: Report,
    /// its first frame, in the order of the file
    first: Option<FrameId>,
    /// notes about the first frame of a reason: their sequence numbers
    reasons: Vec<(u32, Reason)>,
}

/// Writes the corrected log; returns a report for each camera, and the output's contents. Cameras
/// that are left out stand in the first one.
///
/// # Errors
/// Reading or writing failed.
pub fn pass_two(
    input: &Input<'_>,
    (out, mut file): (Output, OutputFile),
    left_out: Vec<Diagnostic>,
    threads: &Threads,
    progress: &dyn Progress,
) -> Result<(Vec<Report>, Output)> {
    let mut writer = Writer { input, out, accounts: Vec::new(), copied: 0, progress };
    let mut diagnostics = writer.declare()?;
    diagnostics.extend(left_out);
    let declared = writer.out.declared().to_vec();
    let frames = input.cameras.iter().map(|c| c.session.survey.frames.len()).sum();
    progress.begin(Step::Correct, frames);
    // Three stages, each parallel and in order: blocks are read, frames are corrected, pieces of
    // the output are packed.
    let read = |block: &Block| input.items(block);
    let correct = |frame: CameraMessage| input.work(frame);
    let pack = |piece: Piece| Ok(piece.into_bytes());
    let chunks = threads.count() * CHUNKS_PER_THREAD;
    threads.scope(|scope| {
        let blocks = input.blocks();
        // Two at least, however large: one is read while the other is worked on.
        let blocks = blocks.map(|block| (block.memory_bytes().min(chunks / 2), Job::Work(block)));
        let items = scope
            .in_order(blocks, chunks, &read)
            .flat_map(|items| items.unwrap_or_else(|e| vec![Item::Failed(e)]));
        let frames = items.map(|item| job(item, threads.count()));
        let mut outcomes = scope.in_order(frames, IN_FLIGHT, &correct).fuse();
        let pieces = std::iter::from_fn(|| {
            let piece = writer.next_piece(&mut outcomes)?;
            Some(match piece {
                Ok(piece) => (piece.memory_bytes().min(chunks / 2), Job::Work(piece)),
                Err(error) => (0, Job::Done(Err(error))),
            })
        });
        scope.in_order(pieces, chunks, &pack).try_for_each(|piece| file.put(piece?))
    })?;
    progress.end();
    writer.finish(file, declared, diagnostics)
}

impl Writer<'_> {
    fn declare(&mut self) -> Result<Vec<Diagnostic>> {
        let diagnostics = self.input.copy_declarations(&mut self.out);
        for camera in &self.input.cameras {
            self.accounts.push(Account {
                channels: Channels::declare(camera, &mut self.out)?,
                tally: Tally::default(),
                report: camera.new_report(),
                first: camera.session.survey.frames.iter().map(|frame| frame.id).min(),
                reasons: Vec::new(),
            });
        }
        Ok(diagnostics)
    }

    /// The next piece of the output, for which as many outcomes are written as it needs.
    fn next_piece(
        &mut self,
        outcomes: &mut impl Iterator<Item = Outcome>,
    ) -> Option<Result<Piece>> {
        loop {
            if let Some(piece) = self.out.next_piece() {
                return Some(Ok(piece));
            }
            match outcomes.next() {
                Some(Outcome::Failed(error)) => return Some(Err(error)),
                Some(Outcome::Chunk(chunk)) => {
                    self.copied += chunk.messages.len() as u64;
                    self.out.copy_chunk(chunk);
                }
                Some(Outcome::Other(message)) => {
                    self.copied += 1;
                    self.out.copy_message(&message);
                }
                Some(Outcome::Frame { camera, frame, is_in_chunk }) => {
                    self.write_frame(camera, &frame, is_in_chunk);
                }
                None => {
                    self.out.flush();
                    return self.out.next_piece().map(Ok);
                }
            }
        }
    }

    fn write_frame(&mut self, camera: usize, frame: &FrameOutput, is_in_chunk: bool) {
        let channel = frame.message.channel;
        // `--drop-raw` drops frames that have a corrected version; others are kept.
        let is_spared = self.input.is_dropped_raw(channel) && frame.result.is_err();
        if is_spared {
            self.input.copy_channel(&mut self.out, channel);
        }
        if !is_in_chunk && (self.input.is_kept(channel) || is_spared) {
            self.out.copy_message(&frame.message);
            self.copied += 1;
        }
        let Account { channels, tally, report, first, reasons } = &mut self.accounts[camera];
        tally.count(frame);
        let context = FrameContext {
            camera: &self.input.cameras[camera],
            output: frame,
            is_first: Some(frame.message.id) == *first,
            is_first_of_reason: frame.result.as_ref().is_err_and(|r| tally.frames_of(r) == 1),
        };
        report.messages_added += channels.write(&context, &mut self.out);
        if let (Err(reason), true, Some(log)) =
            (&frame.result, context.is_first_of_reason, channels.log())
        {
            reasons.push((self.out.next_sequence(log).saturating_sub(1), reason.clone()));
        }
        report.frames += 1;
        self.progress.advance(1);
    }

    fn finish(
        self,
        file: OutputFile,
        declared: Vec<(bool, u16)>,
        diagnostics: Vec<Diagnostic>,
    ) -> Result<(Vec<Report>, Output)> {
        let cameras = self.accounts.into_iter().zip(&self.input.cameras);
        let record = |(account, camera): (Account, &CameraOutput<'_>)| {
            let channels = account.channels.all().map(NewChannel::id).collect();
            CameraRecord {
                name: camera.name.clone(),
                report: account.report,
                tally: account.tally,
                diagnostics: Vec::new(),
                damage: Vec::new(),
                channels,
                log_channel: account.channels.log().map_or(0, NewChannel::id),
                reasons: account.reasons,
            }
        };
        let mut cameras: Vec<CameraRecord> = cameras.map(record).collect();
        if let (Some(first), Some(camera)) = (cameras.first_mut(), self.input.cameras.first()) {
            // Facts of the log as a whole are those of the first camera.
            let index = &camera.session.index;
            first.diagnostics = diagnostics;
            first.damage = index.damage.iter().cloned().chain(index.undeclared_damage()).collect();
        }
        let shard = self.input.shard.map(|shard| ShardRecord {
            shard,
            declared,
            copied_chunks: self.out.copied_chunks().to_vec(),
            copied: self.copied,
            cameras: cameras.clone(),
        });
        let copied = |n: usize| (n == 0).then_some(self.copied);
        let reports = cameras.into_iter().enumerate().map(|(n, c)| c.into_report(copied(n)));
        let mut reports: Vec<Report> = reports.collect();
        attachments::finish(self.input, (&self.out, shard), file, &mut reports)?;
        Ok((reports, self.out))
    }
}
