//! A Python script that shows a corrected log in rerun. Only rerun's own library writes blueprints,
//! and rerun does not load one from beside a log. The scripts of two logs differ in their topics
//! only.

use serde_json::{Value, json};

use super::{CameraTopics, bands};

const SCRIPT: &str = include_str!("rerun.py");

/// The script for the log at path `log`; its command line may name another path.
pub fn rerun(cameras: &[CameraTopics], log: &str) -> String {
    let views: Vec<Value> = cameras.iter().map(of_camera).collect();
    // JSON's null is not Python: the script parses the text.
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
