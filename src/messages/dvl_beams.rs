//! `dvl_msgs/DVL` (Water Linked) and its renames: `beams[].distance` along the beam, `beams[].valid`.
//!
//! Definition: paagutie/dvl_msgs. The message has no directions: the Water Linked geometry is assumed unless the
//! rig file names another. `altitude` freezes at the last good value, so it is never used.

use super::{PingReading, Value, heading, layout::Layout, missing};
use crate::units::{SlantRange, Stamp};
use crate::vehicle::{Beam, DvlFacts, JanusArray, Ping};

pub fn matches(layout: &Layout, _topic: &str) -> bool {
    layout.has("beams.distance") || layout.has("transducers.distance") || layout.has("report.transducers.distance")
}

pub fn decode(value: &Value<'_>, facts: &DvlFacts) -> Result<PingReading, String> {
    if value.text("type").is_some_and(|t| t.contains("water")) || value.flag("is_water_tracking") == Some(true) {
        return Ok(PingReading { ping: None, remark: Some("water-track reports are left out".into()) });
    }
    let list = ["beams", "transducers", "report.transducers"].iter().find_map(|p| value.list(p)).ok_or_else(|| missing("beams"))?;
    let (array, remark) = match array(facts)? {
        Some(array) => (array, None),
        None => {
            let array = JanusArray::named("waterlinked-a50").ok_or("no such instrument")?;
            (array, Some("the message has no beam directions; taken as a Water Linked A50 (22.5°)".into()))
        }
    };
    let directions = array.directions();
    let scale = facts.sound_speed_ratio.unwrap_or(1.0);
    let beams = list.iter().enumerate().filter_map(|(i, beam)| {
        let id = beam.integer("id").and_then(|id| usize::try_from(id).ok()).filter(|id| *id < directions.len()).unwrap_or(i);
        let valid = ["valid", "beam_valid", "locked"].iter().find_map(|f| beam.flag(f)).unwrap_or(true);
        let range = beam.number("distance").filter(|r| valid && r.is_finite() && *r > 0.0);
        Some(Beam { direction: *directions.get(id)?, range: range.map(|r| SlantRange(r * scale)) })
    });
    let ping = Ping { stamp: heading(value).stamp.unwrap_or(Stamp(0)), beams: beams.collect(), altitude: None };
    Ok(PingReading { ping: Some(ping), remark })
}

/// The beams the rig file names, if it does.
pub fn array(facts: &DvlFacts) -> Result<Option<JanusArray>, String> {
    if let Some(name) = &facts.beams {
        let known = || JanusArray::KNOWN.iter().map(|k| k.0).collect::<Vec<_>>().join(", ");
        return JanusArray::named(name).map(Some).ok_or_else(|| format!("rig file: dvl.beams = {name:?} is not one of {}", known()));
    }
    match (facts.janus_angle_deg, &facts.azimuths_deg) {
        (Some(janus_angle_deg), Some(azimuths)) => Ok(Some(JanusArray { janus_angle_deg, azimuths_deg: azimuths.clone() })),
        (None, None) => Ok(None),
        _ => Err("rig file: dvl.janus_angle_deg and dvl.azimuths_deg belong together".into()),
    }
}
