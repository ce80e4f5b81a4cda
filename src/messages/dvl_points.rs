//! `ds_sensor_msgs/Ranges3D`: the return of each beam as a point in the instrument's frame, which
//! needs no assumption about beams.

use nalgebra::Vector3;

use super::dvl::{self, Directions, Report};
use super::header::header;
use super::layout::Layout;
use super::reading::{PingReading, missing};
use super::value::Value;
use crate::coordinates::Direction;
use crate::diagnostics::RangeFact;
use crate::vehicle::{DvlFacts, RangeKind};

/// `range_validity`: 0 unknown, 1 low, 2 high, 3 valid.
const LOW: i64 = 1;

pub fn matches(layout: &Layout, _topic: &str) -> bool {
    layout.has("ranges.range.point.x") && layout.has("ranges.range_validity")
}

pub fn decode(value: &Value<'_>, facts: &DvlFacts) -> Result<PingReading, String> {
    let list = value.list("ranges").ok_or_else(|| missing("ranges"))?;
    let (mut ranges, mut directions) = (Vec::new(), Vec::new());
    for beam in list {
        let point = Vector3::from(beam.xyz("range.point").ok_or_else(|| missing("range.point"))?);
        // A point at the origin has no direction: it is a beam without a return.
        if let Some(direction) =
            Direction::from_vector(point).filter(|_| point.iter().all(|v| v.is_finite()))
        {
            ranges.push((beam.integer("range_validity") != Some(LOW)).then_some(point.norm()));
            directions.push(direction);
        }
    }
    if ranges.is_empty() {
        return Ok(PingReading::none(RangeFact::SomeWithoutBeams));
    }
    let slant = DvlFacts { ranges: Some(RangeKind::Slant), ..facts.clone() };
    let mut reading = dvl::reading(
        value,
        &slant,
        Report { ranges, kind: RangeKind::Slant, directions: Directions::Exact(directions) },
    )?;
    if value.get("header").is_none()
        && let Some((ping, first)) =
            reading.ping.as_mut().zip(list.first().and_then(|b| b.get("range")))
    {
        ping.stamp = header(first).stamp.unwrap_or(ping.stamp);
    }
    Ok(reading)
}
