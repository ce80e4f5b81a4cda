//! DVL messages with a list of beams: Water Linked and its renames, the UUV simulator's family,
//! Gazebo, Blueye.
//!
//! | shape | range | lost | directions |
//! | --- | --- | --- | --- |
//! | `dvl_msgs/DVL` and renames | `distance` | `valid`, `beam_valid` false; −1, 0 | none: Water Linked, by beam id |
//! | Blueye `DvlVelocity` | `distance` | `beam_valid` false | none: Water Linked (4), Nucleus (3) |
//! | UUV simulator, `cola2_msgs`, `smarc_msgs`, Stonefish | `range` | < 0; covariance −1; 81 m, 0.7 m | `pose`, its x axis |
//! | `gz.msgs.DVLVelocityTracking` | `range.mean` | `locked` false | none |
//!
//! `altitude` freezes at the last good value in many drivers: it is used only where the list is
//! empty.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::dvl::{self, Directions, Report, SANE_JANUS_DEG};
use super::{PingReading, Value, layout::Layout};
use crate::coordinates::Direction;
use crate::vehicle::{DvlFacts, RangeKind};

const LISTS: &[&str] = &["beams", "transducers", "report.transducers", "dvl_velocity.transducers"];
const RANGES: &[&str] = &["distance", "range.mean", "range.range", "range"];
const FLAGS: &[&str] = &["valid", "beam_valid", "locked", "is_valid", "data_valid", "dist_valid"];
/// The UUV simulator writes its sensor's limits for a beam without echo [m].
const SIMULATOR_LIMITS_M: [f64; 2] = [0.7, 81.0];

pub fn matches_distance(layout: &Layout, _topic: &str) -> bool {
    LISTS.iter().any(|l| layout.is_number(&format!("{l}.distance")))
}

pub fn matches_pose(layout: &Layout, _topic: &str) -> bool {
    layout.is_array("beams") && layout.is_number("beams.range") && layout.has("beams.pose")
}

pub fn matches_range(layout: &Layout, _topic: &str) -> bool {
    layout.is_array("beams")
        && (layout.is_number("beams.range")
            || layout.is_number("beams.range.mean")
            || layout.is_number("beams.range.range"))
}

pub fn decode(value: &Value<'_>, facts: &DvlFacts) -> Result<PingReading, String> {
    let Some(list) = LISTS.iter().find_map(|p| value.list(p)) else {
        // One stream may carry other reports, too (Water Linked's `position_local`).
        return Ok(dvl::nothing("reports without beams are left out"));
    };
    let posed = list.iter().any(|b| b.get("pose").is_some());
    let range = |beam: &Value<'_>| {
        let valid = FLAGS.iter().find_map(|f| beam.flag(f)).unwrap_or(true);
        let lost = ["range_covariance", "range_covar"].iter().any(|f| beam.number(f) == Some(-1.0));
        let limit = |r: f64| posed && SIMULATOR_LIMITS_M.contains(&r);
        RANGES.iter().find_map(|f| beam.number(f)).filter(|r| valid && !lost && !limit(*r))
    };
    // Beams by their number where they have one: drivers leave lost ones out, or reorder them.
    let ids: Vec<i64> = list.iter().filter_map(|b| b.integer("id")).collect();
    let first = i64::from(!ids.contains(&0));
    let slot = |i: usize, beam: &Value<'_>| {
        beam.integer("id").and_then(|id| usize::try_from(id.checked_sub(first)?).ok()).unwrap_or(i)
    };
    let by_distance = list.iter().any(|b| b.number("distance").is_some());
    let count = if by_distance && list.len() > 3 { list.len().max(4) } else { list.len() };
    let numbered = ids.len() == list.len()
        && list.iter().enumerate().all(|(i, b)| slot(i, b) < count)
        && distinct(&ids);
    let mut ranges = vec![None; count];
    for (i, beam) in list.iter().enumerate() {
        ranges[if numbered { slot(i, beam) } else { i }] = range(beam);
    }
    let directions = match (posed, by_distance, list.len()) {
        // The rig file wins over poses, too.
        (true, ..) if dvl::array(facts)?.is_none() => {
            directions_of_poses(list).map_or(Directions::Unknown, Directions::Exact)
        }
        (true, ..) => Directions::Unknown,
        (_, true, 3) => Directions::Assumed("nortek-nucleus"),
        (_, true, _) => Directions::Assumed("waterlinked-a50"),
        _ => Directions::Unknown,
    };
    dvl::ping(value, facts, Report { ranges, kind: RangeKind::Slant, directions })
}

fn distinct(ids: &[i64]) -> bool {
    let mut sorted = ids.to_vec();
    sorted.sort_unstable();
    sorted.windows(2).all(|w| w[0] != w[1])
}

/// The x axes of the poses, where they fan out around one axis as beams do; some drivers do not
/// normalise the quaternions, others leave them at rest.
fn directions_of_poses(list: &[Value<'_>]) -> Option<Vec<Direction<crate::coordinates::Dvl>>> {
    let axis_of = |beam: &Value<'_>| {
        let [x, y, z, w] =
            ["pose.pose.orientation", "pose.orientation"].iter().find_map(|p| beam.xyzw(p))?;
        let q = Quaternion::new(w, x, y, z);
        (q.norm() > 1e-3 && q.norm().is_finite())
            .then(|| UnitQuaternion::from_quaternion(q) * Vector3::x())
    };
    let axes: Vec<Vector3<f64>> = list.iter().map(axis_of).collect::<Option<_>>()?;
    let mean = axes.iter().sum::<Vector3<f64>>().try_normalize(1e-3)?;
    let fan = axes
        .iter()
        .all(|a| SANE_JANUS_DEG.contains(&a.dot(&mean).clamp(-1.0, 1.0).acos().to_degrees()));
    (axes.len() >= 3 && fan)
        .then(|| axes.iter().filter_map(|a| Direction::from_vector(*a)).collect())
}
