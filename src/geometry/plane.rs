//! The seafloor plane of a frame.

use crate::coordinates::{Body, Direction};
use crate::vehicle::Rig;

/// What determines a plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Support {
    /// four returns or more
    LeastSquares,
    /// three returns
    Exact,
    /// one or two returns, or an altitude only: the seafloor is assumed to be level
    AssumedLevel,
}

impl Support {
    /// Name for tables and channels.
    pub fn word(self) -> &'static str {
        match self {
            Self::LeastSquares => "least squares",
            Self::Exact => "exact",
            Self::AssumedLevel => "assumed level",
        }
    }
}

/// n·x = d in body space, n pointing from the vehicle into the seafloor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeafloorPlane {
    /// n
    pub normal: Direction<Body>,
    /// d: distance from the body's origin (m)
    pub distance_m: f64,
    /// what determines it
    pub support: Support,
    /// number of returns used
    pub returns: usize,
    /// root mean square distance of the returns from the plane (m); NaN without redundancy
    pub residual_m: f64,
    /// time between the frame and the nearest ping with a return or altitude (s)
    pub nearest_ping_s: f64,
}

impl SeafloorPlane {
    /// Level seafloor `altitude_m` below the camera; `down` is the direction of gravity.
    pub fn at_altitude(rig: &Rig, down: Direction<Body>, altitude_m: f64) -> Self {
        let camera = rig.body_from_optical.origin().vector();
        Self {
            normal: down,
            distance_m: altitude_m + down.vector().dot(&camera),
            support: Support::AssumedLevel,
            returns: 1,
            residual_m: f64::NAN,
            nearest_ping_s: 0.0,
        }
    }

    /// Distance of the camera from the plane, along the normal (m).
    pub fn camera_altitude_m(&self, rig: &Rig) -> f64 {
        self.distance_m - self.normal.vector().dot(&rig.body_from_optical.origin().vector())
    }
}

/// Why there is no plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NoSeafloor {
    /// no ping near enough in time
    NoPing {
        /// time to the nearest ping (s); infinite where there is none
        nearest_s: f64,
    },
    /// pings without a return
    NoReturn,
    /// the plane passes through the vehicle or is too steep
    Implausible,
}
