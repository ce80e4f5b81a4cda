//! `sensor_msgs/Image`: pixels as they come off the sensor. Also bayer, also with a padded step,
//! also big-endian. Definition: ros2/common_interfaces, `sensor_msgs/msg/Image.msg` and
//! `image_encodings.hpp`. `foxglove.RawImage` is the same without `is_bigendian`: little-endian.

use super::{Value, layout::Layout, missing};
use crate::image::EncodedImage;

pub fn matches(layout: &Layout, _topic: &str) -> bool {
    ["height", "width", "encoding", "step", "data"].iter().all(|f| layout.has(f))
}

pub fn decode<'v>(value: &'v Value<'_>) -> Result<EncodedImage<'v>, String> {
    let size = |field: &str| {
        value.integer(field).and_then(|v| usize::try_from(v).ok()).ok_or_else(|| missing(field))
    };
    Ok(EncodedImage::Raw {
        width: size("width")?,
        height: size("height")?,
        encoding: value.text("encoding").ok_or_else(|| missing("encoding"))?,
        big_endian: value.flag("is_bigendian").unwrap_or(false),
        step: size("step")?,
        data: value.bytes("data").ok_or_else(|| missing("data"))?,
    })
}
