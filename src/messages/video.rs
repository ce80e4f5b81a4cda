//! Video in messages: known, so that it can be refused with the remedy. A frame of it needs those
//! before it, and a decoder that would be larger than all the rest of the program.

use super::{Value, layout::Layout, missing};
use crate::image::EncodedImage;

/// Codecs in the `format` and `encoding` of messages, each as a word may begin.
const CODECS: &[&str] = &["h264", "h265", "hevc", "vp8", "vp9", "av1", "mpeg", "theora"];

/// Whether a format string names a video codec.
pub fn is_codec(format: &str) -> bool {
    let word = format.trim().to_ascii_lowercase();
    CODECS.iter().any(|c| word.starts_with(c)) && !word.contains("jpeg")
}

/// `ffmpeg_image_transport_msgs/FFMPEGPacket`
pub fn matches(layout: &Layout, _topic: &str) -> bool {
    layout.has_all(&["width", "height", "encoding", "pts", "flags", "data"])
}

pub fn decode<'v>(value: &'v Value<'_>) -> Result<EncodedImage<'v>, String> {
    Ok(EncodedImage::Video { codec: value.text("encoding").ok_or_else(|| missing("encoding"))? })
}
