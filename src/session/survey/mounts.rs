//! Where frames sit on the vehicle: the TF tree of a log.

use std::collections::BTreeMap;

use nalgebra::Isometry3;

use crate::messages::FrameTransform;

use super::super::log::Log;

/// The TF tree of a log: edges by child.
pub struct Mounts<'s> {
    edges: BTreeMap<&'s str, (&'s str, &'s FrameTransform)>,
}

impl<'s> Mounts<'s> {
    /// The edges of `/tf_static`, the first of each child.
    pub fn new(log: &'s Log) -> Self {
        let mut edges = BTreeMap::new();
        // What `/tf` moves is no mount. Only a log with no still tree at all is read from there, as
        // it first stood.
        for suffix in ["tf_static", "tf"] {
            for (id, channel) in &log.index.channels {
                if edges.is_empty() || suffix == "tf_static" {
                    let is_meant = log
                        .recording
                        .channels
                        .get(id)
                        .is_some_and(|c| c.topic.trim_end_matches('/').ends_with(suffix));
                    for edge in channel.edges.iter().filter(|_| is_meant) {
                        edges.entry(edge.child.as_str()).or_insert((edge.parent.as_str(), edge));
                    }
                }
            }
        }
        Self { edges }
    }

    /// Names of all frames.
    pub fn frames(&self) -> Vec<&'s str> {
        let mut names: Vec<&str> =
            self.edges.iter().flat_map(|(child, (parent, _))| [*child, *parent]).collect();
        names.sort_unstable();
        names.dedup();
        names
    }

    /// The root above a frame, and root_from_frame; a tree that bites its tail ends the walk.
    pub fn root(&self, frame: &str) -> (String, Isometry3<f64>) {
        let (mut at, mut pose) = (frame, Isometry3::identity());
        for _ in 0..=self.edges.len() {
            let Some((parent, edge)) = self.edges.get(at) else { break };
            pose = edge.pose * pose;
            at = parent;
        }
        (at.into(), pose)
    }

    fn knows(&self, frame: &str) -> bool {
        self.edges.iter().any(|(child, (parent, _))| *child == frame || *parent == frame)
    }

    /// root_from_frame, where the frame hangs below this root.
    pub fn pose_below(&self, root: &str, frame: &str) -> Option<Isometry3<f64>> {
        let (found, pose) = self.root(frame);
        (found == root && (self.knows(frame) || frame == root)).then_some(pose)
    }
}
