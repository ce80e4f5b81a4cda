//! The check of clock and extrinsics against the images, for `model.json` and as diagnostics.

use nalgebra::UnitQuaternion;

use crate::diagnostics::{ClockFact, Diagnostic, MountFact};
use crate::estimate::MountFit;
use crate::model::{GeometryFile, MountCheckFile};
use crate::vehicle::Extrinsics;

/// Clock and mount that are used instead of those given. `offset_s` is added to the stamps of the
/// camera already (s).
pub fn replaced(found: &MountFit, mounts: &Extrinsics, offset_s: f64) -> GeometryFile {
    let is_mounts = found.contradicts_mount() && !found.turn_is_attitudes;
    GeometryFile {
        clock_offset_s: found.contradicts_clock().then_some(offset_s + found.clock_offset_s),
        dvl_rotation_xyzw: is_mounts.then(|| rotated_mount(found, mounts).coords.into()),
        ..GeometryFile::default()
    }
}

fn rotated_mount(found: &MountFit, mounts: &Extrinsics) -> UnitQuaternion<f64> {
    UnitQuaternion::from_scaled_axis(found.turn_rad) * mounts.body_from_dvl.isometry().rotation
}

/// That they are used. `offset_s` is added to the stamps of the camera already (s).
pub fn replaced_diagnostics(
    found: &MountFit,
    camera_topic: &str,
    offset_s: f64,
) -> Vec<Diagnostic> {
    let residual = found.residual;
    let clock = found.contradicts_clock().then(|| {
        let replaced = ClockFact::CameraReplaced {
            offset_s: found.clock_offset_s,
            std_s: found.clock_offset_std_s,
            time_offset_s: offset_s + found.clock_offset_s,
            residual,
        };
        Diagnostic::on(camera_topic, replaced)
    });
    let is_mounts = found.contradicts_mount() && !found.turn_is_attitudes;
    let mount = is_mounts.then(|| {
        let rotation_deg = found.turn_about_axes_rad.map(f64::to_degrees);
        let std_deg = found.turn_std_rad.map(f64::to_degrees);
        MountFact::DvlReplaced { rotation_deg, std_deg, residual }.into()
    });
    clock.into_iter().chain(mount).collect()
}

/// What the log contradicts. `offset_s` is added to the stamps of the camera already (s).
pub fn mount_diagnostics(
    found: &MountFit,
    mounts: &Extrinsics,
    camera_topic: &str,
    offset_s: f64,
) -> Vec<Diagnostic> {
    let mut diagnostics = Vec::new();
    let (residual, is_lower_bound) = (found.residual, found.at_least);
    if found.contradicts_clock() {
        let contradicted = ClockFact::CameraContradicted {
            offset_s: found.clock_offset_s,
            std_s: found.clock_offset_std_s,
            time_offset_s: offset_s + found.clock_offset_s,
            residual,
        };
        diagnostics.push(Diagnostic::on(camera_topic, contradicted));
    }
    let rotation_deg = found.turn_about_axes_rad.map(f64::to_degrees);
    let std_deg = found.turn_std_rad.map(f64::to_degrees);
    if found.contradicts_mount() && found.turn_is_attitudes {
        diagnostics.push(
            MountFact::AttitudeContradicted { rotation_deg, std_deg, residual, is_lower_bound }
                .into(),
        );
    } else if found.contradicts_mount() {
        let (mount, rotation) = (mounts.body_from_dvl.isometry(), rotated_mount(found, mounts));
        let contradicted = MountFact::DvlContradicted {
            rotation_deg,
            std_deg,
            residual,
            is_lower_bound,
            translation_m: mount.translation.vector.into(),
            rotation_xyzw: rotation.coords.into(),
        };
        diagnostics.push(contradicted.into());
    }
    diagnostics
}

/// The check as numbers.
pub fn mount_check(found: &MountFit) -> MountCheckFile {
    MountCheckFile {
        clock_offset_s: found.clock_offset_s,
        clock_offset_std_s: found.clock_offset_std_s,
        turn_deg: found.turn_about_axes_rad.map(f64::to_degrees),
        turn_std_deg: found.turn_std_rad.map(f64::to_degrees),
        residual: found.residual,
    }
}
