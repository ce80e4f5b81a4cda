//! The light sources of a vehicle: one strobe, or several lamps of one type that fire together.
//!
//! Each lamp has its own pose. All share one beam pattern, each about its own axes, and their light
//! adds up. They are rigidly connected.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use crate::coordinates::{Body, Point, Strobe, Transform};

/// Maximum number of lamps; any others are ignored.
pub const MAX_LAMPS: usize = 4;

/// One of several lamps.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Lamp {
    /// position relative to the first lamp, in its axes (m)
    pub offset: Vector3<f64>,
    /// rotation relative to the first lamp
    pub rotation: UnitQuaternion<f64>,
    /// share of the total power; the shares sum to 1
    pub share: f64,
}

/// Poses and relative power of all lamps.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "LampList", into = "LampList")]
pub struct Lamps {
    body_from_strobe: Transform<Body, Strobe>,
    lamps: [Lamp; MAX_LAMPS],
    count: usize,
}

/// The same as in a file.
#[derive(Serialize, Deserialize)]
struct LampList {
    body_from_strobe: Transform<Body, Strobe>,
    lamps: Vec<Lamp>,
}

impl From<Lamps> for LampList {
    fn from(lamps: Lamps) -> Self {
        Self { body_from_strobe: lamps.body_from_strobe, lamps: lamps.lamps().to_vec() }
    }
}

impl TryFrom<LampList> for Lamps {
    type Error = String;

    fn try_from(LampList { body_from_strobe, lamps }: LampList) -> Result<Self, String> {
        if !(1..=MAX_LAMPS).contains(&lamps.len()) {
            return Err(format!("{} lamps; 1 to {MAX_LAMPS} are expected", lamps.len()));
        }
        let mut all = Self { count: lamps.len(), ..Self::one(body_from_strobe) };
        all.lamps.iter_mut().zip(lamps).for_each(|(of_all, lamp)| *of_all = lamp);
        Ok(all)
    }
}

impl Lamps {
    /// A single strobe.
    pub fn one(body_from_strobe: Transform<Body, Strobe>) -> Self {
        let first =
            Lamp { offset: Vector3::zeros(), rotation: UnitQuaternion::identity(), share: 1.0 };
        Self { body_from_strobe, lamps: [first; MAX_LAMPS], count: 1 }
    }

    /// Several lamps, each with its relative power; `None` for no lamp, for more than
    /// [`MAX_LAMPS`], or where a power is not positive.
    pub fn several(mounts: &[(Transform<Body, Strobe>, f64)]) -> Option<Self> {
        let total: f64 = mounts.iter().map(|m| m.1).sum();
        let first = mounts.first()?.0;
        if mounts.len() > MAX_LAMPS || mounts.iter().any(|m| !m.1.is_finite() || m.1 <= 0.0) {
            return None;
        }
        let mut all = Self { count: mounts.len(), ..Self::one(first) };
        for (lamp, (mount, strength)) in all.lamps.iter_mut().zip(mounts) {
            let from_first = first.isometry().inverse() * mount.isometry();
            *lamp = Lamp {
                offset: from_first.translation.vector,
                rotation: from_first.rotation,
                share: strength / total,
            };
        }
        Some(all)
    }

    /// Pose of the first lamp.
    pub fn body_from_strobe(&self) -> Transform<Body, Strobe> {
        self.body_from_strobe
    }

    /// Position of the first lamp (m).
    pub fn origin(&self) -> Point<Body> {
        self.body_from_strobe.origin()
    }

    /// Between the first lamps of two (m).
    pub fn distance_m(&self, other: Self) -> f64 {
        (self.origin().vector() - other.origin().vector()).norm()
    }

    /// Pose of the first lamp, untyped.
    pub fn isometry(&self) -> Isometry3<f64> {
        self.body_from_strobe.isometry()
    }

    /// All lamps; the first is at the origin.
    pub fn lamps(&self) -> &[Lamp] {
        &self.lamps[..self.count]
    }

    /// Pose in body space and share of the power of each lamp.
    pub fn poses(&self) -> impl Iterator<Item = (Isometry3<f64>, f64)> + '_ {
        self.lamps().iter().map(|l| {
            (
                self.isometry() * Isometry3::from_parts(Translation3::from(l.offset), l.rotation),
                l.share,
            )
        })
    }

    /// The same lamps with the first at another position in the body (m); rotations are unchanged.
    pub fn moved_to(&self, position: Vector3<f64>) -> Self {
        let mut isometry = self.isometry();
        isometry.translation.vector = position;
        Self { body_from_strobe: Transform::from_isometry(isometry), ..*self }
    }
}
