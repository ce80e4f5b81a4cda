//! Coordinate frames as types: a point of one frame cannot be used in another without the
//! transform.
//!
//! All are right-handed, in metres. Since *frame* means an image of a log elsewhere in this crate,
//! coordinate frames are called *spaces*. Transforms are named `to_from`:
//! `point_in_body = body_from_dvl * point_in_dvl`.
//!
//! ```
//! use unwater::coordinates::{Body, Dvl, Point, Transform};
//! let body_from_dvl: Transform<Body, Dvl> =
//!     Transform::from_parts([0.0, 0.0, -0.2], [0.0, 0.0, 0.0, 1.0]);
//! let in_body: Point<Body> = body_from_dvl * Point::<Dvl>::new(0.0, 0.0, 2.0);
//! assert_eq!(in_body.vector().z, 1.8);
//! ```
//!
//! ```compile_fail
//! use unwater::coordinates::{Body, Dvl, Optical, Point, Transform};
//! let body_from_dvl: Transform<Body, Dvl> = Transform::identity();
//! // A point in camera space is not a point in DVL space:
//! let wrong = body_from_dvl * Point::<Optical>::new(0.0, 0.0, 2.0);
//! ```

use std::marker::PhantomData;
use std::ops::Mul;

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// The vehicle: the space in which extrinsics are given (ROS `base_link`; z up or z down). Where
/// the camera moves in the vehicle it is fixed to the camera, see [`crate::vehicle::CameraMotion`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body;
/// The camera: x right, y down, z along the optical axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Optical;
/// The DVL or altimeter: z along its boresight, towards the seafloor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dvl;
/// The strobe: z along its boresight; θ about x, φ about y.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Strobe;

/// A position in space `S` (m).
#[derive(Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Point<S>(Vector3<f64>, PhantomData<S>);
/// A unit vector in space `S`.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Direction<S>(Vector3<f64>, PhantomData<S>);
/// A rigid transform from coordinates of `From` to coordinates of `To`.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Transform<To, From>(Isometry3<f64>, PhantomData<(To, From)>);

macro_rules! copy {
    ($($name:ident<$($p:ident),+>),+) => {$(
        impl<$($p),+> Clone for $name<$($p),+> { fn clone(&self) -> Self { *self } }
        impl<$($p),+> Copy for $name<$($p),+> {}
    )+};
}
copy!(Point<S>, Direction<S>, Transform<To, From>);

impl<S> Point<S> {
    /// From coordinates (m).
    pub fn new(x: f64, y: f64, z: f64) -> Self {
        Self(Vector3::new(x, y, z), PhantomData)
    }
    /// From a vector (m).
    pub fn from_vector(v: Vector3<f64>) -> Self {
        Self(v, PhantomData)
    }
    /// As a vector from the space's origin (m).
    pub fn vector(self) -> Vector3<f64> {
        self.0
    }
}

impl<S> Direction<S> {
    /// Normalises `v`; `None` where it has no length or is not finite.
    pub fn from_vector(v: Vector3<f64>) -> Option<Self> {
        let n = v.norm();
        (n.is_finite() && n > 1e-12).then(|| Self(v / n, PhantomData))
    }
    /// The z axis: the boresight of an instrument.
    pub fn boresight() -> Self {
        Self(Vector3::z(), PhantomData)
    }
    /// As a unit vector.
    pub fn vector(self) -> Vector3<f64> {
        self.0
    }
    /// The opposite direction.
    pub fn reversed(self) -> Self {
        Self(-self.0, PhantomData)
    }
}

impl<To, From> Transform<To, From> {
    /// Translation (m) and quaternion x, y, z, w as ROS writes them; the quaternion is normalised.
    pub fn from_parts(translation_m: [f64; 3], xyzw: [f64; 4]) -> Self {
        let q = Quaternion::new(xyzw[3], xyzw[0], xyzw[1], xyzw[2]);
        let rotation = if q.norm() > 1e-9 {
            UnitQuaternion::from_quaternion(q)
        } else {
            UnitQuaternion::identity()
        };
        Self(
            Isometry3::from_parts(Translation3::from(Vector3::from(translation_m)), rotation),
            PhantomData,
        )
    }
    /// The transform between spaces that coincide.
    pub fn identity() -> Self {
        Self(Isometry3::identity(), PhantomData)
    }
    /// From an untyped transform; the caller guarantees the spaces.
    pub fn from_isometry(isometry: Isometry3<f64>) -> Self {
        Self(isometry, PhantomData)
    }
    /// The untyped transform.
    pub fn isometry(self) -> Isometry3<f64> {
        self.0
    }
    /// The inverse transform.
    pub fn inverse(self) -> Transform<From, To> {
        Transform(self.0.inverse(), PhantomData)
    }
    /// Position of `From`'s origin in `To`.
    pub fn origin(self) -> Point<To> {
        Point(self.0.translation.vector, PhantomData)
    }
}

impl<To, From> Mul<Point<From>> for Transform<To, From> {
    type Output = Point<To>;
    fn mul(self, p: Point<From>) -> Point<To> {
        Point(self.0.rotation * p.0 + self.0.translation.vector, PhantomData)
    }
}

impl<To, From> Mul<Direction<From>> for Transform<To, From> {
    type Output = Direction<To>;
    fn mul(self, d: Direction<From>) -> Direction<To> {
        Direction(self.0.rotation * d.0, PhantomData)
    }
}

impl<To, Via, From> Mul<Transform<Via, From>> for Transform<To, Via> {
    type Output = Transform<To, From>;
    fn mul(self, other: Transform<Via, From>) -> Transform<To, From> {
        Transform(self.0 * other.0, PhantomData)
    }
}
