//! Attitude over time, interpolated (slerp).
//!
//! The world's axes may be ENU or NED: only rotation differences and the vertical line are used,
//! which do not depend on them.

use nalgebra::{UnitQuaternion, Vector3};

use crate::units::Stamp;

/// Rotations `world_from_body` in time order.
#[derive(Clone, Debug, Default)]
pub struct AttitudeTrack {
    /// `world_from_body`
    samples: Vec<(Stamp, UnitQuaternion<f64>)>,
    /// farthest sample that is used, in time (s)
    max_gap_s: f64,
}

impl AttitudeTrack {
    /// Samples in any order; the first of equal stamps is kept.
    pub fn new(mut samples: Vec<(Stamp, UnitQuaternion<f64>)>, max_gap_s: f64) -> Self {
        samples.sort_by_key(|s| s.0);
        samples.dedup_by_key(|s| s.0);
        Self { samples, max_gap_s }
    }

    /// Whether the log has no attitude.
    pub fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.samples.len()
    }

    /// Rotation at `stamp`; `None` where there is no sample near enough in time.
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

    /// Rotation from body coordinates at time `from` to body coordinates at time `to`.
    pub fn rotation_between(&self, to: Stamp, from: Stamp) -> Option<UnitQuaternion<f64>> {
        Some(self.world_from_body(to)?.inverse() * self.world_from_body(from)?)
    }

    /// Vertical unit vector in body space; its sign depends on the world's axes.
    pub fn vertical_in_body(&self, stamp: Stamp) -> Option<Vector3<f64>> {
        Some(self.world_from_body(stamp)?.inverse() * Vector3::z())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotations_are_interpolated_but_not_across_gaps() {
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
        assert!(track.world_from_body(Stamp(4_000_000_000)).is_none(), "a gap of eight seconds");
        let rotation = track.rotation_between(Stamp(1_000_000_000), Stamp(0)).expect("both ends");
        assert!((rotation * Vector3::y() - q(-10.0) * Vector3::y()).norm() < 1e-9);
    }
}
