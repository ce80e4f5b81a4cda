//! What the log says against clock and mounts, for `model.json` and in words with the remedy.

use nalgebra::UnitQuaternion;

use crate::estimate::MountFit;
use crate::model::MountCheckFile;
use crate::vehicle::Rig;

/// The check as numbers, and what the user must know. `offset_s` is what the camera's stamps get
/// already [s].
pub fn mount_check(
    found: &MountFit,
    rig: &Rig,
    camera_topic: &str,
    offset_s: f64,
) -> (MountCheckFile, Vec<String>) {
    let mut warnings = Vec::new();
    let fits = format!("residual {:.4} instead of {:.4}", found.residual[1], found.residual[0]);
    if found.contradicts_clock() {
        let offset = offset_s + found.clock_offset_s;
        warnings.push(format!(
            "the log contradicts the camera's clock: its light fits planes {:.3} ± {:.3} s away \
             ({fits}); if camera and range instrument keep two clocks, write `\"{camera_topic}\" \
             = {offset:.3}` under [time_offset_s] in a rig file",
            found.clock_offset_s, found.clock_offset_std_s
        ));
    }
    let fits = if found.at_least {
        format!("at least so much, as the strobe's place was found in the same light; {fits}")
    } else {
        fits
    };
    let turns = format!(
        "{:.1} ± {:.1}° and {:.1} ± {:.1}° about the camera's x and y ({fits})",
        found.turn_about_axes_rad[0].to_degrees(),
        found.turn_std_rad[0].to_degrees(),
        found.turn_about_axes_rad[1].to_degrees(),
        found.turn_std_rad[1].to_degrees()
    );
    if found.contradicts_mount() && found.turn_is_attitudes {
        warnings.push(format!(
            "the log contradicts the turn between camera and attitude sensor: level floors fit \
             better turned by {turns}; check [camera.mount] and the attitude sensor's mount"
        ));
    } else if found.contradicts_mount() {
        let mount = rig.body_from_dvl.isometry();
        let (t, q) = (
            mount.translation.vector,
            UnitQuaternion::from_scaled_axis(found.turn_rad) * mount.rotation,
        );
        warnings.push(format!(
            "the log contradicts the turn between camera and range instrument: planes fit better \
             turned by {turns}; to use that write `[dvl.mount]` with `translation_m = [{:.4}, \
             {:.4}, {:.4}]` and `rotation_xyzw = [{:.5}, {:.5}, {:.5}, {:.5}]` in a rig file",
            t.x, t.y, t.z, q.i, q.j, q.k, q.w
        ));
    }
    let file = MountCheckFile {
        clock_offset_s: found.clock_offset_s,
        clock_offset_std_s: found.clock_offset_std_s,
        turn_deg: found.turn_about_axes_rad.map(f64::to_degrees),
        turn_std_deg: found.turn_std_rad.map(f64::to_degrees),
        residual: found.residual,
    };
    (file, warnings)
}
