//! The vehicle: rig (calibration, extrinsics, lamps) and sensor data (pings, attitude, camera
//! settings).
//!
//! Facts only; choices are in `config`. Missing values are `None`: vendors' "no return" markers are
//! resolved in `messages`.

mod attitude;
mod camera;
mod camera_info;
mod camera_motion;
mod lamps;
mod lens;
mod light_setting;
mod ping;
mod rig;
mod rig_file_check;

pub use attitude::AttitudeTrack;
pub use camera::{Camera, Distortion, LensModel};
pub use camera_info::{CameraInfo, Intrinsics};
pub use camera_motion::{CameraMotion, Link, PoseTrack};
pub use lamps::{Lamp, Lamps, MAX_LAMPS};
pub use lens::{BlackLevel, Vignetting, VignettingName};
pub use light_setting::SettingSeries;
pub use ping::{Beam, JanusArray, Ping, RangeKind};
pub use rig::{
    CameraFacts, DvlFacts, Extrinsics, LampFacts, Medium, MountFacts, ResponseFacts, Rig, RigFile,
    StrobeMount, StrobeSource,
};
