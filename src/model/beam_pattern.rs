//! The strobe's beam pattern: log BP on a square grid of (θ, φ), bilinear between nodes (paper
//! §IV-C, Fig. 9).
//!
//! In: strobe angles (rad). Out: natural log of the gain, peak 0. Nodes never seen are filled from
//! the nearest seen ones, so that a correction is still defined there; they stay marked.

use std::sync::Arc;

use crate::geometry::StrobeAngles;

/// The grid's shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BeamGrid {
    /// nodes per axis
    pub count: usize,
    /// the grid reaches from −limit to +limit (rad)
    pub limit_rad: f64,
}

impl BeamGrid {
    /// A grid over ±`limit_deg`.
    pub fn new(count: usize, limit_deg: f64) -> Self {
        Self { count, limit_rad: limit_deg.to_radians() }
    }

    /// Angle of a node (rad).
    pub fn angle(&self, index: usize) -> f64 {
        (2.0 * index as f64 / (self.count - 1) as f64 - 1.0) * self.limit_rad
    }

    /// The four nodes around a direction and their bilinear weights; index = θ node × count + φ
    /// node. Directions beyond the grid take its edge.
    pub fn weights(&self, angles: StrobeAngles) -> [(usize, f64); 4] {
        let place = |angle: f64| {
            let x = ((angle / self.limit_rad + 1.0) / 2.0 * (self.count - 1) as f64)
                .clamp(0.0, (self.count - 1) as f64);
            let i = (x as usize).min(self.count - 2);
            (i, x - i as f64)
        };
        let ((i, a), (j, b)) = (place(angles.theta_rad), place(angles.phi_rad));
        let at = |i: usize, j: usize| i * self.count + j;
        [
            (at(i, j), (1.0 - a) * (1.0 - b)),
            (at(i, j + 1), (1.0 - a) * b),
            (at(i + 1, j), a * (1.0 - b)),
            (at(i + 1, j + 1), a * b),
        ]
    }

    /// Whether a direction lies on the grid.
    pub fn holds(&self, angles: StrobeAngles) -> bool {
        angles.theta_rad.abs() <= self.limit_rad && angles.phi_rad.abs() <= self.limit_rad
    }
}

/// log BP(θ, φ). Copies share its nodes.
#[derive(Clone, Debug, PartialEq)]
pub struct BeamPattern {
    nodes: BeamGrid,
    log_gain: Arc<[f64]>,
    seen: Arc<[bool]>,
}

impl BeamPattern {
    /// "Assume BP ≈ 1" (§IV-B).
    pub fn uniform(nodes: BeamGrid) -> Self {
        let count = nodes.count * nodes.count;
        Self { nodes, log_gain: vec![0.0; count].into(), seen: vec![true; count].into() }
    }

    /// From values per node (θ major), `None` where never seen: peak to 0, holes filled from their
    /// neighbours.
    pub fn from_nodes(nodes: BeamGrid, values: &[Option<f64>]) -> Self {
        let peak = values.iter().flatten().copied().fold(f64::NEG_INFINITY, f64::max);
        if !peak.is_finite() {
            return Self { seen: vec![false; values.len()].into(), ..Self::uniform(nodes) };
        }
        let seen = values.iter().map(Option::is_some).collect();
        let from_peak: Vec<Option<f64>> = values.iter().map(|v| v.map(|v| v - peak)).collect();
        Self { nodes, log_gain: filled(nodes.count, &from_peak).into(), seen }
    }

    /// The grid.
    pub fn nodes(&self) -> BeamGrid {
        self.nodes
    }

    /// log BP at a direction.
    pub fn log_gain(&self, angles: StrobeAngles) -> f64 {
        self.read(angles).0
    }

    /// Whether the log has shown this direction.
    pub fn is_seen(&self, angles: StrobeAngles) -> bool {
        self.read(angles).1
    }

    /// Both.
    pub fn read(&self, angles: StrobeAngles) -> (f64, bool) {
        let (mut log_gain, mut seen) = (0.0, self.nodes.holds(angles));
        for (node, weight) in self.nodes.weights(angles) {
            log_gain += self.log_gain[node] * weight;
            seen &= self.seen[node] || weight < 1e-6;
        }
        (log_gain, seen)
    }

    /// log BP by node (θ major), `None` where never seen.
    pub fn by_node(&self) -> Vec<Option<f64>> {
        self.log_gain.iter().zip(self.seen.iter()).map(|(v, seen)| seen.then_some(*v)).collect()
    }

    /// What was subtracted from the values that this pattern was made from, to bring its peak to 0.
    pub fn level_of(&self, values: &[Option<f64>]) -> Option<f64> {
        let nodes = values.iter().zip(self.log_gain.iter().zip(self.seen.iter()));
        nodes.filter(|(_, (_, seen))| **seen).find_map(|(v, (gain, _))| Some((*v)? - gain))
    }

    /// The same pattern on a grid so many times as fine, cubic between its nodes (Catmull and Rom):
    /// a lamp has no edges where a grid has nodes. At the rim of what was seen it goes straight on.
    pub fn refined(&self, times: usize) -> Self {
        let n = self.nodes.count;
        let fine = (n - 1) * times + 1;
        // Along φ, then along θ.
        let (mut rows, mut rows_seen) = (vec![0.0; n * fine], vec![false; n * fine]);
        for i in 0..n {
            let (v, s) =
                refined_line(n, times, |j| (self.log_gain[i * n + j], self.seen[i * n + j]));
            rows[i * fine..][..fine].copy_from_slice(&v);
            rows_seen[i * fine..][..fine].copy_from_slice(&s);
        }
        let (mut log_gain, mut seen) = (vec![0.0; fine * fine], vec![false; fine * fine]);
        for j in 0..fine {
            let (v, s) = refined_line(n, times, |i| (rows[i * fine + j], rows_seen[i * fine + j]));
            for i in 0..fine {
                (log_gain[i * fine + j], seen[i * fine + j]) = (v[i], s[i]);
            }
        }
        Self {
            nodes: BeamGrid { count: fine, ..self.nodes },
            log_gain: log_gain.into(),
            seen: seen.into(),
        }
    }

    /// First and second differences of log BP between neighbours that were seen: those that only
    /// `beyond` of all exceed.
    pub fn roughness(&self, beyond: f64) -> (f64, f64) {
        let n = self.nodes.count;
        let (mut first, mut second) = (Vec::new(), Vec::new());
        for i in 0..n * n {
            for (step, fits) in [(1, i % n >= 2), (n, i / n >= 2)] {
                if fits && self.seen[i] && self.seen[i - step] && self.seen[i - 2 * step] {
                    let [a, b, c] =
                        [self.log_gain[i - 2 * step], self.log_gain[i - step], self.log_gain[i]];
                    first.push((c - b).abs());
                    second.push((a - 2.0 * b + c).abs());
                }
            }
        }
        let exceeded = |mut values: Vec<f64>| {
            let at = (values.len() as f64 * (1.0 - beyond)) as usize;
            if at < values.len() {
                *values.select_nth_unstable_by(at, f64::total_cmp).1
            } else {
                0.0
            }
        };
        (exceeded(first), exceeded(second))
    }
}

/// `count` values along a line, made `times` as many.
fn refined_line(
    count: usize,
    times: usize,
    at: impl Fn(usize) -> (f64, bool),
) -> (Vec<f64>, Vec<bool>) {
    let fine = (0..=(count - 1) * times).map(|k| {
        let (i, t) = ((k / times).min(count - 2), (k % times) as f64 / times as f64);
        let t = if k == (count - 1) * times { 1.0 } else { t };
        let ((b, b_seen), (c, c_seen)) = (at(i), at(i + 1));
        let seen = (b_seen || t == 1.0) && (c_seen || t == 0.0);
        if !(b_seen && c_seen) {
            return (b + (c - b) * t, seen);
        }
        let beyond = |j: Option<usize>, straight: f64| {
            j.filter(|j| *j < count).map(&at).filter(|v| v.1).map_or(straight, |v| v.0)
        };
        let (a, d) = (beyond(i.checked_sub(1), 2.0 * b - c), beyond(Some(i + 2), 2.0 * c - b));
        (
            b + 0.5
                * t
                * (c - a + t * (2.0 * a - 5.0 * b + 4.0 * c - d + t * (3.0 * (b - c) + d - a))),
            seen,
        )
    });
    fine.unzip()
}

/// Fills the holes of a square grid ring by ring outwards: a hole takes the mean of the filled
/// nodes around it.
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
            let around = (-1..=1)
                .flat_map(|di| (-1..=1).map(move |dj| (i + di, j + dj)))
                .filter(|(i, j)| (0..n).contains(i) && (0..n).contains(j));
            let known: Vec<f64> =
                around.filter_map(|(i, j)| before[(i * n + j) as usize]).collect();
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
        let nodes = BeamGrid::new(21, 50.0);
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

    /// A smooth lamp comes back better than bilinearly, up to the rim of what was seen, and no
    /// direction becomes seen.
    #[test]
    fn a_finer_grid_is_nearer_to_a_smooth_lamp() {
        let nodes = BeamGrid::new(41, 70.0);
        let lamp = |theta: f64, phi: f64| {
            -4.0 * theta * theta - 3.0 * phi * phi + 0.3 * (3.0 * theta).sin() - 1.0
        };
        let is_seen = |i: usize| nodes.angle(i / 41).hypot(nodes.angle(i % 41)) < 0.6;
        let values: Vec<Option<f64>> = (0..41 * 41)
            .map(|i| is_seen(i).then(|| lamp(nodes.angle(i / 41), nodes.angle(i % 41))))
            .collect();
        let beam = BeamPattern::from_nodes(nodes, &values);
        let fine = beam.refined(8);
        let (mut inside, mut worst, mut worst_of_coarse, peak) =
            (0f64, 0f64, 0f64, values.iter().flatten().copied().fold(f64::NEG_INFINITY, f64::max));
        for k in 0..10_000 {
            let angles = StrobeAngles {
                theta_rad: f64::from(k % 100) * 0.013 - 0.65,
                phi_rad: f64::from(k / 100) * 0.013 - 0.65,
            };
            let ((coarse, seen), (log_gain, seen_in_fine)) = (beam.read(angles), fine.read(angles));
            assert!(seen || !seen_in_fine);
            if seen_in_fine {
                let truth = lamp(angles.theta_rad, angles.phi_rad) - peak;
                if angles.theta_rad.hypot(angles.phi_rad) < 0.45 {
                    inside = inside.max((log_gain - truth).abs());
                }
                (worst, worst_of_coarse) = (
                    worst.max((log_gain - truth).abs()),
                    worst_of_coarse.max((coarse - truth).abs()),
                );
            }
        }
        assert!(
            inside < 3e-4 && worst < 0.7 * worst_of_coarse,
            "{inside} {worst} {worst_of_coarse}"
        );
        assert!(fine.roughness(0.05).1 < beam.roughness(0.05).1 / 30.0);
    }
}
