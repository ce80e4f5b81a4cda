//! Ping1D shapes (Blue Robotics' echo sounder): `distance` in millimetres, `confidence` in percent.

use super::layout::Layout;
use super::reading::{PingReading, missing};
use super::value::Value;
use crate::diagnostics::RangeFact;
use crate::vehicle::DvlFacts;

/// Readings of a lower confidence are not reliable (%).
const MIN_CONFIDENCE: f64 = 60.0;

pub fn matches(layout: &Layout, _topic: &str) -> bool {
    layout.is_number("distance") && layout.is_number("confidence")
}

pub fn decode(value: &Value<'_>, facts: &DvlFacts) -> Result<PingReading, String> {
    let distance = value.number("distance").ok_or_else(|| missing("distance"))?;
    let confident = value.number("confidence").is_none_or(|c| c >= MIN_CONFIDENCE);
    let altitude = distance * facts.unit_m.unwrap_or(1e-3) * facts.sound_speed_ratio.unwrap_or(1.0);
    let altitude = (confident && altitude > 0.0 && altitude.is_finite()).then_some(altitude);
    Ok(PingReading { note: Some(RangeFact::WideCone), ..PingReading::of_altitude(value, altitude) })
}
