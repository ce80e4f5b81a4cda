//! Errors, with their remedies.

use std::path::PathBuf;

/// Failure of a command. A *frame* that cannot be corrected is not an error: it is copied
/// uncorrected and counted.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)] // the messages describe them
pub enum Error {
    #[error("cannot read {path}: {source}")]
    Read { path: PathBuf, source: std::io::Error },
    #[error("cannot write {path}: {source}")]
    Write { path: PathBuf, source: std::io::Error },
    #[error("cannot write {path}: {reason}")]
    WriteRecord { path: PathBuf, reason: String },
    #[error("{path} is not an MCAP file{hint}")]
    NotMcap { path: PathBuf, hint: &'static str },
    #[error("{path} has no readable message{detail}")]
    Empty { path: PathBuf, detail: String },
    #[error("the output is the input itself ({path}); give another name with -o")]
    OutputIsInput { path: PathBuf },
    #[error("{path} exists already; give another name with -o, or --force to overwrite it")]
    OutputExists { path: PathBuf },
    #[error("{what} in {path}: {reason}")]
    BadFile { path: PathBuf, what: &'static str, reason: String },
    #[error(
        "the log has no camera images that can be read; it has {seen}. unwater needs images \
         shaped like sensor_msgs/Image, sensor_msgs/CompressedImage, foxglove.RawImage or \
         foxglove.CompressedImage, in CDR, ROS 1, protobuf or JSON"
    )]
    NoCamera { seen: String },
    #[error(
        "{topic} is {codec} video, which is not supported; convert it to images first: `python3 \
         examples/video_to_pictures.py IN.mcap OUT.mcap`, or in ROS 2 replay it through `ros2 run \
         image_transport republish` (from ffmpeg or foxglove, to compressed) and record it again"
    )]
    Video { topic: String, codec: String },
    #[error(
        "the log has {} cameras: {}; select one with --camera TOPIC",
        topics.len(),
        topics.join(", ")
    )]
    SeveralCameras { topics: Vec<String> },
    #[error("there is no {what} on topic {topic:?}; the log has {seen}")]
    NoSuchTopic { what: &'static str, topic: String, seen: String },
    #[error(
        "the log has no readable DVL or altimeter; it has {seen}. unwater needs ranges to the \
         seafloor: name their topic with --dvl TOPIC"
    )]
    NoRanges { seen: String },
    #[error(
        "the log has no calibration for {topic}; write one into a rig file: `unwater init IN.mcap \
         -o rig.toml`, fill in camera.fx or camera.horizontal_field_of_view_deg, then add --rig \
         rig.toml"
    )]
    NoCalibration { topic: String },
    #[error(
        "the extrinsics of the {what} are unknown: no transform connects its frame {frame:?} to \
         the camera's frame {camera_frame:?} in the log's TF tree; write them into a rig file: \
         `unwater init IN.mcap -o rig.toml`, fill in [{section}.mount], then add --rig rig.toml"
    )]
    NoMount { what: &'static str, frame: String, camera_frame: String, section: &'static str },
    #[error("{0}")]
    Image(String),
    #[error("{0}")]
    Rig(String),
    #[error("{0}")]
    Usage(String),
    #[error("attenuation cannot be estimated: {reason}; {remedy}")]
    NotEstimated { reason: String, remedy: String },
}

/// Result of the library's fallible functions.
pub type Result<T> = std::result::Result<T, Error>;
