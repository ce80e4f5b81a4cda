//! Layouts of a corrected log for viewers: raw beside corrected images, the seafloor in 3-D, plots
//! and the beam pattern below. A layout file for Foxglove and Lichtblick, a blueprint for rerun.
//!
//! Input are the channels and the `unwater` metadata records of a corrected log; output is text.
//! Messages are not read.

mod foxglove;
mod rerun;

pub use foxglove::foxglove;
pub use rerun::rerun;

use crate::recording::Recording;

/// The topics of one corrected camera; `None` for those that the log does not have.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraTopics {
    /// topic of the recorded images
    pub name: String,
    /// raw images that viewers can draw: the preview, else the recorded images
    pub raw: Option<String>,
    /// corrected images
    pub corrected: Option<String>,
    /// camera calibration
    pub camera_info: Option<String>,
    /// beam pattern as an image
    pub beam_pattern: Option<String>,
    /// point cloud of the seafloor, coloured by the corrected image
    pub cloud: Option<String>,
    /// pose of the strobe
    pub strobe: Option<String>,
    /// points of the strobe's beam
    pub strobe_beam: Option<String>,
    /// frame id of the seafloor
    pub seafloor_frame: Option<String>,
    /// array of numbers, one per band (1/m)
    pub attenuation: Option<String>,
    /// camera altitude (m)
    pub altitude: Option<String>,
    /// residual of the seafloor plane (m)
    pub residual: Option<String>,
    /// number of bands
    pub bands: usize,
    /// log lines
    pub log: Option<String>,
}

/// The corrected cameras, in the order of their metadata records.
pub fn cameras(recording: &Recording) -> Vec<CameraTopics> {
    recording
        .metadata
        .iter()
        .filter_map(|record| {
            let namespace = record
                .name
                .strip_prefix("unwater")
                .filter(|namespace| namespace.is_empty() || namespace.starts_with('/'))?;
            let fact = |key: &str| record.metadata.get(key).cloned();
            let (camera, corrected) = (fact("camera_topic")?, fact("corrected_topic")?);
            let existing = |topic: String| {
                recording.channels.values().any(|c| c.topic == topic).then_some(topic)
            };
            let added = |name: &str| existing(format!("/unwater{namespace}/{name}"));
            Some(CameraTopics {
                raw: added("raw/compressed").or_else(|| existing(camera.clone())),
                corrected: existing(corrected),
                camera_info: camera_info_of(recording, &camera),
                beam_pattern: added("beam_pattern/picture/compressed"),
                cloud: added("seafloor/cloud"),
                strobe: added("strobe"),
                strobe_beam: added("strobe/beam"),
                seafloor_frame: added("seafloor/transform")
                    .map(|_| format!("unwater{namespace}/seafloor")),
                attenuation: added("plot/attenuation_per_m"),
                altitude: added("plot/camera_altitude_m"),
                residual: added("plot/seafloor_residual_m"),
                bands: bands_of(recording, namespace),
                log: added("log"),
                name: camera,
            })
        })
        .collect()
}

/// The calibration topic that shares the longest prefix with the camera topic.
fn camera_info_of(recording: &Recording, camera: &str) -> Option<String> {
    let is_calibration = |schema: u16| {
        recording.schemas.get(&schema).is_some_and(|s| {
            s.name.ends_with("CameraInfo") || s.name.ends_with("CameraCalibration")
        })
    };
    let prefix =
        |topic: &str| topic.bytes().zip(camera.bytes()).take_while(|(a, b)| a == b).count();
    let topics = recording
        .channels
        .values()
        .filter(|c| is_calibration(c.schema_id))
        .map(|c| c.topic.clone());
    topics.filter(|t| prefix(t) > 1).max_by_key(|t| (prefix(t), std::cmp::Reverse(t.clone())))
}

/// Number of bands of a camera's model; three where the log has no model.
fn bands_of(recording: &Recording, namespace: &str) -> usize {
    let name = format!("{namespace}/model.json");
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

/// Names and colours of the bands; the band of a mono camera is grey.
fn bands(count: usize) -> &'static [(&'static str, &'static str)] {
    if count == 1 {
        &[("grey", "#9e9e9e")]
    } else {
        &[("red", "#e5484d"), ("green", "#30a46c"), ("blue", "#3e84f7")]
    }
}
