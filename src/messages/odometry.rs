//! `nav_msgs/Odometry`: the attitude of its child frame.

use nalgebra::UnitQuaternion;

use super::{Value, attitude, layout::Layout, missing};

pub fn matches(layout: &Layout, _topic: &str) -> bool {
    layout.has("pose.pose.orientation.w") && layout.has("child_frame_id")
}

pub fn decode(value: &Value<'_>) -> Result<Option<UnitQuaternion<f64>>, String> {
    Ok(attitude(
        value.xyzw("pose.pose.orientation").ok_or_else(|| missing("pose.pose.orientation"))?,
    ))
}
