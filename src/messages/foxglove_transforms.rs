//! `foxglove.FrameTransform` and `foxglove.FrameTransforms`: poses of children in their parents.

use nalgebra::Vector3;

use super::{FrameTransform, Value, attitude, layout::Layout, missing};

pub fn matches(layout: &Layout, _topic: &str) -> bool {
    ["", "transforms."].iter().any(|p| {
        layout.has(&format!("{p}parent_frame_id")) && layout.has(&format!("{p}child_frame_id"))
    })
}

pub fn decode(value: &Value<'_>) -> Result<Vec<FrameTransform>, String> {
    let name =
        |v: &Value<'_>, path: &str| v.text(path).map(String::from).ok_or_else(|| missing(path));
    let edge = |v: &Value<'_>| {
        let t = v.xyz("translation").ok_or_else(|| missing("translation"))?;
        let q = v.xyzw("rotation").and_then(attitude).ok_or("a transform without a rotation")?;
        let pose = nalgebra::Isometry3::from_parts(Vector3::from(t).into(), q);
        Ok(FrameTransform {
            parent: name(v, "parent_frame_id")?,
            child: name(v, "child_frame_id")?,
            pose,
        })
    };
    match value.list("transforms") {
        Some(list) => list.iter().map(edge).collect(),
        None => Ok(vec![edge(value)?]),
    }
}
