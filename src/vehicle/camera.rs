//! Camera calibration: pixel ⇄ ray (paper §II-E).
//!
//! Pixel coordinates: the centre of the upper left pixel is (0, 0), as in ROS and OpenCV. Rays are
//! unit vectors in optical space (x right, y down, z along the optical axis). Distortion models of
//! `sensor_msgs/CameraInfo` (plumb_bob, rational_polynomial, equidistant) and Foxglove (fisheye62),
//! each also calibrated in air and used in water behind a flat port.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::coordinates::{Direction, Optical};

/// Lens distortion and its coefficients, in ROS order.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Distortion {
    /// a pinhole
    None,
    /// Brown-Conrady: k1, k2, p1, p2, k3
    PlumbBob([f64; 5]),
    /// k1, k2, p1, p2, k3, k4, k5, k6
    RationalPolynomial([f64; 8]),
    /// Kannala-Brandt: k1 to k4 over the angle from the axis
    Equidistant([f64; 4]),
    /// as equidistant, k0 to k3, and two tangential terms p0, p1
    Fisheye62([f64; 6]),
    /// calibrated in air, used in water behind a flat port: rays are refracted at the port (Snell)
    /// before they reach the lens
    FlatPort {
        /// of water against air
        refractive_index: f64,
        /// the lens in air
        model: LensModel,
        /// its coefficients, in the model's order
        coefficients: [f64; 8],
    },
}

/// A lens model's name, for [`Distortion::FlatPort`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LensModel {
    /// a pinhole
    None,
    /// see [`Distortion::PlumbBob`]
    PlumbBob,
    /// see [`Distortion::RationalPolynomial`]
    RationalPolynomial,
    /// see [`Distortion::Equidistant`]
    Equidistant,
    /// see [`Distortion::Fisheye62`]
    Fisheye62,
}

/// The first `N` coefficients; missing ones are 0.
fn padded<const N: usize>(d: &[f64]) -> [f64; N] {
    std::array::from_fn(|i| d.get(i).copied().unwrap_or(0.0))
}

impl Distortion {
    /// From a model name and coefficients as in messages; missing coefficients are 0.
    ///
    /// # Errors
    /// The name of an unknown model.
    pub fn named(model: &str, d: &[f64]) -> Result<Self, String> {
        if d.iter().all(|v| *v == 0.0)
            && !matches!(model, "equidistant" | "fisheye" | "kannala_brandt" | "fisheye62")
        {
            return Ok(Self::None);
        }
        match model {
            "" | "none" => Ok(Self::None),
            "plumb_bob" | "radtan" if d.len() <= 5 => Ok(Self::PlumbBob(padded(d))),
            "rational_polynomial" | "plumb_bob" | "radtan" => {
                Ok(Self::RationalPolynomial(padded(d)))
            }
            "equidistant" | "fisheye" | "kannala_brandt" => Ok(Self::Equidistant(padded(d))),
            // A seventh number, the maximum angle, is not needed within a calibrated image.
            "fisheye62" => Ok(Self::Fisheye62(padded(d))),
            other => Err(other.into()),
        }
    }

    /// The name used in `CameraInfo`.
    pub fn name(&self) -> &'static str {
        match self {
            Self::None | Self::PlumbBob(_) => "plumb_bob",
            Self::RationalPolynomial(_) => "rational_polynomial",
            Self::Equidistant(_) => "equidistant",
            Self::Fisheye62(_) => "fisheye62",
            Self::FlatPort { .. } => self.in_air().name(),
        }
    }

    /// Coefficients in ROS order; five zeros for a pinhole.
    pub fn coefficients(&self) -> Vec<f64> {
        match self {
            Self::None => vec![0.0; 5],
            Self::PlumbBob(d) => d.to_vec(),
            Self::RationalPolynomial(d) => d.to_vec(),
            Self::Equidistant(d) => d.to_vec(),
            Self::Fisheye62(d) => d.to_vec(),
            Self::FlatPort { .. } => self.in_air().coefficients(),
        }
    }

    /// The lens in air, without the flat port.
    pub fn in_air(&self) -> Self {
        let Self::FlatPort { model, coefficients: d, .. } = self else { return *self };
        match model {
            LensModel::None => Self::None,
            LensModel::PlumbBob => Self::PlumbBob(padded(d)),
            LensModel::RationalPolynomial => Self::RationalPolynomial(padded(d)),
            LensModel::Equidistant => Self::Equidistant(padded(d)),
            LensModel::Fisheye62 => Self::Fisheye62(padded(d)),
        }
    }

    /// A lens calibrated in air, behind a flat port in water.
    fn behind_flat_port(&self, refractive_index: f64) -> Self {
        let air = self.in_air();
        let model = match air {
            Self::PlumbBob(_) => LensModel::PlumbBob,
            Self::RationalPolynomial(_) => LensModel::RationalPolynomial,
            Self::Equidistant(_) => LensModel::Equidistant,
            Self::Fisheye62(_) => LensModel::Fisheye62,
            Self::None | Self::FlatPort { .. } => LensModel::None,
        };
        Self::FlatPort { refractive_index, model, coefficients: padded(&air.coefficients()) }
    }

    /// Undistorted → distorted image-plane coordinates (both x/z, y/z).
    fn distort(&self, x: f64, y: f64) -> (f64, f64) {
        let brown = |radial: f64, p1: f64, p2: f64| {
            let r2 = x * x + y * y;
            (
                x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
                y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
            )
        };
        let r2 = x * x + y * y;
        match self {
            Self::None => (x, y),
            Self::PlumbBob([k1, k2, p1, p2, k3]) => {
                brown(1.0 + r2 * (k1 + r2 * (k2 + r2 * k3)), *p1, *p2)
            }
            Self::RationalPolynomial([k1, k2, p1, p2, k3, k4, k5, k6]) => brown(
                (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6))),
                *p1,
                *p2,
            ),
            Self::Equidistant([k1, k2, k3, k4]) => {
                let r = r2.sqrt();
                if r < 1e-12 {
                    return (x, y);
                }
                let a = r.atan();
                let a2 = a * a;
                let scale = a * (1.0 + a2 * (k1 + a2 * (k2 + a2 * (k3 + a2 * k4)))) / r;
                (x * scale, y * scale)
            }
            Self::Fisheye62([k0, k1, k2, k3, p0, p1]) => {
                let (x, y) = Self::Equidistant([*k0, *k1, *k2, *k3]).distort(x, y);
                let (r2, dot) = (x * x + y * y, x * p0 + y * p1);
                (x + 2.0 * x * dot + p0 * r2, y + 2.0 * y * dot + p1 * r2)
            }
            Self::FlatPort { refractive_index: n, .. } => {
                // Snell: sin in air = n · sin in water. Image-plane coordinates in water are scaled
                // by 1/n, since the focal length in water is n times the one in air.
                let sin_in_air = n * (r2 / (1.0 + r2)).sqrt();
                // NaN beyond the critical angle
                let tan_in_air = sin_in_air / (1.0 - sin_in_air * sin_in_air).sqrt();
                let scale = if r2 > 1e-18 { tan_in_air / r2.sqrt() } else { *n };
                let (x, y) = self.in_air().distort(x * scale, y * scale);
                (x / n, y / n)
            }
        }
    }
}

/// A calibrated camera.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// image width (px)
    pub width: usize,
    /// image height (px)
    pub height: usize,
    /// focal length along x (px)
    pub fx: f64,
    /// focal length along y (px)
    pub fy: f64,
    /// principal point (px)
    pub cx: f64,
    /// principal point (px)
    pub cy: f64,
    /// lens distortion
    pub distortion: Distortion,
}

impl Camera {
    /// A pinhole with horizontal field of view `hfov_deg`.
    pub fn from_field_of_view(width: usize, height: usize, hfov_deg: f64) -> Self {
        let f = width as f64 / 2.0 / (hfov_deg.to_radians() / 2.0).tan();
        Self {
            width,
            height,
            fx: f,
            fy: f,
            cx: (width as f64 - 1.0) / 2.0,
            cy: (height as f64 - 1.0) / 2.0,
            distortion: Distortion::None,
        }
    }

    /// The calibration for scaled images; `None` where the aspect ratio differs by 2 % or more.
    pub fn scaled_to(&self, width: usize, height: usize) -> Option<Self> {
        if (width, height) == (self.width, self.height) {
            return Some(*self);
        }
        let (sx, sy) = (width as f64 / self.width as f64, height as f64 / self.height as f64);
        ((sx / sy - 1.0).abs() < 0.02).then_some(Self {
            width,
            height,
            fx: self.fx * sx,
            fy: self.fy * sy,
            cx: (self.cx + 0.5) * sx - 0.5,
            cy: (self.cy + 0.5) * sy - 0.5,
            ..*self
        })
    }

    /// A camera calibrated in air, used in water behind a thin flat port perpendicular to the
    /// optical axis.
    pub fn behind_flat_port(&self, refractive_index: f64) -> Self {
        let distortion = self.distortion.behind_flat_port(refractive_index);
        Self { fx: self.fx * refractive_index, fy: self.fy * refractive_index, distortion, ..*self }
    }

    /// The calibration without the flat port; inverts [`Self::behind_flat_port`].
    pub fn as_calibrated(&self) -> Self {
        match self.distortion {
            Distortion::FlatPort { refractive_index: n, .. } => Self {
                fx: self.fx / n,
                fy: self.fy / n,
                distortion: self.distortion.in_air(),
                ..*self
            },
            _ => *self,
        }
    }

    /// The camera of rectified images: without distortion.
    pub fn rectified(&self) -> Self {
        Self { distortion: Distortion::None, ..*self }
    }

    /// Image-plane coordinates x/z, y/z of a pixel: the distortion inverted by Newton's method with
    /// a numeric Jacobian. `None` where it cannot be inverted (beyond the model's range).
    pub fn image_plane(&self, u: f64, v: f64) -> Option<(f64, f64)> {
        let (xd, yd) = ((u - self.cx) / self.fx, (v - self.cy) / self.fy);
        if self.distortion == Distortion::None {
            return Some((xd, yd));
        }
        let (mut x, mut y) = match self.distortion {
            // A wide equidistant lens is far from a pinhole: start at the angle itself.
            Distortion::Equidistant(_) | Distortion::Fisheye62(_) => {
                let r = xd.hypot(yd);
                let scale = if r > 1e-9 { r.min(1.5).tan() / r } else { 1.0 };
                (xd * scale, yd * scale)
            }
            _ => (xd, yd),
        };
        for _ in 0..30 {
            let (fx, fy) = self.distortion.distort(x, y);
            let (ex, ey) = (fx - xd, fy - yd);
            if ex.hypot(ey) < 1e-12 {
                return Some((x, y));
            }
            let h = 1e-6 * (1.0 + x.abs().max(y.abs()));
            let (ax, ay) = self.distortion.distort(x + h, y);
            let (bx, by) = self.distortion.distort(x, y + h);
            let (j11, j21, j12, j22) = ((ax - fx) / h, (ay - fy) / h, (bx - fx) / h, (by - fy) / h);
            let det = j11 * j22 - j12 * j21;
            if !det.is_finite() || det.abs() < 1e-9 {
                return None;
            }
            let (dx, dy) = ((ex * j22 - ey * j12) / det, (ey * j11 - ex * j21) / det);
            let step = dx.hypot(dy);
            let limit = 0.5 * (1.0 + x.hypot(y));
            let damp = if step > limit { limit / step } else { 1.0 };
            (x, y) = (x - dx * damp, y - dy * damp);
        }
        let (fx, fy) = self.distortion.distort(x, y);
        ((fx - xd).hypot(fy - yd) < 1e-6).then_some((x, y))
    }

    /// The ray of a pixel; `None` where the distortion cannot be inverted.
    pub fn ray(&self, u: f64, v: f64) -> Option<Direction<Optical>> {
        let (x, y) = self.image_plane(u, v)?;
        Direction::from_vector(Vector3::new(x, y, 1.0))
    }

    /// The pixel of image-plane coordinates x/z, y/z.
    pub fn pixel(&self, x: f64, y: f64) -> (f64, f64) {
        let (xd, yd) = self.distortion.distort(x, y);
        (self.fx * xd + self.cx, self.fy * yd + self.cy)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_model_is_inverted() {
        let models = [
            Distortion::None,
            Distortion::PlumbBob([0.28, 0.12, 0.001, -0.002, 0.05]),
            Distortion::PlumbBob([-0.25, 0.07, 0.0005, 0.0003, 0.0]),
            Distortion::RationalPolynomial([0.4, 0.1, 0.001, 0.001, 0.01, 0.2, 0.02, 0.001]),
            Distortion::Equidistant([0.02, -0.01, 0.003, 0.0]),
            Distortion::Fisheye62([0.02, -0.01, 0.003, 0.0, 0.001, -0.002]),
            Distortion::PlumbBob([-0.25, 0.07, 0.0005, 0.0003, 0.0]).behind_flat_port(1.33),
            Distortion::Equidistant([0.02, -0.01, 0.003, 0.0]).behind_flat_port(1.33),
        ];
        for distortion in models {
            let camera = Camera {
                width: 1360,
                height: 1024,
                fx: 1100.0,
                fy: 1090.0,
                cx: 690.0,
                cy: 500.0,
                distortion,
            };
            for v in (0..1024).step_by(93) {
                for u in (0..1360).step_by(97) {
                    let (x, y) = camera.image_plane(f64::from(u), f64::from(v)).expect("a ray");
                    let (u2, v2) = camera.pixel(x, y);
                    assert!(
                        (u2 - f64::from(u)).hypot(v2 - f64::from(v)) < 1e-6,
                        "{distortion:?} at {u},{v}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_flat_port_refracts() {
        let air = Camera::from_field_of_view(1360, 1024, 70.0);
        let water = air.behind_flat_port(1.33);
        let back = water.as_calibrated();
        assert!(
            (water.fx / air.fx - 1.33).abs() < 1e-12
                && (back.fx - air.fx).abs() < 1e-9
                && back.distortion == air.distortion
        );
        let angle = |c: &Camera| c.ray(1300.0, c.cy).map(|r| r.vector().x).expect("a ray");
        assert!(
            (angle(&air) / angle(&water) - 1.33).abs() < 1e-9,
            "the sines have the ratio of the refractive index"
        );
    }

    #[test]
    fn a_ray_points_right_and_down() {
        let camera = Camera::from_field_of_view(640, 480, 60.0);
        let ray = camera.ray(639.0, 479.0).expect("a ray").vector();
        assert!(ray.x > 0.0 && ray.y > 0.0 && ray.z > 0.0);
        assert!((ray.x / ray.z - (319.5 / 320.0) * 30f64.to_radians().tan()).abs() < 1e-9);
    }
}
