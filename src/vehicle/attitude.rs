//! Attitude over time: how the body was turned between a ping and a frame.
//!
//! In: stamped rotations `world_from_body`, whatever the world's axes (ENU or NED): only
//! differences and the vertical line are used, and both are the same in either. Out: interpolated
//! rotations (slerp).

use nalgebra::{UnitQuaternion, Vector3};

use crate::units::Stamp;

/// Rotations `world_from_body` in time order.
#[derive(Clone, Debug, Default)]
pub struct AttitudeTrack {
    samples: Vec<(Stamp, UnitQuaternion<f64>)>,
    /// a gap longer than this is not bridged [s]
    max_gap_s: f64,
}

impl AttitudeTrack {
    /// Sorts the samples; keeps the first of equal stamps.
    pub fn new(mut samples: Vec<(Stamp, UnitQuaternion<f64>)>, max_gap_s: f64) -> Self {
        samples.sort_by_key(|s| s.0);
        samples.dedup_by_key(|s| s.0);
        Self { samples, max_gap_s }
    }

    /// Whether there is any.
    pub fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }

    /// How many samples there are.
    pub fn len(&self) -> usize {
        self.samples.len()
    }

    /// Rotation at `stamp`; `None` where the log has none within the gap.
    pub fn world_from_body(&self, stamp: Stamp) -> Option<UnitQuaternion<f64>> {
        let after = self.samples.partition_point(|s| s.0 < stamp);
        let near = |s: &(Stamp, UnitQuaternion<f64>)| {
            (s.0.seconds_since(stamp).abs() <= self.max_gap_s).then_some(s.1)
        };
        match (after.checked_sub(1).and_then(|i| self.samples.get(i)), self.samples.get(after)) {
            (Some(a), Some(b)) if b.0.seconds_since(a.0) <= 2.0 * self.max_gap_s => {
                let share = stamp.seconds_since(a.0) / b.0.seconds_since(a.0);
                Some(a.1.try_slerp(&b.1, share, 1e-9).unwrap_or(a.1))
            }
            (Some(a), Some(b)) => near(a).or_else(|| near(b)),
            (Some(a), None) => near(a),
            (None, Some(b)) => near(b),
            (None, None) => None,
        }
    }

    /// The rotation that takes body coordinates at `from` to body coordinates at `to`.
    pub fn rotation_between(&self, to: Stamp, from: Stamp) -> Option<UnitQuaternion<f64>> {
        Some(self.world_from_body(to)?.inverse() * self.world_from_body(from)?)
    }

    /// The vertical line in body space; which end is down is for the caller to say.
    pub fn vertical_in_body(&self, stamp: Stamp) -> Option<Vector3<f64>> {
        Some(self.world_from_body(stamp)?.inverse() * Vector3::z())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_are_interpolated_and_gaps_are_not() {
        let q = |deg: f64| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), deg.to_radians());
        let track = AttitudeTrack::new(
            vec![
                (Stamp(1_000_000_000), q(10.0)),
                (Stamp(0), q(0.0)),
                (Stamp(9_000_000_000), q(0.0)),
            ],
            0.6,
        );
        let half = track.world_from_body(Stamp(500_000_000)).expect("between two samples");
        assert!((half.angle().to_degrees() - 5.0).abs() < 1e-9);
        assert!(
            track.world_from_body(Stamp(4_000_000_000)).is_none(),
            "eight seconds are not bridged"
        );
        let turn = track.rotation_between(Stamp(1_000_000_000), Stamp(0)).expect("both ends");
        assert!((turn * Vector3::y() - q(-10.0) * Vector3::y()).norm() < 1e-9);
    }
}
