//! Ready-made views of a corrected log: raw beside corrected, the seafloor in 3-D, plots and the
//! beam pattern below; as a layout that Foxglove and Lichtblick import, and as a blueprint for
//! rerun.
//!
//! In: the channels and the `unwater` metadata records of a corrected log. Out: text. Pixels and
//! messages are not looked at.

mod foxglove;
mod rerun;

pub use foxglove::foxglove;
pub use rerun::rerun;

use crate::recording::Recording;

/// The topics of one corrected camera; those that the log does not hold are `None`.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraTopics {
    /// the camera's own topic, as it was recorded
    pub name: String,
    /// raw pictures that a viewer can draw: those for the eye, else those of the camera
    pub raw: Option<String>,
    /// corrected pictures
    pub corrected: Option<String>,
    /// the camera's calibration
    pub camera_info: Option<String>,
    /// the beam pattern's picture
    pub beam_pattern: Option<String>,
    /// the corrected picture on the seafloor
    pub cloud: Option<String>,
    /// the strobe's pose
    pub strobe: Option<String>,
    /// its beams' axes
    pub strobe_beam: Option<String>,
    /// the name of the seafloor's coordinate frame
    pub seafloor_frame: Option<String>,
    /// bare numbers: red, green, blue [1/m]
    pub attenuation: Option<String>,
    /// bare number [m]
    pub altitude: Option<String>,
    /// bare number [m]
    pub residual: Option<String>,
    /// bands of the attenuation
    pub bands: usize,
    /// lines of text
    pub log: Option<String>,
}

/// The cameras that were corrected, in the order of their records; empty where none was.
pub fn cameras(recording: &Recording) -> Vec<CameraTopics> {
    recording
        .metadata
        .iter()
        .filter_map(|record| {
            let place = record
                .name
                .strip_prefix("unwater")
                .filter(|place| place.is_empty() || place.starts_with('/'))?;
            let fact = |key: &str| record.metadata.get(key).cloned();
            let (camera, corrected) = (fact("camera_topic")?, fact("corrected_topic")?);
            let held = |topic: String| {
                recording.channels.values().any(|c| c.topic == topic).then_some(topic)
            };
            let ours = |name: &str| held(format!("/unwater{place}/{name}"));
            Some(CameraTopics {
                raw: ours("raw/compressed").or_else(|| held(camera.clone())),
                corrected: held(corrected),
                camera_info: camera_info_of(recording, &camera),
                beam_pattern: ours("beam_pattern/picture/compressed"),
                cloud: ours("seafloor/cloud"),
                strobe: ours("strobe"),
                strobe_beam: ours("strobe/beam"),
                seafloor_frame: ours("seafloor/transform")
                    .map(|_| format!("unwater{place}/seafloor")),
                attenuation: ours("plot/attenuation_per_m"),
                altitude: ours("plot/camera_altitude_m"),
                residual: ours("plot/seafloor_residual_m"),
                bands: bands_of(recording, place),
                log: ours("log"),
                name: camera,
            })
        })
        .collect()
}

/// The calibration whose topic has most in common with the camera's.
fn camera_info_of(recording: &Recording, camera: &str) -> Option<String> {
    let is_calibration = |schema: u16| {
        recording.schemas.get(&schema).is_some_and(|s| {
            s.name.ends_with("CameraInfo") || s.name.ends_with("CameraCalibration")
        })
    };
    let alike = |topic: &str| topic.bytes().zip(camera.bytes()).take_while(|(a, b)| a == b).count();
    let topics = recording
        .channels
        .values()
        .filter(|c| is_calibration(c.schema_id))
        .map(|c| c.topic.clone());
    topics.filter(|t| alike(t) > 1).max_by_key(|t| (alike(t), std::cmp::Reverse(t.clone())))
}

/// How many bands a camera's model has; three where the log does not say.
fn bands_of(recording: &Recording, place: &str) -> usize {
    let name = format!("{place}/model.json");
    let model = recording
        .attachments()
        .filter_map(Result::ok)
        .find(|a| a.name == name.trim_start_matches('/'));
    let model = model.and_then(|a| recording.attachment_data(&a).ok());
    let model = model.and_then(|data| serde_json::from_slice::<serde_json::Value>(&data).ok());
    model
        .and_then(|m| m["attenuation_per_m"].as_array().map(Vec::len))
        .filter(|n| (1..=3).contains(n))
        .unwrap_or(3)
}

/// Names and colours of bands; a mono camera's one is grey.
fn bands(count: usize) -> &'static [(&'static str, &'static str)] {
    if count == 1 {
        &[("grey", "#9e9e9e")]
    } else {
        &[("red", "#e5484d"), ("green", "#30a46c"), ("blue", "#3e84f7")]
    }
}
