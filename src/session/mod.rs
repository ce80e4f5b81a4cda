//! An open log: what it holds (index), what that means for one of its cameras (survey), and the
//! frames of that camera.
//!
//! A log is scanned once per command. All its cameras, both passes and every product work on that
//! one index; a frame is identified by its place in the log ([`FrameId`]) and built by
//! [`CameraSession::frame`].
//!
//! The files depend on each other in this order: `options`, `readings`, `index`, `log`,
//! `frame_gains`, `survey`, `camera`, `frame`.

mod camera;
mod frame;
mod frame_gains;
pub mod index;
mod joints;
mod log;
mod options;
mod readings;
pub mod survey;
mod tilts;

pub use crate::parallel::Threads;
pub use crate::recording::FrameId;
pub use camera::CameraSession;
pub use frame::{Frame, ImageMessage, UnusableFrame};
pub use frame_gains::FrameGains;
pub use index::FrameRef;
pub use log::{Log, sha256};
pub use options::{Options, Progress, Selection, Shard, Silent, Step};
pub use readings::{ChannelReadings, Readings};
pub use tilts::Tilts;
