//! The camera's clock (s) and the rotation of the range instrument's mount about the camera's x
//! and y axes (rad): both move the seafloor plane under a frame.
//!
//! A late clock pairs every frame with the plane of another moment; a rotated mount tilts every
//! plane in the same way.

use nalgebra::Vector3;

use super::Parameter;
use crate::coordinates::{Body, Direction, Optical, Point, Transform};
use crate::geometry::{LightPath, MIN_COS_INCIDENCE, PlaneChange, tilt_rotation};
use crate::solver::{Observation, Sample};
use crate::vehicle::Lamps;

/// Seconds from a frame to the planes around it.
pub const PLANES_AROUND_S: f64 = 0.3;
/// The parabola through the planes is followed this many times as far as they lie.
const MAX_EXTRAPOLATION: f64 = 2.0;
/// Steps of the numeric derivatives: clock (s), rotations (rad).
const STEPS: [f64; 3] = [0.02, 0.005, 0.005];

/// The seafloor plane under a frame, and shortly before and after it.
#[derive(Clone, Copy, Debug)]
pub struct PlaneTrack {
    /// normal n, pointing into the seafloor, and distance d of n·x = d (m)
    pub plane: (Direction<Body>, f64),
    /// the same `PLANES_AROUND_S` earlier and later, where pings allow
    pub around: Option<[(Direction<Body>, f64); 2]>,
}

/// Planes with the clock off by x (s) and rotated by y, z about the camera's axes (rad), around
/// the range instrument.
#[derive(Clone, Copy)]
pub struct ShiftedPlanes<'s> {
    /// by frame
    pub planes: &'s [PlaneTrack],
    /// the camera's mount
    pub body_from_optical: Transform<Body, Optical>,
    /// position of the range instrument in the body (m)
    pub instrument: Vector3<f64>,
    /// clock (s) and rotations (rad)
    pub by: Vector3<f64>,
    /// see [`PlaneChange`]
    pub log_scale: f64,
}

impl<'s> ShiftedPlanes<'s> {
    /// The rotation as a vector in body space (rad).
    pub fn rotation(&self) -> Vector3<f64> {
        tilt_rotation(&self.body_from_optical, [self.by.y, self.by.z]).scaled_axis()
    }

    /// The three unknowns: clock, rotation about the camera's x axis, about its y axis.
    pub fn parameters(self, lamps: Lamps) -> Vec<Parameter<'s>> {
        let stepped = move |k: usize, step: f64| {
            let mut by = self.by;
            by[k] += step;
            Self { by, ..self }
        };
        (0..3)
            .map(|k| Parameter {
                step: STEPS[k],
                path: Box::new(move |o, step| stepped(k, step).path(o, lamps)),
            })
            .collect()
    }

    /// The light path of an observation over the shifted plane.
    pub fn path(&self, o: &Observation, lamps: Lamps) -> Option<LightPath> {
        self.sample(o.frame, &o.sample)?.path(lamps)
    }

    /// A sample of a frame over the shifted plane. What stands above the plane as given stands
    /// above the shifted one.
    pub fn sample(&self, frame: u32, sample: &Sample) -> Option<Sample> {
        let track = self.planes.get(frame as usize)?;
        let (normal, distance) = self.plane(track);
        let given = track.plane.0.vector();
        let camera = self.body_from_optical.origin().vector();
        let ray = (sample.hit.vector() - camera) / sample.seafloor_to_camera_m;
        let range = |normal: &Vector3<f64>, distance: f64| {
            let (towards, along) = (normal.dot(&ray), distance - normal.dot(&camera));
            (towards > MIN_COS_INCIDENCE && along > 0.0).then(|| along / towards)
        };
        let seafloor_to_camera_m =
            sample.seafloor_to_camera_m + range(&normal, distance)? - range(&given, track.plane.1)?;
        let normal = Direction::from_vector(sample.normal.vector() + normal - given)?;
        let hit = Point::from_vector(camera + ray * seafloor_to_camera_m);
        Some(Sample { hit, seafloor_to_camera_m, normal, ..*sample })
    }

    /// n and d of the shifted plane.
    pub fn plane(&self, track: &PlaneTrack) -> (Vector3<f64>, f64) {
        let (mut normal, mut distance) = (track.plane.0.vector(), track.plane.1);
        if let Some([before, after]) = track.around {
            // A parabola through three planes: a swell curves.
            let t = (self.by.x / PLANES_AROUND_S).clamp(-MAX_EXTRAPOLATION, MAX_EXTRAPOLATION);
            let (b, n, a) = (t * (t - 1.0) / 2.0, 1.0 - t * t, t * (t + 1.0) / 2.0);
            normal = before.0.vector() * b + normal * n + after.0.vector() * a;
            distance = before.1 * b + distance * n + after.1 * a;
        }
        let change = PlaneChange { tilt: [self.by.y, self.by.z], log_scale: self.log_scale };
        change.of((normal, distance), &self.body_from_optical, &self.instrument)
    }
}
