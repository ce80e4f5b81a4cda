//! A bare altitude: `std_msgs/Float64` or `Float32` on a topic that says so, or a message with a
//! field for it (`rti_dvl`, PD6 shapes, `NavSts`, Nucleus `Altimeter`, Blueye `Altitude`). 0 and
//! below mean lost, so do −9999 and the like.

use super::{PingReading, Value, header, layout::Layout, missing};
use crate::units::{Altitude, Stamp};
use crate::vehicle::{DvlFacts, Ping};

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
/// Fields that say the altitude is one over the sea: satellites and air data.
const OVER_THE_SEA: &[&str] = &["latitude", "airspeed", "climb", "monotonic", "lat"];

fn topic_says_altitude(topic: &str) -> bool {
    ["altitude", "altimeter", "height_above"].iter().any(|w| topic.to_ascii_lowercase().contains(w))
}

pub fn matches_bare(layout: &Layout, topic: &str) -> bool {
    topic_says_altitude(topic)
        && ((layout.root().len() == 1 && layout.is_number("data"))
            || (layout.is_number("value") && layout.has("is_valid")))
}

pub fn matches_field(layout: &Layout, _topic: &str) -> bool {
    FIELDS.iter().any(|f| layout.is_number(f)) && !OVER_THE_SEA.iter().any(|f| layout.has(f))
}

pub fn decode(value: &Value<'_>, facts: &DvlFacts) -> Result<PingReading, String> {
    let altitude = FIELDS
        .iter()
        .chain(&["data", "value"])
        .find_map(|f| value.number(f))
        .ok_or_else(|| missing("altitude"))?;
    let valid = FLAGS.iter().find_map(|f| value.flag(f)).unwrap_or(true);
    let altitude = (valid && altitude.is_finite() && altitude > 0.0)
        .then_some(Altitude(altitude * facts.sound_speed_ratio.unwrap_or(1.0)));
    let stamp = header(value).stamp.unwrap_or(Stamp(0));
    Ok(PingReading {
        ping: Some(Ping { stamp, beams: Vec::new(), altitude, velocity_m_per_s: None }),
        ..PingReading::default()
    })
}
