//! `sensor_msgs/Range`: an altimeter. A narrow beam is a slant range along the frame's x axis (REP
//! 117 says what infinities mean); a wide cone has no direction and is read as an altitude.

use nalgebra::Vector3;

use super::{PingReading, Value, header, layout::Layout, missing};
use crate::coordinates::Direction;
use crate::units::{Altitude, SlantRange, Stamp};
use crate::vehicle::{Beam, DvlFacts, Ping};

/// A cone wider than this hits the floor anywhere: its range is the shortest one, an altitude
/// [rad].
const NARROW_RAD: f64 = 0.35;

pub fn matches(layout: &Layout, _topic: &str) -> bool {
    ["radiation_type", "field_of_view", "min_range", "max_range", "range"]
        .iter()
        .all(|f| layout.has(f))
}

pub fn decode(value: &Value<'_>, facts: &DvlFacts) -> Result<PingReading, String> {
    let range = value.number("range").ok_or_else(|| missing("range"))?;
    let (least, most) =
        (value.number("min_range").unwrap_or(0.0), value.number("max_range").unwrap_or(0.0));
    let within = range >= least && (most <= 0.0 || range < most);
    let range = (range.is_finite() && range > 0.0 && within)
        .then_some(range * facts.sound_speed_ratio.unwrap_or(1.0));
    let stamp = header(value).stamp.unwrap_or(Stamp(0));
    let narrow = value.number("field_of_view").unwrap_or(0.0) <= NARROW_RAD;
    let direction = Direction::from_vector(Vector3::x()).ok_or("no axis")?;
    let ping = if narrow {
        Ping {
            stamp,
            beams: vec![Beam { direction, range: range.map(SlantRange) }],
            altitude: None,
            velocity_m_per_s: None,
        }
    } else {
        Ping { stamp, beams: Vec::new(), altitude: range.map(Altitude), velocity_m_per_s: None }
    };
    let warning = (!narrow).then(|| "a wide sonar cone: its range is read as an altitude".into());
    Ok(PingReading { ping: Some(ping), warning, ..PingReading::default() })
}
