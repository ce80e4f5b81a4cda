//! What seafloor planes that were assumed level are off by, by a model, for one log.

use std::collections::BTreeMap;

use crate::geometry::PlaneChange;
use crate::model::{TiltFile, TiltsFile};
use crate::units::Stamp;

/// Stamps that are rounded in other ways are the same (ns).
const SAME_NS: i64 = 1000;

/// Tilts and altitudes of planes.
#[derive(Clone, Debug)]
pub struct Tilts {
    by_stamp: BTreeMap<Stamp, PlaneChange>,
    /// of all other frames
    median: PlaneChange,
}

impl Tilts {
    /// The tilts of a model for a log; `is_own` tells of an input of the model whether it is that
    /// log. `None` where there are none: they are those of a dive, not of a vehicle.
    pub fn of(tilts: &TiltsFile, is_own: impl Fn(usize) -> bool) -> Option<Self> {
        let radians = |tilt: [f64; 2]| tilt.map(f64::to_radians);
        let of_own = |tilt: &&TiltFile| is_own(tilt.input);
        let of_frame = |of: &TiltFile| {
            let (tilt, log_scale) = (radians(of.tilt_deg), of.altitude_factor.ln());
            (Stamp(of.stamp_ns), PlaneChange { tilt, log_scale })
        };
        let by_stamp: BTreeMap<Stamp, PlaneChange> =
            tilts.frames.iter().filter(of_own).map(of_frame).collect();
        let median = PlaneChange { tilt: radians(tilts.median_deg), log_scale: 0.0 };
        (!by_stamp.is_empty()).then_some(Self { by_stamp, median })
    }

    /// What the plane of the frame is off by that the camera stamped at this time.
    pub fn at(&self, recorded: Stamp) -> PlaneChange {
        let near = Stamp(recorded.0 - SAME_NS)..=Stamp(recorded.0 + SAME_NS);
        self.by_stamp.range(near).next().map_or(self.median, |(_, plane)| *plane)
    }
}
