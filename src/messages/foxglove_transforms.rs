//! `foxglove.FrameTransform` and `foxglove.FrameTransforms`: poses of child frames.

use super::header::header;
use super::layout::Layout;
use super::reading::{FrameTransform, missing, pose};
use super::value::Value;

pub fn matches(layout: &Layout, _topic: &str) -> bool {
    ["", "transforms."].iter().any(|p| {
        layout.has(&format!("{p}parent_frame_id")) && layout.has(&format!("{p}child_frame_id"))
    })
}

pub fn decode(value: &Value<'_>) -> Result<Vec<FrameTransform>, String> {
    let edge = |v: &Value<'_>| {
        let name = |path: &str| v.text(path).map(String::from).ok_or_else(|| missing(path));
        Ok(FrameTransform {
            stamp: header(v).stamp,
            pose: pose(v, "translation", "rotation")?,
            parent: name("parent_frame_id")?,
            child: name("child_frame_id")?,
        })
    };
    match value.list("transforms") {
        Some(list) => list.iter().map(edge).collect(),
        None => Ok(vec![edge(value)?]),
    }
}
