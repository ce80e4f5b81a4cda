//! The rig: camera calibration and the extrinsics of camera, DVL and strobe.
//!
//! From the log (`/tf_static`, `camera_info`) or from a rig file, which takes precedence.
//! Extrinsics are poses in one common body space. No public recording contains a strobe pose;
//! without one the strobe is assumed to be at the camera, and the report warns about it.

use std::collections::BTreeMap;

use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

use super::{BlackLevel, Camera, CameraMotion, Lamps, RangeKind, Vignetting};
use crate::coordinates::{Body, Dvl, Optical, Point, Strobe, Transform};
use crate::units::Stamp;

/// Calibration and extrinsics of the vehicle.
#[derive(Clone, Debug)]
pub struct Rig {
    /// calibration
    pub camera: Camera,
    /// extrinsics of the camera
    pub body_from_optical: Transform<Body, Optical>,
    /// extrinsics of the DVL or altimeter
    pub body_from_dvl: Transform<Body, Dvl>,
    /// extrinsics of the lamps
    pub strobe: StrobeMount,
    /// how the camera moves in the vehicle; `None` where it stands still
    pub camera_motion: Option<CameraMotion>,
}

impl Rig {
    /// A camera and one strobe, for frames without a log. Body space is the camera's: x right, y
    /// down, z along the optical axis; the DVL is taken to be at its origin.
    pub fn of_camera_and_strobe(camera: Camera, body_from_strobe: Transform<Body, Strobe>) -> Self {
        Self {
            camera,
            body_from_optical: Transform::identity(),
            body_from_dvl: Transform::identity(),
            strobe: StrobeMount { lamps: Lamps::one(body_from_strobe), source: None },
            camera_motion: None,
        }
    }

    /// The extrinsics.
    pub fn extrinsics(&self) -> Extrinsics {
        Extrinsics {
            body_from_optical: self.body_from_optical,
            body_from_dvl: self.body_from_dvl,
            strobe: self.strobe.clone(),
        }
    }

    /// Pose of the body in the vehicle, where the camera moves in it; else they are one.
    pub fn vehicle_from_body(&self, stamp: Stamp) -> Option<Isometry3<f64>> {
        self.camera_motion.as_ref().map(|motion| motion.vehicle_from_body(stamp))
    }
}

/// Where the instruments sit on the vehicle.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Extrinsics {
    /// the camera
    pub body_from_optical: Transform<Body, Optical>,
    /// the DVL or altimeter
    pub body_from_dvl: Transform<Body, Dvl>,
    /// the lamps
    pub strobe: StrobeMount,
}

/// Extrinsics of the strobe and their source.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct StrobeMount {
    /// pose of the strobe, or of several lamps
    pub lamps: Lamps,
    /// `None` where the strobe is assumed to be at the camera
    pub source: Option<StrobeSource>,
}

/// Source of a strobe pose; a word in `model.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(from = "String", into = "String")]
pub enum StrobeSource {
    /// assumed at the camera
    Camera,
    /// estimated from the images
    Found,
    /// estimated from the images, starting at the given pose
    Refined,
    /// a TF frame, or `rig file`
    Given(String),
}

impl StrobeSource {
    /// Whether the pose was estimated from the images.
    pub fn is_estimated(&self) -> bool {
        matches!(self, Self::Found | Self::Refined)
    }
}

impl std::fmt::Display for StrobeSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Camera => "camera",
            Self::Found => "found",
            Self::Refined => "refined",
            Self::Given(name) => name,
        })
    }
}

impl From<String> for StrobeSource {
    fn from(word: String) -> Self {
        let known = [Self::Camera, Self::Found, Self::Refined].into_iter();
        known.into_iter().find(|s| s.to_string() == word).unwrap_or(Self::Given(word))
    }
}

impl From<StrobeSource> for String {
    fn from(source: StrobeSource) -> Self {
        source.to_string()
    }
}

impl StrobeMount {
    /// Position of the (first) strobe in the body (m).
    pub fn position(&self) -> Point<Body> {
        self.lamps.origin()
    }
}

/// A pose as in `rig.toml` and in the output's attachments.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MountFacts {
    /// position in the body (m)
    pub translation_m: [f64; 3],
    /// rotation as a quaternion x, y, z, w
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rotation_xyzw: Option<[f64; 4]>,
    /// rotation about the body's fixed x, y, z axes (deg), applied in this order
    #[serde(skip_serializing_if = "Option::is_none")]
    pub roll_pitch_yaw_deg: Option<[f64; 3]>,
}

impl MountFacts {
    /// Transform from sensor to body coordinates.
    ///
    /// # Errors
    /// Both forms of the rotation are given, or none.
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

    /// From a pose.
    pub fn of(isometry: nalgebra::Isometry3<f64>) -> Self {
        let (t, q) = (isometry.translation.vector, isometry.rotation);
        Self {
            translation_m: [t.x, t.y, t.z],
            rotation_xyzw: Some([q.i, q.j, q.k, q.w]),
            roll_pitch_yaw_deg: None,
        }
    }
}

/// Medium of a camera calibration.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Medium {
    /// air; the camera is used in water behind a flat port
    Air,
    /// water, through the port in use; or any medium for a dome port, which does not refract
    Water,
}

/// Refractive index of fresh water; sea water is 0.5 % higher.
const REFRACTIVE_INDEX: f64 = 1.33;

/// Section `[camera]` of a rig file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraFacts {
    /// topic of the camera_info to use, where it shares neither namespace nor frame with the images
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera_info: Option<String>,
    /// image size of the calibration (px)
    pub width: Option<usize>,
    /// image size of the calibration (px)
    pub height: Option<usize>,
    /// focal length (px)
    pub fx: Option<f64>,
    /// focal length (px); `fx` where absent
    pub fy: Option<f64>,
    /// principal point (px); the image centre where absent
    pub cx: Option<f64>,
    /// principal point (px); the image centre where absent
    pub cy: Option<f64>,
    /// plumb_bob, rational_polynomial, equidistant or fisheye62
    pub distortion_model: Option<String>,
    /// coefficients in ROS order
    pub distortion: Option<Vec<f64>>,
    /// approximate calibration by the horizontal field of view (deg)
    pub horizontal_field_of_view_deg: Option<f64>,
    /// medium of the calibration, also of one from the log; water where absent. For air a flat port
    /// is assumed
    #[serde(skip_serializing_if = "Option::is_none")]
    pub medium: Option<Medium>,
    /// vignetting model (Eq. 7)
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vignetting: Option<Vignetting>,
    /// image of an evenly lit surface by this camera, instead of a vignetting model
    #[serde(skip_serializing_if = "Option::is_none")]
    pub flat_field: Option<std::path::PathBuf>,
    /// what the sensor adds to every pixel value (share of full scale)
    #[serde(skip_serializing_if = "Option::is_none")]
    pub black_level: Option<BlackLevel>,
    /// measured response, instead of `light.transfer`
    #[serde(skip_serializing_if = "Option::is_none")]
    pub response: Option<ResponseFacts>,
    /// full well at the gain in use, for the noise model only (electrons)
    #[serde(skip_serializing_if = "Option::is_none")]
    pub full_well_e: Option<f64>,
    /// read noise (electrons)
    #[serde(skip_serializing_if = "Option::is_none")]
    pub read_noise_e: Option<f64>,
    /// extrinsics
    pub mount: Option<MountFacts>,
}

/// Camera response in a rig file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum ResponseFacts {
    /// (pixel value, light) as shares of full scale
    Points(Vec<[f64; 2]>),
    /// CSV file of the same two columns
    File(std::path::PathBuf),
}

/// Section `[dvl]` of a rig file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DvlFacts {
    /// known instrument (`waterlinked-a50`) whose beam geometry replaces the message's
    pub beams: Option<String>,
    /// angle between beams and boresight, for an instrument that is not known by name (deg)
    pub janus_angle_deg: Option<f64>,
    /// azimuth of each beam in message order, from x towards y (deg)
    pub azimuths_deg: Option<Vec<f64>>,
    /// actual speed of sound divided by the one configured in the instrument
    pub sound_speed_ratio: Option<f64>,
    /// meaning of the ranges, overriding the message type
    pub ranges: Option<RangeKind>,
    /// ranges at or below this are no return (m)
    pub min_range_m: Option<f64>,
    /// ranges at or above this are no return (m): simulators report their maximum range for a lost
    /// beam
    pub max_range_m: Option<f64>,
    /// raw values of the message that mean "no return"
    pub bad_values: Option<Vec<f64>>,
    /// topic of the ranges; `--dvl` takes precedence
    pub topic: Option<String>,
    /// path of the ranges in an unknown message type: `report.ranges`, `beams.depth`
    pub path: Option<String>,
    /// path of the validity flags
    pub valid_path: Option<String>,
    /// metres per unit of the ranges in the messages, or of the values at `path` (0.001 for
    /// millimetres)
    pub unit_m: Option<f64>,
    /// extrinsics
    pub mount: Option<MountFacts>,
}

/// Section `[strobe]` of a rig file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StrobeFacts {
    /// extrinsics
    pub mount: Option<MountFacts>,
    /// several lamps of one beam pattern, instead of `mount`
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lamps: Option<Vec<LampFacts>>,
}

/// One of several lamps in a rig file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LampFacts {
    /// position in the body (m)
    pub translation_m: [f64; 3],
    /// rotation as a quaternion x, y, z, w; that of the camera where no rotation is given
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rotation_xyzw: Option<[f64; 4]>,
    /// rotation about the body's fixed x, y, z axes (deg)
    #[serde(skip_serializing_if = "Option::is_none")]
    pub roll_pitch_yaw_deg: Option<[f64; 3]>,
    /// relative power
    #[serde(default = "one")]
    pub strength: f64,
}

fn one() -> f64 {
    1.0
}

impl LampFacts {
    /// A lamp at a pose.
    pub fn of(mount: &MountFacts, strength: f64) -> Self {
        let MountFacts { translation_m, rotation_xyzw, roll_pitch_yaw_deg } = mount.clone();
        Self { translation_m, rotation_xyzw, roll_pitch_yaw_deg, strength }
    }

    /// Transform from lamp to body coordinates.
    ///
    /// # Errors
    /// Both forms of the rotation are given.
    pub fn mount(
        &self,
        body_from_optical: Transform<Body, Optical>,
    ) -> Result<Transform<Body, Strobe>, String> {
        if self.rotation_xyzw.is_none() && self.roll_pitch_yaw_deg.is_none() {
            let mut pose = body_from_optical.isometry();
            pose.translation.vector = self.translation_m.into();
            return Ok(Transform::from_isometry(pose));
        }
        self.facts().transform()
    }

    /// Pose as in the file.
    pub fn facts(&self) -> MountFacts {
        let Self { translation_m, rotation_xyzw, roll_pitch_yaw_deg, .. } = *self;
        MountFacts { translation_m, rotation_xyzw, roll_pitch_yaw_deg }
    }
}

/// A rig file (TOML). Its values take precedence over the log.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RigFile {
    /// calibration, response and extrinsics of the camera
    #[serde(default)]
    pub camera: CameraFacts,
    /// beams, ranges and extrinsics of the DVL or altimeter
    #[serde(default)]
    pub dvl: DvlFacts,
    /// extrinsics of the lamps
    #[serde(default)]
    pub strobe: StrobeFacts,
    /// clock correction by topic: seconds to add to its stamps (s)
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub time_offset_s: BTreeMap<String, f64>,
}

impl DvlFacts {
    /// Metres per unit of the ranges in a message that is in metres unless the file says otherwise.
    pub fn scale(&self) -> f64 {
        self.sound_speed_ratio.unwrap_or(1.0) * self.unit_m.unwrap_or(1.0)
    }
}

impl CameraFacts {
    /// From a calibration.
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

    /// The calibration in water.
    pub fn in_water(&self, camera: Camera) -> Camera {
        if self.medium == Some(Medium::Air) {
            camera.behind_flat_port(REFRACTIVE_INDEX)
        } else {
            camera
        }
    }

    /// The calibration for images of this size, if the file has one.
    ///
    /// # Errors
    /// The key that is missing or wrong.
    pub fn calibration(&self, image: Option<(usize, usize)>) -> Result<Option<Camera>, String> {
        use super::Distortion;
        let size = self.width.zip(self.height).or(image);
        let Some((width, height)) = size else {
            return if self.fx.is_some() {
                Err("camera.fx needs camera.width and camera.height".into())
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
