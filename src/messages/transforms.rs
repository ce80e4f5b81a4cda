//! `tf2_msgs/TFMessage`: poses of children in their parents.

use nalgebra::Vector3;

use super::{FrameTransform, Value, attitude, layout::Layout, missing};

pub fn matches(layout: &Layout, _topic: &str) -> bool {
    layout.has("transforms.child_frame_id") && layout.has("transforms.transform.rotation")
}

pub fn decode(value: &Value<'_>) -> Result<Vec<FrameTransform>, String> {
    let list = value.list("transforms").ok_or_else(|| missing("transforms"))?;
    let name = |v: &Value<'_>, path: &str| {
        v.text(path).map(|s| String::from(s.trim_start_matches('/'))).ok_or_else(|| missing(path))
    };
    let edge = |v: &Value<'_>| {
        let t = v.xyz("transform.translation").ok_or_else(|| missing("transform.translation"))?;
        let q = v
            .xyzw("transform.rotation")
            .and_then(attitude)
            .ok_or("a transform without a rotation")?;
        let pose = nalgebra::Isometry3::from_parts(Vector3::from(t).into(), q);
        Ok(FrameTransform {
            parent: name(v, "header.frame_id")?,
            child: name(v, "child_frame_id")?,
            pose,
        })
    };
    list.iter().map(edge).collect()
}
