//! Ranges where the rig file says they are: `[dvl] path = "…"`, for a message of no known shape.
//!
//! The path may lead to one number, to an array of numbers, or through a list of messages
//! (`beams.depth`).

use super::dvl::{self, Directions, Report};
use super::{PingReading, Value, header};
use crate::units::{Altitude, Stamp};
use crate::vehicle::{DvlFacts, Ping, RangeKind};

pub fn decode(value: &Value<'_>, facts: &DvlFacts) -> Result<PingReading, String> {
    let path = facts.path.as_deref().unwrap_or("");
    let numbers = numbers(value, path)
        .ok_or_else(|| format!("rig file: dvl.path = {path:?} leads to no number"))?;
    let flags = facts.valid_path.as_deref().map(|p| self::numbers(value, p).unwrap_or_default());
    let unit = facts.unit_m.unwrap_or(1.0);
    let bad = |v: f64| facts.bad_values.as_ref().is_some_and(|b| b.contains(&v));
    let valid = |i: usize| {
        flags.as_ref().is_none_or(|f| {
            f.get(i).or(f.first().filter(|_| f.len() == 1)).is_some_and(|v| *v != 0.0)
        })
    };
    let ranges: Vec<Option<f64>> = numbers
        .iter()
        .enumerate()
        .map(|(i, v)| (valid(i) && !bad(*v)).then_some(v * unit))
        .collect();
    if facts.ranges == Some(RangeKind::Altitude)
        || ranges.len() == 1 && facts.beams.is_none() && facts.azimuths_deg.is_none()
    {
        let inside = |a: &f64| {
            a.is_finite()
                && *a > facts.min_range_m.unwrap_or(0.0)
                && facts.max_range_m.is_none_or(|most| *a < most)
        };
        let altitude = ranges
            .first()
            .copied()
            .flatten()
            .filter(inside)
            .map(|a| Altitude(a * facts.sound_speed_ratio.unwrap_or(1.0)));
        let ping = Ping {
            stamp: header(value).stamp.unwrap_or(Stamp(0)),
            beams: Vec::new(),
            altitude,
            velocity_m_per_s: None,
        };
        return Ok(PingReading { ping: Some(ping), ..PingReading::default() });
    }
    dvl::ping(
        value,
        facts,
        Report { ranges, kind: RangeKind::Slant, directions: Directions::Unknown },
    )
}

/// The numbers at a path; a list on the way gives one for each of its messages.
fn numbers(value: &Value<'_>, path: &str) -> Option<Vec<f64>> {
    if let Some(v) = value.number(path) {
        return Some(vec![v]);
    }
    if let Some(v) = value.numbers(path) {
        return Some(v);
    }
    let (at, _) = path.match_indices('.').find(|(at, _)| value.list(&path[..*at]).is_some())?;
    value.list(&path[..at])?.iter().map(|v| v.number(&path[at + 1..])).collect()
}
