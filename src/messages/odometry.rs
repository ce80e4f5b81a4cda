//! `nav_msgs/Odometry`: the attitude of its child frame.

use nalgebra::UnitQuaternion;

use super::layout::Layout;
use super::reading::rotation;
use super::value::Value;

pub fn matches(layout: &Layout, _topic: &str) -> bool {
    layout.has("pose.pose.orientation.w") && layout.has("child_frame_id")
}

pub fn decode(value: &Value<'_>) -> Result<Option<UnitQuaternion<f64>>, String> {
    rotation(value, "pose.pose.orientation")
}
