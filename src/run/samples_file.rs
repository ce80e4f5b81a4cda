//! Samples of a log as a file: a dive is sampled once and estimated with others later, without its
//! images.
//!
//! A first line of JSON says what is known of the log; after it come the samples as postcard,
//! compressed with zstd. A model from the file of one log is that of `estimate` on the log, byte
//! for byte.

use std::io::{BufRead as _, BufReader, Read as _, Seek as _};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::fit::Kept;
use super::log_samples::{LogSamples, SampledLog, ensure_same_camera};
use super::model_of::model_of;
use super::pass_one::share_of_log;
use crate::diagnostics::NotIdentified;
use crate::error::{Error, Result};
use crate::estimate::{FrameSamples, Track};
use crate::model::ModelFile;
use crate::parallel::Threads;
use crate::session::{FrameId, Options};

const FORMAT: &str = "unwater-samples";
/// Another version has other samples.
const VERSION: u32 = 3;
const COMPRESSION: i32 = 3;
/// A longer first line is of another kind of file (bytes).
const MAX_LINE: u64 = 1 << 24;

/// The first line.
#[derive(Serialize, Deserialize)]
struct Header {
    format: String,
    version: u32,
    log: SampledLog,
    /// what its own estimate replaced before the frames were sampled
    kept: Kept,
}

/// What follows it.
type Body = (Vec<FrameSamples>, Vec<Option<FrameId>>, Vec<Vec<f64>>, Vec<Track>);

/// The file of a log's samples and of the model that was estimated from them.
///
/// # Errors
/// The samples cannot be written down.
pub fn samples_file(samples: LogSamples, model: &ModelFile) -> Result<Vec<u8>> {
    let LogSamples { log, frames, ids, settings, tracks } = samples;
    let (format, version, kept) = (FORMAT.into(), VERSION, Kept::of(model));
    let failed = |reason: String| Error::WriteRecord { path: "samples".into(), reason };
    let mut bytes = serde_json::to_vec(&Header { format, version, log, kept })
        .map_err(|e| failed(e.to_string()))?;
    bytes.push(b'\n');
    let body: Body = (frames, ids, settings, tracks);
    let plain = postcard::to_stdvec(&body).map_err(|e| failed(e.to_string()))?;
    let compressed = || -> std::io::Result<Vec<u8>> {
        let mut encoder = zstd::stream::Encoder::new(bytes, COMPRESSION)?;
        encoder.include_checksum(true)?;
        std::io::Write::write_all(&mut encoder, &plain)?;
        encoder.finish()
    };
    compressed().map_err(|e| failed(e.to_string()))
}

/// Estimates a model from the samples of several logs, of no more frames together than of one log.
///
/// # Errors
/// A file cannot be read, the logs are of different cameras, or attenuation cannot be estimated.
pub fn estimate_samples(paths: &[PathBuf], options: &Options) -> Result<ModelFile> {
    let max_frames = options.config.estimate.max_frames;
    let (mut logs, mut kept) = (Vec::new(), Vec::new());
    for (n, path) in paths.iter().enumerate() {
        // One after the other: what is left out is not kept.
        let (samples, of_log) = read(path)?;
        logs.push(samples.thinned(share_of_log(max_frames, n, paths.len())));
        kept.push(of_log);
    }
    let known: Vec<&SampledLog> = logs.iter().map(|samples| &samples.log).collect();
    ensure_same_camera(&known)?;
    if let Some(other) = known.iter().find(|log| log.response != known[0].response) {
        let (a, b) = (&known[0].input.name, &other.input.name);
        return Err(Error::Usage(format!(
            "the images of {a} and of {b} were read by different transfer curves; sample them \
             again with one of them: --transfer, or camera.response of the rig file"
        )));
    }
    let is_alone = logs.len() == 1;
    let mut model = Threads::new(options.threads).install(|| model_of(logs, options))?;
    if !is_alone && model.geometry.is_some() {
        // Frames cannot be sampled again with it.
        model.set_not_identified(NotIdentified::MountContradicted);
    }
    if let Some(kept) = Kept::common(kept) {
        kept.keep_in(&mut model);
    }
    Ok(model)
}

/// The samples of a log, and what its estimate replaced.
fn read(path: &Path) -> Result<(LogSamples, Kept)> {
    let failed = |source| Error::Read { path: path.into(), source };
    let bad =
        |reason: String| Error::BadFile { path: path.into(), what: "invalid samples", reason };
    let mut file = BufReader::new(std::fs::File::open(path).map_err(failed)?);
    let mut line = Vec::new();
    file.by_ref().take(MAX_LINE).read_until(b'\n', &mut line).map_err(failed)?;
    let header: serde_json::Value =
        serde_json::from_slice(&line).map_err(|e| bad(format!("the first line: {e}")))?;
    if header["format"] != FORMAT {
        return Err(bad(format!("`estimate --save-samples` writes files of format {FORMAT:?}")));
    }
    if header["version"] != VERSION {
        let version = &header["version"];
        return Err(bad(format!(
            "they are of version {version}, and this program reads version {VERSION}; sample the \
             dive again with `estimate --save-samples`"
        )));
    }
    let Header { log, kept, .. } =
        serde_json::from_value(header).map_err(|e| bad(format!("the first line: {e}")))?;
    let at = file.stream_position().map_err(failed)?;
    let plain = zstd::stream::decode_all(file)
        .map_err(|e| bad(format!("what follows byte {at} is damaged: {e}")))?;
    let (frames, ids, settings, tracks): Body =
        postcard::from_bytes(&plain).map_err(|e| bad(format!("the samples: {e}")))?;
    let is_of_frame = |length: usize| length == frames.len();
    let is_whole = is_of_frame(ids.len())
        && settings.len() == log.settings.len()
        && settings.iter().all(|values| is_of_frame(values.len()))
        && tracks.iter().flatten().all(|o| (o.frame as usize) < frames.len());
    if !is_whole {
        return Err(bad("tracks or settings are of other frames".into()));
    }
    if frames.is_empty() {
        return Err(bad("there is no frame".into()));
    }
    Ok((LogSamples { log, frames, ids, settings, tracks }, kept))
}
