//! The commented rig file that `init` writes.

use std::path::Path;

use crate::vehicle::{CameraFacts, MountFacts, RigFile};

/// The text of a rig file: facts with units, and lines to be filled in.
pub fn rig_text(facts: &RigFile, input: &Path, notes: &[String]) -> String {
    let mut text =
        format!("# The rig of {}, for `unwater --rig`. It overrides the log.\n", input.display());
    for note in notes {
        text += &format!("# note: {note}\n");
    }
    text += &camera_text(&facts.camera);
    let camera_mount = Mount {
        section: "camera",
        is_needed: false,
        about: "optical frame: x right, y down, z out of the lens. Without it and without TF, the \
                other mounts are in this frame",
    };
    text += &camera_mount.text(facts.camera.mount.as_ref());
    text += DVL_TEXT;
    let about = "z along its axis, towards the seafloor";
    let dvl_mount = Mount { section: "dvl", is_needed: true, about };
    text += &dvl_mount.text(facts.dvl.mount.as_ref());
    let about = "z along its beam; where absent, its position is estimated from the log";
    let strobe_mount = Mount { section: "strobe", is_needed: false, about };
    text += &strobe_mount.text(facts.strobe.mount.as_ref());
    text + TIME_OFFSET_TEXT
}

const DVL_TEXT: &str = "
[dvl]
# beams = \"waterlinked-a50\"  # instead of the message's own: a known instrument,
# janus_angle_deg = 22.5           # or the angle off the axis [deg]
# azimuths_deg = [135.0, -135.0, -45.0, 45.0]  # and each beam's azimuth from x towards y [deg]
# sound_speed_ratio = 1.0          # true speed of sound over the instrument's setting
# ranges = \"slant\"                # or \"vertical\", where the message's type misleads
";

const TIME_OFFSET_TEXT: &str = "
# [time_offset_s]  # seconds to add to a topic's stamps; `unwater inspect --clocks` estimates them
# \"/dvl/data\" = 0.0
";

fn camera_text(camera: &CameraFacts) -> String {
    let mut text = "\n[camera]\n# calibration in water, for images of this size\n".to_string();
    for (key, value) in [("width", camera.width), ("height", camera.height)] {
        text += &value.map_or_else(
            || format!("# {key} =   # FILL IN [px]\n"),
            |value| format!("{key} = {value}  # [px]\n"),
        );
    }
    for (key, value) in [("fx", camera.fx), ("fy", camera.fy), ("cx", camera.cx), ("cy", camera.cy)]
    {
        text += &value.map_or_else(
            || format!("# {key} =   # FILL IN [px]\n"),
            |value| format!("{key} = {value:?}  # [px]\n"),
        );
    }
    text += &match (&camera.distortion_model, &camera.distortion) {
        (Some(model), Some(coefficients)) => format!(
            "distortion_model = {model:?}  # plumb_bob, rational_polynomial, equidistant, \
             fisheye62\ndistortion = {coefficients:?}\n"
        ),
        _ => "# distortion_model = \"plumb_bob\"  # or rational_polynomial, equidistant, \
              fisheye62\n# distortion = [0.0, 0.0, 0.0, 0.0, 0.0]\n"
            .into(),
    };
    if camera.fx.is_none() {
        text += "# or, where there is no calibration, the field of view in water, as seen in the \
                 images:\n# horizontal_field_of_view_deg =   # FILL IN [deg]\n";
    }
    text + "# medium = \"air\"  # where it was calibrated in air and dives behind a flat port\n"
}

/// The section of a mount.
struct Mount {
    section: &'static str,
    is_needed: bool,
    about: &'static str,
}

impl Mount {
    fn text(&self, facts: Option<&MountFacts>) -> String {
        let Self { section, is_needed, about } = self;
        match facts {
            Some(m) => format!(
                "\n[{section}.mount]  # {about}\ntranslation_m = {:?}\nrotation_xyzw = {:?}\n",
                m.translation_m,
                m.rotation_xyzw.unwrap_or([0.0, 0.0, 0.0, 1.0])
            ),
            None => format!(
                "\n# [{section}.mount]  # {}: {about}\n# translation_m = [0.0, 0.0, 0.0]  # \
                 position in the body [m]\n# roll_pitch_yaw_deg = [0.0, 0.0, 0.0]  # or \
                 rotation_xyzw\n",
                if *is_needed { "FILL IN" } else { "where it is known" }
            ),
        }
    }
}
