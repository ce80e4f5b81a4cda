use super::*;
use crate::coordinates::Transform;
use crate::geometry::SeafloorPlane;
use crate::vehicle::{Camera, Lamps, Rig, StrobeMount};

/// A function of a view of 640×480 pixels over seafloor that is inclined about the image's rows.
fn over<T>(slope_deg: f64, of: impl FnOnce(&View<'_>) -> T) -> T {
    let (sin, cos) = slope_deg.to_radians().sin_cos();
    let camera = Camera::from_field_of_view(640, 480, 60.0);
    let mounted = Transform::identity();
    let rig = Rig {
        camera,
        body_from_optical: mounted,
        body_from_dvl: Transform::identity(),
        strobe: StrobeMount { lamps: Lamps::one(Transform::identity()), source: None },
        camera_motion: None,
    };
    let normal = Direction::from_vector(nalgebra::Vector3::new(0.0, sin, cos)).expect("a normal");
    let plane = SeafloorPlane {
        normal,
        distance_m: 2.0 * cos,
        support: Support::LeastSquares,
        returns: 4,
        residual_m: 0.0,
        nearest_ping_s: 0.0,
    };
    of(&View { camera: &camera, rig: &rig, plane: &plane, terrain: None })
}

/// Metres per pixel at a pixel, times the focal length.
fn metres(u: f64, v: f64, slope_deg: f64) -> [f64; 2] {
    over(slope_deg, |view| {
        let hit = view.seafloor_point(u, v).expect("a place").position;
        pixel_on_seafloor_m(view, u, v, &hit)
            .map(|m| m.map(|m| m * view.camera.fx))
            .expect("its size")
    })
}

#[test]
fn levels_reach_that_of_the_coarsest_corner() {
    assert!((over(0.0, coarsest_m) - 2.0).abs() < 1e-2, "level seafloor is the same everywhere");
    let [near, far] =
        [metres(0.0, 0.0, 30.0), metres(0.0, 479.0, 30.0)].map(|[a, b]| (a * b).sqrt());
    assert!(
        (over(30.0, coarsest_m) - near.max(far)).abs() < 1e-9
            && near.max(far) > 2.0 * near.min(far),
        "{near} and {far}"
    );
    assert_eq!(over(75.0, coarsest_m), f64::INFINITY, "the horizon is in view");
    assert_eq!(first_level(f64::INFINITY, &MatchingConfig::default()), i32::MAX);
}

#[test]
fn size_of_a_pixel_follows_from_depth_along_the_axis_and_slope() {
    let near = |is: [f64; 2], expected: [f64; 2]| {
        assert!(
            (0..2).all(|i| (is[i] / expected[i] - 1.0).abs() < 5e-3),
            "{is:?} instead of {expected:?}"
        );
    };
    // The size follows from the depth along the axis (2 m), not from slant range (2.4 m in the
    // corner).
    near(metres(319.5, 239.5, 0.0), [2.0, 2.0]);
    near(metres(10.0, 10.0, 0.0), [2.0, 2.0]);
    near(metres(319.5, 239.5, 30.0), [2.0, 2.0 / 30f64.to_radians().cos()]);
}
