//! What all DVL messages have in common: which beams there are, when a range is none, slant or
//! vertical.
//!
//! A file per shape says where its numbers are ([`Report`]); here they become a ping. The rig file
//! wins over the message, the message's own directions over a known instrument's. Nothing is
//! switched silently: what is assumed becomes a warning, and the message's own altitude is held
//! against its ranges for the survey to judge.

use nalgebra::Vector3;

use super::{AltitudeCheck, PingReading, Value, header};
use crate::coordinates::{Direction, Dvl};
use crate::units::{Altitude, SlantRange, Stamp};
use crate::vehicle::{Beam, DvlFacts, JanusArray, Ping, RangeKind};

/// Beams of any instrument known lie this far off the axis [deg].
pub const SANE_JANUS_DEG: std::ops::RangeInclusive<f64> = 12.0..=35.0;
/// Neighbours around the axis are this far from evenly spaced at most [deg].
const UNEVEN_DEG: f64 = 30.0;
/// What Nortek writes for a velocity it does not have [m/s].
pub const NORTEK_BAD_VELOCITY: f64 = -32.768;
/// What Nortek writes for the figure of merit of a beam that is bad [m/s].
pub const NORTEK_BAD_FOM: f64 = 10.0;

/// What the message says of its beams' directions.
pub enum Directions<'r> {
    /// vectors in the message
    Vectors(Vec<Vector3<f64>>),
    /// directions that are right by construction: hits as points
    Exact(Vec<Direction<Dvl>>),
    /// nothing; this instrument is assumed
    Assumed(&'r str),
    /// nothing, but the angle off the axis [deg], with this instrument's azimuths
    Angle(f64, &'r str),
    /// nothing at all
    Unknown,
}

/// A message's ranges, freed of its own flags and markers.
pub struct Report<'r> {
    /// one per beam [m]; `None` where the message says it is lost
    pub ranges: Vec<Option<f64>>,
    /// what a range is, by the type of message
    pub kind: RangeKind,
    /// where the beams look
    pub directions: Directions<'r>,
}

/// Reports over water have ranges to a layer of it, not to the seafloor.
pub fn is_water_track(value: &Value<'_>) -> bool {
    let says_water =
        |path: &str| value.text(path).is_some_and(|t| t.to_ascii_lowercase().contains("water"));
    value.integer("velocity_mode") == Some(2)
        || value.integer("velocity_reference") == Some(1)
        || value.integer("target.type") == Some(2)
        || ["type", "target.type", "velocity_mode"].iter().any(|p| says_water(p))
        || ["is_water_tracking", "dvl_velocity.is_water_tracking"]
            .iter()
            .any(|p| value.flag(p) == Some(true))
}

/// A report that holds no bottom range at all.
pub fn nothing(why: &str) -> PingReading {
    PingReading { warning: Some(why.into()), ..PingReading::default() }
}

/// The altitude a DVL message gives beside its beams.
fn altitude(value: &Value<'_>) -> Option<f64> {
    ["altitude", "avg_altitude", "report.altitude", "target.range.mean"]
        .iter()
        .find_map(|p| value.number(p))
        .filter(|a| a.is_finite() && *a > 0.0)
}

/// Faster over the ground is a marker of "none" [m/s].
const FASTEST_M_PER_S: f64 = 10.0;

/// The velocity over the ground that a DVL message gives beside its beams.
fn velocity(value: &Value<'_>) -> Option<Vector3<f64>> {
    let is_said_bad =
        ["velocity_valid", "valid", "bottom_lock"].iter().any(|p| value.flag(p) == Some(false));
    let [x, y, z] = value.xyz("velocity").or_else(|| value.xyz("velocity.twist.linear"))?;
    let v = Vector3::new(x, y, z);
    (!is_said_bad
        && v.iter().all(|c| c.is_finite() && *c != NORTEK_BAD_VELOCITY)
        && v.norm() < FASTEST_M_PER_S)
        .then_some(v)
}

/// Geometry, units and the rig file's rules.
pub fn ping(
    value: &Value<'_>,
    facts: &DvlFacts,
    report: Report<'_>,
) -> Result<PingReading, String> {
    if is_water_track(value) {
        return Ok(nothing("water-track reports are left out"));
    }
    let stamp = header(value).stamp.unwrap_or(Stamp(0));
    let scale = facts.sound_speed_ratio.unwrap_or(1.0);
    if report.ranges.is_empty() {
        let altitude = altitude(value).map(|a| Altitude(a * scale));
        let warning = Some("the message lists no beams; its altitude is used".into());
        return Ok(PingReading {
            ping: Some(Ping { stamp, beams: Vec::new(), altitude, velocity_m_per_s: None }),
            warning,
            ..PingReading::default()
        });
    }
    let (directions, warning) = directions(report.directions, report.ranges.len(), facts)?;
    let axis: Vector3<f64> =
        directions.iter().map(|d| d.vector()).sum::<Vector3<f64>>().normalize();
    let kind = facts.ranges.unwrap_or(report.kind);
    let good = |range: f64| {
        let inside = range > facts.min_range_m.unwrap_or(0.0)
            && facts.max_range_m.is_none_or(|most| range < most);
        let marker = facts.bad_values.as_ref().is_some_and(|bad| bad.contains(&range));
        range.is_finite() && range > 0.0 && inside && !marker
    };
    let sent: Vec<Option<f64>> = report.ranges.iter().map(|r| r.filter(|r| good(*r))).collect();
    let beams = directions.iter().zip(&sent).map(|(direction, range)| {
        let cosine = if kind == RangeKind::Vertical { direction.vector().dot(&axis) } else { 1.0 };
        Beam { direction: *direction, range: range.map(|r| SlantRange(r / cosine * scale)) }
    });
    let beams: Vec<Beam> = beams.collect();
    let all: Option<Vec<f64>> = sent.iter().copied().collect();
    let mean_cosine = directions.iter().map(|d| d.vector().dot(&axis)).sum::<f64>()
        / directions.len().max(1) as f64;
    let height =
        all.filter(|r| r.len() >= 3).zip(altitude(value)).map(|(ranges, altitude)| AltitudeCheck {
            ratio: altitude * ranges.len() as f64 / ranges.iter().sum::<f64>(),
            cosine: mean_cosine,
            kind,
        });
    Ok(PingReading {
        ping: Some(Ping { stamp, beams, altitude: None, velocity_m_per_s: velocity(value) }),
        warning,
        altitude_check: height,
        depth: None,
    })
}

/// The beams the rig file names, if it does.
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

/// As many directions as there are beams; one beam more than an array has azimuths looks along the
/// axis, as the fifth of every five-beam instrument does.
fn spread(array: &JanusArray, beams: usize) -> Result<Vec<Direction<Dvl>>, String> {
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

/// Where the beams look: the rig file's word, else the message's if it is sane, else what is known
/// of the shape.
fn directions(
    said: Directions<'_>,
    beams: usize,
    facts: &DvlFacts,
) -> Result<(Vec<Direction<Dvl>>, Option<String>), String> {
    if let Directions::Exact(directions) = said {
        return Ok((directions, None));
    }
    if let Some(array) = array(facts)? {
        return Ok((spread(&array, beams)?, None));
    }
    let named =
        |name: &str| JanusArray::named(name).ok_or_else(|| format!("{name} is no instrument"));
    match said {
        Directions::Exact(directions) => Ok((directions, None)),
        Directions::Vectors(vectors) => sane(&vectors),
        Directions::Assumed(name) => {
            let array = named(name)?;
            let warning = format!(
                "the message has no beam directions; taken as {name} ({}°)",
                array.janus_angle_deg
            );
            Ok((spread(&array, beams)?, Some(warning)))
        }
        Directions::Angle(janus_angle_deg, name) => {
            let array = JanusArray { janus_angle_deg, ..named(name)? };
            let warning = format!(
                "the message gives the beams' angle ({janus_angle_deg}°) and not their azimuths; \
                 those of {name} are taken"
            );
            Ok((spread(&array, beams)?, Some(warning)))
        }
        Directions::Unknown => Err("the message has no beam directions; name the instrument in \
                                    rig.toml: [dvl] beams = \"waterlinked-a50\""
            .into()),
    }
}

/// Vectors that are believed, or mended where the fault is known.
fn sane(vectors: &[Vector3<f64>]) -> Result<(Vec<Direction<Dvl>>, Option<String>), String> {
    let off_axis_deg =
        |v: &Vector3<f64>| (v.z.abs() / v.norm()).clamp(0.0, 1.0).acos().to_degrees();
    let unit = vectors.len() >= 3 && vectors.iter().all(|v| (v.norm() - 1.0).abs() < 0.02);
    let one_side = vectors.iter().all(|v| v.z > 0.0) || vectors.iter().all(|v| v.z < 0.0);
    if unit && one_side && evenly_spread(vectors) {
        if vectors.iter().all(|v| SANE_JANUS_DEG.contains(&off_axis_deg(v))) {
            return Ok((vectors.iter().filter_map(|v| Direction::from_vector(*v)).collect(), None));
        }
        if vectors.iter().all(|v| SANE_JANUS_DEG.contains(&(90.0 - off_axis_deg(v)))) {
            let azimuths_deg = vectors.iter().map(|v| v.y.atan2(v.x).to_degrees()).collect();
            let janus_angle_deg =
                90.0 - vectors.iter().map(off_axis_deg).sum::<f64>() / vectors.len() as f64;
            let warning = format!(
                "beam_unit_vec has sine and cosine swapped ({:.1}° off the axis); taken as \
                 {janus_angle_deg:.1}°",
                90.0 - janus_angle_deg
            );
            return Ok((JanusArray { janus_angle_deg, azimuths_deg }.directions(), Some(warning)));
        }
    }
    Err("the beam vectors are not usable (zero, not of unit length, not 12 to 35° off the axis, \
         or not spread around it); name the instrument in rig.toml: [dvl] beams = \
         \"waterlinked-a50\""
        .into())
}

/// Whether the azimuths about z are about evenly spaced.
fn evenly_spread(vectors: &[Vector3<f64>]) -> bool {
    let mut azimuths: Vec<f64> = vectors.iter().map(|v| v.y.atan2(v.x).to_degrees()).collect();
    azimuths.sort_by(f64::total_cmp);
    let even = 360.0 / vectors.len() as f64;
    let next = azimuths.iter().skip(1).copied().chain(azimuths.first().map(|a| a + 360.0));
    azimuths.iter().zip(next).all(|(a, b)| (b - a - even).abs() <= UNEVEN_DEG)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn swapped_vectors_are_mended_and_senseless_ones_refused() {
        let corners = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)];
        let swapped: Vec<_> =
            corners.iter().map(|(x, y)| Vector3::new(0.6533 * x, 0.6533 * y, 0.3827)).collect();
        let (directions, warning) = sane(&swapped).expect("mended");
        assert!(
            (directions[0].vector() - Vector3::new(0.2706, 0.2706, 0.9239)).norm() < 1e-3
                && warning.is_some()
        );
        assert!(sane(&[Vector3::zeros(); 4]).is_err());
        assert!(
            sane(&[Vector3::new(0.2706, 0.2706, 0.9239); 4]).is_err(),
            "four times the same beam"
        );
    }

    #[test]
    fn a_fifth_beam_looks_along_the_axis() {
        let array = JanusArray::named("nortek-25").expect("known");
        assert_eq!(spread(&array, 5).expect("five").last(), Some(&Direction::boresight()));
        assert!(spread(&array, 3).is_err() && spread(&array, 6).is_err());
    }
}
