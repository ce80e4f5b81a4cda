//! Positions of the vehicle from all sources of a log, seen from above.
//!
//! Odometry is preferred, as it is smooth; then the DVL's velocity, rotated by the attitude and
//! integrated; then fixes (latitude and longitude), which jump. Whether the world's z points up or
//! down follows from the seafloor, which is below.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use super::messages::messages_of;
use crate::error::Result;
use crate::geometry::SeafloorPlane;
use crate::messages::value::Value;
use crate::messages::{Decoder, header};
use crate::recording::{Channel, Recording, Window};
use crate::session::CameraSession;
use crate::units::Stamp;

/// Positions farther apart in time are not joined (s).
const LONGEST_GAP_S: f64 = 3.0;
/// Metres of a degree of latitude.
pub const M_PER_DEG: f64 = 111_195.0;

/// A pose: the body in some world.
#[derive(Clone, Copy, Debug)]
pub struct Pose {
    stamp: Stamp,
    world_from_body: Isometry3<f64>,
    has_rotation: bool,
}

/// A fix: where on Earth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fix {
    /// when
    pub stamp: Stamp,
    /// (deg)
    pub latitude: f64,
    /// (deg)
    pub longitude: f64,
}

/// All positions in a log, by topic.
#[derive(Default)]
pub struct Places {
    /// odometry and poses
    pub poses: BTreeMap<String, Vec<Pose>>,
    /// fixes
    pub fixes: BTreeMap<String, Vec<Fix>>,
    /// depths below the sea surface (m)
    depths: BTreeMap<String, Vec<(Stamp, f64)>>,
}

impl Places {
    /// Reads positions and poses.
    ///
    /// # Errors
    /// The log cannot be read.
    pub fn read(recording: &Recording, window: Window) -> Result<Self> {
        let decoder = |channel: &Channel| {
            let schema = recording.schemas.get(&channel.schema_id)?;
            let is_depth = is_depth_topic(&channel.topic) && !may_hold_images(&schema.data);
            let may_hold = may_hold_places(&schema.data) || is_depth;
            if !may_hold || channel.topic.starts_with("/unwater") {
                return None;
            }
            Decoder::by_path(
                &channel.message_encoding,
                &schema.name,
                &schema.encoding,
                &schema.data,
            )
            .ok()
        };
        let decoders: BTreeMap<u16, Decoder> =
            recording.channels.iter().filter_map(|(id, c)| Some((*id, decoder(c)?))).collect();
        let wanted: BTreeSet<u16> = decoders.keys().copied().collect();
        let mut places = Self::default();
        for message in messages_of(recording, &wanted, window) {
            let message = message?;
            let (Some(channel), Some(decoder)) =
                (recording.channels.get(&message.channel), decoders.get(&message.channel))
            else {
                continue;
            };
            let Ok(value) = decoder.read(message.data()) else { continue };
            let stamp = header(&value).stamp.unwrap_or(message.log_stamp());
            if let Some(fix) = fix(&value, stamp) {
                places.fixes.entry(channel.topic.clone()).or_default().push(fix);
            } else if let Some(pose) = pose(&value, stamp) {
                places.poses.entry(channel.topic.clone()).or_default().push(pose);
            } else if let Some(depth_m) = depth_m(&value, is_depth_topic(&channel.topic)) {
                places.depths.entry(channel.topic.clone()).or_default().push((stamp, depth_m));
            }
        }
        places.poses.values_mut().for_each(|p| p.sort_by_key(|p| p.stamp));
        places.fixes.values_mut().for_each(|f| f.sort_by_key(|f| f.stamp));
        places.depths.values_mut().for_each(|d| d.sort_by_key(|(stamp, _)| *stamp));
        // A pose that never moves is a mount or a goal, not a trajectory.
        places.poses.retain(|_, poses| {
            poses
                .windows(2)
                .any(|p| p[0].world_from_body.translation != p[1].world_from_body.translation)
        });
        Ok(places)
    }

    /// The topic with most poses.
    fn best(&self) -> Option<(&String, &Vec<Pose>)> {
        self.poses
            .iter()
            .max_by_key(|(topic, poses)| (poses.len(), std::cmp::Reverse((*topic).clone())))
    }

    /// Depths: of a topic of that name rather than from pressure, which needs a density; then of
    /// the topic with most of them.
    pub fn best_depths(&self) -> &[(Stamp, f64)] {
        let best = self.depths.iter().max_by_key(|(topic, depths)| {
            (is_depth_topic(topic), depths.len(), std::cmp::Reverse((*topic).clone()))
        });
        best.map(|(_, depths)| depths.as_slice()).unwrap_or_default()
    }

    /// The topic with most fixes.
    pub fn best_fixes(&self) -> Option<(&String, &Vec<Fix>)> {
        self.fixes
            .iter()
            .max_by_key(|(topic, fixes)| (fixes.len(), std::cmp::Reverse((*topic).clone())))
    }
}

/// A schema's text, or a protobuf descriptor's, names its fields.
fn names(schema: &[u8], word: &[u8]) -> bool {
    schema.windows(word.len()).any(|w| w.eq_ignore_ascii_case(word))
}

fn may_hold_places(schema: &[u8]) -> bool {
    [&b"latitude"[..], b"pose", b"fluid_pressure"].iter().any(|word| names(schema, word))
}

fn may_hold_images(schema: &[u8]) -> bool {
    names(schema, b"uint8[]") || names(schema, b"encoding")
}

/// Whether a topic's last element is about depth.
fn is_depth_topic(topic: &str) -> bool {
    let last = topic.rsplit('/').next().unwrap_or_default().to_ascii_lowercase();
    last == "depth" || last.starts_with("depth_") || last.ends_with("_depth")
}

/// Atmospheric pressure (Pa), and pressure per metre of sea water (Pa/m).
const AIR_PA: f64 = 101_325.0;
const WATER_PA_PER_M: f64 = 1025.0 * 9.81;

/// Depth below the sea surface (m): a number on a topic of that name, of whatever sign, or from an
/// absolute pressure.
fn depth_m(value: &Value<'_>, is_depth_topic: bool) -> Option<f64> {
    let of_topic = || ["data", "depth", "depth_m"].iter().find_map(|path| value.number(path));
    let of_pressure = || {
        let pressure = value.number("fluid_pressure").filter(|pa| *pa > 0.5 * AIR_PA)?;
        Some(((pressure - AIR_PA) / WATER_PA_PER_M).max(0.0))
    };
    let depth = is_depth_topic.then(of_topic).flatten().map(f64::abs).or_else(of_pressure);
    depth.filter(|depth| depth.is_finite() && *depth < DEEPEST_M)
}

/// Deeper than any sea (m).
const DEEPEST_M: f64 = 12_000.0;

/// A depth between two others; `None` far from any.
pub fn depth_at(depths: &[(Stamp, f64)], stamp: Stamp) -> Option<f64> {
    let after = depths.partition_point(|(s, _)| *s < stamp);
    let near = |(s, depth): &(Stamp, f64)| {
        (s.seconds_since(stamp).abs() < LONGEST_GAP_S).then_some(*depth)
    };
    match (after.checked_sub(1).and_then(|i| depths.get(i)), depths.get(after)) {
        (Some((a, p)), Some((b, q))) if b.seconds_since(*a) < 2.0 * LONGEST_GAP_S => {
            Some(p + (q - p) * stamp.seconds_since(*a) / b.seconds_since(*a))
        }
        (a, b) => a.and_then(near).or_else(|| b.and_then(near)),
    }
}

fn fix(value: &Value<'_>, stamp: Stamp) -> Option<Fix> {
    // NavSatFix has status −1 without a fix, and others write zeros.
    let has_none = value.number("status.status").is_some_and(|s| s < 0.0);
    let at = |path: &str| value.number(path).or_else(|| value.number(&format!("position.{path}")));
    let (latitude, longitude) = (at("latitude")?, at("longitude")?);
    let sane =
        latitude.abs() <= 90.0 && longitude.abs() <= 360.0 && (latitude, longitude) != (0.0, 0.0);
    (sane && !has_none).then_some(Fix { stamp, latitude, longitude })
}

fn pose(value: &Value<'_>, stamp: Stamp) -> Option<Pose> {
    let path = ["pose.pose", "pose"]
        .into_iter()
        .find(|p| value.xyz(&format!("{p}.position")).is_some())?;
    let [x, y, z] = value.xyz(&format!("{path}.position"))?;
    if ![x, y, z].iter().all(|v| v.is_finite()) {
        return None;
    }
    let orientation = value
        .xyzw(&format!("{path}.orientation"))
        .filter(|q| q.iter().map(|v| v * v).sum::<f64>() > 0.5);
    let rotation = orientation.map_or_else(UnitQuaternion::identity, |[x, y, z, w]| {
        UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z))
    });
    Some(Pose {
        stamp,
        world_from_body: Isometry3::from_parts(Translation3::new(x, y, z), rotation),
        has_rotation: orientation.is_some(),
    })
}

/// Poses of frames and their source.
pub struct Placed {
    /// per frame: the segment it belongs to, and world_from_body with z up; `None` where nothing is
    /// known
    pub poses: Vec<Option<(u32, Isometry3<f64>)>>,
    /// source of the poses, as text
    pub source: String,
}

/// Poses of frames with their planes, by odometry or else by the integrated DVL velocity; `None`
/// where the log has neither.
pub fn placed(
    log: &CameraSession,
    places: &Places,
    frames: &[(Stamp, SeafloorPlane)],
) -> Option<Placed> {
    let survey = &log.survey;
    let in_body = |world_from_vehicle: Isometry3<f64>, stamp| {
        let moved = survey.rig.vehicle_from_body(stamp);
        moved.map_or(world_from_vehicle, |vehicle_from_body| world_from_vehicle * vehicle_from_body)
    };
    if let Some((topic, poses)) = places.best().filter(|(_, p)| p.iter().all(|p| p.has_rotation)) {
        let found: Vec<_> = frames
            .iter()
            .map(|(stamp, plane)| {
                Some((0, upright(in_body(pose_at(poses, *stamp)?, *stamp), plane)))
            })
            .collect();
        if 2 * found.iter().flatten().count() > frames.len() {
            return Some(Placed { poses: found, source: format!("odometry ({topic})") });
        }
    }
    let by_velocity = |(stamp, plane): &(Stamp, SeafloorPlane)| {
        let (segment, pose) = survey.pings.world_from_body(*stamp, &survey.rig)?;
        Some((segment, upright(pose, plane)))
    };
    let found: Vec<_> = frames.iter().map(by_velocity).collect();
    let is_known = 2 * found.iter().flatten().count() > frames.len();
    is_known.then(|| Placed {
        poses: found,
        source: format!("velocities of {} and attitude, added up", survey.dvl_topic),
    })
}

/// A pose between two others.
fn pose_at(poses: &[Pose], stamp: Stamp) -> Option<Isometry3<f64>> {
    let after = poses.partition_point(|p| p.stamp < stamp);
    let near = |p: &Pose| {
        (p.stamp.seconds_since(stamp).abs() < LONGEST_GAP_S / 2.0).then_some(p.world_from_body)
    };
    match (after.checked_sub(1).and_then(|i| poses.get(i)), poses.get(after)) {
        (Some(a), Some(b)) if b.stamp.seconds_since(a.stamp) < LONGEST_GAP_S => {
            let share = stamp.seconds_since(a.stamp) / b.stamp.seconds_since(a.stamp);
            let (p, q) = (a.world_from_body, b.world_from_body);
            let rotation = p.rotation.try_slerp(&q.rotation, share, 1e-9).unwrap_or(p.rotation);
            Some(Isometry3::from_parts(
                Translation3::from(p.translation.vector.lerp(&q.translation.vector, share)),
                rotation,
            ))
        }
        (a, b) => a.and_then(near).or_else(|| b.and_then(near)),
    }
}

/// A pose in a world with z up: x east and y north where the log's had z down and its axes north
/// and east.
fn upright(world_from_body: Isometry3<f64>, plane: &SeafloorPlane) -> Isometry3<f64> {
    if (world_from_body.rotation * plane.normal.vector()).z <= 0.0 {
        return world_from_body;
    }
    // North, east, down → east, north, up: 180° about the bisector of the first two.
    let half_turn = UnitQuaternion::from_axis_angle(
        &nalgebra::Unit::new_normalize(Vector3::new(1.0, 1.0, 0.0)),
        std::f64::consts::PI,
    );
    half_turn * world_from_body
}

/// Metres east and north of the first fix.
pub fn east_north(fix: &Fix, from: &Fix) -> [f64; 2] {
    [
        (fix.longitude - from.longitude) * M_PER_DEG * from.latitude.to_radians().cos(),
        (fix.latitude - from.latitude) * M_PER_DEG,
    ]
}

/// A fix between two others; `None` far from any.
pub fn fix_at(fixes: &[Fix], stamp: Stamp) -> Option<Fix> {
    let after = fixes.partition_point(|f| f.stamp < stamp);
    // Fixes from a ship come every few seconds.
    let near = |f: &Fix| (f.stamp.seconds_since(stamp).abs() < 5.0 * LONGEST_GAP_S).then_some(*f);
    match (after.checked_sub(1).and_then(|i| fixes.get(i)), fixes.get(after)) {
        (Some(a), Some(b)) if b.stamp.seconds_since(a.stamp) < 10.0 * LONGEST_GAP_S => {
            let share = stamp.seconds_since(a.stamp) / b.stamp.seconds_since(a.stamp);
            let between = |p: f64, q: f64| p + (q - p) * share;
            Some(Fix {
                stamp,
                latitude: between(a.latitude, b.latitude),
                longitude: between(a.longitude, b.longitude),
            })
        }
        (a, b) => a.and_then(near).or_else(|| b.and_then(near)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::coordinates::Direction;
    use crate::geometry::Support;

    /// The seafloor is below the vehicle in either world; seen from above, east is right and north
    /// is up.
    #[test]
    fn north_east_down_becomes_east_north_up() {
        let normal = Direction::from_vector(Vector3::z()).expect("a direction");
        let plane = SeafloorPlane {
            normal,
            distance_m: 2.0,
            support: Support::LeastSquares,
            returns: 9,
            residual_m: 0.0,
            nearest_ping_s: 0.0,
        };
        let north_5_east_2 = Isometry3::translation(5.0, 2.0, 30.0);
        let up = upright(north_5_east_2, &plane);
        assert!((up.translation.vector - Vector3::new(2.0, 5.0, -30.0)).norm() < 1e-12, "{up}");
        assert!(
            ((up.rotation * Vector3::z()) + Vector3::z()).norm() < 1e-12,
            "the seafloor is below"
        );
        // Heading north: the body's x points north, which is now y.
        assert!((up.rotation * Vector3::x() - Vector3::y()).norm() < 1e-12);
    }

    #[test]
    fn fixes_are_metres_and_lie_between_each_other() {
        let fix = |stamp, latitude, longitude| Fix { stamp: Stamp(stamp), latitude, longitude };
        let (a, b) = (fix(0, 60.0, 10.0), fix(2_000_000_000, 60.001, 10.002));
        let [east, north] = east_north(&b, &a);
        assert!((east - 111.2).abs() < 0.1 && (north - 111.2).abs() < 0.1, "{east} {north}");
        let half = fix_at(&[a, b], Stamp(1_000_000_000)).expect("between");
        assert!((half.latitude - 60.0005).abs() < 1e-9);
        assert_eq!(fix_at(&[a, b], Stamp(60_000_000_000)), None);
    }
}
