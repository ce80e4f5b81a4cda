//! Diagnostics of a log as a file: unusual properties that are not damage.

use std::collections::BTreeMap;
use std::path::Path;

use super::recording::Recording;
use crate::diagnostics::{Diagnostic, LogFact};

/// Parts of one recording follow one another within seconds (s).
const MAX_GAP_S: f64 = 60.0;

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
        diagnostics.extend(self.parts_diagnostics());
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

    /// The parts of a split recording, and pairs of them that are far apart in time.
    pub fn parts_diagnostics(&self) -> Vec<Diagnostic> {
        let parts: Vec<_> = self.parts().collect();
        if parts.len() < 2 {
            return Vec::new();
        }
        let name = |path: &Path| {
            path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default()
        };
        let gap = |pair: &[(&Path, Option<(u64, u64)>)]| {
            let gap_s = (pair[1].1?.0 as f64 - pair[0].1?.1 as f64) / 1e9;
            let (before, after) = (name(pair[0].0), name(pair[1].0));
            (gap_s.abs() > MAX_GAP_S).then(|| LogFact::PartsApart { before, after, gap_s }.into())
        };
        let whole = LogFact::Parts { parts: parts.len() }.into();
        [whole].into_iter().chain(parts.windows(2).filter_map(gap)).collect()
    }
}
