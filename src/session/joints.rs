//! The joints of the TF tree over a whole log: mounts, which stand still, and others, which move.

use std::sync::Arc;

use nalgebra::Isometry3;

use crate::messages::FrameTransform;
use crate::units::Stamp;
use crate::vehicle::PoseTrack;

/// Smaller changes of a transform are noise of whatever publishes it (rad, m).
const STILL_RAD: f64 = 0.01;
const STILL_M: f64 = 0.01;
/// What moves farther is no joint of a vehicle, but the vehicle in its world (m).
const JOINT_M: f64 = 3.0;
/// Stamps farther from the time of logging are those of another clock (s).
const CLOCK_S: f64 = 2.0;

/// An edge of the TF tree over the whole log.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// frame id
    pub parent: String,
    /// frame id
    pub child: String,
    /// first parent_from_child of the window; `None` where no message has a rotation
    pub pose: Option<Isometry3<f64>>,
    /// largest rotation from the first pose (rad)
    pub rotation_rad: f64,
    /// largest displacement from the first pose (m)
    pub displacement_m: f64,
    /// its poses over time, where it is part of the vehicle
    pub track: Arc<PoseTrack>,
    is_inside: bool,
}

impl Joint {
    /// Whether it moves in the window.
    pub fn moves(&self) -> bool {
        self.rotation_rad > STILL_RAD || self.displacement_m > STILL_M
    }

    /// Whether two poses of one frame agree.
    pub fn is_same(a: &Isometry3<f64>, b: &Isometry3<f64>) -> bool {
        a.rotation.angle_to(&b.rotation) <= STILL_RAD
            && (a.translation.vector - b.translation.vector).norm() <= STILL_M
    }

    fn add(&mut self, stamp: Stamp, pose: Isometry3<f64>, is_inside: bool) {
        if self.displacement_m < JOINT_M {
            Arc::make_mut(&mut self.track).push(stamp, pose);
        } else {
            self.track = Arc::default();
        }
        match self.pose {
            // What stood before the window counts where the window has nothing.
            Some(first) if self.is_inside && is_inside => {
                let displacement_m = (first.translation.vector - pose.translation.vector).norm();
                self.rotation_rad = self.rotation_rad.max(first.rotation.angle_to(&pose.rotation));
                self.displacement_m = self.displacement_m.max(displacement_m);
            }
            Some(_) if !is_inside => {}
            _ => (self.pose, self.is_inside) = (Some(pose), is_inside),
        }
    }
}

/// Adds a transform to the joints of its channel.
pub fn add(joints: &mut Vec<Joint>, edge: FrameTransform, logged: Stamp, is_inside: bool) {
    let FrameTransform { stamp, parent, child, pose } = edge;
    let stamp = stamp.filter(|stamp| stamp.seconds_since(logged).abs() < CLOCK_S).unwrap_or(logged);
    let is_known = |j: &Joint| j.child == child && j.parent == parent;
    let at = joints.iter().position(is_known).unwrap_or_else(|| {
        let (rotation_rad, displacement_m) = (0.0, 0.0);
        let (pose, track, is_inside) = Default::default();
        joints.push(Joint { parent, child, pose, rotation_rad, displacement_m, track, is_inside });
        joints.len() - 1
    });
    if let Some(pose) = pose {
        joints[at].add(stamp, pose, is_inside);
    }
}
