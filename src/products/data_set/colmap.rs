//! A COLMAP model as text: camera and poses, without points. Units are metres.
//!
//! COLMAP has the upper left corner of the upper left pixel at (0, 0), ROS its centre.

use std::fmt::Write as _;

use super::poses::CameraPoses;
use super::still::Still;
use crate::vehicle::{Camera, Distortion};

/// `cameras.txt`, `images.txt` and `points3D.txt`; `None` for lenses that COLMAP has no model of,
/// and without poses.
pub fn model(poses: &CameraPoses, stills: &[Still<'_>]) -> Option<[(&'static str, String); 3]> {
    if stills.iter().all(|still| still.pose.is_none()) {
        return None;
    }
    let camera = camera(&poses.camera)?;
    let cameras = format!(
        "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n# Number of cameras: 1\n1 {camera}\n"
    );
    let points = "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[]\n# Number of points: 0\n".into();
    let images = images(poses, stills);
    Some([("cameras.txt", cameras), ("images.txt", images), ("points3D.txt", points)])
}

fn images(poses: &CameraPoses, stills: &[Still<'_>]) -> String {
    let mut text = format!(
        "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n# (an empty line for its \
         points)\n# Poses from {}; the world is x east, y north, z up\n",
        poses.source
    );
    let posed = stills.iter().filter_map(|still| Some((still, still.pose?)));
    for (number, (still, world_from_optical)) in (1..).zip(posed) {
        let pose = world_from_optical.inverse();
        let (q, t) = (pose.rotation.quaternion(), pose.translation.vector);
        let written = writeln!(
            text,
            "{number} {:.12} {:.12} {:.12} {:.12} {:.6} {:.6} {:.6} 1 {}\n",
            q.w, q.i, q.j, q.k, t.x, t.y, t.z, still.name
        );
        debug_assert!(written.is_ok(), "text grows");
    }
    text
}

/// Model, size and parameters.
fn camera(camera: &Camera) -> Option<String> {
    let Camera { width, height, fx, fy, cx, cy, distortion } = *camera;
    let (model, coefficients) = match distortion {
        Distortion::None => ("PINHOLE", Vec::new()),
        Distortion::PlumbBob([k1, k2, p1, p2, 0.0]) => ("OPENCV", vec![k1, k2, p1, p2]),
        Distortion::PlumbBob(d) => ("FULL_OPENCV", [&d[..], &[0.0; 3]].concat()),
        Distortion::RationalPolynomial(d) => ("FULL_OPENCV", d.to_vec()),
        Distortion::Equidistant(d) => ("OPENCV_FISHEYE", d.to_vec()),
        Distortion::Fisheye62(_) | Distortion::FlatPort { .. } => return None,
    };
    let parameters = [fx, fy, cx + 0.5, cy + 0.5].into_iter().chain(coefficients);
    let parameters: Vec<String> = parameters.map(|p| p.to_string()).collect();
    Some(format!("{model} {width} {height} {}", parameters.join(" ")))
}
