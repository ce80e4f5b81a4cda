//! The readings that decoders return, and the fields they share.

use nalgebra::{Isometry3, Quaternion, UnitQuaternion, Vector3};

use super::header::header;
use super::value::Value;
use crate::diagnostics::RangeFact;
use crate::units::{Altitude, Stamp};
use crate::vehicle::{Beam, Ping, RangeKind};

/// One report of a range instrument.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PingReading {
    /// `None` where the message has no range to the seafloor (a water-track report)
    pub ping: Option<Ping>,
    /// a repaired or assumed property of the message; reported once per channel
    pub note: Option<RangeFact>,
    /// the message's own altitude compared with its ranges
    pub altitude_check: Option<AltitudeCheck>,
    /// samples of a depth image; they become beams once the camera is calibrated
    pub depth: Option<DepthSamples>,
}

impl PingReading {
    /// A ping at the message's stamp.
    pub(super) fn of_beams(value: &Value<'_>, beams: Vec<Beam>) -> Self {
        let stamp = stamp(value);
        let ping = Ping { stamp, beams, altitude: None, velocity_m_per_s: None };
        Self { ping: Some(ping), ..Self::default() }
    }

    /// A ping without beams; `altitude_m` is `None` where there is no return.
    pub(super) fn of_altitude(value: &Value<'_>, altitude_m: Option<f64>) -> Self {
        let (stamp, altitude) = (stamp(value), altitude_m.map(Altitude));
        let ping = Ping { stamp, beams: Vec::new(), altitude, velocity_m_per_s: None };
        Self { ping: Some(ping), ..Self::default() }
    }

    /// A message without any range to the seafloor.
    pub(super) fn none(reason: RangeFact) -> Self {
        Self { note: Some(reason), ..Self::default() }
    }
}

/// Samples of a depth image.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DepthSamples {
    /// of the image (px)
    pub width: usize,
    /// of the image (px)
    pub height: usize,
    /// column (px), row (px), depth along the optical axis (m)
    pub samples: Vec<[f64; 3]>,
}

/// Evidence whether a message's ranges are slant or vertical.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AltitudeCheck {
    /// the message's altitude over the mean of its ranges, all beams valid: about `cosine` for
    /// slant ranges, 1 for vertical ones
    pub ratio: f64,
    /// mean cosine of the angles between beams and instrument axis
    pub cosine: f64,
    /// the interpretation that was used
    pub kind: RangeKind,
}

/// One edge of the TF tree.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameTransform {
    /// `None` where it has no stamp or one of 0
    pub stamp: Option<Stamp>,
    /// frame id
    pub parent: String,
    /// frame id
    pub child: String,
    /// parent_from_child; `None` where the rotation is no unit quaternion
    pub pose: Option<Isometry3<f64>>,
}

/// `exposure`, `gain` or `strobe`, or `value` for a message of one number; and the value in the
/// sender's unit.
pub type RadiometrySetting = (&'static str, f64);

/// Stamp of a message; 0 where it has none.
pub(super) fn stamp(value: &Value<'_>) -> Stamp {
    header(value).stamp.unwrap_or(Stamp(0))
}

pub(super) fn missing(field: &str) -> String {
    format!("the message has no field {field}")
}

/// A size or count that must be there.
pub(super) fn size(value: &Value<'_>, field: &str) -> Result<usize, String> {
    value.size(field).ok_or_else(|| missing(field))
}

/// The rotation of a quaternion at a path. `None` where it is all zero or not finite: drivers write
/// that for "no attitude".
///
/// # Errors
/// The field is missing.
pub(super) fn rotation(
    value: &Value<'_>,
    path: &str,
) -> Result<Option<UnitQuaternion<f64>>, String> {
    let [x, y, z, w] = value.xyzw(path).ok_or_else(|| missing(path))?;
    let q = Quaternion::new(w, x, y, z);
    Ok((q.norm().is_finite() && q.norm() > 0.5).then(|| UnitQuaternion::from_quaternion(q)))
}

/// The pose of a transform message; `None` where the rotation is no unit quaternion, or the
/// translation not finite.
///
/// # Errors
/// A field is missing.
pub(super) fn pose(
    value: &Value<'_>,
    translation: &str,
    rotation: &str,
) -> Result<Option<Isometry3<f64>>, String> {
    let t = value.xyz(translation).ok_or_else(|| missing(translation))?;
    let q = self::rotation(value, rotation)?.filter(|_| t.iter().all(|v| v.is_finite()));
    Ok(q.map(|q| Isometry3::from_parts(Vector3::from(t).into(), q)))
}
