//! The rig: where camera, range instrument and strobe sit on the vehicle, and how the camera sees.
//!
//! Facts come from the log (`/tf_static`, `camera_info`) or from a rig file, which wins. Mounts are
//! poses in one common body space. No public recording holds a strobe's pose; without one the light
//! is taken to sit at the camera, and the report says so.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::{Camera, Lamps, RangeKind};
use crate::coordinates::{Body, Dvl, Optical, Point, Strobe, Transform};

/// Everything geometry needs to know of the vehicle.
#[derive(Clone, Debug)]
pub struct Rig {
    /// the camera
    pub camera: Camera,
    /// its mount
    pub body_from_optical: Transform<Body, Optical>,
    /// the range instrument's mount
    pub body_from_dvl: Transform<Body, Dvl>,
    /// the light
    pub strobe: StrobeMount,
}

/// Where the light sits and how that is known.
#[derive(Clone, Debug)]
pub struct StrobeMount {
    /// its pose, or those of several
    pub lamps: Lamps,
    /// the TF frame or file it was taken from; `None` where it was put at the camera for want of
    /// better
    pub source: Option<String>,
}

impl StrobeMount {
    /// The light's place in the body [m].
    pub fn position(&self) -> Point<Body> {
        self.lamps.origin()
    }
}

/// A pose as `rig.toml` and the output's attachments write it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MountFacts {
    /// place in the body [m]
    pub translation_m: [f64; 3],
    /// turn, as a quaternion x, y, z, w
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rotation_xyzw: Option<[f64; 4]>,
    /// turn, as roll, pitch, yaw about the body's x, y, z [deg], applied in this order
    #[serde(skip_serializing_if = "Option::is_none")]
    pub roll_pitch_yaw_deg: Option<[f64; 3]>,
}

impl MountFacts {
    /// The transform that takes sensor coordinates to body coordinates.
    ///
    /// # Errors
    /// Both or neither of the two ways to give the turn.
    pub fn transform<S>(&self) -> Result<Transform<Body, S>, String> {
        match (self.rotation_xyzw, self.roll_pitch_yaw_deg) {
            (Some(q), None) => Ok(Transform::from_parts(self.translation_m, q)),
            (None, Some([roll, pitch, yaw])) => {
                let q = nalgebra::UnitQuaternion::from_euler_angles(
                    roll.to_radians(),
                    pitch.to_radians(),
                    yaw.to_radians(),
                );
                Ok(Transform::from_parts(self.translation_m, [q.i, q.j, q.k, q.w]))
            }
            _ => Err("a mount needs exactly one of rotation_xyzw and roll_pitch_yaw_deg".into()),
        }
    }

    /// The facts of a known pose.
    pub fn of(isometry: nalgebra::Isometry3<f64>) -> Self {
        let (t, q) = (isometry.translation.vector, isometry.rotation);
        Self {
            translation_m: [t.x, t.y, t.z],
            rotation_xyzw: Some([q.i, q.j, q.k, q.w]),
            roll_pitch_yaw_deg: None,
        }
    }
}

/// What a camera was calibrated in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Medium {
    /// air; used in water behind a flat port
    Air,
    /// water, with the port it dives with; also a dome port, which keeps the angles
    Water,
}

/// Of water over air; sea water is 0.5 % above.
const REFRACTIVE_INDEX: f64 = 1.33;

/// The camera's part of a rig file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraFacts {
    /// picture size the calibration was made for [px]
    pub width: Option<usize>,
    /// see `width`
    pub height: Option<usize>,
    /// focal length [px]
    pub fx: Option<f64>,
    /// focal length [px]; `fx` where absent
    pub fy: Option<f64>,
    /// principal point [px]; the picture's centre where absent
    pub cx: Option<f64>,
    /// principal point [px]
    pub cy: Option<f64>,
    /// plumb_bob, rational_polynomial, equidistant or fisheye62
    pub distortion_model: Option<String>,
    /// its coefficients, in ROS order
    pub distortion: Option<Vec<f64>>,
    /// horizontal field of view, where nothing better is known [deg]
    pub horizontal_field_of_view_deg: Option<f64>,
    /// what the calibration was made in, the log's too; water where absent. Of air a flat port is
    /// assumed
    #[serde(skip_serializing_if = "Option::is_none")]
    pub medium: Option<Medium>,
    /// how the lens's light falls off towards the edge (Eq. 7)
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vignetting: Option<Vignetting>,
    /// a picture of an evenly lit surface, as the camera takes it, instead of a formula
    #[serde(skip_serializing_if = "Option::is_none")]
    pub flat_field: Option<std::path::PathBuf>,
    /// codes to light by a table, instead of `light.transfer`
    #[serde(skip_serializing_if = "Option::is_none")]
    pub response: Option<ResponseFacts>,
    /// electrons of a pixel at full scale, by the data sheet and the gain; for the account of noise
    /// alone
    #[serde(skip_serializing_if = "Option::is_none")]
    pub full_well_e: Option<f64>,
    /// noise of reading a pixel [electrons]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub read_noise_e: Option<f64>,
    /// where the camera sits
    pub mount: Option<MountFacts>,
}

/// A camera's response as a rig file gives it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum ResponseFacts {
    /// points of code share and light share
    Points(Vec<[f64; 2]>),
    /// a file of two columns
    File(std::path::PathBuf),
}

/// Fall-off of light towards the picture's edge.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Vignetting {
    /// a formula by name
    Named(VignettingName),
    /// 1 + a₂ r² + a₄ r⁴ + a₆ r⁶, r the tangent of the angle off the axis
    Radial([f64; 3]),
}

/// Formulas of vignetting.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum VignettingName {
    /// the fourth power of the cosine of the angle off the axis, as of a simple lens
    Cos4,
}

impl Vignetting {
    /// Share of light that arrives from a ray x/z, y/z.
    pub fn share(&self, x: f64, y: f64) -> f64 {
        let r2 = x * x + y * y;
        match self {
            Self::Named(VignettingName::Cos4) => (1.0 + r2).powi(-2),
            Self::Radial([a2, a4, a6]) => 1.0 + r2 * (a2 + r2 * (a4 + r2 * a6)),
        }
    }
}

/// The range instrument's part of a rig file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DvlFacts {
    /// a known instrument's beams (`waterlinked-a50`), instead of the message's
    pub beams: Option<String>,
    /// angle between beams and boresight [deg], for an instrument not in the list
    pub janus_angle_deg: Option<f64>,
    /// azimuth of each beam in message order, from x towards y [deg]
    pub azimuths_deg: Option<Vec<f64>>,
    /// true speed of sound over the one the instrument was set to
    pub sound_speed_ratio: Option<f64>,
    /// what the ranges are, against what the message's type says
    pub ranges: Option<RangeKind>,
    /// ranges at or below this are none [m]
    pub min_range_m: Option<f64>,
    /// ranges at or above this are none [m]: simulators write their limit for a lost beam
    pub max_range_m: Option<f64>,
    /// numbers in the message that mean "no return", as they are written there
    pub bad_values: Option<Vec<f64>>,
    /// the range channel; `--dvl` wins
    pub topic: Option<String>,
    /// where the ranges are in a message of no known shape: `report.ranges`, `beams.depth`
    pub path: Option<String>,
    /// where the flags of their validity are
    pub valid_path: Option<String>,
    /// metres per unit of the numbers at `path` (0.001 for millimetres)
    pub unit_m: Option<f64>,
    /// where the instrument sits
    pub mount: Option<MountFacts>,
}

/// The strobe's part of a rig file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StrobeFacts {
    /// where the light sits
    pub mount: Option<MountFacts>,
    /// several lamps of one beam pattern, instead of `mount`
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lamps: Option<Vec<LampFacts>>,
}

/// One of several lamps in a rig file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LampFacts {
    /// place in the body [m]
    pub translation_m: [f64; 3],
    /// where it looks, as a quaternion x, y, z, w; as the camera does where neither this nor the
    /// next is given
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rotation_xyzw: Option<[f64; 4]>,
    /// the same as angles about x, y, z [deg]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub roll_pitch_yaw_deg: Option<[f64; 3]>,
    /// light of it over that of the others
    #[serde(default = "one")]
    pub strength: f64,
}

fn one() -> f64 {
    1.0
}

impl LampFacts {
    /// A lamp at a mount.
    pub fn of(mount: &MountFacts, strength: f64) -> Self {
        let MountFacts { translation_m, rotation_xyzw, roll_pitch_yaw_deg } = mount.clone();
        Self { translation_m, rotation_xyzw, roll_pitch_yaw_deg, strength }
    }

    /// Its pose.
    ///
    /// # Errors
    /// Two turns are given.
    pub fn mount(
        &self,
        body_from_optical: Transform<Body, Optical>,
    ) -> Result<Transform<Body, Strobe>, String> {
        let Self { translation_m, rotation_xyzw, roll_pitch_yaw_deg, .. } = self.clone();
        if rotation_xyzw.is_none() && roll_pitch_yaw_deg.is_none() {
            let mut pose = body_from_optical.isometry();
            pose.translation.vector = translation_m.into();
            return Ok(Transform::from_isometry(pose));
        }
        MountFacts { translation_m, rotation_xyzw, roll_pitch_yaw_deg }.transform()
    }
}

/// A rig file (TOML). Everything in it wins over the log.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RigFile {
    /// the camera
    #[serde(default)]
    pub camera: CameraFacts,
    /// the range instrument
    #[serde(default)]
    pub dvl: DvlFacts,
    /// the light
    #[serde(default)]
    pub strobe: StrobeFacts,
    /// seconds to add to the stamps of a topic, where its clock is known to be off [s]
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub time_offset_s: BTreeMap<String, f64>,
}

impl CameraFacts {
    /// The facts of a known calibration.
    pub fn of(camera: &Camera) -> Self {
        Self {
            width: Some(camera.width),
            height: Some(camera.height),
            fx: Some(camera.fx),
            fy: Some(camera.fy),
            cx: Some(camera.cx),
            cy: Some(camera.cy),
            distortion_model: Some(camera.distortion.name().into()),
            distortion: Some(camera.distortion.coefficients()),
            ..Self::default()
        }
    }

    /// A calibration as it holds in water.
    pub fn in_water(&self, camera: Camera) -> Camera {
        if self.medium == Some(Medium::Air) {
            camera.behind_flat_port(REFRACTIVE_INDEX)
        } else {
            camera
        }
    }

    /// The calibration the file gives, if it gives one, for pictures of this size.
    ///
    /// # Errors
    /// A sentence naming the key that is missing or wrong.
    pub fn calibration(&self, picture: Option<(usize, usize)>) -> Result<Option<Camera>, String> {
        use super::Distortion;
        let size = self.width.zip(self.height).or(picture);
        let Some((width, height)) = size else {
            return if self.fx.is_some() {
                Err("camera.width and camera.height belong to camera.fx".into())
            } else {
                Ok(None)
            };
        };
        let centre = |n: usize| (n as f64 - 1.0) / 2.0;
        let distortion = Distortion::named(
            self.distortion_model.as_deref().unwrap_or("plumb_bob"),
            self.distortion.as_deref().unwrap_or(&[]),
        )
        .map_err(|model| {
            format!(
                "camera.distortion_model = {model:?} is not one of plumb_bob, \
                 rational_polynomial, equidistant, fisheye62"
            )
        })?;
        Ok(match (self.fx, self.horizontal_field_of_view_deg) {
            (Some(fx), _) => Some(Camera {
                width,
                height,
                fx,
                fy: self.fy.unwrap_or(fx),
                cx: self.cx.unwrap_or_else(|| centre(width)),
                cy: self.cy.unwrap_or_else(|| centre(height)),
                distortion,
            }),
            (None, Some(hfov)) => {
                Some(Camera { distortion, ..Camera::from_field_of_view(width, height, hfov) })
            }
            (None, None) => None,
        })
    }
}
