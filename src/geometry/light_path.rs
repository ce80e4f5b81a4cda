//! Light path through a pixel: strobe → seafloor → camera (paper §II-C and §IV-A, Eq. 4, 15).
//!
//! ```text
//! ℓ_s = (d − n·c) / (n·r)         camera at c, ray r, plane n·x = d
//! ℓ_a = |h − s|,  h = c + ℓ_s r   strobe at s, seafloor point h
//! θ = atan2(y, z), φ = atan2(x, z) of (h − s) in strobe space
//! cos γ = n·(h − s) / ℓ_a         angle of incidence on the plane
//! ```
//!
//! In: plane, terrain and extrinsics, in body space (m). Out: lengths (m), angles (rad).

use crate::coordinates::{Body, Direction, Point};
use crate::vehicle::{Camera, Lamps, MAX_LAMPS, Rig};

use super::plane::SeafloorPlane;
use super::terrain::Terrain;

/// Cosine of the angle between a ray and the seafloor normal below which the ray is grazing: the
/// seafloor where it meets the plane is unknown.
pub const MIN_COS_INCIDENCE: f64 = 0.05;

/// Direction from the strobe to a seafloor point (rad).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StrobeAngles {
    /// about the strobe's x axis: atan2(y, z)
    pub theta_rad: f64,
    /// about its y axis: atan2(x, z)
    pub phi_rad: f64,
}

/// ℓ_a, ℓ_s, (θ, φ) and cos γ of the paper. For several lamps ℓ_a and cos γ are those of one
/// equivalent lamp that gives the same irradiance, with the angles of the first; each lamp's own
/// are its [`lamp_paths`](Self::lamp_paths).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightPath {
    /// ℓ_a (m)
    pub strobe_to_seafloor_m: f64,
    /// ℓ_s (m)
    pub seafloor_to_camera_m: f64,
    /// direction in the beam
    pub angles: StrobeAngles,
    /// cos γ: cosine of the angle between the incident light and the seafloor's normal
    pub cos_incidence: f64,
    lamp_paths: [LampPath; MAX_LAMPS],
    count: usize,
}

/// Light path from one of several lamps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LampPath {
    /// ℓ_a (m)
    pub length_m: f64,
    /// direction in its beam
    pub angles: StrobeAngles,
    /// cos γ
    pub cos_incidence: f64,
    /// share of the power of all lamps
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
    /// ℓ = ℓ_a + ℓ_s (m)
    pub fn length_m(&self) -> f64 {
        self.strobe_to_seafloor_m + self.seafloor_to_camera_m
    }

    /// Paths from each of several lamps; empty for a single strobe.
    pub fn lamp_paths(&self) -> &[LampPath] {
        &self.lamp_paths[..self.count]
    }

    /// The path of a single lamp.
    pub fn via(&self, lamp: &LampPath) -> Self {
        let LampPath { length_m, angles, cos_incidence, .. } = *lamp;
        Self { strobe_to_seafloor_m: length_m, angles, cos_incidence, count: 0, ..*self }
    }

    /// Directions in the beams of all lamps.
    pub fn all_angles(&self) -> impl Iterator<Item = StrobeAngles> + '_ {
        self.lamp_paths().iter().map(|l| l.angles).chain((self.count == 0).then_some(self.angles))
    }
}

/// The light path to a seafloor point at `seafloor_to_camera_m` from the camera. `None` where no
/// lamp is above the seafloor.
///
/// All that depends on the strobe's position, and nothing else, is computed here: the search for an
/// unknown strobe position calls this function only.
pub fn light_path(
    point: Point<Body>,
    seafloor_to_camera_m: f64,
    normal: Direction<Body>,
    lamps: Lamps,
) -> Option<LightPath> {
    let mut lamp_paths = [LampPath::NONE; MAX_LAMPS];
    let mut count = 0;
    for (pose, share) in lamps.poses() {
        let from_lamp = point.vector() - pose.translation.vector;
        let length_m = from_lamp.norm();
        let cos_incidence = normal.vector().dot(&from_lamp) / length_m;
        let s = pose.rotation.inverse() * from_lamp;
        if length_m > 1e-6 && cos_incidence > 0.0 {
            let angles = StrobeAngles { theta_rad: s.y.atan2(s.z), phi_rad: s.x.atan2(s.z) };
            lamp_paths[count] = LampPath { length_m, angles, cos_incidence, share };
            count += 1;
        }
    }
    // The equivalent lamp: irradiance Σ w with w = share · cos γ / ℓ², ℓ the weighted mean.
    let weight = |l: &LampPath| l.share * l.cos_incidence / (l.length_m * l.length_m);
    let irradiance: f64 = lamp_paths[..count].iter().map(weight).sum();
    let mean_length =
        lamp_paths[..count].iter().map(|l| weight(l) * l.length_m).sum::<f64>() / irradiance;
    let is_multiple = lamps.lamps().len() > 1;
    (count > 0).then_some(LightPath {
        strobe_to_seafloor_m: if is_multiple { mean_length } else { lamp_paths[0].length_m },
        seafloor_to_camera_m,
        angles: lamp_paths[0].angles,
        cos_incidence: if is_multiple {
            irradiance * mean_length * mean_length
        } else {
            lamp_paths[0].cos_incidence
        },
        lamp_paths,
        count: if is_multiple { count } else { 0 },
    })
}

/// Geometry of one frame: camera, extrinsics and seafloor.
#[derive(Clone, Copy, Debug)]
pub struct View<'r> {
    /// calibration for the size of this image
    pub camera: &'r Camera,
    /// extrinsics
    pub rig: &'r Rig,
    /// seafloor plane of this frame
    pub plane: &'r SeafloorPlane,
    /// heights over the plane; `None` for flat seafloor
    pub terrain: Option<&'r Terrain>,
}

/// Intersection of a pixel's ray with the seafloor.
#[derive(Clone, Copy, Debug)]
pub struct SeafloorPoint {
    /// (m)
    pub position: Point<Body>,
    /// ℓ_s (m)
    pub seafloor_to_camera_m: f64,
    /// normal of the seafloor there, pointing into it
    pub normal: Direction<Body>,
}

impl View<'_> {
    /// Seafloor point of a pixel; `None` where its ray is grazing or does not meet the seafloor.
    pub fn seafloor_point(&self, u: f64, v: f64) -> Option<SeafloorPoint> {
        let (x, y) = self.camera.image_plane(u, v)?;
        self.seafloor_point_of_ray(x, y)
    }

    /// As [`Self::seafloor_point`], of image-plane coordinates x/z, y/z.
    pub fn seafloor_point_of_ray(&self, x: f64, y: f64) -> Option<SeafloorPoint> {
        let ray = Direction::from_vector(nalgebra::Vector3::new(x, y, 1.0))?;
        let ray = (self.rig.body_from_optical * ray).vector();
        let camera = self.rig.body_from_optical.origin().vector();
        let (normal, distance) = (self.plane.normal.vector(), self.plane.distance_m);
        let cos = normal.dot(&ray);
        let seafloor_to_camera_m = (distance - normal.dot(&camera)) / cos;
        if cos <= MIN_COS_INCIDENCE || seafloor_to_camera_m <= 0.0 {
            return None;
        }
        match self.terrain {
            Some(terrain) => {
                let (position, seafloor_to_camera_m, normal) = terrain.intersect(&camera, &ray)?;
                Some(SeafloorPoint {
                    position,
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

    /// The light path through a pixel.
    pub fn light_path(&self, u: f64, v: f64) -> Option<LightPath> {
        let SeafloorPoint { position, seafloor_to_camera_m, normal } = self.seafloor_point(u, v)?;
        light_path(position, seafloor_to_camera_m, normal, self.rig.strobe.lamps)
    }

    /// Distance of the camera from the plane (m).
    pub fn camera_altitude_m(&self) -> f64 {
        self.plane.camera_altitude_m(self.rig)
    }
}
