//! The strobe's beam pattern: log BP on a square grid of (θ, φ), bilinear between nodes (paper §IV-C, Fig. 9).
//!
//! In: strobe angles [rad]. Out: natural log of the gain, peak 0. Nodes never seen are filled from the nearest
//! seen ones, so that a correction is still defined there; they stay marked.

use crate::geometry::StrobeAngles;

/// The grid's shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nodes {
    /// nodes per axis
    pub count: usize,
    /// the grid reaches from −limit to +limit [rad]
    pub limit_rad: f64,
}

impl Nodes {
    /// A grid over ±`limit_deg`.
    pub fn new(count: usize, limit_deg: f64) -> Self {
        Self { count, limit_rad: limit_deg.to_radians() }
    }

    /// Angle of a node [rad].
    pub fn angle(&self, index: usize) -> f64 {
        (2.0 * index as f64 / (self.count - 1) as f64 - 1.0) * self.limit_rad
    }

    /// The four nodes around a direction and their bilinear weights; index = θ node × count + φ node.
    /// Directions beyond the grid take its edge.
    pub fn weights(&self, angles: StrobeAngles) -> [(usize, f64); 4] {
        let place = |angle: f64| {
            let x = ((angle / self.limit_rad + 1.0) / 2.0 * (self.count - 1) as f64).clamp(0.0, (self.count - 1) as f64);
            let i = (x.floor() as usize).min(self.count - 2);
            (i, x - i as f64)
        };
        let ((i, a), (j, b)) = (place(angles.theta_rad), place(angles.phi_rad));
        let at = |i: usize, j: usize| i * self.count + j;
        [(at(i, j), (1.0 - a) * (1.0 - b)), (at(i, j + 1), (1.0 - a) * b), (at(i + 1, j), a * (1.0 - b)), (at(i + 1, j + 1), a * b)]
    }

    /// Whether a direction lies on the grid.
    pub fn holds(&self, angles: StrobeAngles) -> bool {
        angles.theta_rad.abs() <= self.limit_rad && angles.phi_rad.abs() <= self.limit_rad
    }
}

/// log BP(θ, φ).
#[derive(Clone, Debug, PartialEq)]
pub struct BeamPattern {
    nodes: Nodes,
    log_gain: Vec<f64>,
    seen: Vec<bool>,
}

impl BeamPattern {
    /// "Assume BP ≈ 1" (§IV-B).
    pub fn uniform(nodes: Nodes) -> Self {
        Self { nodes, log_gain: vec![0.0; nodes.count * nodes.count], seen: vec![true; nodes.count * nodes.count] }
    }

    /// From values per node (θ major), `None` where never seen: peak to 0, holes filled from their neighbours.
    pub fn from_nodes(nodes: Nodes, values: &[Option<f64>]) -> Self {
        let peak = values.iter().flatten().copied().fold(f64::NEG_INFINITY, f64::max);
        if !peak.is_finite() {
            return Self { seen: vec![false; values.len()], ..Self::uniform(nodes) };
        }
        let seen: Vec<bool> = values.iter().map(Option::is_some).collect();
        let from_peak: Vec<Option<f64>> = values.iter().map(|v| v.map(|v| v - peak)).collect();
        Self { nodes, log_gain: filled(nodes.count, &from_peak), seen }
    }

    /// The grid.
    pub fn nodes(&self) -> Nodes {
        self.nodes
    }

    /// log BP at a direction.
    pub fn log_gain(&self, angles: StrobeAngles) -> f64 {
        self.nodes.weights(angles).iter().map(|(node, weight)| self.log_gain[*node] * weight).sum()
    }

    /// Whether the log has shown this direction.
    pub fn is_seen(&self, angles: StrobeAngles) -> bool {
        self.nodes.holds(angles) && self.nodes.weights(angles).iter().all(|(node, weight)| self.seen[*node] || *weight < 1e-6)
    }

    /// log BP by node (θ major), `None` where never seen.
    pub fn by_node(&self) -> Vec<Option<f64>> {
        self.log_gain.iter().zip(&self.seen).map(|(v, seen)| seen.then_some(*v)).collect()
    }
}

/// Fills the holes of a square grid ring by ring outwards: a hole takes the mean of the filled nodes around it.
pub fn filled(count: usize, values: &[Option<f64>]) -> Vec<f64> {
    let mut filled = values.to_vec();
    let n = count as isize;
    while filled.iter().any(Option::is_none) {
        let before = filled.clone();
        if before.iter().all(Option::is_none) {
            break;
        }
        for (index, value) in filled.iter_mut().enumerate().filter(|(_, v)| v.is_none()) {
            let (i, j) = (index as isize / n, index as isize % n);
            let around = (-1..=1).flat_map(|di| (-1..=1).map(move |dj| (i + di, j + dj))).filter(|(i, j)| (0..n).contains(i) && (0..n).contains(j));
            let known: Vec<f64> = around.filter_map(|(i, j)| before[(i * n + j) as usize]).collect();
            if !known.is_empty() {
                *value = Some(known.iter().sum::<f64>() / known.len() as f64);
            }
        }
    }
    filled.into_iter().map(Option::unwrap_or_default).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn theta_is_the_first_index_and_holes_are_filled_but_marked() {
        let nodes = Nodes::new(21, 50.0);
        let value = |index: usize| -nodes.angle(index / 21).powi(2) - 0.5 * nodes.angle(index % 21);
        let values: Vec<Option<f64>> = (0..441).map(|i| (i % 21 < 18).then(|| value(i))).collect();
        let beam = BeamPattern::from_nodes(nodes, &values);
        let at = |theta_rad, phi_rad| StrobeAngles { theta_rad, phi_rad };
        let difference = beam.log_gain(at(0.3, -0.2)) - beam.log_gain(at(0.0, -0.2));
        assert!((difference + 0.09).abs() < 0.003, "{difference}");
        assert!(beam.is_seen(at(0.0, 0.0)) && !beam.is_seen(at(0.0, 0.85)));
        assert!(beam.log_gain(at(0.0, 0.85)).is_finite());
        assert_eq!(beam.by_node().iter().flatten().copied().fold(f64::NEG_INFINITY, f64::max), 0.0);
    }
}
