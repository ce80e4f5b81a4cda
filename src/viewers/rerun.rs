//! A script that shows a corrected log in rerun. rerun's blueprints can only be written by its own
//! library, and one that lies beside a log is not looked at; so this is Python, with the topics on
//! top and nothing else that differs from log to log.

use serde_json::{Value, json};

use super::{CameraTopics, bands};

const SCRIPT: &str = include_str!("rerun.py");

/// The script for a log that lies at `log`, which may also be given on its command line.
pub fn rerun(cameras: &[CameraTopics], log: &str) -> String {
    let views: Vec<Value> = cameras.iter().map(of_camera).collect();
    // JSON's null is not Python's: the script reads the text.
    let text =
        serde_json::to_string_pretty(&json!({ "log": log, "cameras": views })).unwrap_or_default();
    SCRIPT.replace("@VIEWS@", &text.replace('\\', "\\\\").replace("'''", "\\'\\'\\'"))
}

fn of_camera(camera: &CameraTopics) -> Value {
    json!({
        "name": camera.name,
        "raw": camera.raw,
        "corrected": camera.corrected,
        "beam_pattern": camera.beam_pattern,
        "cloud": camera.cloud,
        "strobe": camera.strobe,
        "strobe_beam": camera.strobe_beam,
        "camera_info": camera.camera_info,
        "seafloor_frame": camera.seafloor_frame,
        "attenuation": camera.attenuation,
        "bands": bands(camera.bands),
        "altitude": camera.altitude,
        "residual": camera.residual,
        "log": camera.log,
    })
}
