//! The strobe's beam pattern: log BP on the nodes of a bilinear grid, shared by the bands, its
//! second differences held small.

use super::{Equation, Prior, Row, Term};
use crate::model::BeamGrid;

/// Nodes with less weight of observations are not solved for.
const MIN_NODE_WEIGHT: f64 = 3.0;

/// log BP on the observed nodes of the grid.
pub struct Beam {
    grid: BeamGrid,
    /// node → unknown; `None` where it is not solved for
    unknowns: Vec<Option<usize>>,
    count: usize,
    smoothness: f64,
}

impl Beam {
    /// Unknowns for the nodes that are observed often enough.
    pub fn new(grid: BeamGrid, node_weight: &[f64], smoothness: f64) -> Self {
        let mut count = 0;
        let unknown = |weight: &f64| {
            let is_seen = *weight >= MIN_NODE_WEIGHT;
            count += usize::from(is_seen);
            is_seen.then(|| count - 1)
        };
        let unknowns = node_weight.iter().map(unknown).collect();
        Self { grid, unknowns, count, smoothness }
    }

    /// Unknown of a node.
    pub fn unknown(&self, node: usize) -> Option<usize> {
        self.unknowns.get(node).copied().flatten()
    }

    /// log BP by node; `None` where not solved for.
    pub fn by_node(&self, values: &[f64]) -> Vec<Option<f64>> {
        self.unknowns.iter().map(|u| values.get((*u)?).copied()).collect()
    }

    /// log BP from nodes and weights.
    pub fn log_gain(&self, nodes: &[(usize, f64)], values: &[f64]) -> f64 {
        nodes.iter().filter_map(|(n, w)| Some(w * values[self.unknown(*n)?])).sum()
    }
}

impl Term for Beam {
    fn columns(&self) -> usize {
        self.count
    }

    fn jacobian(&self, equation: &Equation, band: usize, row: &mut Row) {
        let share = equation.path.lamp_share[band];
        for &(node, weight) in &equation.path.nodes[..equation.path.nodes_used] {
            if let Some(unknown) = self.unknown(node) {
                row.push(unknown, share * weight);
            }
        }
    }

    fn prior(&self, prior: &mut Prior<'_>) {
        let n = self.grid.count;
        for i in 0..n {
            for j in 0..n {
                for (step, is_inside) in [(1, j + 2 < n), (n, i + 2 < n)] {
                    let node = |k: usize| {
                        if is_inside { self.unknown(i * n + j + k * step) } else { None }
                    };
                    if let (Some(a), Some(b), Some(c)) = (node(0), node(1), node(2)) {
                        prior.hold(&[(a, 1.0), (b, -2.0), (c, 1.0)], self.smoothness);
                    }
                }
            }
        }
    }
}
