//! `sensor_msgs/CameraInfo`, `foxglove.CameraCalibration`: the calibration. K\[0\] = 0 means there is none, which is common.

use super::{Value, layout::Layout, missing};
use crate::vehicle::{Camera, Distortion};

pub fn matches(layout: &Layout, _topic: &str) -> bool {
    ["distortion_model", "k", "d", "width", "height"].iter().all(|f| layout.has(f))
}

pub fn decode(value: &Value<'_>) -> Result<Option<Camera>, String> {
    let k = value.numbers("k").filter(|k| k.len() == 9).ok_or_else(|| missing("k"))?;
    let size = |field: &str| value.integer(field).and_then(|v| usize::try_from(v).ok()).ok_or_else(|| missing(field));
    let (width, height) = (size("width")?, size("height")?);
    if !(k[0] > 0.0 && k[4] > 0.0) || width == 0 || height == 0 {
        return Ok(None);
    }
    let model = value.text("distortion_model").unwrap_or("");
    let distortion = Distortion::named(model, &value.numbers("d").unwrap_or_default())
        .map_err(|m| format!("the distortion model {m:?} is not one of plumb_bob, rational_polynomial, equidistant; give the camera in rig.toml"))?;
    Ok(Some(Camera { width, height, fx: k[0], fy: k[4], cx: k[2], cy: k[5], distortion }))
}
