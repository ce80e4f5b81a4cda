//! Choice of the camera and the range instrument of a log.

use std::collections::{BTreeMap, BTreeSet};

use super::super::log::Log;
use super::super::options::Selection;
use super::ranges::LoggedPings;
use crate::diagnostics::{CameraFact, Diagnostic};
use crate::error::{Error, Result};
use crate::messages::Kind;
use crate::units::Stamp;
use crate::vehicle::{Ping, RigFile};

/// The camera that is selected, or the only one.
pub fn choose_camera(
    log: &Log,
    selection: &Selection,
    diagnostics: &mut Vec<Diagnostic>,
) -> Result<String> {
    let mut frames: BTreeMap<String, usize> = BTreeMap::new();
    for (id, decoder) in &log.index.decoders {
        if matches!(decoder.message_type.kind, Kind::Image(_)) {
            let of_channel = log.index.channels.get(id).map_or(0, |c| c.frames.len());
            *frames.entry(log.topic(*id)).or_default() += of_channel;
        }
    }
    if let Some(topic) = &selection.camera {
        return match video(log, topic) {
            Some(codec) => Err(video_error(log, topic, codec)),
            None if frames.contains_key(topic) => Ok(topic.clone()),
            None => {
                let topics: Vec<String> = frames.into_keys().collect();
                let seen = if topics.is_empty() { log.channel_list() } else { topics.join(", ") };
                Err(Error::NoSuchTopic { what: "camera", topic: topic.clone(), seen })
            }
        };
    }
    let mut topics: BTreeSet<String> = BTreeSet::new();
    let (mut videos, mut without_images) = (Vec::new(), Vec::new());
    for (topic, frames) in frames {
        match video(log, &topic) {
            Some(codec) => videos.push((topic, codec)),
            None if frames > 0 => drop(topics.insert(topic)),
            None => without_images.push(topic),
        }
    }
    if let (true, Some((topic, codec))) = (topics.is_empty(), videos.into_iter().next()) {
        return Err(video_error(log, &topic, codec));
    }
    let is_own = |t: &String| t.contains("image_corrected") || t.starts_with("/unwater/");
    if !topics.iter().all(is_own) {
        topics.retain(|t| !is_own(t));
    }
    // The same camera twice, raw and compressed: the raw images are better.
    let is_raw = |t: &&String| topics.contains(&format!("{t}/compressed"));
    for raw in topics.iter().filter(is_raw).cloned().collect::<Vec<_>>() {
        let compressed_topic = format!("{raw}/compressed");
        topics.remove(&compressed_topic);
        diagnostics.push(Diagnostic::on(&raw, CameraFact::RawPreferred { compressed_topic }));
    }
    match topics.len() {
        0 if !without_images.is_empty() => Err(Error::Data(format!(
            "{} has no image, in the window of -S and -E if there is one",
            without_images.join(", ")
        ))),
        0 => Err(Error::NoCamera { seen: log.channel_list(), unreadable: log.unreadable_list() }),
        1 => Ok(topics.into_iter().next().unwrap_or_default()),
        _ => Err(Error::SeveralCameras { topics: topics.into_iter().collect() }),
    }
}

fn video_error(log: &Log, topic: &str, codec: String) -> Error {
    Error::Video { topic: topic.into(), codec, file: log.recording.path().into() }
}

/// The codec of a topic that holds video.
fn video(log: &Log, topic: &str) -> Option<String> {
    let channels = log.recording.channels.iter().filter(|(_, c)| c.topic == topic);
    channels.filter_map(|(id, _)| log.index.channels.get(id)?.video.clone()).next()
}

/// The range channel that tells most: beams before a single range before a bare altitude, and more
/// answers before fewer.
pub fn choose_ranges(
    log: &Log,
    pings: &BTreeMap<u16, LoggedPings<'_>>,
    wanted: Option<&String>,
    rig_file: &RigFile,
) -> Result<u16> {
    let candidates = log.index.decoders.iter().filter_map(|(id, d)| {
        if let Kind::Ping(rank, _) = d.message_type.kind { Some((*id, rank)) } else { None }
    });
    // The cloud that a corrected log got is no instrument.
    let is_meant =
        |topic: &String| wanted.map_or(!topic.starts_with("/unwater/"), |wanted| wanted == topic);
    let candidates: Vec<(u16, u8)> =
        candidates.filter(|(id, _)| is_meant(&log.topic(*id))).collect();
    let score = |id: u16, rank: u8| {
        let (plane, beam, altitude) = pings.get(&id).map_or((0, 0, 0), |pings| ping_counts(pings));
        let quality = if plane > 0 {
            3
        } else if beam > 0 {
            2
        } else {
            usize::from(altitude > 0)
        };
        // The altitude beside a DVL's beams freezes or means the mean range: an altimeter's is
        // better.
        let rank = if quality == 1 && rank == 0 { u8::MAX } else { rank };
        (quality, std::cmp::Reverse(rank), plane.max(beam).max(altitude), std::cmp::Reverse(id))
    };
    let best = candidates.iter().max_by_key(|(id, rank)| score(*id, *rank)).map(|(id, _)| *id);
    let answered = best.filter(|id| score(*id, 0).0 > 0);
    match (answered, best, wanted) {
        (Some(id), ..) => Ok(id),
        (None, Some(id), _) => {
            let complaint = log
                .index
                .channels
                .get(&id)
                .and_then(|c| c.unreadable.1.clone())
                .filter(|_| rig_file.dvl.beams.is_none());
            let topic = log.topic(id);
            Err(match complaint {
                Some(complaint) => Error::Rig(format!("{topic}: {complaint}")),
                None => Error::Data(format!(
                    "{topic} holds no valid range to the seafloor; another instrument can be \
                     named with --dvl TOPIC"
                )),
            })
        }
        (None, None, Some(wanted)) => Err(Error::NoSuchTopic {
            what: "range instrument",
            topic: wanted.clone(),
            seen: log.channel_list(),
        }),
        (None, None, None) => {
            Err(Error::NoRanges { seen: log.channel_list(), unreadable: log.unreadable_list() })
        }
    }
}

/// Pings with at least three returns, with at least one, and with an altitude.
fn ping_counts(pings: &[(Ping, Stamp)]) -> (usize, usize, usize) {
    let count = |f: &dyn Fn(&Ping) -> bool| pings.iter().filter(|(p, _)| f(p)).count();
    (count(&|p| p.returns() >= 3), count(&|p| p.returns() >= 1), count(&|p| p.altitude.is_some()))
}
