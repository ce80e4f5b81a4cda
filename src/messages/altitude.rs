//! A bare altitude: `std_msgs/Float64` or `Float32` on a topic named after it, or a message with an
//! altitude field (`rti_dvl`, PD6 shapes, `NavSts`, Nucleus `Altimeter`, Blueye `Altitude`). Zero,
//! negative and non-finite values mean no return; so does a flag that is false.

use super::layout::Layout;
use super::reading::{PingReading, missing};
use super::value::Value;
use crate::vehicle::DvlFacts;

const FIELDS: &[&str] =
    &["altitude", "avg_altitude", "bottom_distance", "altimeter_distance", "altitude.value"];
const FLAGS: &[&str] = &[
    "altimeter_distance_valid",
    "altitude.is_valid",
    "is_valid",
    "valid",
    "altitude_valid",
    "data_valid",
    "dist_valid",
    "beam_valid",
    "locked",
];
/// Fields of satellite and air data, whose altitude is above sea level.
const ABOVE_SEA_LEVEL: &[&str] = &["latitude", "airspeed", "climb", "monotonic", "lat"];

fn names_altitude(topic: &str) -> bool {
    ["altitude", "altimeter", "height_above"].iter().any(|w| topic.to_ascii_lowercase().contains(w))
}

pub fn matches_bare(layout: &Layout, topic: &str) -> bool {
    names_altitude(topic)
        && ((layout.root().len() == 1 && layout.is_number("data"))
            || (layout.is_number("value") && layout.has("is_valid")))
}

pub fn matches_field(layout: &Layout, _topic: &str) -> bool {
    FIELDS.iter().any(|f| layout.is_number(f)) && !ABOVE_SEA_LEVEL.iter().any(|f| layout.has(f))
}

pub fn decode(value: &Value<'_>, facts: &DvlFacts) -> Result<PingReading, String> {
    let altitude = FIELDS
        .iter()
        .chain(&["data", "value"])
        .find_map(|f| value.number(f))
        .ok_or_else(|| missing("altitude"))?;
    let valid = FLAGS.iter().find_map(|f| value.flag(f)).unwrap_or(true);
    let altitude =
        (valid && altitude.is_finite() && altitude > 0.0).then_some(altitude * facts.scale());
    Ok(PingReading::of_altitude(value, altitude))
}
