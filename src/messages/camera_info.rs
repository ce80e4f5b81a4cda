//! `sensor_msgs/CameraInfo`, `foxglove.CameraCalibration`: the calibration. K\[0\] = 0 means there
//! is none, which is common. K is that of the whole sensor; `roi` and `binning` say what of it the
//! pictures are (0 means all, and unbinned). Nothing says whether it was made in air or in water:
//! that is for the rig file.

use super::{Value, layout::Layout, missing};
use crate::vehicle::{Calibration, Camera, Distortion};

pub fn matches(layout: &Layout, _topic: &str) -> bool {
    layout.has_all(&["distortion_model", "k", "d", "width", "height"])
}

pub fn decode(value: &Value<'_>) -> Result<Option<Calibration>, String> {
    let k = value.numbers("k").unwrap_or_default();
    let size = |field: &str| value.integer(field).and_then(|v| usize::try_from(v).ok());
    let (width, height) = (
        size("width").ok_or_else(|| missing("width"))?,
        size("height").ok_or_else(|| missing("height"))?,
    );
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
    let or_0 = |field: &str| size(field).unwrap_or(0);
    let (offset, of_interest) =
        ((or_0("roi.x_offset"), or_0("roi.y_offset")), (or_0("roi.width"), or_0("roi.height")));
    Ok(Some(Calibration::new(full, offset, of_interest, (or_0("binning_x"), or_0("binning_y")))))
}
