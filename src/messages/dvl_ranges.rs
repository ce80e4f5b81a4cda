//! `marine_acoustic_msgs/Dvl` and its family: `range[4]` along `beam_unit_vec[4]`, slant.
//!
//! Definition: apl-ocean-engineering/marine_msgs. There is no flag per beam: 0, negative, NaN and
//! infinite mean no return. The vectors are checked before use: two public drivers swap sine and
//! cosine (67.5° off the axis for a 22.5° instrument), a bridge leaves them zero, WHOI's point
//! along −z (z up).

use nalgebra::Vector3;

use super::dvl::{self, Directions, Report};
use super::layout::Layout;
use super::reading::{PingReading, missing};
use super::value::Value;
use crate::vehicle::{DvlFacts, RangeKind};

/// Shorter ranges of `ds_sensor_msgs/Dvl` are not echoes (m).
const WHOI_MIN_RANGE_M: f64 = 0.25;

pub fn matches(layout: &Layout, _topic: &str) -> bool {
    layout.has("range") && layout.has("beam_unit_vec.x")
}

pub fn decode(value: &Value<'_>, facts: &DvlFacts) -> Result<PingReading, String> {
    let ranges = value.numbers("range").ok_or_else(|| missing("range"))?;
    let vectors = value.list("beam_unit_vec").unwrap_or(&[]);
    let vectors: Vec<_> = vectors
        .iter()
        .filter_map(|v| Some(Vector3::new(v.number("x")?, v.number("y")?, v.number("z")?)))
        .collect();
    let valid = value.flag("beam_ranges_valid").unwrap_or(true);
    let min = if value.get("ds_header").is_some() { WHOI_MIN_RANGE_M } else { 0.0 };
    let ranges = ranges.into_iter().map(|r| (valid && r > min).then_some(r)).collect();
    dvl::reading(
        value,
        facts,
        Report { ranges, kind: RangeKind::Slant, directions: Directions::Vectors(vectors) },
    )
}
