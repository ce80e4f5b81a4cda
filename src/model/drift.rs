//! Attenuation that changes along a log: nodes in time, linear between, constant beyond the ends.

use serde::{Deserialize, Serialize};

use crate::image::Bands;
use crate::units::Stamp;

/// α at one time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TimeNode {
    /// when (ns)
    pub stamp_ns: i64,
    /// α (1/m) per band
    pub attenuation_per_m: Vec<f64>,
    /// its standard deviation (1/m)
    pub attenuation_std_per_m: Vec<f64>,
}

/// α(t); no nodes where it does not change.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct AttenuationOverTime(pub Vec<TimeNode>);

impl AttenuationOverTime {
    /// α (1/m) at a time; `None` where it does not change.
    pub fn at(&self, stamp: Stamp) -> Option<Bands> {
        self.between(stamp, |n| &n.attenuation_per_m)
    }

    /// Its standard deviation (1/m) at a time.
    pub fn std_at(&self, stamp: Stamp) -> Option<Bands> {
        self.between(stamp, |n| &n.attenuation_std_per_m)
    }

    fn between(&self, stamp: Stamp, of: impl Fn(&TimeNode) -> &Vec<f64>) -> Option<Bands> {
        let after = self.0.partition_point(|n| n.stamp_ns <= stamp.0);
        let of = |node: &TimeNode, b: usize| of(node).get(b).copied().unwrap_or_default();
        Some(match (after.checked_sub(1).and_then(|i| self.0.get(i)), self.0.get(after)) {
            (Some(from), Some(to)) => {
                let share = (stamp.0 - from.stamp_ns) as f64 / (to.stamp_ns - from.stamp_ns) as f64;
                std::array::from_fn(|b| of(from, b) + (of(to, b) - of(from, b)) * share)
            }
            (Some(only), None) | (None, Some(only)) => std::array::from_fn(|b| of(only, b)),
            (None, None) => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_linear_between_nodes_and_constant_beyond() {
        let node = |stamp_ns, alpha| TimeNode {
            stamp_ns,
            attenuation_per_m: vec![alpha],
            attenuation_std_per_m: vec![0.0],
        };
        let over_time = AttenuationOverTime(vec![node(100, 0.2), node(200, 0.4)]);
        let at = |t| over_time.at(Stamp(t)).expect("nodes")[0];
        assert!((at(125) - 0.25).abs() < 1e-12);
        assert_eq!((at(0), at(100), at(200), at(999)), (0.2, 0.2, 0.4, 0.4));
        assert_eq!(AttenuationOverTime::default().at(Stamp(5)), None);
    }
}
