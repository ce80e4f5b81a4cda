//! `sensor_msgs/CompressedImage`: JPEG or PNG. The bytes say which; the format string is believed only for
//! what the pixels were before (`bayer_rggb8; jpeg compressed `: the mosaic itself went through JPEG).

use super::{Value, missing, ros_schema::Layout};
use crate::image::EncodedImage;

pub fn matches(layout: &Layout, _topic: &str) -> bool {
    layout.has("format") && layout.has("data") && layout.has("header") && !layout.has("width")
}

pub fn decode<'v>(value: &'v Value<'_>) -> Result<EncodedImage<'v>, String> {
    Ok(EncodedImage::Compressed {
        format: value.text("format").ok_or_else(|| missing("format"))?,
        data: value.bytes("data").ok_or_else(|| missing("data"))?,
    })
}
