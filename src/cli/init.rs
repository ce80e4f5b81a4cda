//! `init`: a rig file with what the log knows, and with what it does not know marked.

use std::path::Path;

use super::commands::{say, write_text};
use super::{Ended, EstimateOptions, Init, RenderOptions};
use crate::diagnostics::{Diagnostic, Severity};
use crate::error::{Error, Result};
use crate::session::survey::{Survey, facts_without_ranges, rig_facts, survey};
use crate::session::{Log, Options};
use crate::vehicle::{CameraFacts, MountFacts, RigFile};

/// Field of view of a camera whose calibration is not known yet [deg].
const REPLACED_VIEW_DEG: f64 = 60.0;

pub fn run(args: &Init) -> Result<Ended> {
    let options = args.shared.options(&EstimateOptions::default(), &RenderOptions::default())?;
    let to_stdout = args.output.as_os_str() == "-";
    if !to_stdout {
        crate::recording::check_output_path(&args.input, &args.output, options.force)?;
    }
    let (facts, notes) = known_facts(&Log::open(&args.input, &options)?, &options)?;
    let text = rig_text(&facts, &args.input, &notes);
    write_text(&args.output, &text)?;
    if !to_stdout {
        say(&format!("written      {}\n", args.output.display()));
    }
    Ok(Ended::Done)
}

/// The rig of the log, and what to know of it. What is missing stays open in the file; the log is
/// surveyed with a replacement for it, to find the rest.
fn known_facts(log: &Log, options: &Options) -> Result<(RigFile, Vec<String>)> {
    let mut replaced = options.clone();
    let (mut open_camera, mut open_dvl) = (false, false);
    loop {
        let error = match survey(log, &replaced) {
            Ok(s) => {
                let mut facts = rig_facts(&s.rig, &options.rig);
                if open_camera {
                    let CameraFacts { width, height, mount, .. } = facts.camera;
                    facts.camera = CameraFacts { width, height, mount, ..Default::default() };
                }
                if open_dvl {
                    facts.dvl.mount = None;
                }
                return Ok((facts, warnings(&s)));
            }
            Err(error) => error,
        };
        let has_view = replaced.rig.camera.horizontal_field_of_view_deg.is_some();
        match error {
            Error::NoCalibration { .. } if !has_view => {
                replaced.rig.camera.horizontal_field_of_view_deg = Some(REPLACED_VIEW_DEG);
                open_camera = true;
            }
            Error::NoMount { .. } if !open_dvl => {
                replaced.rig.dvl.mount = Some(MountFacts {
                    translation_m: [0.0; 3],
                    rotation_xyzw: Some([0.0, 0.0, 0.0, 1.0]),
                    roll_pitch_yaw_deg: None,
                });
                open_dvl = true;
            }
            Error::NoCalibration { .. } | Error::NoRanges { .. } | Error::Rig(_) => {
                return Ok((facts_without_ranges(log, options), vec![error.to_string()]));
            }
            error if open_camera || open_dvl => {
                return Ok((facts_without_ranges(log, options), vec![error.to_string()]));
            }
            error => return Err(error),
        }
    }
}

fn warnings(survey: &Survey) -> Vec<String> {
    let warnings = survey.diagnostics.iter().filter(|d| d.severity() == Severity::Warning);
    warnings.map(Diagnostic::with_remedy).collect()
}

fn rig_text(facts: &RigFile, input: &Path, notes: &[String]) -> String {
    let mut text = format!(
        "# The rig of {}, for `unwater --rig`. What stands here wins over the log.\n",
        input.display()
    );
    for note in notes {
        text += &format!("# note: {note}\n");
    }
    let mut put = |line: &str| text += &(line.to_string() + "\n");
    let number = |name: &str, v: Option<f64>, unit: &str| {
        v.map_or_else(
            || format!("# {name} =   # FILL IN [{unit}]"),
            |v| format!("{name} = {v:?}  # [{unit}]"),
        )
    };
    let count = |name: &str, v: Option<usize>| {
        v.map_or_else(
            || format!("# {name} =   # FILL IN [px]"),
            |v| format!("{name} = {v}  # [px]"),
        )
    };
    let c = &facts.camera;
    put("\n[camera]\n# calibration in water, for pictures of this size");
    put(&count("width", c.width));
    put(&count("height", c.height));
    for (name, v) in [("fx", c.fx), ("fy", c.fy), ("cx", c.cx), ("cy", c.cy)] {
        put(&number(name, v, "px"));
    }
    match (&c.distortion_model, &c.distortion) {
        (Some(model), Some(d)) => {
            put(&format!(
                "distortion_model = {model:?}  # plumb_bob, rational_polynomial, equidistant, \
                 fisheye62\ndistortion = {d:?}"
            ));
        }
        _ => put("# distortion_model = \"plumb_bob\"  # or rational_polynomial, equidistant, \
                  fisheye62\n# distortion = [0.0, 0.0, 0.0, 0.0, 0.0]"),
    }
    if c.fx.is_none() {
        put("# or, where there is no calibration, the field of view in water, as it is seen in \
             the pictures:\n# horizontal_field_of_view_deg =   # FILL IN [deg]");
    }
    put("# medium = \"air\"  # where it was calibrated in air and dives behind a flat port");
    let mount = |section: &str, m: &Option<MountFacts>, needed: bool, what: &str| match m {
        Some(m) => format!(
            "\n[{section}.mount]  # {what}\ntranslation_m = {:?}\nrotation_xyzw = {:?}",
            m.translation_m,
            m.rotation_xyzw.unwrap_or([0.0, 0.0, 0.0, 1.0])
        ),
        None => format!(
            "\n# [{section}.mount]  # {}: {what}\n# translation_m = [0.0, 0.0, 0.0]  # place in \
             the body [m]\n# roll_pitch_yaw_deg = [0.0, 0.0, 0.0]  # or rotation_xyzw",
            if needed { "FILL IN" } else { "where it is known" }
        ),
    };
    put(&mount(
        "camera",
        &c.mount,
        false,
        "optical frame: x right, y down, z out of the lens. Without it and without TF, the other \
         mounts are in this frame",
    ));
    put("\n[dvl]\n# beams = \"waterlinked-a50\"  # instead of the message's own: a known \
         instrument,\n# janus_angle_deg = 22.5           # or the angle off the axis [deg]\n# \
         azimuths_deg = [135.0, -135.0, -45.0, 45.0]  # and each beam's azimuth from x towards y \
         [deg]\n# sound_speed_ratio = 1.0          # true speed of sound over the instrument's \
         setting\n# ranges = \"slant\"                # or \"vertical\", where the message's \
         type misleads");
    put(&mount("dvl", &facts.dvl.mount, true, "z along its axis, towards the seafloor"));
    put(&mount(
        "strobe",
        &facts.strobe.mount,
        false,
        "z along its beam; where absent its place is looked for in the log",
    ));
    put("\n# [time_offset_s]  # seconds to add to a topic's stamps; `unwater inspect --clocks` \
         looks for them\n# \"/dvl/data\" = 0.0");
    text
}
