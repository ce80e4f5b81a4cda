//! The table of all message types: a row each. `docs/messages.md` is made of it.

use super::layout::Layout;
use super::*;

/// One message type the program reads.
pub struct MessageType {
    /// the best known name of the shape
    pub name: &'static str,
    /// what is read of it and what means "no return"
    pub about: &'static str,
    /// whether a schema (and topic) has this shape
    pub matches: fn(&Layout, &str) -> bool,
    /// how it is read
    pub kind: Kind,
}

/// The row that no schema matches: its messages are shaped like pictures.
pub const DEPTH: &str = "depth image";

/// Every message type that is read, first match wins.
#[rustfmt::skip]
pub const TYPES: &[MessageType] = &[
    MessageType { name: DEPTH, matches: |_, _| false, kind: Kind::Ping(2, depth_image::decode),
        about: "`16UC1` [mm] on a topic that says depth, `32FC1` [m], `compressedDepth` PNG of both; 20 places become beams, with the camera's calibration" },
    MessageType { name: "FFMPEGPacket", matches: video::matches, kind: Kind::Image(video::decode),
        about: "video: refused, with the remedy; so is `foxglove.CompressedVideo`" },
    MessageType { name: "sensor_msgs/Image", matches: ros_image::matches, kind: Kind::Image(ros_image::decode),
        about: "pictures, also `foxglove.RawImage`" },
    MessageType { name: "sensor_msgs/CompressedImage", matches: ros_compressed_image::matches, kind: Kind::Image(ros_compressed_image::decode),
        about: "JPEG, PNG, WebP, told by their bytes; also `foxglove.CompressedImage`" },
    MessageType { name: "sensor_msgs/CameraInfo", matches: camera_info::matches, kind: Kind::CameraInfo(camera_info::decode),
        about: "calibration, with region of interest and binning; also `foxglove.CameraCalibration`" },
    MessageType { name: "tf2_msgs/TFMessage", matches: transforms::matches, kind: Kind::Transforms(transforms::decode),
        about: "mounts" },
    MessageType { name: "foxglove.FrameTransform(s)", matches: foxglove_transforms::matches, kind: Kind::Transforms(foxglove_transforms::decode),
        about: "mounts" },
    MessageType { name: "sensor_msgs/Imu", matches: imu::matches, kind: Kind::Attitude(imu::decode),
        about: "attitude; covariance −1 or a zero quaternion means none" },
    MessageType { name: "nav_msgs/Odometry", matches: odometry::matches, kind: Kind::Attitude(odometry::decode),
        about: "attitude of the child frame" },
    MessageType { name: "ds_sensor_msgs/Ranges3D", matches: dvl_points::matches, kind: Kind::Ping(0, dvl_points::decode),
        about: "hits as points, the best form; validity 1 (low) is lost" },
    MessageType { name: "marine_acoustic_msgs/Dvl", matches: dvl_ranges::matches, kind: Kind::Ping(0, dvl_ranges::decode),
        about: "`range[]` along `beam_unit_vec[]`, slant; also `acoustic_msgs`, WHOI's `ds_sensor_msgs`; vectors are checked; ≤ 0, NaN, infinite are lost" },
    MessageType { name: "dvl_msgs/DVL", matches: dvl_beams::matches_distance, kind: Kind::Ping(0, dvl_beams::decode),
        about: "a list of beams with `distance`, slant: Water Linked and its renames, its own JSON, Blueye; `valid` or `beam_valid` false is lost" },
    MessageType { name: "uuv_sensor_ros_plugins/DVL", matches: dvl_beams::matches_pose, kind: Kind::Ping(0, dvl_beams::decode),
        about: "a list of beams with `range` and `pose` (x axis), slant: UUV simulator, `cola2_msgs`, `smarc_msgs`, Stonefish; < 0, covariance −1, 81 m, 0.7 m are lost; no beams: the altitude" },
    MessageType { name: "gz.msgs.DVLVelocityTracking", matches: dvl_beams::matches_range, kind: Kind::Ping(0, dvl_beams::decode),
        about: "a list of beams with `range` or `range.mean`, slant, no directions; `locked` false is lost" },
    MessageType { name: "cola2_msgs/LinkquestDvl", matches: dvl_arrays::matches_vertical, kind: Kind::Ping(0, dvl_arrays::decode),
        about: "an array of vertical ranges: `altitudeBeam`, `distBeam` (Nortek DF21), `vertical_distance`; `dataGood` 0, velocity −32.768, merit 10 are lost" },
    MessageType { name: "holoocean/DVLSensorRange", matches: dvl_arrays::matches_slant, kind: Kind::Ping(0, dvl_arrays::decode),
        about: "an array of slant ranges: `range[4]`, `ranges`, `beam_distance` (Nucleus), `beam_ranges`; with `config_beamangle` PD0's vertical ones" },
    MessageType { name: "Nucleus BottomTrack", matches: dvl_numbered::matches, kind: Kind::Ping(0, dvl_numbered::decode),
        about: "one field per beam: `distance_beam_1` (slant), `dist_beam0`, `altitude1`, `b1_dist` (vertical), with their flags" },
    MessageType { name: "MAVLink DISTANCE_SENSOR", matches: mavlink_distance::matches, kind: Kind::Ping(1, mavlink_distance::decode),
        about: "centimetres; one beam by its orientation, or an altitude; quality 1 is invalid" },
    MessageType { name: "sensor_msgs/PointCloud2", matches: point_cloud::matches, kind: Kind::Ping(2, point_cloud::decode),
        about: "24 points become beams; also `foxglove.PointCloud`" },
    MessageType { name: "sensor_msgs/Range", matches: range::matches, kind: Kind::Ping(1, range::decode),
        about: "a slant range along x; an altitude where the cone is above 0.35 rad; outside [min, max] is lost" },
    MessageType { name: "Ping1D", matches: ping1d::matches, kind: Kind::Ping(1, ping1d::decode),
        about: "`distance` [mm] and `confidence` [%]; below 60 % is lost" },
    MessageType { name: "flir_camera_msgs/ImageMetaData", matches: radiometry::matches_fields, kind: Kind::Radiometry(radiometry::decode),
        about: "exposure, gain, strobe power by name: two of them, or one on a topic that says so; Blueye `CameraParameters`" },
    MessageType { name: "std_msgs/Float64 (radiometry)", matches: radiometry::matches_bare, kind: Kind::Radiometry(radiometry::decode),
        about: "one number on a topic that says exposure, shutter, strobe, flash, lamp, or gain of a camera" },
    MessageType { name: "std_msgs/Float64 (altitude)", matches: altitude::matches_bare, kind: Kind::Ping(3, altitude::decode),
        about: "one number on a topic that says `altitude`, `altimeter` or `height_above`; ≤ 0 is lost" },
    MessageType { name: "altitude in any message", matches: altitude::matches_field, kind: Kind::Ping(4, altitude::decode),
        about: "a field `altitude`, `avg_altitude`, `bottom_distance`, `altimeter_distance`, where nothing better is there" },
];
