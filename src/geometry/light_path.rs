//! The way of light through one pixel: strobe → seafloor → camera (paper §II-C and §IV-A, Eq. 4, 15).
//!
//! ```text
//! ℓ_s = (d − n·c) / (n·r)         camera at c, ray r, plane n·x = d
//! ℓ_a = |h − s|,  h = c + ℓ_s r   strobe at s, seafloor point h
//! θ = atan2(y, z), φ = atan2(x, z) of (h − s) in strobe space
//! cos γ = n·(h − s) / ℓ_a         angle of incidence on the plane
//! ```
//!
//! In: a plane and the mounts, in body space [m]. Out: lengths [m], angles [rad]. Assumed: the floor is
//! the plane, or the plane and its relief. Attenuation and beam pattern do not live here.

use crate::spaces::{Body, Direction, Point, Strobe, Transform};
use crate::vehicle::{Camera, Rig};

use super::{Relief, SeafloorPlane};

/// Direction of a seafloor point as the strobe sees it [rad].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StrobeAngles {
    /// about the strobe's x axis: atan2(y, z)
    pub theta_rad: f64,
    /// about its y axis: atan2(x, z)
    pub phi_rad: f64,
}

/// The paper's ℓ_a, ℓ_s, (θ, φ) and cos γ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightPath {
    /// ℓ_a [m]
    pub strobe_to_seafloor_m: f64,
    /// ℓ_s [m]
    pub seafloor_to_camera_m: f64,
    /// where in the beam
    pub angles: StrobeAngles,
    /// cosine of the angle between the light and the seafloor's normal
    pub cos_incidence: f64,
}

impl LightPath {
    /// ℓ = ℓ_a + ℓ_s [m]
    pub fn length_m(&self) -> f64 {
        self.strobe_to_seafloor_m + self.seafloor_to_camera_m
    }
}

/// The light path to a seafloor point that the camera sees from `seafloor_to_camera_m` away.
///
/// Everything that depends on where the strobe is, and nothing else, happens in this function: the search for
/// an unmeasured strobe moves it. `None` where the light would come from below the floor.
pub fn light_path(
    hit: Point<Body>,
    seafloor_to_camera_m: f64,
    normal: Direction<Body>,
    body_from_strobe: Transform<Body, Strobe>,
) -> Option<LightPath> {
    let from_strobe = hit.vector() - body_from_strobe.origin().vector();
    let strobe_to_seafloor_m = from_strobe.norm();
    let cos_incidence = normal.vector().dot(&from_strobe) / strobe_to_seafloor_m;
    let s = body_from_strobe.isometry().rotation.inverse() * from_strobe;
    let angles = StrobeAngles { theta_rad: s.y.atan2(s.z), phi_rad: s.x.atan2(s.z) };
    (strobe_to_seafloor_m > 1e-6 && cos_incidence > 0.0).then_some(LightPath { strobe_to_seafloor_m, seafloor_to_camera_m, angles, cos_incidence })
}

/// One frame's geometry: which way each pixel looks and what plane it meets.
#[derive(Clone, Copy, Debug)]
pub struct View<'r> {
    /// the camera at the size of this picture
    pub camera: &'r Camera,
    /// the mounts
    pub rig: &'r Rig,
    /// the seafloor below this frame
    pub plane: &'r SeafloorPlane,
    /// heights over it, where it is not flat
    pub relief: Option<&'r Relief>,
}

/// A place of the seafloor that a pixel sees.
#[derive(Clone, Copy, Debug)]
pub struct Sighted {
    /// where
    pub hit: Point<Body>,
    /// ℓ_s [m]
    pub seafloor_to_camera_m: f64,
    /// into the floor there
    pub normal: Direction<Body>,
}

impl View<'_> {
    /// Where the ray of a pixel meets the seafloor; `None` where it never does.
    pub fn seafloor_point(&self, u: f64, v: f64) -> Option<Sighted> {
        let (x, y) = self.camera.image_plane(u, v)?;
        self.seafloor_point_of(x, y)
    }

    /// The same for image-plane coordinates x/z, y/z.
    pub fn seafloor_point_of(&self, x: f64, y: f64) -> Option<Sighted> {
        let ray = Direction::from_vector(nalgebra::Vector3::new(x, y, 1.0))?;
        let ray = (self.rig.body_from_optical * ray).vector();
        let camera = self.rig.body_from_optical.origin().vector();
        let (normal, distance) = (self.plane.normal.vector(), self.plane.distance_m);
        let towards = normal.dot(&ray);
        let seafloor_to_camera_m = (distance - normal.dot(&camera)) / towards;
        // A grazing ray meets the plane so far off that nothing is known of the floor there.
        if towards <= 0.05 || seafloor_to_camera_m <= 0.0 {
            return None;
        }
        match self.relief {
            Some(relief) => {
                let (hit, seafloor_to_camera_m, normal) = relief.meet(self.plane, &camera, &ray)?;
                Some(Sighted { hit, seafloor_to_camera_m, normal: Direction::from_vector(normal)? })
            }
            None => Some(Sighted { hit: Point::from_vector(camera + ray * seafloor_to_camera_m), seafloor_to_camera_m, normal: self.plane.normal }),
        }
    }

    /// The way of light through a pixel.
    pub fn light_path(&self, u: f64, v: f64) -> Option<LightPath> {
        let Sighted { hit, seafloor_to_camera_m, normal } = self.seafloor_point(u, v)?;
        light_path(hit, seafloor_to_camera_m, normal, self.rig.strobe.body_from_strobe)
    }

    /// Height of the camera over the plane [m].
    pub fn camera_altitude_m(&self) -> f64 {
        self.plane.distance_m - self.plane.normal.vector().dot(&self.rig.body_from_optical.origin().vector())
    }
}
