//! DVL messages with a list of beams: Water Linked and its renames, the UUV simulator's family,
//! Gazebo, Blueye.
//!
//! | shape | range | no return | directions |
//! | --- | --- | --- | --- |
//! | `dvl_msgs/DVL`, renames | `distance` | `valid`, `beam_valid` false; ≤ 0 | by id |
//! | Blueye `DvlVelocity` | `distance` | `beam_valid` false | Water Linked (4), Nucleus (3) |
//! | UUV simulator and others | `range` | < 0; covariance −1; 81 m, 0.7 m | `pose`, its x axis |
//! | `gz.msgs.DVLVelocityTracking` | `range.mean` | `locked` false | none |
//!
//! `dvl_msgs/DVL` has the beams of Water Linked, the other simulators are `cola2_msgs`,
//! `smarc_msgs`, Stonefish. `altitude` freezes at the last good value in many drivers: it is used
//! only where the list is empty.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::dvl::{self, Directions, Report, SANE_JANUS_DEG};
use super::layout::Layout;
use super::reading::PingReading;
use super::value::Value;
use crate::coordinates::{Direction, Dvl};
use crate::diagnostics::RangeFact;
use crate::vehicle::{DvlFacts, RangeKind};

const LISTS: &[&str] = &["beams", "transducers", "report.transducers", "dvl_velocity.transducers"];
const RANGES: &[&str] = &["distance", "range.mean", "range.range", "range"];
const FLAGS: &[&str] = &["valid", "beam_valid", "locked", "is_valid", "data_valid", "dist_valid"];
/// The UUV simulator writes the limits of its sensor for a beam without a return (m).
const SIMULATOR_LIMITS_M: [f64; 2] = [0.7, 81.0];

pub fn matches_distance(layout: &Layout, _topic: &str) -> bool {
    LISTS.iter().any(|l| layout.is_number(&format!("{l}.distance")))
}

pub fn matches_pose(layout: &Layout, _topic: &str) -> bool {
    layout.is_array("beams") && layout.is_number("beams.range") && layout.has("beams.pose")
}

pub fn matches_range(layout: &Layout, _topic: &str) -> bool {
    let ranges = ["beams.range", "beams.range.mean", "beams.range.range"];
    layout.is_array("beams") && ranges.iter().any(|r| layout.is_number(r))
}

pub fn decode(value: &Value<'_>, facts: &DvlFacts) -> Result<PingReading, String> {
    let Some(list) = LISTS.iter().find_map(|p| value.list(p)) else {
        // A channel may carry other reports, too (Water Linked's `position_local`).
        return Ok(PingReading::none(RangeFact::SomeWithoutBeams));
    };
    let has_poses = list.iter().any(|b| b.get("pose").is_some());
    let has_distances = list.iter().any(|b| b.number("distance").is_some());
    let directions = match (has_poses, has_distances, list.len()) {
        // The rig file takes precedence over poses.
        (true, ..) if dvl::array(facts)?.is_none() => {
            directions_of_poses(list).map_or(Directions::Unknown, Directions::Exact)
        }
        (true, ..) => Directions::Unknown,
        (_, true, 3) => Directions::Assumed("nortek-nucleus"),
        (_, true, _) => Directions::Assumed("waterlinked-a50"),
        _ => Directions::Unknown,
    };
    let count = if has_distances && list.len() > 3 { list.len().max(4) } else { list.len() };
    let range = |beam: &Value<'_>| {
        let valid = FLAGS.iter().find_map(|f| beam.flag(f)).unwrap_or(true);
        let lost = ["range_covariance", "range_covar"].iter().any(|f| beam.number(f) == Some(-1.0));
        let is_limit = |r: f64| has_poses && SIMULATOR_LIMITS_M.contains(&r);
        RANGES.iter().find_map(|f| beam.number(f)).filter(|r| valid && !lost && !is_limit(*r))
    };
    let mut ranges = vec![None; count];
    for (slot, beam) in slots(list, count).into_iter().zip(list) {
        ranges[slot] = range(beam);
    }
    dvl::reading(value, facts, Report { ranges, kind: RangeKind::Slant, directions })
}

/// Index of each beam in an array of `count`: its id where all have one, as drivers leave out or
/// reorder lost beams; else its position in the list. Ids start at 0 or 1.
fn slots(list: &[Value<'_>], count: usize) -> Vec<usize> {
    let ids: Vec<i64> = list.iter().filter_map(|b| b.integer("id")).collect();
    let first = i64::from(!ids.contains(&0));
    let slots: Option<Vec<usize>> = ids
        .iter()
        .map(|id| usize::try_from(id.checked_sub(first)?).ok().filter(|slot| *slot < count))
        .collect();
    let is_distinct = |slots: &Vec<usize>| {
        let mut sorted = slots.clone();
        sorted.sort_unstable();
        sorted.windows(2).all(|w| w[0] != w[1])
    };
    slots
        .filter(|slots| slots.len() == list.len() && is_distinct(slots))
        .unwrap_or_else(|| (0..list.len()).collect())
}

/// The x axes of the poses, where they lie around one axis as beams do: some drivers leave the
/// quaternions at identity. They need not be normalised.
fn directions_of_poses(list: &[Value<'_>]) -> Option<Vec<Direction<Dvl>>> {
    let axis_of = |beam: &Value<'_>| {
        let [x, y, z, w] =
            ["pose.pose.orientation", "pose.orientation"].iter().find_map(|p| beam.xyzw(p))?;
        let q = Quaternion::new(w, x, y, z);
        (q.norm() > 1e-3 && q.norm().is_finite())
            .then(|| UnitQuaternion::from_quaternion(q) * Vector3::x())
    };
    let axes: Vec<Vector3<f64>> = list.iter().map(axis_of).collect::<Option<_>>()?;
    let mean = axes.iter().sum::<Vector3<f64>>().try_normalize(1e-3)?;
    let is_janus = axes
        .iter()
        .all(|a| SANE_JANUS_DEG.contains(&a.dot(&mean).clamp(-1.0, 1.0).acos().to_degrees()));
    (axes.len() >= 3 && is_janus)
        .then(|| axes.iter().filter_map(|a| Direction::from_vector(*a)).collect())
}
