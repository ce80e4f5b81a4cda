//! Common parts of all DVL messages: beam directions, validity of ranges, slant or vertical.
//!
//! One file per shape locates the numbers ([`Report`]); this file turns them into a ping. The rig
//! file takes precedence over the message, the message's directions over those of a known
//! instrument. Assumptions are reported, and the message's own altitude is compared
//! with its ranges (the survey evaluates it).

use nalgebra::Vector3;

use super::reading::{AltitudeCheck, PingReading};
use super::value::Value;
use crate::coordinates::{Direction, Dvl};
use crate::diagnostics::RangeFact;
use crate::units::SlantRange;
use crate::vehicle::{Beam, DvlFacts, JanusArray, RangeKind};

/// Angles between beams and axis of all known instruments (deg).
pub const SANE_JANUS_DEG: std::ops::RangeInclusive<f64> = 12.0..=35.0;
/// Largest deviation of neighbouring azimuths from even spacing (deg).
const MAX_UNEVENNESS_DEG: f64 = 30.0;
/// Nortek's marker for an invalid velocity (m/s).
pub const NORTEK_BAD_VELOCITY: f64 = -32.768;
/// Nortek's figure of merit of an invalid beam (m/s).
pub const NORTEK_BAD_FOM: f64 = 10.0;
/// A larger velocity over the seafloor is a marker for "none" (m/s).
const MAX_VELOCITY_M_PER_S: f64 = 10.0;

/// Beam directions in the message.
pub enum Directions<'r> {
    /// beam vectors, not yet checked
    Vectors(Vec<Vector3<f64>>),
    /// reliable directions: returns as points, poses
    Exact(Vec<Direction<Dvl>>),
    /// none; this instrument is assumed
    Assumed(&'r str),
    /// only the Janus angle (deg); the azimuths of this instrument are assumed
    Angle(f64, &'r str),
    /// none, and the instrument is unknown
    Unknown,
}

/// A message's ranges, without its flags and markers.
pub struct Report<'r> {
    /// one per beam (m); `None` where the message marks it invalid
    pub ranges: Vec<Option<f64>>,
    /// by the type of message
    pub kind: RangeKind,
    /// one per beam
    pub directions: Directions<'r>,
}

/// Beam directions, and the note where they are assumed or repaired.
type Resolved = (Vec<Direction<Dvl>>, Option<RangeFact>);

/// Whether the ranges are to a layer of water, not to the seafloor.
pub fn is_water_track(value: &Value<'_>) -> bool {
    let names_water =
        |path: &str| value.text(path).is_some_and(|t| t.to_ascii_lowercase().contains("water"));
    value.integer("velocity_mode") == Some(2)
        || value.integer("velocity_reference") == Some(1)
        || value.integer("target.type") == Some(2)
        || ["type", "target.type", "velocity_mode"].iter().any(|p| names_water(p))
        || ["is_water_tracking", "dvl_velocity.is_water_tracking"]
            .iter()
            .any(|p| value.flag(p) == Some(true))
}

/// The altitude beside the beams (m).
fn altitude(value: &Value<'_>) -> Option<f64> {
    ["altitude", "avg_altitude", "report.altitude", "target.range.mean"]
        .iter()
        .find_map(|p| value.number(p))
        .filter(|a| a.is_finite() && *a > 0.0)
}

/// The velocity over the seafloor, along the instrument's axes (m/s).
fn velocity(value: &Value<'_>) -> Option<Vector3<f64>> {
    let is_flagged =
        ["velocity_valid", "valid", "bottom_lock"].iter().any(|p| value.flag(p) == Some(false));
    let [x, y, z] = value.xyz("velocity").or_else(|| value.xyz("velocity.twist.linear"))?;
    let v = Vector3::new(x, y, z);
    (!is_flagged
        && v.iter().all(|c| c.is_finite() && *c != NORTEK_BAD_VELOCITY)
        && v.norm() < MAX_VELOCITY_M_PER_S)
        .then_some(v)
}

/// Whether a range is inside the limits of the rig file.
pub fn is_within_limits(range_m: f64, facts: &DvlFacts) -> bool {
    range_m > facts.min_range_m.unwrap_or(0.0) && facts.max_range_m.is_none_or(|max| range_m < max)
}

/// The ping of a report, with the units and the overrides of the rig file.
///
/// # Errors
/// The beam directions cannot be determined.
pub fn reading(
    value: &Value<'_>,
    facts: &DvlFacts,
    report: Report<'_>,
) -> Result<PingReading, String> {
    if is_water_track(value) {
        return Ok(PingReading::none(RangeFact::WaterTrack));
    }
    // Ranges at a path of the rig file are in metres already.
    let unit_m = facts.unit_m.filter(|_| facts.path.is_none()).unwrap_or(1.0);
    let scale = facts.sound_speed_ratio.unwrap_or(1.0) * unit_m;
    if report.ranges.is_empty() {
        return Ok(PingReading {
            note: Some(RangeFact::NoBeams),
            ..PingReading::of_altitude(value, altitude(value).map(|a| a * scale))
        });
    }
    let (directions, note) = resolve(report.directions, report.ranges.len(), facts)?;
    let axis: Vector3<f64> =
        directions.iter().map(|d| d.vector()).sum::<Vector3<f64>>().normalize();
    let kind = facts.ranges.unwrap_or(report.kind);
    let is_good = |range: f64| {
        let is_marker = facts.bad_values.as_ref().is_some_and(|bad| bad.contains(&range));
        range.is_finite() && range > 0.0 && is_within_limits(range * unit_m, facts) && !is_marker
    };
    let ranges: Vec<Option<f64>> =
        report.ranges.iter().map(|r| r.filter(|r| is_good(*r))).collect();
    let beams = directions.iter().zip(&ranges).map(|(direction, range)| {
        let cosine = if kind == RangeKind::Vertical { direction.vector().dot(&axis) } else { 1.0 };
        Beam { direction: *direction, range: range.map(|r| SlantRange(r / cosine * scale)) }
    });
    let mut reading = PingReading::of_beams(value, beams.collect());
    if let Some(ping) = &mut reading.ping {
        ping.velocity_m_per_s = velocity(value);
    }
    let mean_cosine = directions.iter().map(|d| d.vector().dot(&axis)).sum::<f64>()
        / directions.len().max(1) as f64;
    let all: Option<Vec<f64>> = ranges.into_iter().collect();
    let altitude_check =
        all.filter(|r| r.len() >= 3).zip(altitude(value)).map(|(ranges, altitude)| AltitudeCheck {
            ratio: altitude * ranges.len() as f64 / ranges.iter().sum::<f64>(),
            cosine: mean_cosine,
            kind,
        });
    Ok(PingReading { note, altitude_check, ..reading })
}

/// The beams named in the rig file.
///
/// # Errors
/// The instrument is unknown, or only one of angle and azimuths is given.
pub fn array(facts: &DvlFacts) -> Result<Option<JanusArray>, String> {
    if let Some(name) = &facts.beams {
        let known = || JanusArray::KNOWN.iter().map(|k| k.0).collect::<Vec<_>>().join(", ");
        return JanusArray::named(name)
            .map(Some)
            .ok_or_else(|| format!("rig file: dvl.beams = {name:?} is not one of {}", known()));
    }
    match (facts.janus_angle_deg, &facts.azimuths_deg) {
        (Some(janus_angle_deg), Some(azimuths)) => {
            Ok(Some(JanusArray { janus_angle_deg, azimuths_deg: azimuths.clone() }))
        }
        (None, None) => Ok(None),
        _ => Err("rig file: dvl.janus_angle_deg and dvl.azimuths_deg belong together".into()),
    }
}

/// One direction per beam. One beam more than the array has azimuths points along the axis, as the
/// fifth beam of every five-beam instrument does.
fn directions_of(array: &JanusArray, beams: usize) -> Result<Vec<Direction<Dvl>>, String> {
    let mut directions = array.directions();
    if beams == directions.len() + 1 {
        directions.push(Direction::boresight());
    }
    if directions.len() != beams {
        return Err(format!(
            "the message has {beams} beams, the instrument {}; name its beams in rig.toml: [dvl] \
             janus_angle_deg, azimuths_deg",
            directions.len()
        ));
    }
    Ok(directions)
}

/// Beam directions: of the rig file, else of the message if sane, else of the assumed instrument.
fn resolve(in_message: Directions<'_>, beams: usize, facts: &DvlFacts) -> Result<Resolved, String> {
    if let Directions::Exact(directions) = in_message {
        return Ok((directions, None));
    }
    if let Some(array) = array(facts)? {
        return Ok((directions_of(&array, beams)?, None));
    }
    let known =
        |name: &str| JanusArray::named(name).ok_or_else(|| format!("unknown instrument {name}"));
    let (array, note) = match in_message {
        Directions::Exact(directions) => return Ok((directions, None)),
        Directions::Vectors(vectors) => return checked(&vectors),
        Directions::Assumed(name) => {
            let array = known(name)?;
            let (instrument, janus_angle_deg) = (name.into(), array.janus_angle_deg);
            (array, RangeFact::DirectionsAssumed { instrument, janus_angle_deg })
        }
        Directions::Angle(janus_angle_deg, name) => (
            JanusArray { janus_angle_deg, ..known(name)? },
            RangeFact::AzimuthsAssumed { instrument: name.into(), janus_angle_deg },
        ),
        Directions::Unknown => {
            return Err("the message has no beam directions; name the instrument in rig.toml: \
                        [dvl] beams = \"waterlinked-a50\""
                .into());
        }
    };
    Ok((directions_of(&array, beams)?, Some(note)))
}

/// Directions of sane beam vectors. Swapped sine and cosine are repaired.
fn checked(vectors: &[Vector3<f64>]) -> Result<Resolved, String> {
    let off_axis_deg =
        |v: &Vector3<f64>| (v.z.abs() / v.norm()).clamp(0.0, 1.0).acos().to_degrees();
    let unit = vectors.len() >= 3 && vectors.iter().all(|v| (v.norm() - 1.0).abs() < 0.02);
    let one_side = vectors.iter().all(|v| v.z > 0.0) || vectors.iter().all(|v| v.z < 0.0);
    if unit && one_side && are_evenly_spaced(vectors) {
        if vectors.iter().all(|v| SANE_JANUS_DEG.contains(&off_axis_deg(v))) {
            return Ok((vectors.iter().filter_map(|v| Direction::from_vector(*v)).collect(), None));
        }
        if vectors.iter().all(|v| SANE_JANUS_DEG.contains(&(90.0 - off_axis_deg(v)))) {
            let azimuths_deg = vectors.iter().map(|v| v.y.atan2(v.x).to_degrees()).collect();
            let janus_angle_deg =
                90.0 - vectors.iter().map(off_axis_deg).sum::<f64>() / vectors.len() as f64;
            let note = RangeFact::VectorsSwapped { janus_angle_deg };
            return Ok((JanusArray { janus_angle_deg, azimuths_deg }.directions(), Some(note)));
        }
    }
    Err("the beam vectors are not usable (zero, not of unit length, not 12 to 35° off the axis, \
         or not evenly spaced around it); name the instrument in rig.toml: [dvl] beams = \
         \"waterlinked-a50\""
        .into())
}

/// Whether the azimuths about z are evenly spaced.
fn are_evenly_spaced(vectors: &[Vector3<f64>]) -> bool {
    let mut azimuths: Vec<f64> = vectors.iter().map(|v| v.y.atan2(v.x).to_degrees()).collect();
    azimuths.sort_by(f64::total_cmp);
    let even = 360.0 / vectors.len() as f64;
    let next = azimuths.iter().skip(1).copied().chain(azimuths.first().map(|a| a + 360.0));
    azimuths.iter().zip(next).all(|(a, b)| (b - a - even).abs() <= MAX_UNEVENNESS_DEG)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn swapped_vectors_are_repaired_and_invalid_ones_rejected() {
        let corners = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)];
        let swapped: Vec<_> =
            corners.iter().map(|(x, y)| Vector3::new(0.6533 * x, 0.6533 * y, 0.3827)).collect();
        let (directions, note) = checked(&swapped).expect("repaired");
        assert!(
            (directions[0].vector() - Vector3::new(0.2706, 0.2706, 0.9239)).norm() < 1e-3
                && note.is_some_and(|n| n.code() == "beam-vectors-swapped")
        );
        assert!(checked(&[Vector3::zeros(); 4]).is_err());
        assert!(checked(&[Vector3::new(0.2706, 0.2706, 0.9239); 4]).is_err(), "four equal beams");
    }

    #[test]
    fn the_fifth_beam_points_along_the_axis() {
        let array = JanusArray::named("nortek-25").expect("known instrument");
        assert_eq!(
            directions_of(&array, 5).expect("five beams").last(),
            Some(&Direction::boresight())
        );
        assert!(directions_of(&array, 3).is_err() && directions_of(&array, 6).is_err());
    }
}
