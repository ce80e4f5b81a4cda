//! Ping1D shapes (Blue Robotics' echo sounder): `distance` in millimetres with `confidence` in
//! percent.

use super::{PingReading, Value, header, layout::Layout, missing};
use crate::units::{Altitude, Stamp};
use crate::vehicle::{DvlFacts, Ping};

/// Below this the sounder is guessing [%].
const LEAST_CONFIDENCE: f64 = 60.0;

pub fn matches(layout: &Layout, _topic: &str) -> bool {
    layout.is_number("distance") && layout.is_number("confidence")
}

pub fn decode(value: &Value<'_>, facts: &DvlFacts) -> Result<PingReading, String> {
    let distance = value.number("distance").ok_or_else(|| missing("distance"))?;
    let sure = value.number("confidence").is_none_or(|c| c >= LEAST_CONFIDENCE);
    let altitude = distance * facts.unit_m.unwrap_or(1e-3) * facts.sound_speed_ratio.unwrap_or(1.0);
    let altitude = (sure && altitude > 0.0 && altitude.is_finite()).then_some(Altitude(altitude));
    let ping = Ping {
        stamp: header(value).stamp.unwrap_or(Stamp(0)),
        beams: Vec::new(),
        altitude,
        velocity_m_per_s: None,
    };
    Ok(PingReading {
        ping: Some(ping),
        warning: Some("an echo sounder's wide cone: its distance is read as an altitude".into()),
        ..PingReading::default()
    })
}
