//! The lamps of a vehicle: one strobe, or several of one make that shine together.
//!
//! Each of several stands where it stands and looks where it looks; their beam pattern is one, each
//! about its own axes, and their light adds up. They are rigid: moved, all move.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use crate::coordinates::{Body, Point, Strobe, Transform};

/// More lamps than this shine as these.
pub const MAX_LAMPS: usize = 4;

/// One of several lamps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lamp {
    /// place from the first, along its axes [m]
    pub offset: Vector3<f64>,
    /// turn against the first
    pub rotation: UnitQuaternion<f64>,
    /// share of the light; all add up to 1
    pub share: f64,
}

/// Where the light comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lamps {
    body_from_strobe: Transform<Body, Strobe>,
    lamps: [Lamp; MAX_LAMPS],
    count: usize,
}

impl Lamps {
    /// One strobe.
    pub fn one(body_from_strobe: Transform<Body, Strobe>) -> Self {
        let first =
            Lamp { offset: Vector3::zeros(), rotation: UnitQuaternion::identity(), share: 1.0 };
        Self { body_from_strobe, lamps: [first; MAX_LAMPS], count: 1 }
    }

    /// Several, with the strength of each; `None` where there are none, or more than
    /// [`MAX_LAMPS`], or one has no strength.
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

    /// The first lamp's pose.
    pub fn body_from_strobe(&self) -> Transform<Body, Strobe> {
        self.body_from_strobe
    }

    /// The first lamp's place [m].
    pub fn origin(&self) -> Point<Body> {
        self.body_from_strobe.origin()
    }

    /// The first lamp's pose as a rigid motion.
    pub fn isometry(&self) -> Isometry3<f64> {
        self.body_from_strobe.isometry()
    }

    /// All of them.
    pub fn lamps(&self) -> &[Lamp] {
        &self.lamps[..self.count]
    }

    /// Pose and share of each.
    pub fn poses(&self) -> impl Iterator<Item = (Isometry3<f64>, f64)> + '_ {
        self.lamps().iter().map(|l| {
            (
                self.isometry() * Isometry3::from_parts(Translation3::from(l.offset), l.rotation),
                l.share,
            )
        })
    }

    /// All of them with the first at another place of the body [m].
    pub fn moved_to(&self, place: Vector3<f64>) -> Self {
        let mut isometry = self.isometry();
        isometry.translation.vector = place;
        Self { body_from_strobe: Transform::from_isometry(isometry), ..*self }
    }
}
