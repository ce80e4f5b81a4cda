//! The messages unwater writes: CDR with self-contained `ros2msg` schemas, flat numeric fields, units in the
//! names, NaN for unknown. ROS 2 throughout, as it is the family that rerun and Foxglove both show best.

use super::Heading;
use super::cdr::Writer;
use crate::units::Stamp;
use crate::vehicle::Camera;

/// A message type that is written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OutputType {
    /// `pkg/msg/Type`
    pub name: &'static str,
    /// the definition with its dependencies
    pub schema: &'static str,
}

macro_rules! with_header {
    ($fields:literal) => {
        concat!(
            "std_msgs/Header header\n",
            $fields,
            "================================================================================\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n",
            "================================================================================\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
        )
    };
}

/// A corrected picture as JPEG or PNG.
pub const COMPRESSED_IMAGE: OutputType =
    OutputType { name: "sensor_msgs/msg/CompressedImage", schema: with_header!("string format\nuint8[] data\n") };

/// A corrected picture as bare pixels.
pub const IMAGE: OutputType = OutputType {
    name: "sensor_msgs/msg/Image",
    schema: with_header!("uint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\nuint8[] data\n"),
};

/// Calibration of a rectified picture.
pub const CAMERA_INFO: OutputType = OutputType {
    name: "sensor_msgs/msg/CameraInfo",
    schema: concat!(
        with_header!(
            "uint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\nfloat64[9] k\nfloat64[9] r\nfloat64[12] p\nuint32 binning_x\nuint32 binning_y\nsensor_msgs/RegionOfInterest roi\n"
        ),
        "================================================================================\nMSG: sensor_msgs/RegionOfInterest\nuint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify\n"
    ),
};

/// α of a frame.
pub const ATTENUATION: OutputType = OutputType {
    name: "unwater_msgs/msg/Attenuation",
    schema: with_header!(
        "# red, green, blue; NaN where there is no such band\nfloat64[3] attenuation_per_m\nfloat64[3] attenuation_std_per_m\n# true: spreading is modelled; false: an effective value that holds spreading too\nbool physical\nbool identified\n"
    ),
};

/// The plane below a frame.
pub const SEAFLOOR: OutputType = OutputType {
    name: "unwater_msgs/msg/Seafloor",
    schema: with_header!(
        "# the plane n.x = d in the camera's optical frame, n pointing into the floor\nfloat64 normal_x\nfloat64 normal_y\nfloat64 normal_z\nfloat64 distance_m\nfloat64 camera_altitude_m\nfloat64 tilt_to_camera_deg\n# hits of sonar beams, their spread over the plane, and the time to the nearest ping\nuint32 hits\nfloat64 residual_m\nfloat64 nearest_ping_s\n# least squares, exact, assumed level\nstring support\n"
    ),
};

/// Facts of a frame.
pub const FRAME: OutputType = OutputType {
    name: "unwater_msgs/msg/Frame",
    schema: with_header!(
        "bool corrected\n# why not, if not\nstring reason\nfloat64 camera_altitude_m\nfloat64 path_length_min_m\nfloat64 path_length_mean_m\nfloat64 path_length_max_m\n# shares of the picture's pixels\nfloat64 clipped_input_share\nfloat64 clipped_output_share\nfloat64 gain_capped_share\nfloat64 off_surface_share\nfloat64 unseen_beam_share\nfloat64 mean_gain\n"
    ),
};

/// The strobe's pattern.
pub const BEAM_PATTERN: OutputType = OutputType {
    name: "unwater_msgs/msg/BeamPattern",
    schema: with_header!(
        "# angles in the strobe's frame: theta = atan2(y, z), phi = atan2(x, z)\nfloat64[] theta_deg\nfloat64[] phi_deg\n# natural log of the gain, peak 0, NaN where never seen; one row per theta\nfloat64[] log_gain\n"
    ),
};

/// Numbers that rerun plots by itself.
pub const MULTI_ARRAY: OutputType = OutputType {
    name: "std_msgs/msg/Float64MultiArray",
    schema: concat!(
        "std_msgs/MultiArrayLayout layout\nfloat64[] data\n",
        "================================================================================\nMSG: std_msgs/MultiArrayLayout\nstd_msgs/MultiArrayDimension[] dim\nuint32 data_offset\n",
        "================================================================================\nMSG: std_msgs/MultiArrayDimension\nstring label\nuint32 size\nuint32 stride\n"
    ),
};

/// A line for the viewers' log panels.
pub const LOG: OutputType = OutputType {
    name: "rcl_interfaces/msg/Log",
    schema: concat!(
        "byte DEBUG=10\nbyte INFO=20\nbyte WARN=30\nbyte ERROR=40\nbyte FATAL=50\nbuiltin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring file\nstring function\nuint32 line\n",
        "================================================================================\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
    ),
};

/// Weight of a log line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// worth knowing
    Info,
    /// the result may suffer
    Warn,
}

fn time(stamp: Stamp) -> (i32, u32) {
    (stamp.0.div_euclid(1_000_000_000) as i32, stamp.0.rem_euclid(1_000_000_000) as u32)
}

/// A message begun with the header of the frame it speaks of, copied as it is.
pub fn headed(heading: &Heading) -> Writer {
    let (sec, nanosec) = time(heading.stamp.unwrap_or_default());
    Writer::new().header(sec, nanosec, &heading.frame_id)
}

/// `sensor_msgs/msg/CompressedImage`; `format` is `jpeg` or `png`.
pub fn compressed_image(heading: &Heading, format: &str, data: &[u8]) -> Vec<u8> {
    headed(heading).text(format).bytes(data).finish()
}

/// `sensor_msgs/msg/Image`, little-endian.
pub fn image(heading: &Heading, width: usize, height: usize, encoding: &str, step: usize, data: &[u8]) -> Vec<u8> {
    headed(heading).u32(height as u32).u32(width as u32).text(encoding).u8(0).u32(step as u32).bytes(data).finish()
}

/// `sensor_msgs/msg/CameraInfo` of a camera.
pub fn camera_info(heading: &Heading, camera: &Camera) -> Vec<u8> {
    let Camera { fx, fy, cx, cy, .. } = *camera;
    headed(heading)
        .u32(camera.height as u32)
        .u32(camera.width as u32)
        .text(camera.distortion.name())
        .f64_sequence(&camera.distortion.coefficients())
        .f64_array(&[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0])
        .f64_array(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
        .f64_array(&[fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0])
        .u32(0)
        .u32(0)
        .u32(0)
        .u32(0)
        .u32(0)
        .u32(0)
        .u8(0)
        .finish()
}

/// `std_msgs/msg/Float64MultiArray` with one labelled dimension.
pub fn multi_array(label: &str, values: &[f64]) -> Vec<u8> {
    let n = values.len() as u32;
    Writer::new().u32(1).text(label).u32(n).u32(n).u32(0).f64_sequence(values).finish()
}

/// `rcl_interfaces/msg/Log`.
pub fn log(stamp: Stamp, level: Level, text: &str) -> Vec<u8> {
    let (sec, nanosec) = time(stamp);
    let level = match level {
        Level::Info => 20,
        Level::Warn => 30,
    };
    Writer::new().i32(sec).u32(nanosec).u8(level).text("unwater").text(text).text("").text("").u32(0).finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::{cdr, ros_schema};

    #[test]
    fn what_is_written_reads_by_its_own_schema() {
        let heading = Heading { stamp: Some(Stamp(1_700_000_000_500_000_000)), frame_id: "cam".into() };
        let camera = Camera::from_field_of_view(640, 480, 60.0);
        let cases = [
            (COMPRESSED_IMAGE, compressed_image(&heading, "jpeg", &[1, 2, 3])),
            (IMAGE, image(&heading, 2, 1, "rgb8", 6, &[0; 6])),
            (CAMERA_INFO, camera_info(&heading, &camera)),
            (MULTI_ARRAY, multi_array("attenuation_per_m", &[1.0, 2.0])),
            (LOG, log(Stamp(5), Level::Warn, "dark")),
        ];
        for (kind, bytes) in cases {
            let layout = ros_schema::parse(kind.name, kind.schema, ros_schema::Dialect::Ros2).expect(kind.name);
            let value = cdr::read(&layout, &bytes).expect(kind.name);
            match kind.name {
                "sensor_msgs/msg/CameraInfo" => assert_eq!(value.numbers("k").map(|k| k[0]), Some(camera.fx)),
                "std_msgs/msg/Float64MultiArray" => assert_eq!(value.numbers("data"), Some(vec![1.0, 2.0])),
                "rcl_interfaces/msg/Log" => assert_eq!((value.integer("level"), value.text("msg")), (Some(30), Some("dark"))),
                _ => assert_eq!(value.text("header.frame_id"), Some("cam")),
            }
        }
    }
}
