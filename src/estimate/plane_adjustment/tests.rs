use nalgebra::{Isometry3, Rotation3, UnitQuaternion};

use super::*;
use crate::coordinates::{Direction, Point, Transform};
use crate::estimate::CameraKnown;
use crate::estimate::samples::FrameSamples;
use crate::solver::Sample;
use crate::vehicle::Lamps;

const CAMERA: Vector3<f64> = Vector3::new(0.3, 0.05, 0.1);
const PRIOR: [f64; 2] = [0.02, 0.05];

/// The camera looks along the body's z axis; the range instrument is the body's origin.
fn mounts() -> Mounts {
    let ahead = Isometry3::new(CAMERA, Vector3::zeros());
    Mounts {
        body_from_optical: Transform::from_isometry(ahead),
        lamps: Lamps::one(Transform::identity()),
        strobe_is_measured: true,
        instrument: Vector3::zeros(),
        camera: CameraKnown::default(),
    }
}

/// The body of a frame over the seafloor z = 0, tilted about its x and y axes.
fn body(f: usize, step_m: f64, tilt: [f64; 2]) -> Isometry3<f64> {
    let t = f as f64;
    let at = Vector3::new(step_m * t, 0.1 * (0.5 * t).sin(), 2.0 + 0.5 * (0.4 * t).sin());
    let down = UnitQuaternion::from_euler_angles(std::f64::consts::PI, 0.0, 0.1 * t.sin());
    let turn = Rotation3::from_scaled_axis(-Vector3::new(tilt[0], tilt[1], 0.0));
    Isometry3::from_parts(at.into(), down * UnitQuaternion::from_rotation_matrix(&turn))
}

/// Frames that take their seafloor to be level, and what they see of it: every `stray`-th point
/// is another one in every second frame.
fn dive(
    step_m: f64,
    tilt: &dyn Fn(usize) -> [f64; 2],
    stray: usize,
) -> (Vec<FrameSamples>, Vec<Track>) {
    let bodies: Vec<_> = (0..70).map(|f| body(f, step_m, tilt(f))).collect();
    let normal = Direction::boresight();
    let distance_m = |body: &Isometry3<f64>| body.translation.vector.z;
    let of_frame = |(f, body): (usize, &Isometry3<f64>)| FrameSamples {
        normal,
        distance_m: distance_m(body),
        ..FrameSamples::of_level_seafloor(f, distance_m(body) - CAMERA.z)
    };
    let of_point = |k: usize| {
        let spread = |by: f64| (by * k as f64).fract();
        let point = Vector3::new(step_m * 70.0 * spread(0.618), 2.0 * spread(0.754) - 1.0, 0.0);
        let seen = |(f, body): (usize, &Isometry3<f64>)| {
            let off = if k.is_multiple_of(stray) && f.is_multiple_of(2) { 0.2 } else { 0.0 };
            let point = point + Vector3::new(off, 0.0, 0.0);
            let from_camera = body.inverse_transform_point(&point.into()).coords - CAMERA;
            let is_in_view = from_camera.xy().norm() < 0.4 * from_camera.z;
            let range_m = (distance_m(body) - CAMERA.z) / from_camera.normalize().z;
            let hit = Point::from_vector(CAMERA + from_camera.normalize() * range_m);
            let sample = Sample { hit, seafloor_to_camera_m: range_m, normal, log_color: [0.0; 3] };
            is_in_view.then_some(Observation { frame: f as u32, sample })
        };
        bodies.iter().enumerate().filter_map(seen).collect::<Track>()
    };
    let tracks = (0..2500).map(of_point).filter(|t| t.len() > 1).collect();
    (bodies.iter().enumerate().map(of_frame).collect(), tracks)
}

fn found(frames: &[FrameSamples], tracks: &[Track]) -> Option<Vec<PlaneChange>> {
    let mounts = mounts();
    planes(&Dataset::plain(frames, tracks, mounts.body_from_optical, mounts.lamps), &mounts, PRIOR)
}

#[test]
fn overlaps_show_how_frames_are_tilted() {
    let tilt = |f: usize| [0.03 + 0.04 * (0.7 * f as f64).sin(), -0.02 + 0.03 * (f as f64).cos()];
    let (frames, tracks) = dive(0.3, &tilt, 10);
    let found = found(&frames, &tracks).expect("tilts");
    for (f, found) in found.iter().enumerate() {
        for (axis, expected) in tilt(f).into_iter().enumerate() {
            let error = found.tilt[axis] - expected;
            assert!(error.abs() < 0.002, "frame {f}, axis {axis}: {error:.5}");
        }
    }
}

#[test]
fn frames_that_do_not_overlap_show_no_tilts() {
    let (frames, tracks) = dive(2.0, &|_| [0.03, 0.0], 10);
    assert_eq!(found(&frames, &tracks), None);
}
