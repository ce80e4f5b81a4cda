//! The table of all message types. `docs/messages.md` is generated from it.

use nalgebra::UnitQuaternion;

use super::layout::Layout;
use super::reading::{FrameTransform, PingReading, RadiometrySetting};
use super::value::Value;
use super::{
    altitude, camera_info, depth_image, dvl_arrays, dvl_beams, dvl_by_path, dvl_numbered,
    dvl_points, dvl_ranges, foxglove_transforms, imu, mavlink_distance, odometry, ping1d,
    point_cloud, radiometry, range, ros_compressed_image, ros_image, transforms, video,
};
use crate::image::EncodedImage;
use crate::vehicle::{CameraInfo, DvlFacts};

/// What a channel carries, with the function that decodes it.
#[derive(Clone, Copy, Debug)]
pub enum Kind {
    /// camera images
    Image(for<'v> fn(&'v Value<'_>) -> Result<EncodedImage<'v>, String>),
    /// camera calibration, also of an uncalibrated camera
    CameraInfo(fn(&Value<'_>) -> Result<CameraInfo, String>),
    /// edges of the TF tree
    Transforms(fn(&Value<'_>) -> Result<Vec<FrameTransform>, String>),
    /// world_from_sensor; `None` where the message has no attitude
    Attitude(fn(&Value<'_>) -> Result<Option<UnitQuaternion<f64>>, String>),
    /// ranges along beams, or an altitude. The rank orders instruments by preference, 0 first.
    Ping(u8, fn(&Value<'_>, &DvlFacts) -> Result<PingReading, String>),
    /// exposure, gain or strobe power
    Radiometry(fn(&Value<'_>) -> Result<Vec<RadiometrySetting>, String>),
}

impl Kind {
    /// One word for tables.
    pub fn label(&self) -> &'static str {
        match self {
            Self::Image(_) => "image",
            Self::CameraInfo(_) => "camera_info",
            Self::Transforms(_) => "transforms",
            Self::Attitude(_) => "attitude",
            Self::Ping(..) => "range",
            Self::Radiometry(_) => "radiometry",
        }
    }
}

/// One supported message type.
pub struct MessageType {
    /// the best known name of this shape
    pub name: &'static str,
    /// fields that are read, and markers for "no return"
    pub about: &'static str,
    /// whether a schema (and topic) has this shape
    pub matches: Matches,
    /// with the decoding function
    pub kind: Kind,
}

type Matches = fn(&Layout, &str) -> bool;

const fn row(name: &'static str, matches: Matches, kind: Kind, about: &'static str) -> MessageType {
    MessageType { name, about, matches, kind }
}

/// Name of the row that no schema matches: depth images have the schema of camera images.
pub const DEPTH_IMAGE: &str = "depth image";

/// The field named by `dvl.path` in the rig file; not a row of the table.
pub static BY_PATH: MessageType = row(
    "dvl.path in the rig file",
    |_, _| false,
    Kind::Ping(0, dvl_by_path::decode),
    "the field that the rig file names",
);

/// Every supported message type; the first match applies.
#[rustfmt::skip]
pub const TYPES: &[MessageType] = &[
    row(DEPTH_IMAGE, |_, _| false, Kind::Ping(2, depth_image::decode),
        "`16UC1` [mm] on a topic named depth, `32FC1` [m], `compressedDepth` PNG of both; 20 \
         samples become beams, with the camera's calibration"),
    row("FFMPEGPacket", video::matches, Kind::Image(video::decode),
        "video: refused, with the remedy; also `foxglove.CompressedVideo`"),
    row("sensor_msgs/Image", ros_image::matches, Kind::Image(ros_image::decode),
        "raw images; also `foxglove.RawImage`"),
    row("sensor_msgs/CompressedImage", ros_compressed_image::matches,
        Kind::Image(ros_compressed_image::decode),
        "JPEG, PNG, TIFF, WebP, identified by their bytes; also `foxglove.CompressedImage`"),
    row("sensor_msgs/CameraInfo", camera_info::matches, Kind::CameraInfo(camera_info::decode),
        "calibration, with region of interest and binning; also `foxglove.CameraCalibration`"),
    row("tf2_msgs/TFMessage", transforms::matches, Kind::Transforms(transforms::decode),
        "extrinsics"),
    row("foxglove.FrameTransform(s)", foxglove_transforms::matches,
        Kind::Transforms(foxglove_transforms::decode),
        "extrinsics"),
    row("sensor_msgs/Imu", imu::matches, Kind::Attitude(imu::decode),
        "attitude; covariance −1 or a zero quaternion means none"),
    row("nav_msgs/Odometry", odometry::matches, Kind::Attitude(odometry::decode),
        "attitude of the child frame"),
    row("ds_sensor_msgs/Ranges3D", dvl_points::matches, Kind::Ping(0, dvl_points::decode),
        "returns as points; validity 1 (low) means no return"),
    row("marine_acoustic_msgs/Dvl", dvl_ranges::matches, Kind::Ping(0, dvl_ranges::decode),
        "`range[]` along `beam_unit_vec[]`, slant; also `acoustic_msgs`, WHOI's \
         `ds_sensor_msgs`; vectors are checked; ≤ 0, NaN, infinite mean no return"),
    row("dvl_msgs/DVL", dvl_beams::matches_distance, Kind::Ping(0, dvl_beams::decode),
        "a list of beams with `distance`, slant: Water Linked and its renames, its own JSON, \
         Blueye; `valid` or `beam_valid` false means no return"),
    row("uuv_sensor_ros_plugins/DVL", dvl_beams::matches_pose, Kind::Ping(0, dvl_beams::decode),
        "a list of beams with `range` and `pose` (x axis), slant: UUV simulator, `cola2_msgs`, \
         `smarc_msgs`, Stonefish; < 0, covariance −1, 81 m, 0.7 m mean no return; without beams \
         the altitude"),
    row("gz.msgs.DVLVelocityTracking", dvl_beams::matches_range, Kind::Ping(0, dvl_beams::decode),
        "a list of beams with `range` or `range.mean`, slant, no directions; `locked` false \
         means no return"),
    row("cola2_msgs/LinkquestDvl", dvl_arrays::matches_vertical, Kind::Ping(0, dvl_arrays::decode),
        "an array of vertical ranges: `altitudeBeam`, `distBeam` (Nortek DF21), \
         `vertical_distance`; `dataGood` 0, velocity −32.768, figure of merit 10 mean no return"),
    row("holoocean/DVLSensorRange", dvl_arrays::matches_slant, Kind::Ping(0, dvl_arrays::decode),
        "an array of slant ranges: `range[4]`, `ranges`, `beam_distance` (Nucleus), \
         `beam_ranges`; vertical with PD0's `config_beamangle`"),
    row("Nucleus BottomTrack", dvl_numbered::matches, Kind::Ping(0, dvl_numbered::decode),
        "one field per beam: `distance_beam_1` (slant), `dist_beam0`, `altitude1`, `b1_dist` \
         (vertical), with their flags"),
    row("MAVLink DISTANCE_SENSOR", mavlink_distance::matches,
        Kind::Ping(1, mavlink_distance::decode),
        "centimetres; one beam by its orientation, or an altitude; quality 1 is invalid"),
    row("sensor_msgs/PointCloud2", point_cloud::matches, Kind::Ping(2, point_cloud::decode),
        "24 points become beams; also `foxglove.PointCloud`"),
    row("sensor_msgs/Range", range::matches, Kind::Ping(1, range::decode),
        "a slant range along x; an altitude where the cone is wider than 0.35 rad; outside \
         [min, max] means no return"),
    row("Ping1D", ping1d::matches, Kind::Ping(1, ping1d::decode),
        "`distance` [mm] and `confidence` [%]; below 60 % means no return"),
    row("flir_camera_msgs/ImageMetaData", radiometry::matches_fields,
        Kind::Radiometry(radiometry::decode),
        "exposure, gain, strobe power by field name: two of them, or one on a topic named after \
         it; Blueye `CameraParameters`"),
    row("std_msgs/Float64 (radiometry)", radiometry::matches_bare,
        Kind::Radiometry(radiometry::decode),
        "one number on a topic named exposure, shutter, strobe, flash, lamp, or gain of a \
         camera"),
    row("std_msgs/Float64 (altitude)", altitude::matches_bare, Kind::Ping(3, altitude::decode),
        "one number on a topic named `altitude`, `altimeter` or `height_above`; ≤ 0 means no \
         return"),
    row("altitude in any message", altitude::matches_field, Kind::Ping(4, altitude::decode),
        "a field `altitude`, `avg_altitude`, `bottom_distance`, `altimeter_distance`, where no \
         better instrument is present"),
];
