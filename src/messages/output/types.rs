//! The written message types, with their schemas in ROS 2, ROS 1 and protobuf.

use super::super::descriptor::FieldType::{
    Bytes, Double, Doubles, Enum, Fixed32, Message, Messages, Text, Time,
};
use super::super::descriptor::ProtoType;
use super::schema::OutputType;

/// A section of a schema: the definition of a dependency.
macro_rules! section {
    ($name:literal, $fields:literal) => {
        concat!(
            "================================================================================\n",
            "MSG: ",
            $name,
            "\n",
            $fields
        )
    };
}

macro_rules! time {
    () => {
        section!("builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n")
    };
}

macro_rules! header {
    () => {
        concat!(
            section!("std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id\n"),
            time!()
        )
    };
}

macro_rules! ros1_header {
    () => {
        section!("std_msgs/Header", "uint32 seq\ntime stamp\nstring frame_id\n")
    };
}

macro_rules! quaternion {
    () => {
        section!("geometry_msgs/Quaternion", "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n")
    };
}

pub(super) use {header, quaternion, section, time};

macro_rules! region_of_interest {
    () => {
        section!(
            "sensor_msgs/RegionOfInterest",
            "uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify\n"
        )
    };
}

/// A schema that begins with a header.
macro_rules! with_header {
    ($fields:expr) => {
        concat!("std_msgs/Header header\n", $fields, header!())
    };
}

/// Image compressed as JPEG or PNG.
pub const COMPRESSED_IMAGE: OutputType = OutputType {
    name: "sensor_msgs/msg/CompressedImage",
    schema: with_header!("string format\nuint8[] data\n"),
    ros1: None,
    protobuf: Some(&ProtoType {
        name: "foxglove.CompressedImage",
        fields: &[
            ("timestamp", 1, Time), ("frame_id", 4, Text), ("data", 2, Bytes),
            ("format", 3, Text),
        ],
    }),
};

/// Raw image.
pub const IMAGE: OutputType = OutputType {
    name: "sensor_msgs/msg/Image",
    schema: with_header!(
        "uint32 height\nuint32 width\nstring encoding\n\
         uint8 is_bigendian\nuint32 step\nuint8[] data\n"
    ),
    ros1: None,
    protobuf: Some(&ProtoType {
        name: "foxglove.RawImage",
        fields: &[
            ("timestamp", 1, Time), ("frame_id", 7, Text), ("width", 2, Fixed32),
            ("height", 3, Fixed32), ("encoding", 4, Text), ("step", 5, Fixed32),
            ("data", 6, Bytes),
        ],
    }),
};

/// Calibration of rectified images.
pub const CAMERA_INFO: OutputType = OutputType {
    name: "sensor_msgs/msg/CameraInfo",
    schema: concat!(
        with_header!(
            "uint32 height\nuint32 width\nstring distortion_model\n\
             float64[] d\nfloat64[9] k\nfloat64[9] r\nfloat64[12] p\n\
             uint32 binning_x\nuint32 binning_y\nsensor_msgs/RegionOfInterest roi\n"
        ),
        region_of_interest!()
    ),
    // ROS 1 has capitals here, and its readers depend on them.
    ros1: Some((
        "sensor_msgs/CameraInfo",
        concat!(
            "std_msgs/Header header\nuint32 height\nuint32 width\nstring distortion_model\n",
            "float64[] D\nfloat64[9] K\nfloat64[9] R\nfloat64[12] P\n",
            "uint32 binning_x\nuint32 binning_y\nsensor_msgs/RegionOfInterest roi\n",
            ros1_header!(),
            region_of_interest!()
        ),
    )),
    protobuf: Some(&ProtoType {
        name: "foxglove.CameraCalibration",
        fields: &[
            ("timestamp", 1, Time), ("frame_id", 9, Text), ("width", 2, Fixed32),
            ("height", 3, Fixed32), ("distortion_model", 4, Text), ("D", 5, Doubles),
            ("K", 6, Doubles), ("R", 7, Doubles), ("P", 8, Doubles),
        ],
    }),
};

/// Attenuation coefficients of a frame.
pub const ATTENUATION: OutputType = OutputType::of_ros2(
    "unwater_msgs/msg/Attenuation",
    with_header!(
        "# red, green, blue; NaN where there is no such band\n\
         float64[3] attenuation_per_m\nfloat64[3] attenuation_std_per_m\n\
         # true: spreading is modelled; false: an effective value that includes spreading\n\
         bool physical\nbool identified\n"
    ),
);

/// The seafloor plane of a frame.
pub const SEAFLOOR: OutputType = OutputType::of_ros2(
    "unwater_msgs/msg/Seafloor",
    with_header!(
        "# the plane n.x = d in the camera's optical frame, n pointing into the seafloor\n\
         float64 normal_x\nfloat64 normal_y\nfloat64 normal_z\nfloat64 distance_m\n\
         float64 camera_altitude_m\nfloat64 tilt_to_camera_deg\n\
         # sonar returns, their scatter about the plane, and the time to the nearest ping\n\
         uint32 hits\nfloat64 residual_m\nfloat64 nearest_ping_s\n\
         # least squares, exact, assumed level\nstring support\n"
    ),
);

/// Facts of a frame.
pub const FRAME: OutputType = OutputType::of_ros2(
    "unwater_msgs/msg/Frame",
    with_header!(
        "bool corrected\n# why not corrected\nstring reason\nfloat64 camera_altitude_m\n\
         float64 path_length_min_m\nfloat64 path_length_mean_m\nfloat64 path_length_max_m\n\
         # shares of the image's pixels\n\
         float64 clipped_input_share\nfloat64 clipped_output_share\nfloat64 gain_capped_share\n\
         float64 off_surface_share\nfloat64 unseen_beam_share\nfloat64 mean_gain\n\
         # share of the image's pixels whose signal is close to the noise\n\
         float64 low_signal_share\n\
         # light of the frame over that of others, divided out\n\
         float64 frame_gain_red\nfloat64 frame_gain_green\nfloat64 frame_gain_blue\n"
    ),
);

/// Beam pattern of the strobe.
pub const BEAM_PATTERN: OutputType = OutputType::of_ros2(
    "unwater_msgs/msg/BeamPattern",
    with_header!(
        "# angles in the strobe's frame: theta = atan2(y, z), phi = atan2(x, z)\n\
         float64[] theta_deg\nfloat64[] phi_deg\n\
         # natural log of the gain, peak 0, NaN where never observed; one row per theta\n\
         float64[] log_gain\n"
    ),
);

/// Numbers that rerun plots without a plug-in.
pub const MULTI_ARRAY: OutputType = OutputType {
    name: "std_msgs/msg/Float64MultiArray",
    schema: concat!(
        "std_msgs/MultiArrayLayout layout\nfloat64[] data\n",
        section!(
            "std_msgs/MultiArrayLayout",
            "std_msgs/MultiArrayDimension[] dim\nuint32 data_offset\n"
        ),
        section!("std_msgs/MultiArrayDimension", "string label\nuint32 size\nuint32 stride\n")
    ),
    ros1: None,
    protobuf: Some(&ProtoType {
        name: "unwater_msgs.Numbers",
        fields: &[("label", 1, Text), ("data", 2, Doubles)],
    }),
};

/// A line for the viewers' log panels.
pub const LOG: OutputType = OutputType {
    name: "rcl_interfaces/msg/Log",
    schema: concat!(
        "byte DEBUG=10\nbyte INFO=20\nbyte WARN=30\nbyte ERROR=40\nbyte FATAL=50\n",
        "builtin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\n",
        "string file\nstring function\nuint32 line\n",
        time!()
    ),
    // ROS 1 numbers the levels differently.
    ros1: Some((
        "rosgraph_msgs/Log",
        concat!(
            "byte DEBUG=1\nbyte INFO=2\nbyte WARN=4\nbyte ERROR=8\nbyte FATAL=16\n",
            "std_msgs/Header header\nbyte level\nstring name\nstring msg\n",
            "string file\nstring function\nuint32 line\nstring[] topics\n",
            ros1_header!()
        ),
    )),
    protobuf: Some(&ProtoType {
        name: "foxglove.Log",
        fields: &[
            ("timestamp", 1, Time), ("level", 2, Enum("Level", LEVELS)), ("message", 3, Text),
            ("name", 4, Text), ("file", 5, Text), ("line", 6, Fixed32),
        ],
    }),
};

/// `foxglove.Log.Level`, numbered from 0.
const LEVELS: &[&str] = &["UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL"];

/// A cloud of coloured points.
pub const POINT_CLOUD: OutputType = OutputType {
    name: "sensor_msgs/msg/PointCloud2",
    schema: concat!(
        with_header!(
            "uint32 height\nuint32 width\nsensor_msgs/PointField[] fields\nbool is_bigendian\n\
             uint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense\n"
        ),
        section!(
            "sensor_msgs/PointField",
            "string name\nuint32 offset\nuint8 datatype\nuint32 count\n"
        )
    ),
    ros1: None,
    protobuf: Some(&ProtoType {
        name: "foxglove.PointCloud",
        fields: &[
            ("timestamp", 1, Time), ("frame_id", 2, Text), ("pose", 3, Message(&PROTO_POSE)),
            ("point_stride", 4, Fixed32), ("fields", 5, Messages(&PACKED_FIELD)),
            ("data", 6, Bytes),
        ],
    }),
};

/// A pose in the frame of its header.
pub const POSE: OutputType = OutputType {
    name: "geometry_msgs/msg/PoseStamped",
    schema: concat!(
        with_header!("geometry_msgs/Pose pose\n"),
        section!(
            "geometry_msgs/Pose",
            "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n"
        ),
        section!("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n"),
        quaternion!()
    ),
    ros1: None,
    protobuf: Some(&ProtoType {
        name: "foxglove.PoseInFrame",
        fields: &[
            ("timestamp", 1, Time), ("frame_id", 2, Text), ("pose", 3, Message(&PROTO_POSE)),
        ],
    }),
};

/// The pose of a child frame in its parent.
pub const TRANSFORM: OutputType = OutputType {
    name: "tf2_msgs/msg/TFMessage",
    schema: concat!(
        "geometry_msgs/TransformStamped[] transforms\n",
        section!(
            "geometry_msgs/TransformStamped",
            "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n"
        ),
        header!(),
        section!(
            "geometry_msgs/Transform",
            "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n"
        ),
        section!("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n"),
        quaternion!()
    ),
    ros1: None,
    protobuf: Some(&ProtoType {
        name: "foxglove.FrameTransform",
        fields: &[
            ("timestamp", 1, Time), ("parent_frame_id", 2, Text), ("child_frame_id", 3, Text),
            ("translation", 4, Message(&VECTOR3)), ("rotation", 5, Message(&QUATERNION)),
        ],
    }),
};

static PROTO_POSE: ProtoType = ProtoType {
    name: "foxglove.Pose",
    fields: &[
        ("position", 1, Message(&VECTOR3)), ("orientation", 2, Message(&QUATERNION)),
    ],
};
static VECTOR3: ProtoType = ProtoType {
    name: "foxglove.Vector3",
    fields: &[
        ("x", 1, Double), ("y", 2, Double), ("z", 3, Double),
    ],
};
static QUATERNION: ProtoType = ProtoType {
    name: "foxglove.Quaternion",
    fields: &[
        ("x", 1, Double), ("y", 2, Double), ("z", 3, Double), ("w", 4, Double),
    ],
};
static PACKED_FIELD: ProtoType = ProtoType {
    name: "foxglove.PackedElementField",
    fields: &[
        ("name", 1, Text), ("offset", 2, Fixed32),
        ("type", 3, Enum("NumericType", NUMERIC_TYPES)),
    ],
};
/// `foxglove.PackedElementField.NumericType`, numbered from 0.
const NUMERIC_TYPES: &[&str] =
    &["UNKNOWN", "UINT8", "INT8", "UINT16", "INT16", "UINT32", "INT32", "FLOAT32", "FLOAT64"];
