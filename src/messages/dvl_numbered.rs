//! DVL messages with one field per beam: `distance_beam_1`, `dist_beam0`, `altitude1`, `b1_dist`.
//!
//! The Nucleus driver's `BottomTrack` has three slant ranges and flags; Nortek's other messages and
//! NavQuest's have vertical ranges.

use super::dvl::{self, Directions, NORTEK_BAD_FOM, NORTEK_BAD_VELOCITY, Report};
use super::layout::Layout;
use super::reading::{PingReading, missing};
use super::value::{Value, plain_name};
use crate::vehicle::{DvlFacts, RangeKind};

/// Name of the range field of beam N, without case and underscores: `{prefix}N{suffix}`.
struct Shape {
    prefix: &'static str,
    suffix: &'static str,
    kind: RangeKind,
    /// name in [`crate::vehicle::JanusArray::KNOWN`]
    instrument: &'static str,
}

const fn shape(
    prefix: &'static str,
    suffix: &'static str,
    kind: RangeKind,
    instrument: &'static str,
) -> Shape {
    Shape { prefix, suffix, kind, instrument }
}

const SHAPES: &[Shape] = &[
    shape("distancebeam", "", RangeKind::Slant, "nortek-nucleus"),
    shape("distbeam", "", RangeKind::Vertical, "nortek-25"),
    shape("rangebeam", "", RangeKind::Slant, "nortek-25"),
    shape("altitudebeam", "", RangeKind::Vertical, "linkquest-22"),
    shape("altitude", "", RangeKind::Vertical, "linkquest-22"),
    shape("b", "dist", RangeKind::Vertical, "nortek-25"),
];

impl Shape {
    /// Numbers of the beams present, from 0 to 5.
    fn beams(&self, has: impl Fn(&str) -> bool) -> Vec<usize> {
        (0..=5).filter(|n| has(&format!("{}{n}{}", self.prefix, self.suffix))).collect()
    }
}

/// Whether these are three to five consecutive numbers.
fn is_dvl(beams: &[usize]) -> bool {
    (3..=5).contains(&beams.len()) && beams.windows(2).all(|w| w[1] == w[0] + 1)
}

pub fn matches(layout: &Layout, _topic: &str) -> bool {
    SHAPES.iter().any(|s| is_dvl(&s.beams(|name| layout.is_number(name))))
}

pub fn decode(value: &Value<'_>, facts: &DvlFacts) -> Result<PingReading, String> {
    let Value::Record(fields) = value else { return Err(missing("distance_beam_1")) };
    let names: Vec<String> = fields.iter().map(|(name, _)| plain_name(name)).collect();
    let found = SHAPES
        .iter()
        .map(|s| (s, s.beams(|name| names.iter().any(|n| n == name))))
        .find(|(_, beams)| is_dvl(beams));
    let (shape, beams) = found.ok_or_else(|| missing("distance_beam_1"))?;
    let range = |n: &usize| {
        let flags = [
            format!("beam{n}distancevalid"),
            format!("b{n}distvalid"),
            format!("beam{n}valid"),
            format!("distancebeam{n}valid"),
        ];
        let valid = flags.iter().find_map(|f| value.flag(f)).unwrap_or(true);
        let is = |field: &str, marker: f64| {
            value.number(&format!("{field}{n}")).is_some_and(|v| (v - marker).abs() < 1e-3)
        };
        let lost = is("velbeam", NORTEK_BAD_VELOCITY)
            || is("velocitybeam", NORTEK_BAD_VELOCITY)
            || is("fombeam", NORTEK_BAD_FOM);
        value.number(&format!("{}{n}{}", shape.prefix, shape.suffix)).filter(|_| valid && !lost)
    };
    let ranges = beams.iter().map(range).collect();
    dvl::reading(
        value,
        facts,
        Report { ranges, kind: shape.kind, directions: Directions::Assumed(shape.instrument) },
    )
}
