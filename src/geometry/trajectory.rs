//! Trajectory of the DVL over ground by dead reckoning.
//!
//! ```text
//! p(t) = ∫ q · v dt     velocity over ground v in body space, rotated by the attitude q
//! ```

use nalgebra::Vector3;

use super::ping_store::PingStore;
use crate::units::Stamp;
use crate::vehicle::{AttitudeTrack, Ping, Rig};

/// Longer gaps between velocities are not integrated over (s).
const MAX_GAP_S: f64 = 1.0;

/// Per ping the number of its segment and the DVL's position in the world (m). Positions are
/// comparable within a segment only.
#[derive(Clone, Debug, Default)]
pub struct Trajectory(Vec<(u32, Vector3<f64>)>);

impl Trajectory {
    /// Integrates the velocities; a new segment starts wherever one is missing.
    pub fn integrate(pings: &PingStore, attitude: &AttitudeTrack, rig: &Rig) -> Self {
        let velocity = |p: &Ping| {
            Some(
                attitude.world_from_body(p.stamp)?
                    * (rig.body_from_dvl.isometry().rotation * p.velocity_m_per_s?),
            )
        };
        let (mut segment, mut position) = (0, Vector3::zeros());
        let mut previous: Option<(Stamp, Vector3<f64>)> = None;
        let mut positions = Vec::with_capacity(pings.len());
        for ping in pings.iter() {
            let current = velocity(&ping);
            match (previous, current) {
                (Some((stamp, v)), Some(current))
                    if ping.stamp.seconds_since(stamp) <= MAX_GAP_S =>
                {
                    position += (v + current) / 2.0 * ping.stamp.seconds_since(stamp);
                }
                _ => segment += 1,
            }
            previous = current.map(|v| (ping.stamp, v));
            positions.push((segment, position));
        }
        Self(positions)
    }

    /// Segment and position at the `i`-th ping.
    pub fn at_ping(&self, i: usize) -> Option<(u32, Vector3<f64>)> {
        self.0.get(i).copied()
    }

    /// Segment and position at a time between two pings of one segment.
    pub fn at(&self, pings: &PingStore, stamp: Stamp) -> Option<(u32, Vector3<f64>)> {
        let after = pings.before(Stamp(stamp.0.saturating_add(1))).min(pings.len().checked_sub(1)?);
        let (a, b) = (after.checked_sub(1)?, after);
        if pings.stamp(b) < stamp {
            return None;
        }
        let (first, second) = (self.0.get(a)?, self.0.get(b)?);
        let span = pings.stamp(b).seconds_since(pings.stamp(a));
        let share = if span > 0.0 { stamp.seconds_since(pings.stamp(a)) / span } else { 0.0 };
        (first.0 == second.0).then(|| (first.0, first.1.lerp(&second.1, share)))
    }
}
