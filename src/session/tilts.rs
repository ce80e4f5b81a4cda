//! Tilts of seafloor planes that were assumed level, by a model, for one log.

use std::collections::BTreeMap;

use crate::model::{ModelFile, TiltFile};
use crate::units::Stamp;

/// Stamps that are rounded in other ways are the same (ns).
const SAME_NS: i64 = 1000;

/// Tilts about the camera's x and y axes (rad).
#[derive(Clone, Debug)]
pub struct Tilts {
    by_stamp: BTreeMap<Stamp, [f64; 2]>,
    /// of all other frames
    median: [f64; 2],
}

impl Tilts {
    /// The tilts of a model for a log; `is_own` tells for each input of the model whether it is
    /// that log. `None` where there are none: they are those of a dive, not of a vehicle.
    pub fn of(file: &ModelFile, is_own: &[bool]) -> Option<Self> {
        let tilts = file.tilts.as_ref()?;
        let radians = |tilt: [f64; 2]| tilt.map(f64::to_radians);
        let of_own = |tilt: &&TiltFile| is_own.get(tilt.input).is_some_and(|is_own| *is_own);
        let of_frame = |tilt: &TiltFile| (Stamp(tilt.stamp_ns), radians(tilt.tilt_deg));
        let by_stamp: BTreeMap<Stamp, [f64; 2]> =
            tilts.frames.iter().filter(of_own).map(of_frame).collect();
        (!by_stamp.is_empty()).then(|| Self { by_stamp, median: radians(tilts.median_deg) })
    }

    /// The tilt of the frame that the camera stamped at this time.
    pub fn at(&self, recorded: Stamp) -> [f64; 2] {
        let near = Stamp(recorded.0 - SAME_NS)..=Stamp(recorded.0 + SAME_NS);
        self.by_stamp.range(near).next().map_or(self.median, |(_, tilt)| *tilt)
    }
}
