//! Definitions of common ROS messages, for channels whose schema is empty or incomplete.

/// Name and definition, with the packages' own types written out below.
const KNOWN: &[(&str, &str)] = &[
    ("std_msgs/Float32", "float32 data\n"),
    ("std_msgs/Float64", "float64 data\n"),
    ("std_msgs/String", "string data\n"),
    ("sensor_msgs/Image", IMAGE),
    ("sensor_msgs/CompressedImage", "std_msgs/Header header\nstring format\nuint8[] data\n"),
    ("sensor_msgs/CameraInfo", CAMERA_INFO),
    ("sensor_msgs/Imu", IMU),
    ("sensor_msgs/Range", RANGE),
    ("tf2_msgs/TFMessage", "geometry_msgs/TransformStamped[] transforms\n"),
    ("tf/tfMessage", "geometry_msgs/TransformStamped[] transforms\n"),
    ("nav_msgs/Odometry", ODOMETRY),
    ("marine_acoustic_msgs/Dvl", DVL),
    ("acoustic_msgs/Dvl", DVL),
    ("dvl_msgs/DVL", WATER_LINKED),
    ("waterlinked_a50_ros_driver/DVL", WATER_LINKED),
];

const IMAGE: &str = "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\n\
                     uint8 is_bigendian\nuint32 step\nuint8[] data\n";
const CAMERA_INFO: &str = "std_msgs/Header header\nuint32 height\nuint32 width\n\
                           string distortion_model\nfloat64[] d\nfloat64[9] k\nfloat64[9] r\n\
                           float64[12] p\nuint32 binning_x\nuint32 binning_y\n\
                           sensor_msgs/RegionOfInterest roi\n";
const IMU: &str = "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\n\
                   float64[9] orientation_covariance\ngeometry_msgs/Vector3 angular_velocity\n\
                   float64[9] angular_velocity_covariance\n\
                   geometry_msgs/Vector3 linear_acceleration\n\
                   float64[9] linear_acceleration_covariance\n";
const RANGE: &str = "std_msgs/Header header\nuint8 radiation_type\nfloat32 field_of_view\n\
                     float32 min_range\nfloat32 max_range\nfloat32 range\n";
const ODOMETRY: &str = "std_msgs/Header header\nstring child_frame_id\n\
                        geometry_msgs/PoseWithCovariance pose\n\
                        geometry_msgs/TwistWithCovariance twist\n";
const DVL: &str = "std_msgs/Header header\nuint8 velocity_mode\nuint8 dvl_type\n\
                   geometry_msgs/Vector3 velocity\nfloat64[9] velocity_covar\nfloat64 altitude\n\
                   float64 course_gnd\nfloat64 speed_gnd\nuint8 num_good_beams\n\
                   float32 sound_speed\nbool beam_ranges_valid\nbool beam_velocities_valid\n\
                   geometry_msgs/Vector3[4] beam_unit_vec\nfloat64[4] range\n\
                   float32[4] range_covar\nfloat32[4] beam_quality\nfloat32[4] beam_velocity\n\
                   float32[4] beam_velocity_covar\n";
const WATER_LINKED: &str = "std_msgs/Header header\nfloat64 time\n\
                            geometry_msgs/Vector3 velocity\nfloat64 fom\nfloat64[] covariance\n\
                            float64 altitude\ndvl_msgs/DVLBeam[] beams\nbool velocity_valid\n\
                            int64 status\nint64 time_of_validity\nint64 time_of_transmission\n\
                            string form\n";

/// Types that others consist of.
const PARTS: &str = "
===
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
===
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
===
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
===
MSG: geometry_msgs/Transform
geometry_msgs/Vector3 translation
geometry_msgs/Quaternion rotation
===
MSG: geometry_msgs/TransformStamped
std_msgs/Header header
string child_frame_id
geometry_msgs/Transform transform
===
MSG: geometry_msgs/Pose
geometry_msgs/Point position
geometry_msgs/Quaternion orientation
===
MSG: geometry_msgs/PoseWithCovariance
geometry_msgs/Pose pose
float64[36] covariance
===
MSG: geometry_msgs/Twist
geometry_msgs/Vector3 linear
geometry_msgs/Vector3 angular
===
MSG: geometry_msgs/TwistWithCovariance
geometry_msgs/Twist twist
float64[36] covariance
===
MSG: sensor_msgs/RegionOfInterest
uint32 x_offset
uint32 y_offset
uint32 height
uint32 width
bool do_rectify
===
MSG: dvl_msgs/DVLBeam
int64 id
float64 velocity
float64 distance
float64 rssi
float64 nsd
bool valid
";

/// The definition of a type by its name, with all types it needs.
pub fn definition(name: &str) -> Option<String> {
    let short = name.replace("/msg/", "/");
    let known = KNOWN.iter().find(|(known, _)| *known == short)?;
    Some(format!("{}{PARTS}", known.1))
}

#[cfg(test)]
mod tests {
    use super::super::ros_schema::{Dialect, parse};
    use super::*;

    #[test]
    fn every_definition_is_complete() {
        for (name, _) in KNOWN {
            let text = definition(name).expect("a definition");
            for dialect in [Dialect::Ros1, Dialect::Ros2] {
                parse(name, &text, dialect).expect(name);
            }
        }
        assert!(definition("sensor_msgs/msg/Imu").is_some() && definition("a/B").is_none());
    }
}
