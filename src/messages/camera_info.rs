//! `sensor_msgs/CameraInfo`, `foxglove.CameraCalibration`: the camera calibration. `K[0]` = 0 means
//! an uncalibrated camera, which is common. K describes the whole sensor; `roi` and `binning` give
//! the part of it that the images show (0 means all of it, and unbinned). The message does not
//! state whether the camera was calibrated in air or in water: the rig file does.

use super::layout::Layout;
use super::reading::size;
use super::value::Value;
use crate::vehicle::{Calibration, Camera, Distortion};

pub fn matches(layout: &Layout, _topic: &str) -> bool {
    layout.has_all(&["distortion_model", "k", "d", "width", "height"])
}

pub fn decode(value: &Value<'_>) -> Result<Option<Calibration>, String> {
    let k = value.numbers("k").unwrap_or_default();
    let (width, height) = (size(value, "width")?, size(value, "height")?);
    if k.len() != 9 || !(k[0] > 0.0 && k[4] > 0.0) || width == 0 || height == 0 {
        return Ok(None);
    }
    let model = value.text("distortion_model").unwrap_or("");
    let distortion =
        Distortion::named(model, &value.numbers("d").unwrap_or_default()).map_err(|m| {
            format!(
                "the distortion model {m:?} is not one of plumb_bob, rational_polynomial, \
                 equidistant, fisheye62; give the camera in rig.toml"
            )
        })?;
    let full = Camera { width, height, fx: k[0], fy: k[4], cx: k[2], cy: k[5], distortion };
    let pair = |a: &str, b: &str| (value.size(a).unwrap_or(0), value.size(b).unwrap_or(0));
    Ok(Some(Calibration::new(
        full,
        pair("roi.x_offset", "roi.y_offset"),
        pair("roi.width", "roi.height"),
        pair("binning_x", "binning_y"),
    )))
}
