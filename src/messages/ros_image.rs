//! `sensor_msgs/Image`: raw pixels, also Bayer, padded rows and big-endian. Definition:
//! ros2/common_interfaces, `sensor_msgs/msg/Image.msg` and `image_encodings.hpp`.
//! `foxglove.RawImage` has no `is_bigendian`: it is little-endian.

use super::layout::Layout;
use super::reading::{missing, size};
use super::value::Value;
use crate::image::EncodedImage;

pub fn matches(layout: &Layout, _topic: &str) -> bool {
    layout.has_all(&["height", "width", "encoding", "step", "data"])
}

pub fn decode<'v>(value: &'v Value<'_>) -> Result<EncodedImage<'v>, String> {
    Ok(EncodedImage::Raw {
        width: size(value, "width")?,
        height: size(value, "height")?,
        encoding: value.text("encoding").ok_or_else(|| missing("encoding"))?,
        big_endian: value.flag("is_bigendian").unwrap_or(false),
        step: size(value, "step")?,
        data: value.bytes("data").ok_or_else(|| missing("data"))?,
    })
}
