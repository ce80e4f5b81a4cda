//! `tf2_msgs/TFMessage`: poses of child frames in their parents.

use super::header::header;
use super::layout::Layout;
use super::reading::{FrameTransform, missing, pose};
use super::value::Value;

pub fn matches(layout: &Layout, _topic: &str) -> bool {
    layout.has("transforms.child_frame_id") && layout.has("transforms.transform.rotation")
}

pub fn decode(value: &Value<'_>) -> Result<Vec<FrameTransform>, String> {
    let list = value.list("transforms").ok_or_else(|| missing("transforms"))?;
    let edge = |v: &Value<'_>| {
        let name = |path: &str| {
            let id = v.text(path).ok_or_else(|| missing(path))?;
            Ok::<_, String>(id.trim_start_matches('/').to_string())
        };
        Ok(FrameTransform {
            stamp: header(v).stamp,
            pose: pose(v, "transform.translation", "transform.rotation")?,
            parent: name("header.frame_id")?,
            child: name("child_frame_id")?,
        })
    };
    list.iter().map(edge).collect()
}
