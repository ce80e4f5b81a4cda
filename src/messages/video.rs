//! Video in messages: recognised in order to refuse it with a remedy. A video frame depends on the
//! frames before it, and a decoder would be larger than the rest of the program.

use super::layout::Layout;
use super::reading::missing;
use super::value::Value;
use crate::image::EncodedImage;

/// Prefixes of video codecs in the fields `format` and `encoding`.
const CODECS: &[&str] = &["h264", "h265", "hevc", "vp8", "vp9", "av1", "mpeg", "theora"];

/// Whether a format string names a video codec.
pub fn is_codec(format: &str) -> bool {
    let format = format.trim().to_ascii_lowercase();
    CODECS.iter().any(|c| format.starts_with(c)) && !format.contains("jpeg")
}

/// `ffmpeg_image_transport_msgs/FFMPEGPacket`
pub fn matches(layout: &Layout, _topic: &str) -> bool {
    layout.has_all(&["width", "height", "encoding", "pts", "flags", "data"])
}

pub fn decode<'v>(value: &'v Value<'_>) -> Result<EncodedImage<'v>, String> {
    Ok(EncodedImage::Video { codec: value.text("encoding").ok_or_else(|| missing("encoding"))? })
}
