//! Lengths and times that must not be confused.
//!
//! A slant range lies along a sonar beam, an altitude along the seafloor's normal: both are metres,
//! and taking one for the other is an error of 8 to 15 % that goes straight into the attenuation.
//! Times are integer nanoseconds, as in the log; only differences become floating point.

/// A moment on the recording's clock [ns since its epoch, normally Unix].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Stamp(pub i64);

impl Stamp {
    /// From a ROS time. `nanos` may exceed a second; it is carried over.
    pub fn from_sec_nanos(sec: i64, nanos: i64) -> Self {
        Self(sec.saturating_mul(1_000_000_000).saturating_add(nanos))
    }

    /// This moment and so many seconds; they may be negative.
    pub fn plus_seconds(self, seconds: f64) -> Self {
        Self(self.0.saturating_add((seconds * 1e9).round() as i64))
    }

    /// Seconds from `other` to `self`; negative when `self` is earlier.
    pub fn seconds_since(self, other: Self) -> f64 {
        self.0.saturating_sub(other.0) as f64 * 1e-9
    }
}

/// Length along one sonar beam, transducer to seafloor [m]. Not an altitude.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct SlantRange(pub f64);

/// Height over the seafloor along its normal [m]. Not a depth, not a slant range.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct Altitude(pub f64);
