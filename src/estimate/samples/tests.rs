use super::*;
use crate::coordinates::Transform;
use crate::geometry::SeafloorPlane;
use crate::vehicle::{Camera, Lamps, Rig, StrobeMount};

/// What is asked of a view of 640×480 pixels, over a floor that tips by so much about the
/// image's rows.
fn over<T>(tipped_deg: f64, ask: impl FnOnce(&View<'_>) -> T) -> T {
    let (sin, cos) = tipped_deg.to_radians().sin_cos();
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
    ask(&View { camera: &camera, rig: &rig, plane: &plane, terrain: None })
}

/// Metres to a pixel at a place, times the focal length.
fn metres(u: f64, v: f64, tipped_deg: f64) -> [f64; 2] {
    over(tipped_deg, |view| {
        let hit = view.seafloor_point(u, v).expect("a place").position;
        pixel_on_seafloor_m(view, u, v, &hit)
            .map(|m| m.map(|m| m * view.camera.fx))
            .expect("its size")
    })
}

#[test]
fn ladders_go_as_far_up_as_the_coarsest_corner() {
    assert!((over(0.0, coarsest_m) - 2.0).abs() < 1e-2, "a level floor is the same everywhere");
    let [near, far] =
        [metres(0.0, 0.0, 30.0), metres(0.0, 479.0, 30.0)].map(|[a, b]| (a * b).sqrt());
    assert!(
        (over(30.0, coarsest_m) - near.max(far)).abs() < 1e-9
            && near.max(far) > 2.0 * near.min(far),
        "{near} and {far}"
    );
    assert_eq!(
        over(75.0, coarsest_m),
        f64::INFINITY,
        "where the horizon is in sample, nobody knows"
    );
    assert_eq!(first_rung(f64::INFINITY, &MatchingConfig::default()), i32::MAX);
}

#[test]
fn a_pixel_covers_as_much_floor_as_lies_square_to_the_axis_and_more_on_a_slope() {
    let near = |is: [f64; 2], ought: [f64; 2]| {
        assert!(
            (0..2).all(|i| (is[i] / ought[i] - 1.0).abs() < 5e-3),
            "{is:?} instead of {ought:?}"
        );
    };
    // Slant range would say 2.4 m in the corner; it is the depth along the axis, 2 m, that a
    // pixel's size goes by.
    near(metres(319.5, 239.5, 0.0), [2.0, 2.0]);
    near(metres(10.0, 10.0, 0.0), [2.0, 2.0]);
    near(metres(319.5, 239.5, 30.0), [2.0, 2.0 / 30f64.to_radians().cos()]);
}
