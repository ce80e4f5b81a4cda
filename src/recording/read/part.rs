//! One file of a log, and how its schemas and channels are numbered in the whole.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use super::super::source::Source;
use super::block::{Block, Contents, Entry};
use super::index::Index;
use super::records::MAGIC;
use super::types::{Channel, Damage, Declarations, Window, free_id};
use crate::error::{Error, Result};

/// One file of a log.
pub struct Part {
    pub path: PathBuf,
    pub source: Source,
    /// channel ids of the file → of the log; `None` where they are the same
    renamed: Option<BTreeMap<u16, u16>>,
    /// first and last log time, as far as the blocks show it (ns)
    pub times: Option<(u64, u64)>,
}

impl Part {
    /// Opens a file and indexes it.
    ///
    /// # Errors
    /// It cannot be read, or is not MCAP.
    pub fn open(path: &Path) -> Result<(Self, Index)> {
        let read = |source| Error::Read { path: path.into(), source };
        let source = Source::open(path).map_err(read)?;
        let magic = source.bytes(0..source.length().min(MAGIC.len() as u64)).map_err(read)?;
        if magic != MAGIC {
            return Err(Error::NotMcap { path: path.into(), hint: hint(&magic) });
        }
        let mut index = Index::read(&source).map_err(read)?;
        // Without a summary, or with one that repeats no channels, they are only inside chunks.
        if !index.is_complete || index.declarations.channels.is_empty() {
            for block in &index.blocks {
                let declared = block.read(&source, Window::ALL).map_err(read)?.declared;
                declared.into_iter().for_each(|record| index.declarations.add(record));
            }
        }
        let times = index.blocks.iter().filter_map(Block::times);
        let times = times.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)));
        Ok((Self { path: path.into(), source, renamed: None, times }, index))
    }

    /// Adds the declarations of the file to those of the log. Equal ones are shared; where an id
    /// is taken by another, the file's is renamed.
    ///
    /// # Errors
    /// All ids are taken.
    pub fn declare(&mut self, own: Declarations, all: &mut Declarations) -> Result<()> {
        let full = || Error::BadFile {
            path: self.path.clone(),
            what: "too many channels",
            reason: "the parts of this recording have more of them than MCAP can number".into(),
        };
        let schemas = merged(own.schemas, &mut all.schemas).ok_or_else(full)?;
        let schema_of = |id: u16| schemas.get(&id).copied().unwrap_or(id);
        let rename = |(id, channel): (u16, Channel)| {
            (id, Channel { schema_id: schema_of(channel.schema_id), ..channel })
        };
        let channels = own.channels.into_iter().map(rename).collect();
        let channels = merged(channels, &mut all.channels).ok_or_else(full)?;
        let is_same = |ids: &BTreeMap<u16, u16>| ids.iter().all(|(own, id)| own == id);
        self.renamed = (!is_same(&schemas) || !is_same(&channels)).then_some(channels);
        Ok(())
    }

    /// The id in the log of a channel of this file.
    pub fn channel(&self, own: u16) -> u16 {
        self.renamed.as_ref().and_then(|ids| ids.get(&own)).copied().unwrap_or(own)
    }

    /// Contents of a block of this file by the log's ids. A chunk with other ids inside cannot be
    /// copied as it is.
    pub fn rename(&self, contents: &mut Contents) {
        let Some(ids) = &self.renamed else { return };
        contents.chunk = None;
        contents.declared.clear();
        for entry in &mut contents.entries {
            let Entry::Message(message) = entry else { continue };
            match ids.get(&message.channel) {
                Some(id) => message.channel = *id,
                None => {
                    let (start_ns, end_ns) = (message.log_time, message.log_time);
                    let reason = "a message belongs to no channel and is left out".into();
                    *entry = Entry::Damaged(Damage { offset: 0, start_ns, end_ns, reason });
                }
            }
        }
    }
}

/// Adds things with ids to others. Returns the id of each among them all; `None` where there are
/// no more ids.
fn merged<T: PartialEq>(
    own: BTreeMap<u16, T>,
    all: &mut BTreeMap<u16, T>,
) -> Option<BTreeMap<u16, u16>> {
    // Those of other files, which are shared once.
    let mut shared: BTreeSet<u16> = all.keys().copied().collect();
    let mut ids = BTreeMap::new();
    for (id, thing) in own {
        let is_equal = |known: &&u16| all.get(known).is_some_and(|other| *other == thing);
        let same = shared.get(&id).filter(is_equal);
        let known = same.or_else(|| shared.iter().find(is_equal)).copied();
        let new = match known {
            Some(known) => known,
            None if !all.contains_key(&id) => id,
            None => free_id(all)?,
        };
        all.entry(new).or_insert(thing);
        shared.remove(&new);
        ids.insert(id, new);
    }
    Some(ids)
}

/// What a file with another magic is, and how to convert it.
fn hint(magic: &[u8]) -> &'static str {
    match magic {
        [] => " (it is empty)",
        [b'#', b'R', b'O', b'S', b'B', b'A', b'G', ..] => {
            " but a ROS 1 bag; convert it first: `mcap convert in.bag out.mcap`"
        }
        [b'S', b'Q', b'L', b'i', b't', b'e', ..] => {
            " but a ROS 2 SQLite bag; convert it first: `ros2 bag convert`"
        }
        [0x28, 0xb5, 0x2f, 0xfd, ..] => " but a zstd file; decompress it first: `zstd -d`",
        _ => "",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_things_are_shared_and_others_renamed() {
        let mut all = BTreeMap::from([(1, "a"), (2, "b"), (3, "b")]);
        let own = BTreeMap::from([(1, "b"), (2, "b"), (3, "c"), (9, "d")]);
        let ids = merged(own, &mut all).expect("there are ids");
        assert_eq!(ids, BTreeMap::from([(1, 2), (2, 3), (3, 4), (9, 9)]));
        assert_eq!(all, BTreeMap::from([(1, "a"), (2, "b"), (3, "b"), (4, "c"), (9, "d")]));
    }
}
