//! `sensor_msgs/Range`: an altimeter. A narrow beam is a slant range along the frame's x axis
//! (REP 117 defines the infinities); a wide cone has no direction, its range is used as altitude.

use nalgebra::Vector3;

use super::layout::Layout;
use super::reading::{PingReading, missing};
use super::value::Value;
use crate::coordinates::Direction;
use crate::diagnostics::RangeFact;
use crate::units::SlantRange;
use crate::vehicle::{Beam, DvlFacts};

/// The first echo of a cone wider than this may come from any direction inside it: the range is the
/// shortest distance to the seafloor, an altitude (rad).
const MAX_NARROW_RAD: f64 = 0.35;

pub fn matches(layout: &Layout, _topic: &str) -> bool {
    layout.has_all(&["radiation_type", "field_of_view", "min_range", "max_range", "range"])
}

pub fn decode(value: &Value<'_>, facts: &DvlFacts) -> Result<PingReading, String> {
    let range = value.number("range").ok_or_else(|| missing("range"))?;
    let limit = |field: &str| value.number(field).unwrap_or(0.0);
    let (min, max) = (limit("min_range"), limit("max_range"));
    let within = range >= min && (max <= 0.0 || range < max);
    let range = (range.is_finite() && range > 0.0 && within).then_some(range * facts.scale());
    if limit("field_of_view") <= MAX_NARROW_RAD {
        let direction = Direction::from_vector(Vector3::x()).ok_or("no axis")?;
        let beam = Beam { direction, range: range.map(SlantRange) };
        return Ok(PingReading::of_beams(value, vec![beam]));
    }
    Ok(PingReading { note: Some(RangeFact::WideCone), ..PingReading::of_altitude(value, range) })
}
