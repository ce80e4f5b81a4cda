//! Pairs of matched keypoints → tracks: one point of seafloor and every frame that saw it.
//!
//! All views must stay in: thinned at random, blue came out 19 % off. A track that meets a frame
//! twice has swallowed a false match and is dropped.

use std::collections::BTreeMap;

use super::matching::MatchedPair;
use super::samples::FrameSamples;
use crate::solver::{Observation, Track};

/// Joins matches of pairs of frames into tracks.
pub fn tracks(frames: &[FrameSamples], pairs: &[MatchedPair]) -> Vec<Track> {
    let starts: Vec<usize> = frames
        .iter()
        .scan(0, |at, f| {
            let start = *at;
            *at += f.keypoints.len();
            Some(start)
        })
        .collect();
    let total = frames.iter().map(|f| f.keypoints.len()).sum();
    let mut parent: Vec<usize> = (0..total).collect();
    fn root(parent: &mut [usize], mut i: usize) -> usize {
        while parent[i] != i {
            parent[i] = parent[parent[i]];
            i = parent[i];
        }
        i
    }
    for MatchedPair { a, b, keypoints } in pairs {
        for (i, j) in keypoints {
            let (p, q) = (
                root(&mut parent, starts[*a] + *i as usize),
                root(&mut parent, starts[*b] + *j as usize),
            );
            // The smaller index wins, so that a track's name does not depend on the order of pairs.
            parent[p.max(q)] = p.min(q);
        }
    }
    let mut members: BTreeMap<usize, Vec<(usize, usize)>> = BTreeMap::new();
    for (frame, samples) in frames.iter().enumerate() {
        for keypoint in 0..samples.keypoints.len() {
            let name = root(&mut parent, starts[frame] + keypoint);
            members.entry(name).or_default().push((frame, keypoint));
        }
    }
    members
        .into_values()
        .filter(|m| m.len() >= 2 && m.windows(2).all(|w| w[0].0 != w[1].0))
        .filter_map(|m| track(frames, &m))
        .collect()
}

/// All views of a point at the level of the farthest.
fn track(frames: &[FrameSamples], members: &[(usize, usize)]) -> Option<Track> {
    let level = members.iter().map(|(f, k)| frames[*f].samples[*k].first_level).max()?;
    let track: Track = members
        .iter()
        .filter_map(|(f, k)| {
            Some(Observation {
                frame: *f as u32,
                sample: frames[*f].samples[*k].at_level(level, frames[*f].bands)?,
            })
        })
        .collect();
    (track.len() >= 2).then_some(track)
}
