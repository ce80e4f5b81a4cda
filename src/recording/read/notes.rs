//! What is odd about a log without being damage.

use std::collections::BTreeMap;

use super::Recording;

impl Recording {
    /// What is odd about the log without being damage: for `inspect`.
    pub fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        if self.bare_messages > 0 {
            let outside = self.bare_messages;
            notes.push(format!(
                "{outside} messages lie outside of chunks, with no checksum that would tell \
                 damage; rerun shows none of them"
            ));
        }
        let unchecked = self.blocks.iter().filter(|b| b.is_chunk() && !b.is_checked()).count();
        if unchecked > 0 {
            notes.push(format!(
                "{unchecked} of {} chunks have no checksum: damage inside them cannot be told",
                self.chunk_count()
            ));
        }
        if self.is_complete && !self.has_summary {
            notes.push(
                "there is no summary: other programs may show nothing, or ask to recover it. The \
                 corrected log has one"
                    .into(),
            );
        }
        let mut by_name: BTreeMap<&str, Vec<&[u8]>> = BTreeMap::new();
        for schema in self.schemas.values() {
            let definitions = by_name.entry(&schema.name).or_default();
            if !definitions.contains(&schema.data.as_slice()) {
                definitions.push(&schema.data);
            }
        }
        for (name, definitions) in by_name.into_iter().filter(|(_, d)| d.len() > 1) {
            notes.push(format!(
                "{} different schemas are named {name}; each channel is read by its own",
                definitions.len()
            ));
        }
        let mut by_topic: BTreeMap<&str, usize> = BTreeMap::new();
        self.channels.values().for_each(|c| *by_topic.entry(&c.topic).or_default() += 1);
        notes.extend(
            by_topic
                .into_iter()
                .filter(|(_, n)| *n > 1)
                .map(|(topic, n)| format!("{topic} has {n} channels")),
        );
        notes
    }
}
