//! `sensor_msgs/Imu`: attitude. orientation_covariance\[0\] = −1 or an all-zero quaternion says
//! there is none.

use nalgebra::UnitQuaternion;

use super::{Value, attitude, layout::Layout, missing};

pub fn matches(layout: &Layout, _topic: &str) -> bool {
    ["orientation.w", "angular_velocity", "linear_acceleration"].iter().all(|f| layout.has(f))
}

pub fn decode(value: &Value<'_>) -> Result<Option<UnitQuaternion<f64>>, String> {
    if value.numbers("orientation_covariance").is_some_and(|c| c.first() == Some(&-1.0)) {
        return Ok(None);
    }
    Ok(attitude(value.xyzw("orientation").ok_or_else(|| missing("orientation"))?))
}
