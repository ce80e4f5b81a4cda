//! The camera_info that belongs to a camera: by its namespace or its frame, never because its size
//! fits.

use super::super::log::Log;
use crate::diagnostics::{CameraFact, Diagnostic, Severity};
use crate::messages::Kind;
use crate::vehicle::Camera;

/// Words of topics that every camera has.
const COMMON_WORDS: &[&str] = &[
    "image",
    "raw",
    "rect",
    "color",
    "colour",
    "mono",
    "rgb",
    "compressed",
    "camera",
    "cam",
    "info",
    "calibration",
    "calib",
    "depth",
    "transport",
];
/// Words that set the cameras of a rig apart.
const SIDES: &[&str] =
    &["left", "right", "port", "starboard", "stbd", "front", "rear", "back", "down", "up", "top"];

/// Images of one topic.
#[derive(Clone, Copy)]
pub struct Images<'i> {
    /// their topic
    pub topic: &'i str,
    /// their frame id
    pub frame: &'i str,
    /// width and height (px)
    pub size: Option<(usize, usize)>,
    /// topic of the camera_info by the rig file
    pub named_info: Option<&'i str>,
}

/// How a camera_info belongs to a camera, the closest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Bond {
    Named,
    NamespaceAndFrame,
    Namespace,
    Frame,
    /// a namespace above, with no other camera below it
    ParentNamespace,
}

impl Bond {
    fn word(self) -> &'static str {
        match self {
            Self::Named => "the rig file names it",
            Self::NamespaceAndFrame => "its namespace and its frame are the camera's",
            Self::Namespace => "its namespace is the camera's",
            Self::Frame => "its frame is the camera's",
            Self::ParentNamespace => "its namespace is above the camera's and no other's",
        }
    }
}

/// The calibration of a camera by the log.
#[derive(Default)]
pub struct FromLog {
    /// of the images as they are
    pub camera: Option<Camera>,
    /// topic of its camera_info
    pub topic: Option<String>,
    /// which one it is and why others are not used
    pub facts: Vec<Diagnostic>,
}

/// The calibration of a camera by the log.
pub fn calibration_in_log(log: &Log, images: Images<'_>) -> FromLog {
    let mut candidates = Vec::new();
    let mut found = FromLog::default();
    for (id, channel) in &log.index.channels {
        let topic = log.topic(*id);
        let Some(info) = &channel.camera else { continue };
        match bond(log, images, &topic, &channel.frame_id) {
            Some(bond) => candidates.push((bond, topic, info)),
            None => {
                let fact = CameraFact::InfoOfAnotherCamera { frame: channel.frame_id.clone() };
                found.facts.push(Diagnostic::on(&topic, fact));
            }
        }
    }
    candidates.sort_by(|a, b| (a.0, &a.1).cmp(&(b.0, &b.1)));
    for (bond, topic, info) in candidates {
        match info.camera(images.size, is_rectified(images.topic)) {
            Err(fact) => found.facts.push(Diagnostic::on(&topic, fact)),
            Ok((camera, assumed)) => {
                found.facts.retain(|d| d.severity() > Severity::Info);
                found.facts.extend(assumed.map(|fact| Diagnostic::on(&topic, fact)));
                let fact = CameraFact::InfoUsed { because: bond.word().into() };
                found.facts.push(Diagnostic::on(&topic, fact));
                (found.camera, found.topic) = (Some(camera), Some(topic));
                return found;
            }
        }
    }
    found
}

/// Whether a topic's name says that its images are rectified.
fn is_rectified(topic: &str) -> bool {
    topic.split(['/', '_']).any(|word| matches!(word, "rect" | "rectified" | "rectify"))
}

/// Elements of a topic before the first that names images; of one without such an element all.
fn namespace_of_images(topic: &str) -> Vec<&str> {
    let elements = elements(topic);
    let images = elements.iter().position(|e| e.to_ascii_lowercase().contains("image"));
    elements[..images.unwrap_or(elements.len())].to_vec()
}

fn elements(topic: &str) -> Vec<&str> {
    topic.split('/').filter(|e| !e.is_empty()).collect()
}

/// Words of a topic below a namespace that are not common to all cameras.
fn own_words(topic: &str, namespace: usize) -> Vec<String> {
    let below = elements(topic).into_iter().skip(namespace).take(1);
    let words = below.flat_map(|e| e.split('_')).map(str::to_ascii_lowercase);
    words.filter(|w| !w.is_empty() && !COMMON_WORDS.contains(&w.as_str())).collect()
}

/// Whether two topics name different sides of a rig.
fn are_of_two_sides(a: &str, b: &str) -> bool {
    let sides = |topic: &str| -> Vec<String> {
        let words = topic.split(['/', '_']).map(str::to_ascii_lowercase);
        words.filter(|w| SIDES.contains(&w.as_str())).collect()
    };
    let (a, b) = (sides(a), sides(b));
    !a.is_empty() && !b.is_empty() && a.iter().all(|side| !b.contains(side))
}

fn bond(log: &Log, images: Images<'_>, topic: &str, frame: &str) -> Option<Bond> {
    if let Some(named) = images.named_info {
        return (named == topic).then_some(Bond::Named);
    }
    let of_images = namespace_of_images(images.topic);
    let infos = elements(topic);
    let of_info = &infos[..infos.len().saturating_sub(1)];
    let is_framed = !frame.is_empty() && frame == images.frame;
    let contradicts = !frame.is_empty() && !images.frame.is_empty() && !is_framed;
    // `/left_image` and `/right_info` share the root.
    let (own, others) = (own_words(images.topic, of_info.len()), own_words(topic, of_info.len()));
    let differs = !own.is_empty() && !others.is_empty() && own != others;
    // A topic without an element for images (`/front`) may be a namespace or a leaf.
    let is_leaf = of_images.len() == elements(images.topic).len();
    let parent = of_images.split_last().map(|(_, parent)| parent);
    if of_info == of_images || (is_leaf && !differs && Some(of_info) == parent) {
        return match (is_framed, differs) {
            (true, _) => Some(Bond::NamespaceAndFrame),
            (false, false) => Some(Bond::Namespace),
            (false, true) => None,
        };
    }
    if are_of_two_sides(images.topic, topic) {
        return None;
    }
    if is_framed {
        return Some(Bond::Frame);
    }
    let is_above = of_images.starts_with(of_info) && !contradicts;
    (is_above && is_only_camera_below(log, of_info)).then_some(Bond::ParentNamespace)
}

fn is_only_camera_below(log: &Log, namespace: &[&str]) -> bool {
    let images = log.index.decoders.iter();
    let images = images.filter(|(_, d)| matches!(d.message_type.kind, Kind::Image(_)));
    let topics: Vec<String> = images.map(|(id, _)| log.topic(*id)).collect();
    let mut cameras: Vec<Vec<&str>> = topics.iter().map(|t| namespace_of_images(t)).collect();
    cameras.retain(|camera| camera.starts_with(namespace));
    cameras.sort_unstable();
    cameras.dedup();
    cameras.len() <= 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rectified_images_are_recognised_by_whole_words() {
        for topic in ["/c/image_rect", "/c/image_rect_color/compressed", "/c/rectified/image"] {
            assert!(is_rectified(topic), "{topic}");
        }
        for topic in ["/c/image_raw", "/direction/image", "/rectangle/image", "/c/image_unrect"] {
            assert!(!is_rectified(topic), "{topic}");
        }
    }

    #[test]
    fn namespaces_end_where_images_begin() {
        assert_eq!(namespace_of_images("/a/b/image_raw/compressed"), ["a", "b"]);
        assert_eq!(namespace_of_images("/front"), ["front"]);
        assert!(namespace_of_images("/image").is_empty());
        assert!(are_of_two_sides("/left/image", "/right/camera_info"));
        assert!(!are_of_two_sides("/left/image", "/calibration"));
    }
}
