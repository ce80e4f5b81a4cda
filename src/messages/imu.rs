//! `sensor_msgs/Imu`: attitude. `orientation_covariance[0]` = −1 or an all-zero quaternion means no
//! attitude.

use nalgebra::UnitQuaternion;

use super::layout::Layout;
use super::reading::rotation;
use super::value::Value;

pub fn matches(layout: &Layout, _topic: &str) -> bool {
    layout.has_all(&["orientation.w", "angular_velocity", "linear_acceleration"])
}

pub fn decode(value: &Value<'_>) -> Result<Option<UnitQuaternion<f64>>, String> {
    if value.numbers("orientation_covariance").is_some_and(|c| c.first() == Some(&-1.0)) {
        return Ok(None);
    }
    rotation(value, "orientation")
}
