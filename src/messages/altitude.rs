//! `std_msgs/Float64` or `Float32` on a topic that says altitude: no stamp, no flag; 0 and below mean lost.

use super::{PingReading, Value, layout::Layout, missing};
use crate::units::{Altitude, Stamp};
use crate::vehicle::{DvlFacts, Ping};

pub fn matches(layout: &Layout, topic: &str) -> bool {
    let named = ["altitude", "altimeter", "height_above"].iter().any(|w| topic.to_ascii_lowercase().contains(w));
    named && layout.root().len() == 1 && layout.has("data")
}

pub fn decode(value: &Value<'_>, facts: &DvlFacts) -> Result<PingReading, String> {
    let altitude = value.number("data").ok_or_else(|| missing("data"))?;
    let altitude = (altitude.is_finite() && altitude > 0.0).then_some(Altitude(altitude * facts.sound_speed_ratio.unwrap_or(1.0)));
    Ok(PingReading { ping: Some(Ping { stamp: Stamp(0), beams: Vec::new(), altitude }), remark: None })
}
