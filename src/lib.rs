//! Corrects the images of an underwater robot for attenuation and for the beam pattern of its
//! strobe, after J. W. Kaeli and H. Singh.
//!
//! The program `unwater` corrects whole MCAP logs; its manual is the repository's `README.md`. This
//! library does the same from a program of one's own, and corrects single frames, for which no log
//! is needed.
//!
//! # One frame
//!
//! A frame needs an image, the seafloor below it, the rig (calibration and extrinsics) and a model:
//! the `model.json` that `unwater estimate` writes, or one of your own.
//!
//! ```
//! use unwater::{
//!     Camera, Config, Direction, EncodedImage, FrameCorrector, ModelFile, Rig, SeafloorPlane,
//!     Transform,
//! };
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! // The strobe is 0.5 m to the left of the camera and parallel to it: body space is the camera's,
//! // x right, y down, z along the optical axis.
//! let no_rotation = [0.0, 0.0, 0.0, 1.0]; // a quaternion x, y, z, w
//! let strobe = Transform::from_parts([-0.5, 0.0, 0.0], no_rotation);
//! let rig = Rig::of_camera_and_strobe(Camera::from_field_of_view(640, 480, 60.0), strobe);
//!
//! // The seafloor is level, 2 m below the camera, which looks straight down.
//! let down = Direction::boresight();
//! let plane = SeafloorPlane::at_altitude(&rig, down, 2.0);
//!
//! let model = ModelFile::from_json(&std::fs::read_to_string("examples/model.json")?)?;
//! let corrector = FrameCorrector::from_file(&model, rig, Config::default())?;
//!
//! // An image as a driver delivers it; `EncodedImage::Compressed` holds a JPEG or PNG file.
//! let pixels = vec![60; 640 * 480 * 3];
//! let image = EncodedImage::Raw {
//!     width: 640,
//!     height: 480,
//!     encoding: "rgb8",
//!     big_endian: false,
//!     step: 640 * 3,
//!     data: &pixels,
//! };
//! let corrected = corrector.correct(&image, &plane, None)?;
//! println!("mean light path {:.2} m", corrected.facts.path_length_mean_m);
//! # let temporary = tempfile::tempdir()?;
//! # let directory = temporary.path();
//! std::fs::write(directory.join("corrected.png"), corrected.to_png()?)?;
//! # assert!((4.0..5.0).contains(&corrected.facts.path_length_mean_m));
//! # // Red is attenuated most, so that a grey raw image turns red.
//! # let at = (240 * 640 + 320) * 3;
//! # assert!(corrected.samples[at] > corrected.samples[at + 2]);
//! # Ok(())
//! # }
//! ```
//!
//! [`SeafloorEstimator`] computes the plane from the beams of a DVL. `examples/02_one_frame.rs` is
//! this page with a check of the result, `examples/03_custom_model.rs` a model without a file.
//!
//! # A whole log
//!
//! [`correct()`] estimates a model, corrects a log and writes a new one, as in
//! `examples/01_correct_log.rs`:
//!
//! ```no_run
//! use std::path::Path;
//!
//! let (input, output) = (Path::new("dive.mcap"), Path::new("dive.corrected.mcap"));
//! let options = unwater::Options::default();
//! let (report, model) = unwater::correct(input, output, None, &options, &unwater::Silent)?;
//! println!("attenuation {} per metre", model.attenuation_text());
//! # Ok::<(), unwater::Error>(())
//! ```
//!
//! # Stability
//!
//! What this page lists is the interface. The modules behind it are reachable, because the program
//! and the tests of the repository use them, but hidden: they may change in any version.

// The modules in the order of the data flow. ARCHITECTURE.md has the table of layers, which a test
// checks.
#[doc(hidden)]
pub mod coordinates;
#[doc(hidden)]
pub mod diagnostics;
#[doc(hidden)]
pub mod error;
mod parallel;
mod stats;
mod toml_file;
#[doc(hidden)]
pub mod units;

#[doc(hidden)]
pub mod image;

mod plot;

#[doc(hidden)]
pub mod config;

#[doc(hidden)]
pub mod vehicle;

#[doc(hidden)]
pub mod geometry;
#[doc(hidden)]
pub mod messages;

#[doc(hidden)]
pub mod model;

#[doc(hidden)]
pub mod solver;

#[doc(hidden)]
pub mod correct;
#[doc(hidden)]
pub mod estimate;

#[doc(hidden)]
pub mod recording;
#[doc(hidden)]
pub mod report;
#[doc(hidden)]
pub mod viewers;

#[doc(hidden)]
pub mod session;

#[doc(hidden)]
pub mod run;

#[doc(hidden)]
pub mod products;

#[doc(hidden)]
pub mod import;

#[cfg(feature = "cli")]
#[doc(hidden)]
pub mod cli;

// Runs over logs.
pub use error::{Error, Result};
pub use recording::{LogFiles, Window};
pub use report::Report;
pub use run::{correct, correct_all, estimate_logs};
pub use session::{Options, Progress, Selection, Silent, Step};

// Single frames.
pub use correct::{FrameFacts, estimate_rendering};
pub use geometry::{LightPath, SeafloorEstimator, SeafloorPlane, Support, View};
pub use image::decode::{CameraResponse, DecodedImage, decode};
pub use image::transfer::Transfer;
pub use image::{Bands, EncodedImage, ImageShape, LinearImage, SensorImage};
pub use run::{CorrectedFrame, FrameCorrector};

// The vehicle.
pub use coordinates::{Body, Direction, Dvl, Optical, Point, Strobe, Transform};
pub use units::{Altitude, SlantRange, Stamp};
pub use vehicle::{
    AttitudeTrack, Beam, Camera, Distortion, Lamps, Ping, RangeKind, Rig, RigFile, StrobeMount,
    StrobeSource,
};

// The model.
pub use model::{
    AttenuationOverTime, Backscatter, BeamGrid, BeamPattern, ImagingModel, ModelFile, Removal,
    RenderingFile, SpreadingModel,
};

// The settings.
pub use config::{
    Config, EstimateConfig, Estimator, ImageFormat, Method, OutputConfig, RenderConfig,
    SeafloorConfig, Spreading, WhiteBalance,
};
