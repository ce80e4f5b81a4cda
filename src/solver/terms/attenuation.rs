//! α per band, at nodes in time where the water changes along the log (Eq. 1).

use super::{Equation, Prior, Row, Term};
use crate::image::Bands;

/// Weight of the second difference of α in time: it bends by 0.005 per metre from node to node, for
/// a residual of 0.01.
const BEND_WEIGHT: f64 = 4.0;
/// Weight of the first difference: just enough to hold a node that no track determines.
const STEP_WEIGHT: f64 = 1e-3;

/// Nodes of α in time.
#[derive(Clone, Debug)]
pub struct TimeGrid {
    /// per frame: the node before it, and its distance from that node as a share of the interval
    pub frames: Vec<(usize, f64)>,
    /// number of nodes
    pub nodes: usize,
    /// per interval between nodes: whether the log continues over it
    pub is_joined: Vec<bool>,
}

impl TimeGrid {
    /// Whether the nodes are logs: each frame has the α of one of them.
    pub fn is_of_logs(&self) -> bool {
        self.nodes > 1 && self.frames.iter().all(|(_, share)| *share == 0.0)
    }

    /// Number of frames of each log, in the order of the frames.
    pub fn frames_per_node(&self) -> Vec<usize> {
        self.frames.chunk_by(|a, b| a.0 == b.0).map(<[_]>::len).collect()
    }
}

/// α (1/m): all nodes of red, then of green, then of blue.
pub struct Attenuation<'s> {
    bands: usize,
    time: Option<&'s TimeGrid>,
}

impl<'s> Attenuation<'s> {
    /// One α per band, or one per band and node.
    pub fn new(bands: usize, time: Option<&'s TimeGrid>) -> Self {
        Self { bands, time }
    }

    /// 1 or 3.
    pub fn bands(&self) -> usize {
        self.bands
    }

    /// Nodes in time.
    pub fn nodes(&self) -> usize {
        self.time.map_or(1, |t| t.nodes)
    }

    /// Unknown of a band at a node, counted from the term's first.
    pub fn unknown(&self, band: usize, node: usize) -> usize {
        band * self.nodes() + node
    }

    /// α of a frame (1/m).
    pub fn at(&self, frame: u32, values: &[f64]) -> Bands {
        std::array::from_fn(|b| {
            let node = |k: usize| values[self.unknown(b, k)];
            match self.time {
                _ if b >= self.bands => 0.0,
                None => node(0),
                Some(time) => {
                    let (k, share) = time.frames[frame as usize];
                    if share > 0.0 {
                        (1.0 - share) * node(k) + share * node(k + 1)
                    } else {
                        node(k)
                    }
                }
            }
        })
    }

    /// Weights of the nodes in the mean of α over the frames.
    pub fn mean_weights(&self) -> Vec<f64> {
        let Some(time) = self.time else { return vec![1.0] };
        let mut weights = vec![0.0; time.nodes];
        for (node, share) in &time.frames {
            weights[*node] += (1.0 - share) / time.frames.len() as f64;
            if *share > 0.0 {
                weights[node + 1] += share / time.frames.len() as f64;
            }
        }
        weights
    }
}

impl Term for Attenuation<'_> {
    fn columns(&self) -> usize {
        self.bands * self.nodes()
    }

    fn jacobian(&self, equation: &Equation, band: usize, row: &mut Row) {
        let length_m = equation.path.length_in(band);
        match self.time {
            None => row.push(self.unknown(band, 0), -length_m),
            Some(time) => {
                let (node, share) = time.frames[equation.frame as usize];
                row.push(self.unknown(band, node), -length_m * (1.0 - share));
                if share > 0.0 {
                    row.push(self.unknown(band, node + 1), -length_m * share);
                }
            }
        }
    }

    fn prior(&self, prior: &mut Prior<'_>) {
        let Some(time) = self.time else { return };
        for b in 0..self.bands {
            let node = |k: usize| self.unknown(b, k);
            for k in 0..time.is_joined.len() {
                prior.hold(&[(node(k), 1.0), (node(k + 1), -1.0)], STEP_WEIGHT);
            }
            // Across a gap the water may be another.
            let joined = |k: &usize| time.is_joined[k - 1] && time.is_joined[*k];
            for k in (1..time.is_joined.len()).filter(joined) {
                let bend = [(node(k - 1), 1.0), (node(k), -2.0), (node(k + 1), 1.0)];
                prior.hold(&bend, BEND_WEIGHT);
            }
        }
    }
}
