//! Which camera and which range instrument of a log are meant.

use std::collections::BTreeMap;

use super::super::index::{ChannelScan, Scan};
use super::{Selection, channel_list, topic};
use crate::diagnostics::{CameraFact, Diagnostic};
use crate::error::{Error, Result};
use crate::messages::Kind;
use crate::recording::Recording;
use crate::vehicle::RigFile;

pub fn choose_camera(
    recording: &Recording,
    scan: &Scan,
    selection: &Selection,
    diagnostics: &mut Vec<Diagnostic>,
) -> Result<String> {
    let mut topics: BTreeMap<String, usize> = BTreeMap::new();
    for (id, decoder) in &scan.decoders {
        if matches!(decoder.message_type.kind, Kind::Image(_)) {
            *topics.entry(topic(recording, *id)).or_default() +=
                scan.channels.get(id).map_or(0, |c| c.frames.len());
        }
    }
    let seen = if topics.is_empty() {
        channel_list(recording)
    } else {
        topics.keys().cloned().collect::<Vec<_>>().join(", ")
    };
    if let Some(wanted) = &selection.camera {
        return if let Some(codec) = scan
            .channels
            .iter()
            .filter(|(id, _)| topic(recording, **id) == *wanted)
            .find_map(|(_, c)| c.video.clone())
        {
            Err(Error::Video { topic: wanted.clone(), codec })
        } else if topics.contains_key(wanted) {
            Ok(wanted.clone())
        } else {
            Err(Error::NoSuchTopic { what: "camera", topic: wanted.clone(), seen })
        };
    }
    let video = |topic: &String| {
        let of_topic = scan
            .channels
            .iter()
            .filter(|(id, _)| recording.channels.get(id).is_some_and(|c| c.topic == *topic));
        of_topic.filter_map(|(_, c)| c.video.clone()).next()
    };
    let videos: Vec<(String, String)> =
        topics.keys().filter_map(|t| Some((t.clone(), video(t)?))).collect();
    topics.retain(|t, frames| *frames > 0 && videos.iter().all(|(v, _)| v != t));
    if topics.is_empty()
        && let Some((topic, codec)) = videos.into_iter().next()
    {
        return Err(Error::Video { topic, codec });
    }
    let own: Vec<String> = topics
        .keys()
        .filter(|t| t.contains("image_corrected") || t.starts_with("/unwater/"))
        .cloned()
        .collect();
    if own.len() < topics.len() {
        topics.retain(|t, _| !own.contains(t));
    }
    // The same camera twice, raw and compressed: raw has lost less.
    let raw: Vec<String> = topics
        .keys()
        .filter_map(|t| t.strip_suffix("/compressed").map(String::from))
        .filter(|t| topics.contains_key(t))
        .collect();
    for kept in &raw {
        let compressed_topic = format!("{kept}/compressed");
        topics.remove(&compressed_topic);
        diagnostics.push(Diagnostic::on(kept, CameraFact::RawPreferred { compressed_topic }));
    }
    match topics.len() {
        0 => Err(Error::NoCamera { seen: channel_list(recording) }),
        1 => Ok(topics.into_keys().next().unwrap_or_default()),
        _ => Err(Error::SeveralCameras { topics: topics.into_keys().collect() }),
    }
}

/// The range channel that tells most: beams before a single range before a bare altitude, and more
/// answers before fewer.
pub fn choose_ranges(
    recording: &Recording,
    scan: &Scan,
    wanted: Option<&String>,
    rig_file: &RigFile,
) -> Result<u16> {
    let candidates = scan.decoders.iter().filter_map(|(id, d)| {
        if let Kind::Ping(rank, _) = d.message_type.kind { Some((*id, rank)) } else { None }
    });
    // The cloud that a corrected log got is no instrument.
    let is_meant =
        |topic: &String| wanted.map_or(!topic.starts_with("/unwater/"), |wanted| wanted == topic);
    let candidates: Vec<(u16, u8)> =
        candidates.filter(|(id, _)| is_meant(&topic(recording, *id))).collect();
    let score = |id: u16, rank: u8| {
        let (plane, beam, altitude) =
            scan.channels.get(&id).map_or((0, 0, 0), ChannelScan::ping_counts);
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
            let complaint = scan
                .channels
                .get(&id)
                .and_then(|c| c.unreadable.1.clone())
                .filter(|_| rig_file.dvl.beams.is_none());
            let topic = topic(recording, id);
            Err(match complaint {
                Some(complaint) => Error::Rig(format!("{topic}: {complaint}")),
                None => Error::Usage(format!(
                    "{topic} holds no valid range to the seafloor; another instrument can be \
                     named with --dvl TOPIC"
                )),
            })
        }
        (None, None, Some(wanted)) => Err(Error::NoSuchTopic {
            what: "range instrument",
            topic: wanted.clone(),
            seen: channel_list(recording),
        }),
        (None, None, None) => Err(Error::NoRanges { seen: channel_list(recording) }),
    }
}
