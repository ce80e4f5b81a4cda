//! The way of light through one pixel: strobe → seafloor → camera (paper §II-C and §IV-A, Eq. 4,
//! 15).
//!
//! ```text
//! ℓ_s = (d − n·c) / (n·r)         camera at c, ray r, plane n·x = d
//! ℓ_a = |h − s|,  h = c + ℓ_s r   strobe at s, seafloor point h
//! θ = atan2(y, z), φ = atan2(x, z) of (h − s) in strobe space
//! cos γ = n·(h − s) / ℓ_a         angle of incidence on the plane
//! ```
//!
//! In: a plane and the mounts, in body space [m]. Out: lengths [m], angles [rad]. Assumed: the
//! floor is the plane, or the plane and its relief. Attenuation and beam pattern do not live here.

use crate::coordinates::{Body, Direction, Point};
use crate::vehicle::{Camera, Lamps, MAX_LAMPS, Rig};

use super::{SeafloorPlane, Terrain};

/// Cosine of the angle between a ray and the seafloor normal below which the ray is grazing: the
/// seafloor where it meets the plane is unknown.
pub const MIN_COS_INCIDENCE: f64 = 0.05;

/// Direction of a seafloor point as the strobe sees it [rad].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StrobeAngles {
    /// about the strobe's x axis: atan2(y, z)
    pub theta_rad: f64,
    /// about its y axis: atan2(x, z)
    pub phi_rad: f64,
}

/// The paper's ℓ_a, ℓ_s, (θ, φ) and cos γ. Of several lamps: those of one that would light a white
/// floor as much, with the angles of the first; each lamp's own are its [`lamp_paths`](Self::lamp_paths).
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
    legs: [LampPath; MAX_LAMPS],
    count: usize,
}

/// The way from one of several lamps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LampPath {
    /// ℓ_a [m]
    pub length_m: f64,
    /// where in its beam
    pub angles: StrobeAngles,
    /// see [`LightPath`]
    pub cos_incidence: f64,
    /// of all the lamps' light
    pub share: f64,
}

impl LampPath {
    const NONE: Self = Self {
        length_m: 0.0,
        angles: StrobeAngles { theta_rad: 0.0, phi_rad: 0.0 },
        cos_incidence: 0.0,
        share: 0.0,
    };
}

impl LightPath {
    /// ℓ = ℓ_a + ℓ_s [m]
    pub fn length_m(&self) -> f64 {
        self.strobe_to_seafloor_m + self.seafloor_to_camera_m
    }

    /// The ways from several lamps; empty where there is one.
    pub fn lamp_paths(&self) -> &[LampPath] {
        &self.legs[..self.count]
    }

    /// The way by one of the legs alone.
    pub fn via(&self, leg: &LampPath) -> Self {
        let LampPath { length_m, angles, cos_incidence, .. } = *leg;
        Self { strobe_to_seafloor_m: length_m, angles, cos_incidence, count: 0, ..*self }
    }

    /// Directions in the lamps' beams.
    pub fn all_angles(&self) -> impl Iterator<Item = StrobeAngles> + '_ {
        self.lamp_paths().iter().map(|l| l.angles).chain((self.count == 0).then_some(self.angles))
    }
}

/// The light path to a seafloor point that the camera sees from `seafloor_to_camera_m` away.
///
/// Everything that depends on where the strobe is, and nothing else, happens in this function: the
/// search for an unmeasured strobe moves it. `None` where the light would come from below the
/// floor.
pub fn light_path(
    hit: Point<Body>,
    seafloor_to_camera_m: f64,
    normal: Direction<Body>,
    lamps: Lamps,
) -> Option<LightPath> {
    let mut legs = [LampPath::NONE; MAX_LAMPS];
    let mut count = 0;
    for (pose, share) in lamps.poses() {
        let from_lamp = hit.vector() - pose.translation.vector;
        let length_m = from_lamp.norm();
        let cos_incidence = normal.vector().dot(&from_lamp) / length_m;
        let s = pose.rotation.inverse() * from_lamp;
        if length_m > 1e-6 && cos_incidence > 0.0 {
            let angles = StrobeAngles { theta_rad: s.y.atan2(s.z), phi_rad: s.x.atan2(s.z) };
            legs[count] = LampPath { length_m, angles, cos_incidence, share };
            count += 1;
        }
    }
    // The one lamp that would send as much light to a white floor, from as far: Σ w, w = share cos
    // γ / ℓ².
    let weight = |l: &LampPath| l.share * l.cos_incidence / (l.length_m * l.length_m);
    let light: f64 = legs[..count].iter().map(weight).sum();
    let far = legs[..count].iter().map(|l| weight(l) * l.length_m).sum::<f64>() / light;
    let several = lamps.lamps().len() > 1;
    (count > 0).then_some(LightPath {
        strobe_to_seafloor_m: if several { far } else { legs[0].length_m },
        seafloor_to_camera_m,
        angles: legs[0].angles,
        cos_incidence: if several { light * far * far } else { legs[0].cos_incidence },
        legs,
        count: if several { count } else { 0 },
    })
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
    pub terrain: Option<&'r Terrain>,
}

/// A place of the seafloor that a pixel sees.
#[derive(Clone, Copy, Debug)]
pub struct SeafloorPoint {
    /// where
    pub position: Point<Body>,
    /// ℓ_s [m]
    pub seafloor_to_camera_m: f64,
    /// into the floor there
    pub normal: Direction<Body>,
}

impl View<'_> {
    /// Where the ray of a pixel meets the seafloor; `None` where it never does.
    pub fn seafloor_point(&self, u: f64, v: f64) -> Option<SeafloorPoint> {
        let (x, y) = self.camera.image_plane(u, v)?;
        self.seafloor_point_of_ray(x, y)
    }

    /// The same for image-plane coordinates x/z, y/z.
    pub fn seafloor_point_of_ray(&self, x: f64, y: f64) -> Option<SeafloorPoint> {
        let ray = Direction::from_vector(nalgebra::Vector3::new(x, y, 1.0))?;
        let ray = (self.rig.body_from_optical * ray).vector();
        let camera = self.rig.body_from_optical.origin().vector();
        let (normal, distance) = (self.plane.normal.vector(), self.plane.distance_m);
        let towards = normal.dot(&ray);
        let seafloor_to_camera_m = (distance - normal.dot(&camera)) / towards;
        if towards <= MIN_COS_INCIDENCE || seafloor_to_camera_m <= 0.0 {
            return None;
        }
        match self.terrain {
            Some(relief) => {
                let (hit, seafloor_to_camera_m, normal) = relief.meet(self.plane, &camera, &ray)?;
                Some(SeafloorPoint {
                    position: hit,
                    seafloor_to_camera_m,
                    normal: Direction::from_vector(normal)?,
                })
            }
            None => Some(SeafloorPoint {
                position: Point::from_vector(camera + ray * seafloor_to_camera_m),
                seafloor_to_camera_m,
                normal: self.plane.normal,
            }),
        }
    }

    /// The way of light through a pixel.
    pub fn light_path(&self, u: f64, v: f64) -> Option<LightPath> {
        let SeafloorPoint { position: hit, seafloor_to_camera_m, normal } =
            self.seafloor_point(u, v)?;
        light_path(hit, seafloor_to_camera_m, normal, self.rig.strobe.lamps)
    }

    /// Height of the camera over the plane [m].
    pub fn camera_altitude_m(&self) -> f64 {
        self.plane.camera_altitude_m(self.rig)
    }
}
