//! The messages that unwater writes: flat numeric fields, units in the names, NaN for unknown. By
//! default CDR with self-contained `ros2msg` schemas, the family that rerun and Foxglove both show
//! best; protobuf with Foxglove's schemas, or ROS 1, by choice.

mod encode;
mod navigation;
mod scene;
mod schema;
#[rustfmt::skip] // several fields of a message per line
mod types;

pub use encode::{
    LogLine, RawImage, camera_info, compressed_image, image, log, multi_array, with_header,
};
pub use navigation::{FLOAT64, IMU, NAV_SAT_FIX, RANGE, altitude, attitude, number, position};
pub use scene::{ScenePoint, point_cloud, pose, transform};
pub use schema::{OutputSchema, OutputType};
pub use types::{
    ATTENUATION, BEAM_PATTERN, CAMERA_INFO, COMPRESSED_IMAGE, FRAME, IMAGE, LOG, MULTI_ARRAY,
    POINT_CLOUD, POSE, SEAFLOOR, TRANSFORM,
};

#[cfg(test)]
mod tests {
    use nalgebra::Isometry3;

    use super::*;
    use crate::diagnostics::{Diagnostic, MountFact};
    use crate::messages::value::Value;
    use crate::messages::writer::WireFormat;
    use crate::messages::{Decoder, Header, header};
    use crate::units::Stamp;
    use crate::vehicle::Camera;

    fn written_header() -> Header {
        Header { stamp: Some(Stamp(1_700_000_000_500_000_000)), frame_id: "cam".into() }
    }

    fn no_attitude() -> Diagnostic {
        MountFact::NoAttitude.into()
    }

    fn messages(wire: WireFormat) -> [(OutputType, Vec<u8>); 9] {
        let header = written_header();
        let camera = Camera::from_field_of_view(640, 480, 60.0);
        let frame = with_header(wire, &header).u8(1).text("why").f64s(&[0.5; 14]).finish();
        let raw = RawImage { width: 2, height: 1, encoding: "rgb8", step: 6, data: &[0; 6] };
        let point = ScenePoint { position_m: [1.0, 2.0, 3.0], rgb: [255, 128, 0] };
        let shift = Isometry3::translation(1.0, 2.0, 3.0);
        [
            (COMPRESSED_IMAGE, compressed_image(wire, &header, "jpeg", &[1, 2, 3])),
            (IMAGE, image(wire, &header, &raw)),
            (CAMERA_INFO, camera_info(wire, &header, &camera)),
            (MULTI_ARRAY, multi_array(wire, "attenuation_per_m", &[1.0, 2.0])),
            (LOG, log(wire, Stamp(5_000_000_001), &LogLine::of(&no_attitude()))),
            (FRAME, frame),
            (POSE, pose(wire, &header, &shift)),
            (TRANSFORM, transform(wire, &header, "seafloor", &shift)),
            (POINT_CLOUD, point_cloud(wire, &header, &[point; 5])),
        ]
    }

    fn check(kind: &str, value: &Value<'_>) {
        match kind {
            "sensor_msgs/msg/CameraInfo" => {
                let camera = Camera::from_field_of_view(640, 480, 60.0);
                assert_eq!(value.numbers("k").map(|k| k[0]), Some(camera.fx));
            }
            "std_msgs/msg/Float64MultiArray" => {
                assert_eq!(value.numbers("data"), Some(vec![1.0, 2.0]));
            }
            "rcl_interfaces/msg/Log" => {
                assert_eq!(
                    value.text("msg").or(value.text("message")),
                    Some(no_attitude().to_string().as_str())
                );
                assert_eq!(value.text("name"), Some("unwater.attitude-missing"));
                assert_eq!(header(value).stamp, Some(Stamp(5_000_000_001)));
            }
            "geometry_msgs/msg/PoseStamped" => {
                assert_eq!(value.number("pose.position.y"), Some(2.0));
                assert_eq!(value.number("pose.orientation.w"), Some(1.0));
            }
            "tf2_msgs/msg/TFMessage" => assert!(
                value.text("child_frame_id") == Some("seafloor")
                    && value.number("translation.z") == Some(3.0)
                    || value.list("transforms").is_some_and(|t| t.len() == 1)
            ),
            "unwater_msgs/msg/Frame" => {
                assert_eq!(value.flag("corrected"), Some(true));
                assert_eq!(value.number("mean_gain"), Some(0.5));
                assert_eq!(value.text("reason"), Some("why"));
            }
            _ => assert_eq!(header(value), written_header(), "{kind}"),
        }
    }

    #[test]
    fn written_messages_are_read_back_by_their_schemas() {
        for wire in [WireFormat::Cdr, WireFormat::Ros1, WireFormat::Protobuf] {
            for (kind, bytes) in messages(wire) {
                let OutputSchema { name, encoding, data, message_encoding } = kind.schema_in(wire);
                let decoder = Decoder::by_path(message_encoding, &name, encoding, &data);
                let decoder = decoder.expect(kind.name);
                check(kind.name, &decoder.read(&bytes).expect(kind.name));
            }
        }
    }
}
