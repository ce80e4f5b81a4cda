//! DVL messages with an array of ranges and no beam vectors. Most ranges are vertical: slant range
//! times the cosine of the Janus angle.
//!
//! Names are compared without case and underscores: `altitudeBeam` of ROS 1 is `altitudebeam` of
//! the ROS 2 port.

use super::dvl::{self, Directions, NORTEK_BAD_FOM, NORTEK_BAD_VELOCITY, Report};
use super::layout::{Layout, Type};
use super::reading::{PingReading, missing};
use super::value::Value;
use crate::vehicle::{DvlFacts, RangeKind};

struct Shape {
    /// the array of ranges
    field: &'static str,
    kind: RangeKind,
    /// name in [`crate::vehicle::JanusArray::KNOWN`]
    instrument: Option<&'static str>,
}

const fn shape(field: &'static str, kind: RangeKind, instrument: Option<&'static str>) -> Shape {
    Shape { field, kind, instrument }
}

const SHAPES: &[Shape] = &[
    // LinkquestDvl
    shape("altitude_beam", RangeKind::Vertical, Some("linkquest-22")),
    // NortekDF21
    shape("dist_beam", RangeKind::Vertical, Some("nortek-25")),
    // nortek_dvl/ButtomTrack
    shape("vertical_distance", RangeKind::Vertical, Some("nortek-25")),
    // Nucleus1000_bottomtrack
    shape("beam_distance", RangeKind::Slant, Some("nortek-nucleus")),
    shape("beam_ranges", RangeKind::Slant, None),
    // holoocean, RdiPD0
    shape("range", RangeKind::Slant, None),
    shape("ranges", RangeKind::Slant, None),
];

fn shape_of(layout: &Layout, topic: &str) -> Option<&'static Shape> {
    let has_dvl_ranges = |field: &str| match layout.type_at(field) {
        // Scanners have `ranges`, too: an array without a fixed length needs a topic named dvl.
        Some(Type::Array(element, size)) if matches!(**element, Type::Primitive(_)) => match size {
            Some(n) => (3..=5).contains(n),
            None => !field.starts_with("range") || topic.to_ascii_lowercase().contains("dvl"),
        },
        _ => false,
    };
    let is_scanner = layout.has("angle_min") || layout.has("angle_increment");
    SHAPES.iter().find(|s| has_dvl_ranges(s.field)).filter(|_| !is_scanner)
}

pub fn matches_vertical(layout: &Layout, topic: &str) -> bool {
    shape_of(layout, topic).is_some_and(|s| s.kind == RangeKind::Vertical)
}

pub fn matches_slant(layout: &Layout, topic: &str) -> bool {
    shape_of(layout, topic).is_some_and(|s| s.kind == RangeKind::Slant)
}

pub fn decode(value: &Value<'_>, facts: &DvlFacts) -> Result<PingReading, String> {
    let found = SHAPES.iter().find_map(|s| Some((s, value.numbers(s.field)?)));
    let (shape, ranges) = found.ok_or_else(|| missing("range"))?;
    if !(3..=5).contains(&ranges.len()) {
        return Err(format!("a DVL has 3 to 5 beams, the message {} ranges", ranges.len()));
    }
    let per_beam = |field: &str| value.numbers(field).filter(|v| v.len() == ranges.len());
    let (good, velocities, merits) =
        (per_beam("data_good"), per_beam("vel_beam"), per_beam("fom_beam"));
    let valid = ["data_valid", "dist_valid"].iter().find_map(|f| value.flag(f)).unwrap_or(true);
    let is_lost = |i: usize| {
        let is = |list: &Option<Vec<f64>>, marker: f64| {
            list.as_ref().is_some_and(|v| (v[i] - marker).abs() < 1e-3)
        };
        is(&good, 0.0) || is(&velocities, NORTEK_BAD_VELOCITY) || is(&merits, NORTEK_BAD_FOM)
    };
    let ranges =
        ranges.iter().enumerate().map(|(i, r)| (valid && !is_lost(i)).then_some(*r)).collect();
    // PD0's range is vertical, and its header has the Janus angle of the transducer head.
    let janus_deg = value.number("config_beam_angle").filter(|a| dvl::SANE_JANUS_DEG.contains(a));
    let (kind, directions) = match (janus_deg, shape.instrument) {
        (Some(angle), _) => (RangeKind::Vertical, Directions::Angle(angle, "teledyne-30-plus")),
        (None, Some(name)) => (shape.kind, Directions::Assumed(name)),
        (None, None) => (shape.kind, Directions::Unknown),
    };
    dvl::reading(value, facts, Report { ranges, kind, directions })
}
