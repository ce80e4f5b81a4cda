//! `marine_acoustic_msgs/Dvl` and its family: `range[4]` along `beam_unit_vec[4]`, slant.
//!
//! Definition: apl-ocean-engineering/marine_msgs. There is no flag per beam: 0, negative, NaN and infinite mean
//! lost. The vectors are checked before they are believed: two public drivers write sine and cosine swapped
//! (67.5° off the axis for a 22.5° instrument), a bridge leaves them zero, WHOI's point along −z (z up).

use nalgebra::Vector3;

use super::{PingReading, Value, heading, layout::Layout, missing};
use crate::spaces::{Direction, Dvl};
use crate::units::{SlantRange, Stamp};
use crate::vehicle::{Beam, DvlFacts, JanusArray, Ping};

/// `velocity_mode` of a report over water instead of bottom.
const DVL_MODE_WATER: i64 = 2;
/// Beams of any instrument known lie this far off the axis [deg].
const SANE_JANUS_DEG: std::ops::RangeInclusive<f64> = 12.0..=35.0;

pub fn matches(layout: &Layout, _topic: &str) -> bool {
    layout.has("range") && layout.has("beam_unit_vec.x")
}

pub fn decode(value: &Value<'_>, facts: &DvlFacts) -> Result<PingReading, String> {
    if value.integer("velocity_mode") == Some(DVL_MODE_WATER) {
        return Ok(PingReading { ping: None, remark: Some("water-track reports are left out".into()) });
    }
    let ranges = value.numbers("range").ok_or_else(|| missing("range"))?;
    let vectors = value.list("beam_unit_vec").unwrap_or(&[]);
    let vectors: Vec<_> = vectors.iter().filter_map(|v| Some(Vector3::new(v.number("x")?, v.number("y")?, v.number("z")?))).collect();
    let (directions, remark) = directions(&vectors, facts)?;
    let usable = value.flag("beam_ranges_valid").unwrap_or(true);
    let scale = facts.sound_speed_ratio.unwrap_or(1.0);
    let beams: Vec<Beam> = directions
        .into_iter()
        .zip(&ranges)
        .map(|(direction, range)| Beam { direction, range: (usable && range.is_finite() && *range > 0.0).then_some(SlantRange(range * scale)) })
        .collect();
    let ping = Ping { stamp: heading(value).stamp.unwrap_or(Stamp(0)), beams, altitude: None };
    Ok(PingReading { ping: Some(ping), remark })
}

/// The beams' directions: the rig file's, else the message's if they are sane, else mended where the fault is known.
fn directions(vectors: &[Vector3<f64>], facts: &DvlFacts) -> Result<(Vec<Direction<Dvl>>, Option<String>), String> {
    if let Some(array) = super::dvl_beams::array(facts)? {
        return Ok((array.directions(), None));
    }
    let off_axis_deg = |v: &Vector3<f64>| (v.z.abs() / v.norm()).clamp(0.0, 1.0).acos().to_degrees();
    let unit = vectors.len() >= 3 && vectors.iter().all(|v| (v.norm() - 1.0).abs() < 0.02);
    let one_side = vectors.iter().all(|v| v.z > 0.0) || vectors.iter().all(|v| v.z < 0.0);
    if unit && one_side && vectors.iter().all(|v| SANE_JANUS_DEG.contains(&off_axis_deg(v))) {
        return Ok((vectors.iter().filter_map(|v| Direction::from_vector(*v)).collect(), None));
    }
    if unit && one_side && vectors.iter().all(|v| SANE_JANUS_DEG.contains(&(90.0 - off_axis_deg(v)))) {
        let azimuths_deg = vectors.iter().map(|v| v.y.atan2(v.x).to_degrees()).collect();
        let janus_angle_deg = 90.0 - vectors.iter().map(off_axis_deg).sum::<f64>() / vectors.len() as f64;
        let remark =
            format!("beam_unit_vec has sine and cosine swapped ({:.1}° off the axis); taken as {janus_angle_deg:.1}°", 90.0 - janus_angle_deg);
        return Ok((JanusArray { janus_angle_deg, azimuths_deg }.directions(), Some(remark)));
    }
    Err("beam_unit_vec is not usable (zero, not of unit length, or not 12 to 35° off the axis); name the instrument in rig.toml: [dvl] beams = \"waterlinked-a50\"".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn swapped_vectors_are_mended_and_zero_ones_refused() {
        let swapped: Vec<_> =
            [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)].iter().map(|(x, y)| Vector3::new(0.6533 * x, 0.6533 * y, 0.3827)).collect();
        let (directions, remark) = directions(&swapped, &DvlFacts::default()).expect("mended");
        assert!((directions[0].vector() - Vector3::new(0.2706, 0.2706, 0.9239)).norm() < 1e-3 && remark.is_some());
        assert!(super::directions(&[Vector3::zeros(); 4], &DvlFacts::default()).is_err());
    }
}
