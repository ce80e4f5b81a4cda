//! Ranges at the path that the rig file names: `[dvl] path = "…"`, for a message of unknown shape.
//!
//! The path leads to a number, to an array of numbers, or through a list of messages
//! (`beams.depth`).

use super::dvl::{self, Directions, Report};
use super::reading::PingReading;
use super::value::Value;
use crate::vehicle::{DvlFacts, RangeKind};

pub fn decode(value: &Value<'_>, facts: &DvlFacts) -> Result<PingReading, String> {
    let path = facts.path.as_deref().unwrap_or("");
    let numbers = numbers(value, path)
        .ok_or_else(|| format!("rig file: dvl.path = {path:?} leads to no number"))?;
    let flags = facts.valid_path.as_deref().map(|p| self::numbers(value, p).unwrap_or_default());
    let unit_m = facts.unit_m.unwrap_or(1.0);
    let is_marker = |v: f64| facts.bad_values.as_ref().is_some_and(|b| b.contains(&v));
    let is_valid = |i: usize| {
        flags.as_ref().is_none_or(|f| {
            f.get(i).or(f.first().filter(|_| f.len() == 1)).is_some_and(|v| *v != 0.0)
        })
    };
    let ranges: Vec<Option<f64>> = numbers
        .iter()
        .enumerate()
        .map(|(i, v)| (is_valid(i) && !is_marker(*v)).then_some(v * unit_m))
        .collect();
    if facts.ranges == Some(RangeKind::Altitude)
        || ranges.len() == 1 && facts.beams.is_none() && facts.azimuths_deg.is_none()
    {
        let altitude = ranges.first().copied().flatten();
        let altitude = altitude.filter(|a| a.is_finite() && dvl::is_within_limits(*a, facts));
        let scale = facts.sound_speed_ratio.unwrap_or(1.0);
        return Ok(PingReading::of_altitude(value, altitude.map(|a| a * scale)));
    }
    dvl::reading(
        value,
        facts,
        Report { ranges, kind: RangeKind::Slant, directions: Directions::Unknown },
    )
}

/// The numbers at a path; a list along it contributes one number per message.
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
