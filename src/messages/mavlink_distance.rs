//! MAVLink `DISTANCE_SENSOR`, bare or inside mavlink2rest's envelope (`message.…`).
//!
//! Centimetres. A sensor that points down gives an altitude. A fork of BlueOS's Water Linked
//! extension sends one message per beam, with ids 1 to 4 and its azimuth in `orientation`; the
//! plane fit joins the beams of several messages.

use super::layout::Layout;
use super::reading::{PingReading, missing};
use super::value::Value;
use crate::diagnostics::RangeFact;
use crate::units::SlantRange;
use crate::vehicle::{Beam, DvlFacts, JanusArray};

/// `signal_quality` of an invalid reading.
const INVALID: i64 = 1;
/// `MAV_SENSOR_ROTATION_PITCH_270`: straight down.
const DOWN: i64 = 25;
/// Angle between beams and axis of the Water Linked A50, which the extension drives (deg).
const JANUS_DEG: f64 = 22.5;

pub fn matches(layout: &Layout, _topic: &str) -> bool {
    let fields = ["current_distance", "orientation", "max_distance"];
    ["", "message."].iter().any(|p| fields.iter().all(|f| layout.has(&format!("{p}{f}"))))
}

pub fn decode(message: &Value<'_>, facts: &DvlFacts) -> Result<PingReading, String> {
    let value = message.get("message").unwrap_or(message);
    let centimetres =
        value.number("current_distance").ok_or_else(|| missing("current_distance"))?;
    let limit = |field: &str| value.number(field).unwrap_or(0.0);
    let (min, max) = (limit("min_distance"), limit("max_distance"));
    let within = centimetres > min && (max <= 0.0 || centimetres < max);
    let valid = value.integer("signal_quality") != Some(INVALID) && within;
    let range = valid.then_some(centimetres * 0.01 * facts.sound_speed_ratio.unwrap_or(1.0));
    let orientation = value.integer("orientation").or_else(|| {
        orientation_named(value.text("orientation.type").or(value.text("orientation"))?)
    });
    match orientation {
        // YAW_45 to YAW_315 in steps of 45°
        Some(steps @ 0..=7) => {
            let array =
                JanusArray { janus_angle_deg: JANUS_DEG, azimuths_deg: vec![45.0 * steps as f64] };
            let direction = array.directions().first().copied().ok_or("no direction")?;
            let beam = Beam { direction, range: range.map(SlantRange) };
            Ok(PingReading {
                note: Some(RangeFact::MessagePerBeam { janus_angle_deg: JANUS_DEG }),
                ..PingReading::of_beams(message, vec![beam])
            })
        }
        Some(DOWN) => Ok(PingReading::of_altitude(message, range)),
        other => Err(format!(
            "a distance sensor that points neither down nor along a beam (orientation {other:?})"
        )),
    }
}

/// Number of a `MAV_SENSOR_ORIENTATION` by its name.
fn orientation_named(name: &str) -> Option<i64> {
    match name.rsplit("ROTATION_").next()? {
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
