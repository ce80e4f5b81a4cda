//! Extrinsics of camera, range instrument, attitude sensor and strobe.

use super::facts;

facts! {
    /// Facts about where sensors and strobe sit.
    MountFact {
        Info "frame-replaced" FrameReplaced { frame: String, used: String },
            text("its frame {frame:?} is not in the TF tree; {used:?} is used instead");
        Warning "mount-without-translation" NoTranslation { frame: String },
            text("the TF tree has {frame:?} at the vehicle's origin exactly: its position may be a \
                  placeholder, and a wrong one shifts attenuation"),
            remedy("measure the position and write it under [camera.mount] or [dvl.mount] in a rig \
                    file");
        Warning "camera-frame-not-optical" FrameNotOptical { frame: String },
            text("by the ranges its frame {frame:?} has x along the optical axis, not z; the \
                  optical frame is derived from it"),
            remedy("publish an optical frame (x right, y down, z out of the lens) and name it in \
                    the header of the images, or write [camera.mount] into a rig file");
        Warning "transforms-conflict" Conflicting { frame: String, used: String, other: String },
            text("the log has two mounts of {frame:?} that differ, below {used:?} and below \
                  {other:?}; the one below {used:?} is used"),
            remedy("write the right one under [camera.mount], [dvl.mount] or [strobe.mount] in a \
                    rig file");
        Info "joint-followed" JointFollowed { parent: String, child: String, rotation_deg: f64 },
            text("the camera sits on a joint that moves, from {parent:?} to {child:?}, by up to \
                  {rotation_deg:.1}°; it is followed frame by frame, and lamps are taken to turn \
                  with the camera");
        Info "lamps-stay" LampsStay { frames: Vec<String> },
            text("lamps that stay as they are while the camera turns: {}", frames.join(", "));
        Warning "joint-contradicted" JointContradicted { agreement: [f64; 2] },
            text("by the images the camera does not move as the joint does that it sits on \
                  (agreement of the same point {:.2} with the joint held still, {:.2} as it is \
                  followed)", agreement[0], agreement[1]),
            remedy("check the joint on /tf; [camera.mount] in a rig file holds the camera");
        Info "attitude-missing" NoAttitude,
            text("the log has no attitude: echoes are not rotated between ping and frame, and with \
                  fewer than three returns the seafloor is assumed perpendicular to the \
                  instrument axis");
        Info "attitude-frame-unknown" AttitudeFrameUnknown { frame: String },
            text("its frame {frame:?} is not in the TF tree; it is assumed aligned with the \
                  vehicle");
        Info "strobe-axis-off-camera" StrobeAxisOff,
            text("as the rig file orients it, the strobe does not light what the camera sees: its \
                  axis is z, see docs/rig.md");
        Info "strobe-orientation-replaced" StrobeOrientationReplaced { frames: Vec<String> },
            text("as the TF tree orients it, light from {} does not fall on what the camera \
                  sees; the orientation of the camera is used", frames.join(", "));
        Info "several-strobes" SeveralStrobes { frames: Vec<String>, used: usize },
            text("several lights in the TF tree ({}): {used} of them are used, with equal power \
                  and one beam pattern; name the one that shone with --strobe-frame, or strengths \
                  under [[strobe.lamps]] in a rig file", frames.join(", "));
        Warning "strobe-position-unknown" StrobeUnknown,
            text("the position of the strobe is unknown and the log does not determine it: it is \
                  assumed at the camera, which biases attenuation"),
            remedy("write [strobe.mount] into a rig file");
        Warning "strobe-position-contradicted" StrobeContradicted {
            moved_m: f64,
            position_in_body_m: [f64; 3],
            std_m: f64,
            residual: [f64; 2],
        },
            text("the log contradicts the given strobe position: it fits better {moved_m:.2} m \
                  away, at {position_in_body_m:.3?} in the vehicle (± {std_m:.3} m; residual \
                  {:.4} instead of {:.4})", residual[1], residual[0]),
            remedy("use the estimated position with --strobe-position refine");
        Warning "strobe-position-replaced" StrobeReplaced {
            moved_m: f64,
            position_in_body_m: [f64; 3],
            std_m: f64,
            residual: [f64; 2],
        },
            text("the strobe is {moved_m:.2} m from the given position, at \
                  {position_in_body_m:.3?} in the vehicle (± {std_m:.3} m; residual {:.4} instead \
                  of {:.4}); that position is used", residual[1], residual[0]),
            remedy("write the position under [strobe.mount] in a rig file; --self-calibration \
                    report keeps the given one");
        Warning "attitude-mount-contradicted" AttitudeContradicted {
            rotation_deg: [f64; 2],
            std_deg: [f64; 2],
            residual: [f64; 2],
            is_lower_bound: bool,
        },
            text("the log contradicts the rotation between camera and attitude sensor: level \
                  seafloors fit better {}",
                 rotated(rotation_deg, std_deg, residual, is_lower_bound)),
            remedy("check [camera.mount] and the mount of the attitude sensor");
        Warning "dvl-mount-replaced" DvlReplaced {
            rotation_deg: [f64; 2],
            std_deg: [f64; 2],
            residual: [f64; 2],
        },
            text("the range instrument is rotated against the given mount; the seafloor planes are \
                  rotated {}", rotated(rotation_deg, std_deg, residual, &false)),
            remedy("write the mount under [dvl.mount] in a rig file; --self-calibration report \
                    keeps the given one");
        Warning "dvl-turned-about-its-axis" DvlTurned {
            yaw_deg: f64,
            residual_deg: [f64; 2],
            rotation_xyzw: [f64; 4],
        },
            text("the range instrument is turned by {yaw_deg:.0}° about its axis against its \
                  mount: turned, its planes agree with roll and pitch within {:.2}° instead of \
                  {:.2}°, and the images agree better", residual_deg[1], residual_deg[0]),
            remedy("write `rotation_xyzw = {rotation_xyzw:.5?}` with the position under \
                    [dvl.mount] in a rig file; --self-calibration report keeps the given one");
        Warning "attitude-turned" AttitudeTurned { yaw_deg: f64, residual_deg: [f64; 2] },
            text("its planes contradict roll and pitch, as if the attitude sensor were turned by \
                  {:.0}° about the vertical ({:.2}° instead of {:.2}°); the images do not confirm \
                  that the instrument itself is", -yaw_deg, residual_deg[0], residual_deg[1]),
            remedy("check the frame and the mount of the attitude sensor in the TF tree");
        Warning "dvl-mount-contradicted" DvlContradicted {
            rotation_deg: [f64; 2],
            std_deg: [f64; 2],
            residual: [f64; 2],
            is_lower_bound: bool,
            translation_m: [f64; 3],
            rotation_xyzw: [f64; 4],
        },
            text("the log contradicts the rotation between camera and range instrument: planes \
                  fit better {}", rotated(rotation_deg, std_deg, residual, is_lower_bound)),
            remedy("to use that, write `[dvl.mount]` with `translation_m = {translation_m:.4?}` \
                    and `rotation_xyzw = {rotation_xyzw:.5?}` in a rig file");
    }
}

fn rotated(deg: &[f64; 2], std: &[f64; 2], residual: &[f64; 2], is_lower_bound: &bool) -> String {
    let bound = if *is_lower_bound {
        "a lower bound, as the strobe position was estimated from the same images; "
    } else {
        ""
    };
    format!(
        "rotated by {:.1} ± {:.1}° and {:.1} ± {:.1}° about x and y of the camera ({bound}residual \
         {:.4} instead of {:.4})",
        deg[0], std[0], deg[1], std[1], residual[1], residual[0]
    )
}
