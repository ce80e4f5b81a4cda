//! `sensor_msgs/CameraInfo`, `foxglove.CameraCalibration`: the camera calibration. `K[0]` = 0 means
//! an uncalibrated camera, which is common. K describes the whole sensor; `roi` and `binning` give
//! the part of it that the images show (0 means all of it, and unbinned). The message does not
//! state whether the camera was calibrated in air or in water: the rig file does.

use super::layout::Layout;
use super::reading::size;
use super::value::Value;
use crate::vehicle::{CameraInfo, Intrinsics};

pub fn matches(layout: &Layout, _topic: &str) -> bool {
    layout.has_all(&["distortion_model", "k", "d", "width", "height"])
}

pub fn decode(value: &Value<'_>) -> Result<CameraInfo, String> {
    let numbers = |field: &str| value.numbers(field).unwrap_or_default();
    // Focal lengths and principal point in the rows of a matrix.
    let intrinsics = |field: &str, entries: [usize; 4]| {
        let matrix = numbers(field);
        let [fx, fy, cx, cy] = entries.map(|i| matrix.get(i).copied().unwrap_or(0.0));
        Intrinsics { fx, fy, cx, cy }
    };
    let pair = |a: &str, b: &str| (value.size(a).unwrap_or(0), value.size(b).unwrap_or(0));
    Ok(CameraInfo {
        size: (size(value, "width")?, size(value, "height")?),
        recorded: intrinsics("k", [0, 4, 2, 5]),
        rectified: intrinsics("p", [0, 5, 2, 6]),
        model: value.text("distortion_model").unwrap_or("").into(),
        coefficients: numbers("d"),
        offset: pair("roi.x_offset", "roi.y_offset"),
        roi: pair("roi.width", "roi.height"),
        binning: pair("binning_x", "binning_y"),
    })
}
