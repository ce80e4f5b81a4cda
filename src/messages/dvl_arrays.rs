//! DVL messages with an array of ranges and no vectors. Most are vertical: slant × cos of the beam
//! angle.
//!
//! Names are compared without case and underscores: `altitudeBeam` of ROS 1 is `altitudebeam` of
//! the ROS 2 port.

use super::dvl::{self, Directions, NORTEK_BAD_FOM, NORTEK_BAD_VELOCITY, Report};
use super::layout::{Layout, Type};
use super::{PingReading, Value, missing};
use crate::vehicle::{DvlFacts, RangeKind};

/// One family.
struct Shape {
    /// the array
    field: &'static str,
    /// what a range is
    kind: RangeKind,
    /// whose beams they are, where that is known
    instrument: Option<&'static str>,
}

#[rustfmt::skip]
const SHAPES: &[Shape] = &[
    // LinkquestDvl
    Shape { field: "altitude_beam",     kind: RangeKind::Vertical, instrument: Some("linkquest-22") },
    // NortekDF21
    Shape { field: "dist_beam",         kind: RangeKind::Vertical, instrument: Some("nortek-25") },
    // nortek_dvl/ButtomTrack
    Shape { field: "vertical_distance", kind: RangeKind::Vertical, instrument: Some("nortek-25") },
    // Nucleus1000_bottomtrack
    Shape { field: "beam_distance",     kind: RangeKind::Slant,    instrument: Some("nortek-nucleus") },
    Shape { field: "beam_ranges",       kind: RangeKind::Slant,    instrument: None },
    // holoocean, RdiPD0
    Shape { field: "range",             kind: RangeKind::Slant,    instrument: None },
    Shape { field: "ranges",            kind: RangeKind::Slant,    instrument: None },
];

fn shape(layout: &Layout, topic: &str) -> Option<&'static Shape> {
    let three_to_five = |field: &str| match layout.type_at(field) {
        // Scanners have `ranges`, too: those without a fixed length must be said to be a DVL's.
        Some(Type::Array(element, size)) if matches!(**element, Type::Primitive(_)) => match size {
            Some(n) => (3..=5).contains(n),
            None => !field.starts_with("range") || topic.to_ascii_lowercase().contains("dvl"),
        },
        _ => false,
    };
    let scanner = layout.has("angle_min") || layout.has("angle_increment");
    SHAPES.iter().find(|s| three_to_five(s.field)).filter(|_| !scanner)
}

pub fn matches_vertical(layout: &Layout, topic: &str) -> bool {
    shape(layout, topic).is_some_and(|s| s.kind == RangeKind::Vertical)
}

pub fn matches_slant(layout: &Layout, topic: &str) -> bool {
    shape(layout, topic).is_some_and(|s| s.kind == RangeKind::Slant)
}

pub fn decode(value: &Value<'_>, facts: &DvlFacts) -> Result<PingReading, String> {
    let found = SHAPES.iter().find_map(|s| Some((s, value.numbers(s.field)?)));
    let (shape, sent) = found.ok_or_else(|| missing("range"))?;
    if !(3..=5).contains(&sent.len()) {
        return Err(format!("{} ranges are not a DVL's", sent.len()));
    }
    let per_beam = |field: &str| value.numbers(field).filter(|v| v.len() == sent.len());
    let (good, velocities, merits) =
        (per_beam("data_good"), per_beam("vel_beam"), per_beam("fom_beam"));
    let whole = ["data_valid", "dist_valid"].iter().find_map(|f| value.flag(f)).unwrap_or(true);
    let lost = |i: usize| {
        let is = |list: &Option<Vec<f64>>, bad: f64| {
            list.as_ref().is_some_and(|v| (v[i] - bad).abs() < 1e-3)
        };
        is(&good, 0.0) || is(&velocities, NORTEK_BAD_VELOCITY) || is(&merits, NORTEK_BAD_FOM)
    };
    let ranges = sent.iter().enumerate().map(|(i, r)| (whole && !lost(i)).then_some(*r)).collect();
    // PD0's own range is vertical, and its header says the angle of the transducer head.
    let head = value.number("config_beam_angle").filter(|a| dvl::SANE_JANUS_DEG.contains(a));
    let (kind, directions) = match (head, shape.instrument) {
        (Some(angle), _) => (RangeKind::Vertical, Directions::Angle(angle, "teledyne-30-plus")),
        (None, Some(name)) => (shape.kind, Directions::Assumed(name)),
        (None, None) => (shape.kind, Directions::Unknown),
    };
    dvl::ping(value, facts, Report { ranges, kind, directions })
}
