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
        "the log has no camera images that can be read; it has {seen}{unreadable}. unwater needs \
         images shaped like sensor_msgs/Image, sensor_msgs/CompressedImage, foxglove.RawImage or \
         foxglove.CompressedImage, in CDR, ROS 1, protobuf or JSON"
    )]
    NoCamera { seen: String, unreadable: String },
    #[error(
        "{topic} is {codec} video, which is not supported; convert it to images first: `python3 \
         examples/video_to_pictures.py {} OUT.mcap`, or in ROS 2 replay it through `ros2 run \
         image_transport republish` (from ffmpeg or foxglove, to compressed) and record it again",
        file.display()
    )]
    Video { topic: String, codec: String, file: PathBuf },
    #[error(
        "the log has {} cameras: {}; select one with --camera TOPIC",
        topics.len(),
        topics.join(", ")
    )]
    SeveralCameras { topics: Vec<String> },
    #[error("there is no {what} on topic {topic:?}; the log has {seen}")]
    NoSuchTopic { what: &'static str, topic: String, seen: String },
    #[error(
        "the log has no readable DVL or altimeter; it has {seen}{unreadable}. unwater needs ranges \
         to the seafloor, in one of the message types of docs/messages.md"
    )]
    NoRanges { seen: String, unreadable: String },
    #[error(
        "the log has no calibration of {topic} that can be used{found}; write one into a rig file: \
         `unwater init {} -o rig.toml`, fill in camera.fx or camera.horizontal_field_of_view_deg, \
         then add --rig rig.toml", file.display()
    )]
    NoCalibration { topic: String, found: String, file: PathBuf },
    #[error("{0}")]
    NoMount(Box<MissingMount>),
    #[error("{0}")]
    Image(String),
    #[error("{0}")]
    Rig(String),
    #[error("{0}")]
    Data(String),
    #[error("{0}")]
    Usage(String),
    #[error("attenuation cannot be estimated: {reason}; {remedy}")]
    NotEstimated { reason: String, remedy: String },
}

/// Result of the library's fallible functions.
pub type Result<T> = std::result::Result<T, Error>;

/// A mount that is needed and unknown.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "the mount of the {what} {topic} (frame {frame:?}) relative to the camera (frame \
     {camera_frame:?}) is unknown: {gap}; or write it into a rig file: `unwater init {} -o \
     rig.toml`, fill in [{section}.mount], then add --rig rig.toml", file.display()
)]
#[allow(missing_docs)] // the text says it
pub struct MissingMount {
    pub what: &'static str,
    pub topic: String,
    pub frame: String,
    pub camera_frame: String,
    pub gap: MountGap,
    pub section: &'static str,
    pub file: PathBuf,
}

/// Why the pose of a frame relative to the camera is unknown.
#[derive(Clone, Debug, PartialEq)]
#[allow(missing_docs)] // the texts say it
pub enum MountGap {
    NoTransforms,
    NoFrameId { is_camera: bool },
    NoRotation { parent: String, child: String },
    Moving { parent: String, child: String, rotation_deg: f64 },
    NotInTree { frame: String },
    Far { frame: String },
    SeparateTrees { root: String, camera_root: String },
}

impl std::fmt::Display for MountGap {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::NoTransforms => f.write_str(
                "the log has no transforms (/tf_static); if it is a later part of a split \
                 recording, its first part has them: give the folder of the recording, or all its \
                 parts",
            ),
            Self::NoFrameId { is_camera: true } => {
                f.write_str("the camera's images name no frame (frame_id is empty)")
            }
            Self::NoFrameId { is_camera: false } => {
                f.write_str("its messages name no frame (frame_id is empty)")
            }
            Self::NoRotation { parent, child } => {
                write!(f, "the transform from {parent:?} to {child:?} has no valid rotation")
            }
            Self::Moving { parent, child, rotation_deg } => write!(
                f,
                "the joint from {parent:?} to {child:?} moves by up to {rotation_deg:.1}°, and \
                 only joints between vehicle and camera are followed; select a part of the log in \
                 which it stands still with -S and -E"
            ),
            Self::NotInTree { frame } => {
                write!(f, "the frame {frame:?} is not in the log's TF tree")
            }
            Self::Far { frame } => {
                write!(f, "the TF tree has {frame:?} more than 50 m away; translations are metres")
            }
            Self::SeparateTrees { root, camera_root } => write!(
                f,
                "its frame hangs below {root:?}, the camera's below {camera_root:?}, and no \
                 transform connects the two"
            ),
        }
    }
}
