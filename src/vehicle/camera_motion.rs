//! A camera on joints that move: a tilt servo, a gimbal, an arm.
//!
//! ```text
//! vehicle_from_body(t) = T(t) T⁻¹    T(t): mount of the camera at t; T: that in the rig
//! ```
//!
//! Body coordinates stay fixed to the camera, so that all that is derived from images (light paths,
//! the beam pattern of a lamp beside the camera) needs no time. What the vehicle's instruments
//! measure is brought there frame by frame.

use std::sync::Arc;

use nalgebra::{Isometry3, Vector3};

use crate::units::Stamp;

/// Poses within this of the last kept one are not kept (rad, m).
const SAME_RAD: f64 = 0.002;
const SAME_M: f64 = 0.001;

/// Pose of a joint over time; where it stands still, only the first and last pose are kept.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PoseTrack {
    kept: Vec<(Stamp, Isometry3<f64>)>,
    /// the last pose, where it is not kept
    last: Option<(Stamp, Isometry3<f64>)>,
}

impl PoseTrack {
    /// Adds the pose of a later time.
    pub fn push(&mut self, stamp: Stamp, pose: Isometry3<f64>) {
        let moved = |(_, known): &(Stamp, Isometry3<f64>)| {
            known.rotation.angle_to(&pose.rotation) > SAME_RAD
                || (known.translation.vector - pose.translation.vector).norm() > SAME_M
        };
        if self.kept.last().is_none_or(moved) {
            self.kept.extend(self.last.take());
            self.kept.push((stamp, pose));
        } else {
            self.last = Some((stamp, pose));
        }
    }

    /// With all poses in the order of time, on a clock that differs by this (s).
    #[must_use]
    pub fn on_clock(mut self, offset_s: f64) -> Self {
        self.kept.extend(self.last.take());
        self.kept.sort_by_key(|(stamp, _)| *stamp);
        self.kept.iter_mut().for_each(|(stamp, _)| *stamp = stamp.plus_seconds(offset_s));
        self
    }

    /// Whether it has no pose.
    pub fn is_empty(&self) -> bool {
        self.kept.is_empty()
    }

    /// The kept poses with their times.
    pub fn poses(&self) -> &[(Stamp, Isometry3<f64>)] {
        &self.kept
    }

    /// Pose at a time, between two others; beyond the ends the first or last one.
    fn at(&self, stamp: Stamp) -> Option<Isometry3<f64>> {
        let after = self.kept.partition_point(|(at, _)| *at < stamp);
        let before = after.checked_sub(1).and_then(|i| self.kept.get(i));
        match (before, self.kept.get(after)) {
            (Some((start, a)), Some((end, b))) => {
                let share = stamp.seconds_since(*start) / end.seconds_since(*start);
                let rotation = a.rotation.try_slerp(&b.rotation, share, 1e-9);
                let at = a.translation.vector.lerp(&b.translation.vector, share);
                Some(Isometry3::from_parts(at.into(), rotation.unwrap_or(a.rotation)))
            }
            (one, other) => one.or(other).map(|(_, pose)| *pose),
        }
    }
}

/// A link between the vehicle and its camera.
#[derive(Clone, Debug)]
pub enum Link {
    /// parent_from_child
    Still(Isometry3<f64>),
    /// parent_from_child over time
    Moving(Arc<PoseTrack>),
}

/// Mount of a camera over time.
#[derive(Clone, Debug)]
pub struct CameraMotion {
    /// from the vehicle to the camera
    pub links: Vec<Link>,
    /// the mount in the rig is that of this time
    pub reference: Stamp,
}

impl CameraMotion {
    /// The reference is the time at which the camera looks most along a direction in the vehicle.
    pub fn new(links: Vec<Link>, direction: &Vector3<f64>) -> Self {
        let motion = Self { links, reference: Stamp(0) };
        // A frame of another convention than the optical one has x along the optical axis.
        let along = |stamp: Stamp| {
            let rotation = motion.mount(stamp).rotation;
            let axes = [Vector3::z(), Vector3::x()].map(|axis| rotation * axis);
            axes[0].dot(direction).max(axes[1].dot(direction))
        };
        let times = motion.links.iter().flat_map(Link::times);
        let best = times.max_by(|a, b| along(*a).total_cmp(&along(*b)));
        Self { reference: best.unwrap_or(Stamp(0)), ..motion }
    }

    fn mount(&self, stamp: Stamp) -> Isometry3<f64> {
        self.links.iter().fold(Isometry3::identity(), |pose, link| pose * link.at(stamp))
    }

    /// Pose of the body, which is fixed to the camera, in the vehicle.
    pub fn vehicle_from_body(&self, stamp: Stamp) -> Isometry3<f64> {
        self.mount(stamp) * self.mount(self.reference).inverse()
    }
}

impl Link {
    /// parent_from_child at a time.
    pub fn at(&self, stamp: Stamp) -> Isometry3<f64> {
        match self {
            Self::Still(pose) => *pose,
            Self::Moving(track) => track.at(stamp).unwrap_or_else(Isometry3::identity),
        }
    }

    fn times(&self) -> impl Iterator<Item = Stamp> + '_ {
        let poses = match self {
            Self::Moving(track) => track.poses(),
            Self::Still(_) => &[],
        };
        poses.iter().map(|(stamp, _)| *stamp)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;

    fn pitched(deg: f64) -> Isometry3<f64> {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), deg.to_radians());
        Isometry3::from_parts(Vector3::new(0.0, 0.2, 0.0).into(), turn)
    }

    fn second(s: f64) -> Stamp {
        Stamp((s * 1e9) as i64)
    }

    /// Stands still for 10 s, then turns by 20° in 2 s.
    fn servo() -> PoseTrack {
        let mut track = PoseTrack::default();
        for k in 0..240 {
            let s = f64::from(k) * 0.05;
            track.push(second(s), pitched((s - 10.0).max(0.0) * 10.0));
        }
        track.on_clock(0.0)
    }

    #[test]
    fn poses_that_do_not_change_are_not_kept_and_nothing_is_lost_by_it() {
        let track = servo();
        assert!(track.poses().len() <= 42, "{}", track.poses().len());
        for (s, deg) in [(-3.0, 0.0), (0.0, 0.0), (9.9, 0.0), (11.0, 10.0), (11.33, 13.3)] {
            let pose = track.at(second(s)).expect("a pose");
            let error = pose.rotation.angle_to(&pitched(deg).rotation).to_degrees();
            assert!(error < 0.15, "{error:.2}° at {s} s");
        }
    }

    #[test]
    fn a_point_of_the_vehicle_moves_in_the_body_as_the_camera_turns() {
        let links = || vec![Link::Still(pitched(0.0)), Link::Moving(Arc::new(servo()))];
        // The camera looks down at the end.
        let down = pitched(19.5).rotation * Vector3::z();
        let motion = CameraMotion::new(links(), &down);
        assert!((motion.reference.0 as f64 * 1e-9 - 11.95).abs() < 0.1);
        let at_reference = motion.vehicle_from_body(motion.reference);
        assert!(
            at_reference.rotation.angle() < 1e-9 && at_reference.translation.vector.norm() < 1e-9
        );
        // At the beginning what is straight below the vehicle is 19.5° off the camera's axis.
        let in_body = motion.vehicle_from_body(second(1.0)).rotation.inverse() * down;
        let axis = motion.mount(motion.reference).rotation * Vector3::z();
        assert!((in_body.dot(&axis).acos().to_degrees() - 19.5).abs() < 0.2);
    }
}
