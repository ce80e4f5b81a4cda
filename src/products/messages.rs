//! Messages of a log, read in the order of the file. A block that cannot be read is an error, not
//! an empty list.

use std::collections::BTreeSet;

use crate::error::Result;
use crate::recording::{Block, Entry, FrameId, Message, Recording, Window};

/// Messages of some channels. Blocks that hold none of them are not read; damage inside a block is
/// skipped, as the index lists it.
pub fn messages_of<'r>(
    recording: &'r Recording,
    channels: &'r BTreeSet<u16>,
    window: Window,
) -> impl Iterator<Item = Result<Message>> + 'r {
    let may_hold = move |block: &Block| {
        block.may_overlap(window)
            && block.channels().is_none_or(|c| c.iter().any(|id| channels.contains(id)))
    };
    let is_wanted = move |message: &Message| channels.contains(&message.channel);
    let blocks = recording.blocks().iter().filter(move |block| may_hold(block));
    blocks.flat_map(move |block| read(recording, block, window, is_wanted))
}

/// Messages by their identity. Only blocks are read that hold one of them.
pub fn messages_by_id<'r>(
    recording: &'r Recording,
    ids: &'r BTreeSet<FrameId>,
) -> impl Iterator<Item = Result<Message>> + 'r {
    let numbers: BTreeSet<u32> = ids.iter().map(|id| id.block).collect();
    let blocks = numbers.into_iter().filter_map(|number| recording.blocks().get(number as usize));
    blocks.flat_map(move |block| {
        read(recording, block, Window::ALL, |message| ids.contains(&message.id))
    })
}

fn read(
    recording: &Recording,
    block: &Block,
    window: Window,
    is_wanted: impl Fn(&Message) -> bool,
) -> Vec<Result<Message>> {
    let message = |entry| match entry {
        Entry::Message(message) => is_wanted(&message).then_some(Ok(message)),
        Entry::Damaged(_) => None,
    };
    match recording.read(block, window) {
        Ok(contents) => contents.entries.into_iter().filter_map(message).collect(),
        Err(error) => vec![Err(error)],
    }
}
