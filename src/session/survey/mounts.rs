//! Where frames sit on the vehicle: the TF tree of a log.

use std::collections::BTreeMap;

use nalgebra::Isometry3;

use super::super::joints::Joint;
use super::super::log::Log;
use crate::diagnostics::{Diagnostic, MountFact};
use crate::error::MountGap;
use crate::vehicle::{CameraMotion, Link, RigFile};

/// Larger than any vehicle; a larger distance was probably meant in millimetres (m).
const MAX_DISTANCE_M: f64 = 50.0;

/// The still part of a log's TF tree: edges by child; and what moves.
pub struct Mounts<'s> {
    edges: BTreeMap<&'s str, (&'s str, Isometry3<f64>)>,
    /// joints that move in the window
    moving: Vec<&'s Joint>,
    /// those among them that are edges, from the camera on
    followed: Vec<&'s Joint>,
    /// other mounts of frames that have one
    conflicts: Vec<&'s Joint>,
    /// joints without a valid rotation
    broken: Vec<&'s Joint>,
}

impl<'s> Mounts<'s> {
    /// The first still edge of each child; those of `/tf_static` before those of `/tf`.
    pub fn new(log: &'s Log) -> Self {
        let (edges, moving, followed, conflicts, broken) = Default::default();
        let mut mounts = Self { edges, moving, followed, conflicts, broken };
        for is_latched in [true, false] {
            for (id, channel) in &log.index.channels {
                if log.topic(*id).trim_end_matches('/').ends_with("tf_static") == is_latched {
                    channel.joints.iter().for_each(|joint| mounts.add(joint));
                }
            }
        }
        mounts
    }

    fn add(&mut self, joint: &'s Joint) {
        let Some(pose) = joint.pose else { return self.broken.push(joint) };
        if joint.moves() {
            return self.moving.push(joint);
        }
        let known = self.edges.get(joint.child.as_str());
        if known
            .is_some_and(|(parent, known)| *parent != joint.parent || !Joint::is_same(known, &pose))
        {
            self.conflicts.push(joint);
        }
        self.edges.entry(&joint.child).or_insert((&joint.parent, pose));
    }

    /// As [`Mounts::new`], with the joints that move between the camera's frame and another, where
    /// the rig file does not hold the camera.
    pub fn followed(log: &'s Log, rig_file: &RigFile, [camera, other]: [&str; 2]) -> Self {
        let mut mounts = Self::new(log);
        if rig_file.camera.mount.is_none() {
            mounts.follow(camera, other);
        }
        mounts
    }

    /// Takes the joints above a frame, which move, for edges, where they connect it to another.
    fn follow(&mut self, frame: &str, other: &str) {
        let (edges, moving) = (self.edges.clone(), self.moving.clone());
        let above = self.root(other).0;
        loop {
            let root = self.root(frame).0;
            if root == above {
                return;
            }
            let is_next = |joint: &&Joint| joint.child == root && !joint.track.is_empty();
            let Some(next) = self.moving.iter().position(is_next) else { break };
            let joint = self.moving.remove(next);
            let pose = joint.pose.unwrap_or_else(Isometry3::identity);
            self.edges.insert(&joint.child, (&joint.parent, pose));
            self.followed.push(joint);
        }
        (self.edges, self.moving, self.followed) = (edges, moving, Vec::new());
    }

    /// The links from the root to a frame, where joints among them are followed.
    pub fn moving_links(&self, frame: &str, clock_offset_s: f64) -> Option<Vec<Link>> {
        if self.followed.is_empty() {
            return None;
        }
        let link = |child: &str| match self.followed.iter().find(|joint| joint.child == child) {
            Some(joint) => {
                Some(Link::Moving((*joint.track).clone().on_clock(clock_offset_s).into()))
            }
            None => self.edges.get(child).map(|(_, pose)| Link::Still(*pose)),
        };
        Some(self.chain(frame).iter().rev().filter_map(|(child, _)| link(child)).collect())
    }

    /// Sets the followed joints to their pose in the rig.
    pub fn hold(&mut self, motion: &CameraMotion) {
        let moving = motion.links.iter().rev().filter(|link| matches!(link, Link::Moving(_)));
        for (joint, link) in self.followed.iter().zip(moving) {
            self.edges.insert(&joint.child, (&joint.parent, link.at(motion.reference)));
        }
    }

    /// Whether a frame sits below a joint that is followed.
    pub fn turns(&self, frame: &str) -> bool {
        let chain = self.chain(frame);
        self.followed.iter().any(|joint| chain.iter().any(|(child, _)| *child == joint.child))
    }

    /// Whether joints are followed, and a frame does not sit below them.
    pub fn stays(&self, frame: &str) -> bool {
        !self.followed.is_empty() && !self.turns(frame)
    }

    fn facts(&self) -> impl Iterator<Item = MountFact> + '_ {
        self.followed.iter().map(|joint| MountFact::JointFollowed {
            parent: joint.parent.clone(),
            child: joint.child.clone(),
            rotation_deg: joint.rotation_rad.to_degrees(),
        })
    }

    /// Names of all frames.
    pub fn frames(&self) -> Vec<&'s str> {
        let mut names: Vec<&str> =
            self.edges.iter().flat_map(|(child, (parent, _))| [*child, *parent]).collect();
        names.sort_unstable();
        names.dedup();
        names
    }

    /// A frame and those above it, with frame_above_from_frame; a tree that bites its tail ends the
    /// walk.
    fn chain(&self, frame: &str) -> Vec<(String, Isometry3<f64>)> {
        let mut chain = vec![(frame.to_string(), Isometry3::identity())];
        let (mut at, mut pose) = (frame, Isometry3::identity());
        for _ in 0..=self.edges.len() {
            let Some((parent, edge)) = self.edges.get(at) else { break };
            pose = edge * pose;
            at = parent;
            chain.push((at.into(), pose));
        }
        chain
    }

    /// The root above a frame, and root_from_frame.
    pub fn root(&self, frame: &str) -> (String, Isometry3<f64>) {
        self.chain(frame).pop().unwrap_or_default()
    }

    /// Whether a frame is farther from its root than any vehicle is long.
    pub fn is_far(&self, frame: &str) -> bool {
        self.root(frame).1.translation.vector.norm() >= MAX_DISTANCE_M
    }

    fn knows(&self, frame: &str) -> bool {
        self.edges.iter().any(|(child, (parent, _))| *child == frame || *parent == frame)
    }

    /// root_from_frame, where the frame hangs below this root, and within the size of a vehicle.
    pub fn pose_below(&self, root: &str, frame: &str) -> Option<Isometry3<f64>> {
        let (found, pose) = self.root(frame);
        let is_below = found == root && (self.knows(frame) || frame == root);
        (is_below && pose.translation.vector.norm() < MAX_DISTANCE_M).then_some(pose)
    }

    /// What is doubtful of the mounts of these frames, and which joints are followed.
    pub fn doubts(&self, frames: &[&str]) -> Vec<Diagnostic> {
        let doubts = self.conflicts(frames).into_iter().chain(self.placeholders(frames));
        doubts.chain(self.facts()).map(Diagnostic::from).collect()
    }

    /// Mounts of these frames, or of those above them, that the log states twice and differently.
    fn conflicts(&self, frames: &[&str]) -> Vec<MountFact> {
        let chains = frames.iter().flat_map(|frame| self.chain(frame));
        let used: Vec<String> = chains.map(|(frame, _)| frame).collect();
        let is_used = |joint: &&&Joint| used.contains(&joint.child) && !self.agrees(joint);
        let mut facts: Vec<MountFact> = Vec::new();
        for joint in self.conflicts.iter().filter(is_used) {
            let frame = joint.child.clone();
            let used = self.edges.get(frame.as_str()).map_or("", |(parent, _)| *parent).into();
            let fact = MountFact::Conflicting { frame, used, other: joint.parent.clone() };
            if !facts.contains(&fact) {
                facts.push(fact);
            }
        }
        facts
    }

    /// Mounts of these frames that are probably placeholders: no translation from the root at all.
    fn placeholders(&self, frames: &[&str]) -> Vec<MountFact> {
        let has_none = |frame: &&&str| {
            let (root, pose) = self.root(frame);
            root != **frame && pose.translation.vector.norm() < 1e-9
        };
        let fact = |frame: &&str| MountFact::NoTranslation { frame: (*frame).into() };
        frames.iter().filter(has_none).map(fact).collect()
    }

    /// Whether a second mount of a frame gives it the same pose in the vehicle.
    fn agrees(&self, joint: &Joint) -> bool {
        let (root, pose) = self.root(&joint.child);
        let (other_root, above) = self.root(&joint.parent);
        joint
            .pose
            .is_some_and(|other| root == other_root && Joint::is_same(&pose, &(above * other)))
    }

    /// Why the mount of a frame relative to another, the camera's, is unknown.
    pub fn gap(&self, frame: &str, camera_frame: &str) -> MountGap {
        let roots = [frame, camera_frame].map(|f| self.root(f).0);
        let is_between = |joint: &&&Joint| {
            let ends = [self.root(&joint.parent).0, self.root(&joint.child).0];
            ends.iter().any(|end| roots.contains(end)) && ends[0] != ends[1]
        };
        let has_broken = |joint: &&&Joint| [frame, camera_frame].contains(&joint.child.as_str());
        if self.edges.is_empty() && self.moving.is_empty() && self.broken.is_empty() {
            MountGap::NoTransforms
        } else if frame.is_empty() || camera_frame.is_empty() {
            MountGap::NoFrameId { is_camera: camera_frame.is_empty() }
        } else if let Some(joint) = self.broken.iter().find(has_broken) {
            let (parent, child) = (joint.parent.clone(), joint.child.clone());
            MountGap::NoRotation { parent, child }
        } else if let Some(joint) = self.moving.iter().find(is_between) {
            let (parent, child) = (joint.parent.clone(), joint.child.clone());
            MountGap::Moving { parent, child, rotation_deg: joint.rotation_rad.to_degrees() }
        } else if let Some(cut) = [frame, camera_frame].into_iter().find(|frame| !self.knows(frame))
        {
            MountGap::NotInTree { frame: cut.into() }
        } else if let Some(far) = [frame, camera_frame].into_iter().find(|f| self.is_far(f)) {
            MountGap::Far { frame: far.into() }
        } else {
            let [root, camera_root] = roots;
            MountGap::SeparateTrees { root, camera_root }
        }
    }
}
