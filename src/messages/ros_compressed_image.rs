//! `sensor_msgs/CompressedImage`, `foxglove.CompressedImage`: JPEG, PNG or WebP, identified by
//! their bytes. The format string serves only for the encoding before compression (`bayer_rggb8;
//! jpeg compressed `: the Bayer mosaic itself was compressed as JPEG).

use super::layout::Layout;
use super::reading::missing;
use super::value::Value;
use crate::image::EncodedImage;

pub fn matches(layout: &Layout, _topic: &str) -> bool {
    let stamped = layout.has("header") || layout.has("timestamp");
    layout.has_all(&["format", "data"]) && stamped && !layout.has("width")
}

pub fn decode<'v>(value: &'v Value<'_>) -> Result<EncodedImage<'v>, String> {
    let format = value.text("format").ok_or_else(|| missing("format"))?;
    if super::video::is_codec(format) {
        return Ok(EncodedImage::Video { codec: format });
    }
    Ok(EncodedImage::Compressed {
        format,
        data: value.bytes("data").ok_or_else(|| missing("data"))?,
    })
}
