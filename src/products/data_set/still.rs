//! A still: one corrected image as a file, and what is known of it.

use std::collections::BTreeSet;
use std::time::{Duration, UNIX_EPOCH};

use nalgebra::{Isometry3, Matrix3};

use super::super::dive::{CorrectedLog, FrameRecord};
use super::super::places::Fix;
use crate::image::exif::ExifFacts;
use crate::image::{EncodedImage, ImageShape, encode};
use crate::messages::Kind;
use crate::recording::Message;
use crate::session::sha256;
use crate::units::Stamp;

/// A still and what is known of it.
pub struct Still<'l> {
    /// file name
    pub name: String,
    /// the result for its frame
    pub record: &'l FrameRecord,
    /// of that result
    pub index: usize,
    /// latitude and longitude
    pub fix: Option<Fix>,
    /// of the vehicle below the sea surface (m)
    pub depth_m: Option<f64>,
    /// of the camera (s)
    pub exposure_s: Option<f64>,
    /// world_from_optical, where the log has a trajectory; x east, y north, z up
    pub pose: Option<Isometry3<f64>>,
    /// fingerprint of the file
    pub hash: String,
    /// stable identity
    pub uuid: String,
}

impl Still<'_> {
    /// What its EXIF says.
    pub fn exif(&self) -> ExifFacts {
        let altitude_m = self.record.altitude_m;
        ExifFacts {
            taken_at: utc(self.record.stamp).replace('-', ":") + "+00:00",
            position_deg: self.fix.map(|fix| [fix.latitude, fix.longitude]),
            depth_m: self.depth_m,
            heading_deg: self.yaw_pitch_roll_deg().map(|[yaw, ..]| yaw),
            distance_m: altitude_m.is_finite().then_some(altitude_m),
            exposure_s: self.exposure_s,
            id: self.uuid.replace('-', ""),
        }
    }

    /// Yaw, pitch and roll of the image (deg): zero for a camera that looks down with the top of
    /// its image to the north; rotations about down, then the image's right, then its top.
    pub fn yaw_pitch_roll_deg(&self) -> Option<[f64; 3]> {
        // From (top, right, line of sight) to the optical axes, and from the world to north, east,
        // down.
        let optical_from_image = Matrix3::new(0.0, 1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
        let ned_from_world = Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0);
        let rotation = self.pose?.rotation.to_rotation_matrix();
        let m = ned_from_world * rotation.matrix() * optical_from_image;
        let yaw = m[(1, 0)].atan2(m[(0, 0)]);
        let pitch = (-m[(2, 0)]).clamp(-1.0, 1.0).asin();
        let roll = m[(2, 1)].atan2(m[(2, 2)]);
        Some([yaw, pitch, roll].map(f64::to_degrees))
    }
}

/// `2026-05-01 10:00:00.123`, as iFDO writes moments.
pub fn utc(stamp: Stamp) -> String {
    let at = UNIX_EPOCH + Duration::from_nanos(u64::try_from(stamp.0).unwrap_or(0));
    humantime::format_rfc3339_millis(at).to_string().replace('T', " ").trim_end_matches('Z').into()
}

/// The same input gives the same name for a thing: the shape of a UUID of version 4, which archives
/// expect, from a fingerprint.
pub fn uuid(of: &str) -> String {
    let mut hex: Vec<char> = sha256(of.as_bytes()).chars().take(32).collect();
    (hex[12], hex[16]) = ('4', 'a');
    [0..8, 8..12, 12..16, 16..20, 20..32].map(|part| hex[part].iter().collect::<String>()).join("-")
}

/// To the millimetre.
pub fn millimetres(metres: f64) -> f64 {
    (metres * 1000.0).round() / 1000.0
}

/// An unused file name for a frame.
pub fn file_name(
    sensor: &str,
    record: &FrameRecord,
    ending: &str,
    names: &mut BTreeSet<String>,
) -> String {
    let taken = utc(record.stamp).replace(['-', ':'], "").replace(' ', "_");
    // Two in one millisecond are distinguished by their nanoseconds, two of one stamp by a number.
    let plain = format!("{sensor}_{taken}.{ending}");
    let precise = format!("{sensor}_{taken}_{}.{ending}", record.stamp.0);
    let numbered = |n: usize| format!("{sensor}_{taken}_{}_{n}.{ending}", record.stamp.0);
    let mut candidates = [plain, precise].into_iter().chain((2..).map(numbered));
    candidates.find(|name| names.insert(name.clone())).unwrap_or_default()
}

/// An image as a file, and the ending of its name.
///
/// # Errors
/// Why it is none.
pub fn file_of(log: &CorrectedLog, message: &Message) -> Result<(Vec<u8>, &'static str), String> {
    let decoder =
        log.scanned.index.decoders.get(&message.channel).ok_or("its type is not known")?;
    let value = decoder.read(message.data())?;
    let Kind::Image(read) = decoder.message_type.kind else {
        return Err("its channel holds no images".into());
    };
    match read(&value)? {
        EncodedImage::Compressed { data, .. } if data.starts_with(b"\xff\xd8") => {
            Ok((data.to_vec(), "jpg"))
        }
        EncodedImage::Compressed { data, .. } if data.starts_with(b"\x89PNG") => {
            Ok((data.to_vec(), "png"))
        }
        EncodedImage::Raw { width, height, encoding, big_endian, step, data } => {
            let (bands, bits) = match encoding {
                "mono8" => (1, 8),
                "rgb8" => (3, 8),
                "mono16" => (1, 16),
                "rgb16" => (3, 16),
                other => {
                    return Err(format!("images of encoding {other} are not written as files"));
                }
            };
            let row = width * bands * usize::from(bits) / 8;
            let rows = data
                .chunks(step.max(1))
                .take(height)
                .map(|r| r.get(..row).ok_or("it is shorter than its header states"));
            let mut samples = rows.collect::<Result<Vec<_>, _>>()?.concat();
            if bits == 16 && big_endian != cfg!(target_endian = "big") {
                samples.chunks_exact_mut(2).for_each(|pair| pair.swap(0, 1));
            }
            Ok((encode::png(&samples, ImageShape { width, height, bands }, bits)?, "png"))
        }
        _ => Err("it is neither JPEG, PNG nor pixels".into()),
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Rotation3, UnitQuaternion, Vector3};

    use super::*;

    #[test]
    fn angles_of_the_image_are_zero_looking_down_with_the_top_to_the_north() {
        let record = FrameRecord {
            log_time: 0,
            stamp: Stamp(0),
            corrected: true,
            reason: String::new(),
            altitude_m: 1.0,
            seafloor: None,
        };
        let angles = |right: Vector3<f64>, down: Vector3<f64>| {
            let axes = Matrix3::from_columns(&[right, down, right.cross(&down)]);
            let rotation =
                UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
            let still = Still {
                name: String::new(),
                record: &record,
                index: 0,
                fix: None,
                depth_m: None,
                exposure_s: None,
                pose: Some(Isometry3::from_parts(Vector3::zeros().into(), rotation)),
                hash: String::new(),
                uuid: String::new(),
            };
            still.yaw_pitch_roll_deg().expect("a pose").map(f64::round)
        };
        let (east, north, up) = (Vector3::x(), Vector3::y(), Vector3::z());
        assert_eq!(angles(east, -north).map(f64::abs), [0.0, 0.0, 0.0]);
        // The top to the east: a quarter turn to the right.
        assert_eq!(angles(-north, -east).map(|a| a + 0.0), [90.0, 0.0, 0.0]);
        // Looking north with the top up: pitched up by a quarter turn.
        assert_eq!(angles(east, -up)[1], 90.0);
    }

    #[test]
    fn identities_have_the_shape_of_version_4() {
        let id = uuid("a");
        assert_eq!((id.len(), &id[14..15], &id[19..20]), (36, "4", "a"));
        assert_eq!(id, uuid("a"));
        assert_ne!(id, uuid("b"));
    }
}
