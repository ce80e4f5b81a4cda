//! MAVLink `DISTANCE_SENSOR` as messages of its own fields, bare or as mavlink2rest writes them
//! (`message.…`).
//!
//! Centimetres. Id 0 looking down is an altitude; a fork of BlueOS's Water Linked extension sends
//! ids 1 to 4, one message per beam, its azimuth in `orientation`. Beams of several messages come
//! together in the plane's window.

use super::{PingReading, Value, header, layout::Layout, missing};
use crate::units::{Altitude, SlantRange, Stamp};
use crate::vehicle::{Beam, DvlFacts, JanusArray, Ping};

/// `signal_quality` of a reading that is none.
const INVALID: i64 = 1;
/// `MAV_SENSOR_ROTATION_PITCH_270`: straight down.
const DOWN: i64 = 25;
/// The extension is Water Linked's A50.
const JANUS_DEG: f64 = 22.5;

pub fn matches(layout: &Layout, _topic: &str) -> bool {
    ["", "message."].iter().any(|p| {
        ["current_distance", "orientation", "max_distance"]
            .iter()
            .all(|f| layout.has(&format!("{p}{f}")))
    })
}

pub fn decode(value: &Value<'_>, facts: &DvlFacts) -> Result<PingReading, String> {
    let stamp = header(value).stamp.unwrap_or(Stamp(0));
    let value = value.get("message").unwrap_or(value);
    let centimetres =
        value.number("current_distance").ok_or_else(|| missing("current_distance"))?;
    let (least, most) =
        (value.number("min_distance").unwrap_or(0.0), value.number("max_distance").unwrap_or(0.0));
    let within = centimetres > least && (most <= 0.0 || centimetres < most);
    let valid = value.integer("signal_quality") != Some(INVALID) && within;
    let range = valid.then_some(centimetres * 0.01 * facts.sound_speed_ratio.unwrap_or(1.0));
    let orientation = value
        .integer("orientation")
        .or_else(|| rotation_named(value.text("orientation.type").or(value.text("orientation"))?));
    let ping = match orientation {
        // YAW_45 to YAW_315 in steps of 45°
        Some(turns @ 0..=7) => {
            let array =
                JanusArray { janus_angle_deg: JANUS_DEG, azimuths_deg: vec![45.0 * turns as f64] };
            let direction = array.directions().first().copied().ok_or("no direction")?;
            Ping {
                stamp,
                beams: vec![Beam { direction, range: range.map(SlantRange) }],
                altitude: None,
                velocity_m_per_s: None,
            }
        }
        Some(DOWN) => {
            Ping { stamp, beams: Vec::new(), altitude: range.map(Altitude), velocity_m_per_s: None }
        }
        other => {
            return Err(format!(
                "a distance sensor that looks neither down nor along a beam (orientation {other:?})"
            ));
        }
    };
    let warning = (!ping.beams.is_empty()).then(|| {
        format!("one message per beam: {JANUS_DEG}° off the axis, azimuth by its orientation")
    });
    Ok(PingReading { ping: Some(ping), warning, ..PingReading::default() })
}

fn rotation_named(word: &str) -> Option<i64> {
    let word = word.rsplit("ROTATION_").next()?;
    match word {
        "NONE" => Some(0),
        "PITCH_270" => Some(DOWN),
        yaw => yaw
            .strip_prefix("YAW_")?
            .parse::<i64>()
            .ok()
            .filter(|d| d % 45 == 0 && (0..360).contains(d))
            .map(|d| d / 45),
    }
}
