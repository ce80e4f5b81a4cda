//! What the robot *is* (its rig) and what its sensors *said* (frames' stamps, pings, attitudes,
//! settings): facts only.
//!
//! A wrong fact here is a wrong answer; a different choice (`config`) is only another taste. Inside
//! this room absence is `None`: what a vendor writes for "no return" ends in `messages`.

mod attitude;
mod camera;
mod lamps;
mod light_setting;
mod ping;
mod rig;
mod rig_file_check;

pub use attitude::AttitudeTrack;
pub use camera::{Calibration, Camera, Distortion, LensModel};
pub use lamps::{Lamp, Lamps, MAX_LAMPS};
pub use light_setting::SettingSeries;
pub use ping::{Beam, JanusArray, Ping, RangeKind};
pub use rig::{
    CameraFacts, DvlFacts, LampFacts, Medium, MountFacts, ResponseFacts, Rig, RigFile, StrobeMount,
    Vignetting, VignettingName,
};
