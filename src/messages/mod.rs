//! Message types: the bytes of a message to the reading it carries. Wire formats and vendors'
//! markers for "no return" exist in this module only.
//!
//! A channel is recognised by the *fields of its own schema* ([`TYPES`]), never by the name of its
//! type. A new message type is one file and one row of [`TYPES`]. Each row has a sample log in
//! `sample_logs/messages`, and a test reads all of them.

mod altitude;
mod camera_info;
pub mod cdr;
mod decoder;
mod depth_image;
mod descriptor;
mod dvl;
mod dvl_arrays;
mod dvl_beams;
mod dvl_by_path;
mod dvl_numbered;
mod dvl_points;
mod dvl_ranges;
mod foxglove_transforms;
mod header;
mod idl_schema;
mod imu;
mod json;
mod known_schemas;
pub mod layout;
mod mavlink_distance;
mod odometry;
pub mod output;
mod ping1d;
mod point_cloud;
mod protobuf;
mod radiometry;
mod range;
mod reading;
mod ros_compressed_image;
mod ros_image;
pub mod ros_schema;
mod table;
mod transforms;
pub mod value;
mod video;
pub mod writer;

pub use decoder::{ChannelSchema, Decoder};
pub use header::{Header, attitude_frame, header};
pub use reading::{AltitudeCheck, DepthSamples, FrameTransform, PingReading, RadiometrySetting};
pub use table::{Kind, MessageType, TYPES};
