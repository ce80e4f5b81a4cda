//! Some frames of a log, each on whichever core, in order. Only blocks are read that hold one of
//! them.

use std::collections::{BTreeMap, BTreeSet};

use super::index::FrameRef;
use crate::error::Result;
use crate::parallel::{Job, Threads};
use crate::recording::{Entry, Message, Recording, Window};

/// Blocks under way, for each core [byte].
const UNDER_WAY: usize = 8 << 20;
/// Frames under way, for each core.
const PER_CORE: usize = 2;

/// Runs `work` over the chosen of the camera's frames (index and message) and hands the results to
/// `sink` in order.
///
/// # Errors
/// The file cannot be read, or the sink's own.
pub fn for_frames<R: Send>(
    recording: &Recording,
    frames: &[FrameRef],
    chosen: &BTreeSet<usize>,
    threads: &Threads,
    work: impl Fn((usize, Message)) -> R + Sync,
    mut sink: impl FnMut(R) -> Result<()>,
) -> Result<()> {
    // By block: which of its entries is which frame.
    let mut blocks: BTreeMap<u32, BTreeMap<u32, usize>> = BTreeMap::new();
    for index in chosen {
        if let Some(FrameRef { place: (block, entry), .. }) = frames.get(*index) {
            blocks.entry(*block).or_default().insert(*entry, *index);
        }
    }
    let read = |(block, of_frames): (u32, BTreeMap<u32, usize>)| -> Result<Vec<(usize, Message)>> {
        let Some(block) = recording.blocks().get(block as usize) else { return Ok(Vec::new()) };
        let entries = (0..).zip(recording.read(block, Window::ALL)?.entries);
        let frame = |(entry, message): (u32, Entry)| match message {
            Entry::Message(message) => of_frames.get(&entry).map(|index| (*index, message)),
            Entry::Damaged(_) => None,
        };
        Ok(entries.filter_map(frame).collect())
    };
    let work = |frame| Ok(work(frame));
    let under_way = threads.count() * UNDER_WAY;
    threads.scope(|scope| {
        let weight = |block: u32| {
            recording
                .blocks()
                .get(block as usize)
                .map_or(0, |b| b.memory_bytes().min(under_way / 2))
        };
        let blocks = scope.in_order(
            blocks.into_iter().map(|block| (weight(block.0), Job::Work(block))),
            under_way,
            &read,
        );
        let frames = blocks.flat_map(|frames| match frames {
            Ok(frames) => frames.into_iter().map(|frame| (1, Job::Work(frame))).collect(),
            Err(e) => vec![(0, Job::Done(Err(e)))],
        });
        scope
            .in_order(frames, PER_CORE * threads.count(), &work)
            .try_for_each(|result| sink(result?))
    })
}
