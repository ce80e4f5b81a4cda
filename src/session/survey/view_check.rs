//! Whether the camera looks at the seafloor that the range instrument measures.

use nalgebra::{Isometry3, Quaternion, UnitQuaternion, Vector3};

use super::camera::CameraSurvey;
use super::clocks::Clocks;
use super::mounts::Mounts;
use crate::coordinates::{Body, Direction, Dvl, Optical, Transform};
use crate::diagnostics::{Diagnostic, MountFact};
use crate::error::{Error, Result};
use crate::vehicle::{CameraMotion, Ping, RigFile};

/// Smallest cosine between the optical axis and the direction of the ranges.
const MIN_AXIS_COSINE: f64 = 0.2;
/// Cosine from which on the x axis of a frame points along the ranges.
const MIN_X_COSINE: f64 = 0.7;

/// A camera and its mount.
pub struct Mounted<'c> {
    pub topic: &'c str,
    pub frame: &'c str,
    pub body_from_optical: Transform<Body, Optical>,
    /// by the rig file, which is right
    pub is_given: bool,
}

impl<'c> Mounted<'c> {
    /// By the rig file, else by the TF tree.
    ///
    /// # Errors
    /// The rig file's mount is none.
    pub fn new(camera: &'c CameraSurvey, rig: &RigFile, by_tree: Isometry3<f64>) -> Result<Self> {
        let CameraSurvey { topic, frame_id: frame, .. } = camera;
        let body_from_optical = match &rig.camera.mount {
            Some(mount) => mount.transform().map_err(Error::Rig)?,
            None => Transform::from_isometry(by_tree),
        };
        let is_given = rig.camera.mount.is_some();
        Ok(Self { topic, frame, body_from_optical, is_given })
    }
}

/// Mean direction of all beams in the body.
fn mean_direction(pings: &[Ping], body_from_dvl: Transform<Body, Dvl>) -> Option<Vector3<f64>> {
    let beams = pings.iter().flat_map(|ping| &ping.beams);
    let sum: Vector3<f64> = beams.map(|beam| (body_from_dvl * beam.direction).vector()).sum();
    sum.try_normalize(1e-6)
}

/// How the camera moves, where joints between it and the vehicle are followed. They are held where
/// it looks most along the ranges.
pub fn motion(
    mounts: &mut Mounts<'_>,
    camera: &CameraSurvey,
    (pings, body_from_dvl): (&[Ping], Transform<Body, Dvl>),
    clocks: &Clocks<'_>,
) -> Option<CameraMotion> {
    let keeps_log_time = clocks.is_cameras(Some(0.0));
    let offset_s = camera.clock_offset_s.filter(|_| !keeps_log_time).unwrap_or(0.0);
    let links = mounts.moving_links(&camera.frame_id, offset_s)?;
    let boresight = || (body_from_dvl * Direction::boresight()).vector();
    let ranges = mean_direction(pings, body_from_dvl).unwrap_or_else(boresight);
    let motion = CameraMotion::new(links, &ranges);
    mounts.hold(&motion);
    Some(motion)
}

/// The camera's mount. Where its frame is no optical frame (x ahead instead of z) by its name and
/// by the ranges, the optical frame is derived from it.
///
/// # Errors
/// The camera looks elsewhere.
pub fn checked_mount(
    camera: &Mounted<'_>,
    (pings, body_from_dvl): (&[Ping], Transform<Body, Dvl>),
    diagnostics: &mut Vec<Diagnostic>,
) -> Result<Transform<Body, Optical>> {
    let Mounted { topic, frame, body_from_optical, is_given } = *camera;
    let Some(ranges) = mean_direction(pings, body_from_dvl) else { return Ok(body_from_optical) };
    let along = |axis: Vector3<f64>| {
        let axis = Direction::from_vector(axis);
        axis.map_or(0.0, |axis| (body_from_optical * axis).vector().dot(&ranges))
    };
    let cosine = along(Vector3::z());
    if cosine >= MIN_AXIS_COSINE {
        return Ok(body_from_optical);
    }
    let is_optical = frame.to_ascii_lowercase().contains("optical");
    if !is_given && !is_optical && along(Vector3::x()) >= MIN_X_COSINE {
        let fact = MountFact::FrameNotOptical { frame: frame.into() };
        diagnostics.push(Diagnostic::on(topic, fact));
        let link_from_optical =
            UnitQuaternion::from_quaternion(Quaternion::new(0.5, -0.5, 0.5, -0.5));
        let mut pose = body_from_optical.isometry();
        pose.rotation *= link_from_optical;
        return Ok(Transform::from_isometry(pose));
    }
    let angle_deg = cosine.clamp(-1.0, 1.0).acos().to_degrees();
    Err(Error::Data(format!(
        "the optical axis of {topic} (z of frame {frame:?}) is {angle_deg:.0}° off the direction \
         in which the ranges are measured: the camera does not see that seafloor, or its frame is \
         not optical (x right, y down, z out of the lens); write its pose under [camera.mount] in \
         a rig file"
    )))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::Stamp;
    use crate::vehicle::{Beam, JanusArray};

    /// Optical axis in the body by a frame whose x axis looks down, as x ahead pitched by 90°.
    fn axis(frame: &str, pitch_deg: f64, is_given: bool) -> Result<Vector3<f64>> {
        let directions = JanusArray::named("nortek-25").expect("known").directions();
        let beam = |d: &Direction<Dvl>| Beam { direction: *d, range: None };
        let beams = directions.iter().map(beam).collect();
        let ping = Ping { stamp: Stamp(1), beams, altitude: None, velocity_m_per_s: None };
        let down: Transform<Body, Dvl> = Transform::from_parts([0.0; 3], [1.0, 0.0, 0.0, 0.0]);
        let q = UnitQuaternion::from_euler_angles(0.0, f64::to_radians(pitch_deg), 0.0);
        let body_from_optical = Transform::from_parts([0.0; 3], q.coords.into());
        let camera = Mounted { topic: "/camera", frame, body_from_optical, is_given };
        let mount = checked_mount(&camera, (&[ping], down), &mut Vec::new())?;
        Ok((mount * Direction::boresight()).vector())
    }

    #[test]
    fn a_frame_with_x_ahead_is_recognised_and_others_are_refused() {
        let found = axis("camera_link", 90.0, false).expect("a mount");
        assert!((found - -Vector3::z()).norm() < 1e-9, "{found}");
        // z down, as an optical frame has it
        let found = axis("camera_link", 180.0, false).expect("a mount");
        assert!((found - -Vector3::z()).norm() < 1e-9, "{found}");
        for (frame, pitch_deg, is_given) in
            [("camera_optical_frame", 90.0, false), ("camera_link", 0.0, false), ("", 90.0, true)]
        {
            let error = axis(frame, pitch_deg, is_given).expect_err("no mount").to_string();
            assert!(error.contains("/camera") && error.contains("[camera.mount]"), "{error}");
        }
    }
}
