//! Diagnostics of a log as a file: unusual properties that are not damage.

use std::collections::BTreeMap;

use super::recording::Recording;
use crate::diagnostics::{Diagnostic, LogFact};

impl Recording {
    /// Unusual properties that are not damage, for `inspect`.
    pub fn diagnostics(&self) -> Vec<Diagnostic> {
        let mut diagnostics: Vec<Diagnostic> = Vec::new();
        if self.bare_messages > 0 {
            diagnostics.push(LogFact::OutsideChunks { messages: self.bare_messages }.into());
        }
        let chunks = self.blocks().iter().filter(|b| b.is_chunk() && !b.has_checksum()).count();
        if chunks > 0 {
            diagnostics.push(LogFact::WithoutChecksum { chunks, of: self.chunk_count() }.into());
        }
        if self.is_complete && !self.has_summary {
            diagnostics.push(LogFact::NoSummary.into());
        }
        let mut by_name: BTreeMap<&str, Vec<&[u8]>> = BTreeMap::new();
        for schema in self.schemas.values() {
            let definitions = by_name.entry(&schema.name).or_default();
            if !definitions.contains(&schema.data.as_slice()) {
                definitions.push(&schema.data);
            }
        }
        for (name, definitions) in by_name.into_iter().filter(|(_, d)| d.len() > 1) {
            let (name, schemas) = (name.into(), definitions.len());
            diagnostics.push(LogFact::SchemaNameReused { name, schemas }.into());
        }
        let mut by_topic: BTreeMap<&str, usize> = BTreeMap::new();
        self.channels.values().for_each(|c| *by_topic.entry(&c.topic).or_default() += 1);
        let several = by_topic.into_iter().filter(|(_, channels)| *channels > 1);
        diagnostics.extend(
            several.map(|(topic, channels)| {
                Diagnostic::on(topic, LogFact::SeveralChannels { channels })
            }),
        );
        diagnostics
    }
}
