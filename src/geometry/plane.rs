//! The seafloor plane of a frame.

use nalgebra::{Isometry3, UnitQuaternion, Vector3};

use crate::coordinates::{Body, Direction, Optical, Transform};
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

    /// The same plane, changed.
    #[must_use]
    pub fn changed(&self, rig: &Rig, by: PlaneChange) -> Self {
        let instrument = rig.body_from_dvl.origin().vector();
        let given = (self.normal.vector(), self.distance_m);
        let (normal, distance_m) = by.of(given, &rig.body_from_optical, &instrument);
        Direction::from_vector(normal).map_or(*self, |normal| Self { normal, distance_m, ..*self })
    }

    /// The plane in other coordinates, given the pose of those in the plane's own.
    #[must_use]
    pub fn seen_from(&self, pose: &Isometry3<f64>) -> Self {
        let normal = self.normal.vector();
        let distance_m = self.distance_m - normal.dot(&pose.translation.vector);
        Direction::from_vector(pose.rotation.inverse() * normal).map_or(*self, |normal| Self {
            normal,
            distance_m,
            ..*self
        })
    }

    /// Distance of the camera from the plane, along the normal (m).
    pub fn camera_altitude_m(&self, rig: &Rig) -> f64 {
        self.distance_m - self.normal.vector().dot(&rig.body_from_optical.origin().vector())
    }
}

/// What a plane that was measured or assumed is off by.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlaneChange {
    /// rotation about the camera's x and y axes around the range instrument, whose distance from
    /// the plane it keeps (rad)
    pub tilt: [f64; 2],
    /// log of the camera's altitude over the plane thus tilted, over what it is then
    pub log_scale: f64,
}

impl PlaneChange {
    /// Normal and distance of the changed plane, that of `instrument` being its position (m).
    pub fn of(
        &self,
        plane: (Vector3<f64>, f64),
        body_from_optical: &Transform<Body, Optical>,
        instrument: &Vector3<f64>,
    ) -> (Vector3<f64>, f64) {
        let rotation = tilt_rotation(body_from_optical, self.tilt);
        let (normal, distance_m) = turned(plane, rotation, instrument);
        let of_camera_m = normal.dot(&body_from_optical.origin().vector());
        (normal, of_camera_m + (distance_m - of_camera_m) * self.log_scale.exp())
    }
}

/// Rotation about the camera's x and y axes (rad), in body space.
pub fn tilt_rotation(
    body_from_optical: &Transform<Body, Optical>,
    [about_x, about_y]: [f64; 2],
) -> UnitQuaternion<f64> {
    let axis = body_from_optical.isometry().rotation * Vector3::new(about_x, about_y, 0.0);
    UnitQuaternion::from_scaled_axis(axis)
}

/// Normal and distance of a plane that is rotated around a point (m).
pub fn turned(
    (normal, distance_m): (Vector3<f64>, f64),
    rotation: UnitQuaternion<f64>,
    around: &Vector3<f64>,
) -> (Vector3<f64>, f64) {
    let rotated = rotation * normal.normalize();
    (rotated, distance_m + (rotated - normal).dot(around))
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
