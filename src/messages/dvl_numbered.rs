//! DVL messages with one field per beam: `distance_beam_1`, `dist_beam0`, `altitude1`, `b1_dist`.
//!
//! The Nucleus driver's `BottomTrack` has three slant ranges and flags; Nortek's others and
//! NavQuest's are vertical.

use super::dvl::{self, Directions, NORTEK_BAD_FOM, NORTEK_BAD_VELOCITY, Report};
use super::value::plain_name;
use super::{PingReading, Value, layout::Layout, missing};
use crate::vehicle::{DvlFacts, RangeKind};

/// How a family names the field of beam N, in plain letters.
struct Shape {
    before: &'static str,
    after: &'static str,
    kind: RangeKind,
    instrument: &'static str,
}

#[rustfmt::skip]
const SHAPES: &[Shape] = &[
    Shape { before: "distancebeam", after: "",     kind: RangeKind::Slant,    instrument: "nortek-nucleus" },
    Shape { before: "distbeam",     after: "",     kind: RangeKind::Vertical, instrument: "nortek-25" },
    Shape { before: "rangebeam",    after: "",     kind: RangeKind::Slant,    instrument: "nortek-25" },
    Shape { before: "altitudebeam", after: "",     kind: RangeKind::Vertical, instrument: "linkquest-22" },
    Shape { before: "altitude",     after: "",     kind: RangeKind::Vertical, instrument: "linkquest-22" },
    Shape { before: "b",            after: "dist", kind: RangeKind::Vertical, instrument: "nortek-25" },
];

impl Shape {
    /// The numbers of the beams that are there, 0 or 1 first.
    fn beams(&self, has: impl Fn(&str) -> bool) -> Vec<usize> {
        (0..=5).filter(|n| has(&format!("{}{n}{}", self.before, self.after))).collect()
    }
}

fn is_run(beams: &[usize]) -> bool {
    (3..=5).contains(&beams.len()) && beams.windows(2).all(|w| w[1] == w[0] + 1)
}

pub fn matches(layout: &Layout, _topic: &str) -> bool {
    SHAPES.iter().any(|s| is_run(&s.beams(|name| layout.is_number(name))))
}

pub fn decode(value: &Value<'_>, facts: &DvlFacts) -> Result<PingReading, String> {
    let Value::Record(fields) = value else { return Err(missing("distance_beam_1")) };
    let names: Vec<String> = fields.iter().map(|(name, _)| plain_name(name)).collect();
    let found = SHAPES
        .iter()
        .map(|s| (s, s.beams(|name| names.iter().any(|n| n == name))))
        .find(|(_, beams)| is_run(beams));
    let (shape, beams) = found.ok_or_else(|| missing("distance_beam_1"))?;
    let range = |n: &usize| {
        let flags = [
            format!("beam{n}distancevalid"),
            format!("b{n}distvalid"),
            format!("beam{n}valid"),
            format!("distancebeam{n}valid"),
        ];
        let valid = flags.iter().find_map(|f| value.flag(f)).unwrap_or(true);
        let is = |field: &str, bad: f64| {
            value.number(&format!("{field}{n}")).is_some_and(|v| (v - bad).abs() < 1e-3)
        };
        let lost = is("velbeam", NORTEK_BAD_VELOCITY)
            || is("velocitybeam", NORTEK_BAD_VELOCITY)
            || is("fombeam", NORTEK_BAD_FOM);
        value.number(&format!("{}{n}{}", shape.before, shape.after)).filter(|_| valid && !lost)
    };
    let ranges = beams.iter().map(range).collect();
    dvl::ping(
        value,
        facts,
        Report { ranges, kind: shape.kind, directions: Directions::Assumed(shape.instrument) },
    )
}
