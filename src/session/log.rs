//! A log that has been scanned: the recording, its index, and the measurements of its sensors.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;

use sha2::Digest;

use super::index::{ChannelIndex, LogIndex, scan_with};
use super::options::Options;
use super::readings::Readings;
use crate::error::{Error, Result};
use crate::messages::{Kind, RadiometrySetting};
use crate::parallel::Threads;
use crate::recording::{Fingerprint, LogFiles, Recording};
use crate::units::Stamp;
use crate::vehicle::{DvlFacts, SettingSeries};

/// A scanned log. Every camera of it is surveyed from the same scan.
pub struct Log {
    /// the file
    pub recording: Arc<Recording>,
    /// what it holds
    pub index: Arc<LogIndex>,
    /// what its sensors measured
    pub readings: Readings,
    /// how ranges were read
    dvl: DvlFacts,
}

impl Log {
    /// Opens a log and scans it.
    ///
    /// # Errors
    /// It cannot be read, or holds no message.
    pub fn open(path: &Path, options: &Options) -> Result<Self> {
        let threads = Threads::new(options.threads);
        Self::scan(Recording::open(path)?, options, &threads)?.with_messages(options)
    }

    /// As [`Log::open`], of one file or several. Their fingerprint is computed from the same read;
    /// not with a window, for which only what is needed is read.
    ///
    /// # Errors
    /// As [`Log::open`].
    pub fn open_with_sha256(
        files: &LogFiles,
        options: &Options,
        threads: &Threads,
    ) -> Result<Self> {
        let recording = Arc::new(Recording::open_files(files)?);
        let fingerprint = options.window.is_none().then(|| recording.fingerprint());
        Self::read(&recording, fingerprint, options, threads)?.with_messages(options)
    }

    /// Scans an open log, which may be empty.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn scan(
        recording: impl Into<Arc<Recording>>,
        options: &Options,
        threads: &Threads,
    ) -> Result<Self> {
        Self::read(&recording.into(), None, options, threads)
    }

    fn read(
        recording: &Arc<Recording>,
        fingerprint: Option<Fingerprint<'_>>,
        options: &Options,
        threads: &Threads,
    ) -> Result<Self> {
        let (window, dvl) = (options.window(), options.rig.dvl.clone());
        let (index, readings) = scan_with(recording, window, &dvl, fingerprint, threads)?;
        Ok(Self { recording: Arc::clone(recording), index: Arc::new(index), readings, dvl })
    }

    /// An error where the log has no message.
    ///
    /// # Errors
    /// [`Error::Empty`].
    pub fn with_messages(self, options: &Options) -> Result<Self> {
        if self.index.messages > 0 {
            return Ok(self);
        }
        let detail = match (&self.index.damage[..], options.window) {
            (_, Some(_)) => " in the window of -S and -E".into(),
            ([], _) => String::new(),
            ([first, ..], _) => {
                format!(" ({} places are damaged: {})", self.index.damage.len(), first.reason)
            }
        };
        Err(Error::Empty { path: self.recording.path().into(), detail })
    }

    /// Whether its ranges were read by these facts; where the instrument is mounted does not
    /// matter.
    pub fn is_read_by(&self, dvl: &DvlFacts) -> bool {
        let without_mount = |facts: &DvlFacts| DvlFacts { mount: None, ..facts.clone() };
        without_mount(&self.dvl) == without_mount(dvl)
    }

    /// The topic of a channel.
    pub fn topic(&self, channel: u16) -> String {
        self.recording.channels.get(&channel).map(|c| c.topic.clone()).unwrap_or_default()
    }

    /// Settings of camera and strobe, of all channels of a topic together.
    pub fn settings(&self) -> Vec<SettingSeries> {
        type Series = (String, &'static str, Vec<(Stamp, f64)>);
        let mut found: Vec<Series> = Vec::new();
        for (id, channel) in &self.readings.0 {
            let topic = self.topic(*id);
            let named = channel.settings.iter().flat_map(|(_, s)| s.iter().map(|(name, _)| *name));
            for name in named.collect::<BTreeSet<&'static str>>() {
                let value = |(stamp, settings): &(Stamp, Vec<RadiometrySetting>)| {
                    Some((*stamp, settings.iter().find(|(n, _)| *n == name)?.1))
                };
                let values = channel.settings.iter().filter_map(value);
                match found.iter_mut().find(|(t, n, _)| *t == topic && *n == name) {
                    Some((.., known)) => known.extend(values),
                    None => found.push((topic.clone(), name, values.collect())),
                }
            }
        }
        let series = |(topic, name, values): Series| SettingSeries::new(topic, name.into(), values);
        found.into_iter().map(series).collect()
    }

    /// Ids of the channels of a topic that hold images; after a merge there may be several.
    pub fn image_channels(&self, topic: &str) -> Vec<u16> {
        let decoders = self.index.decoders.iter();
        let ids = decoders.filter(|(_, d)| matches!(d.message_type.kind, Kind::Image(_)));
        let is_of_topic =
            |id: &u16| self.recording.channels.get(id).is_some_and(|c| c.topic == topic);
        ids.map(|(id, _)| *id).filter(is_of_topic).collect()
    }

    /// These channels in the index.
    pub fn channels<'l>(&'l self, ids: &[u16]) -> Vec<&'l ChannelIndex> {
        ids.iter().filter_map(|id| self.index.channels.get(id)).collect()
    }

    /// Channels that are not read although they may hold what is missing, with the reason.
    pub fn unreadable_list(&self) -> String {
        let channels = self.index.channels.iter();
        let unread = channels.filter(|(id, _)| !self.index.decoders.contains_key(id));
        let reason = |(id, channel): (&u16, &ChannelIndex)| {
            Some(format!("; {}: {}", self.topic(*id), channel.unreadable.1.as_ref()?))
        };
        unread.filter_map(reason).collect()
    }

    /// Topic and type of every channel, in one line.
    pub fn channel_list(&self) -> String {
        let type_of = |schema_id| {
            self.recording.schemas.get(schema_id).map_or("no schema", |s| s.name.as_str())
        };
        let channels = self.recording.channels.values();
        let list: Vec<String> =
            channels.map(|c| format!("{} ({})", c.topic, type_of(&c.schema_id))).collect();
        if list.is_empty() { "no channels at all".into() } else { list.join(", ") }
    }
}

/// A fingerprint in hexadecimal.
pub fn sha256(bytes: &[u8]) -> String {
    sha2::Sha256::digest(bytes).iter().map(|b| format!("{b:02x}")).collect()
}
