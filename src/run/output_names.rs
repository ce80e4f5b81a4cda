//! Names and formats of the output.

use crate::config::{Config, ImageFormat, Method, OutputEncoding};
use crate::error::{Error, Result};
use crate::image::Container;
use crate::messages::writer::WireFormat;
use crate::session::CameraSession;

/// Topic of the corrected images: the `image…` element becomes `image_corrected`, `/compressed`
/// comes last.
pub fn corrected_topic(camera_topic: &str, compressed: bool) -> String {
    let base = camera_topic.strip_suffix("/compressed").unwrap_or(camera_topic);
    let mut elements: Vec<&str> = base.split('/').collect();
    match elements.iter().rposition(|e| e.starts_with("image")) {
        Some(at) => elements[at] = "image_corrected",
        None => elements.push("image_corrected"),
    }
    elements.join("/") + if compressed { "/compressed" } else { "" }
}

/// Name of a camera among others: its topic without the element of the images.
pub fn camera_name(camera_topic: &str) -> String {
    let base = camera_topic.strip_suffix("/compressed").unwrap_or(camera_topic);
    let elements: Vec<&str> = base.split('/').filter(|e| !e.is_empty()).collect();
    let camera: Vec<&str> = elements.iter().copied().filter(|e| !e.starts_with("image")).collect();
    let named = if camera.is_empty() { elements } else { camera };
    named.iter().map(|e| format!("/{e}")).collect()
}

/// File format of the corrected images.
pub fn output_container(source: Container, config: &Config) -> Container {
    let jpeg =
        Container::Jpeg { subsampled: matches!(source, Container::Jpeg { subsampled: true }) };
    let is_deep = config.render.depth == 16;
    match (config.render.image_format, source) {
        (ImageFormat::Raw, _) | (ImageFormat::Same, Container::Raw) => Container::Raw,
        (ImageFormat::Png, _) | (ImageFormat::Auto | ImageFormat::Same, Container::Png) => {
            Container::Png
        }
        (ImageFormat::Auto | ImageFormat::Same, _) if is_deep => Container::Png,
        (ImageFormat::Jpeg | ImageFormat::Auto | ImageFormat::Same, _) => jpeg,
    }
}

/// Wire format of added messages.
pub fn output_wire(session: &CameraSession) -> WireFormat {
    let channel = session.survey.camera_channels.first();
    let channel = channel.and_then(|id| session.recording.channels.get(id));
    match session.config.output.encoding {
        OutputEncoding::Auto if channel.is_some_and(|c| c.message_encoding == "protobuf") => {
            WireFormat::Protobuf
        }
        OutputEncoding::Auto | OutputEncoding::Cdr => WireFormat::Cdr,
        OutputEncoding::Ros1 => WireFormat::Ros1,
        OutputEncoding::Protobuf => WireFormat::Protobuf,
    }
}

/// Refuses a log that holds topics which would be added: old and new would share a channel.
///
/// # Errors
/// That, with the remedy.
pub fn ensure_not_corrected(session: &CameraSession, only: Option<&regex::Regex>) -> Result<()> {
    let container = output_container(session.survey.container, &session.config);
    let corrected = corrected_topic(&session.survey.camera_topic, container != Container::Raw);
    let is_added = |topic: &str| topic == corrected || topic.starts_with("/unwater/");
    let is_kept = |topic: &str| only.is_none_or(|only| only.is_match(topic));
    let mut channels = session.recording.channels.values();
    match channels.find(|c| is_added(&c.topic) && is_kept(&c.topic)) {
        Some(channel) => Err(Error::Usage(format!(
            "the log holds {} already: it has been corrected before; correct the original, or \
             leave these topics out with --only",
            channel.topic
        ))),
        None => Ok(()),
    }
}

/// Name of a method on the command line.
pub fn method_name(method: Method) -> &'static str {
    match method {
        Method::Full => "full",
        Method::Attenuation => "attenuation",
        Method::BeamPattern => "beam-pattern",
        Method::FrameAverage => "frame-average",
        Method::RangeAverage => "range-average",
        Method::GreyWorld => "grey-world",
        Method::WhitePatch => "white-patch",
        Method::Homomorphic => "homomorphic",
        Method::HomomorphicSurface => "homomorphic-surface",
        Method::Ahe => "ahe",
    }
}

#[cfg(test)]
mod tests {
    use super::corrected_topic;

    #[test]
    fn topics_follow_image_transport() {
        for (topic, compressed, corrected) in [
            ("/camera/image_raw", false, "/camera/image_corrected"),
            ("/camera/image_raw", true, "/camera/image_corrected/compressed"),
            ("/camera/image_color/compressed", true, "/camera/image_corrected/compressed"),
            ("/stereo/left", true, "/stereo/left/image_corrected/compressed"),
        ] {
            assert_eq!(corrected_topic(topic, compressed), corrected);
        }
    }
}
