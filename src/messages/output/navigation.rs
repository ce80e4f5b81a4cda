//! Messages of a vehicle's navigation, for logs that are made from tables; in CDR.

use super::super::header::Header;
use super::super::writer::WireFormat;
use super::encode::with_header;
use super::schema::OutputType;
use super::types::{header, quaternion, section, time};

macro_rules! with_header_first {
    ($fields:literal $(, $more:expr)*) => {
        concat!(
            "std_msgs/Header header\n",
            $fields,
            $($more,)*
            header!()
        )
    };
}

/// An altitude.
pub const RANGE: OutputType = OutputType::of_ros2(
    "sensor_msgs/msg/Range",
    with_header_first!(
        "uint8 radiation_type\nfloat32 field_of_view\nfloat32 min_range\nfloat32 max_range\n\
         float32 range\nfloat32 variance\n"
    ),
);

/// An attitude.
pub const IMU: OutputType = OutputType::of_ros2(
    "sensor_msgs/msg/Imu",
    with_header_first!(
        "geometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n\
         geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n\
         geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance\n",
        quaternion!(),
        section!("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n")
    ),
);

/// A position.
pub const NAV_SAT_FIX: OutputType = OutputType::of_ros2(
    "sensor_msgs/msg/NavSatFix",
    with_header_first!(
        "sensor_msgs/NavSatStatus status\nfloat64 latitude\nfloat64 longitude\nfloat64 altitude\n\
         float64[9] position_covariance\nuint8 position_covariance_type\n",
        section!("sensor_msgs/NavSatStatus", "int8 status\nuint16 service\n")
    ),
);

/// A depth.
pub const FLOAT64: OutputType = OutputType::of_ros2("std_msgs/msg/Float64", "float64 data\n");

/// A cone so wide that its range is an altitude (rad).
const WIDE_CONE_RAD: f32 = 1.0;

/// `Range`: an altitude above the seafloor (m).
pub fn altitude(header: &Header, altitude_m: f64) -> Vec<u8> {
    let message = with_header(WireFormat::Cdr, header).u8(0);
    let limits = message.f32(WIDE_CONE_RAD).f32(0.0).f32(0.0);
    limits.f32(altitude_m as f32).f32(0.0).finish()
}

/// `Imu`: an attitude as a quaternion x, y, z, w; rates and accelerations are marked as unknown.
pub fn attitude(header: &Header, rotation_xyzw: [f64; 4]) -> Vec<u8> {
    let unknown = [-1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let message = with_header(WireFormat::Cdr, header).f64s(&rotation_xyzw).f64s(&[0.0; 9]);
    let rates = message.f64s(&[0.0; 3]).f64s(&unknown);
    rates.f64s(&[0.0; 3]).f64s(&unknown).finish()
}

/// `NavSatFix`: latitude and longitude (deg), and altitude, negative below the sea surface (m).
pub fn position(header: &Header, [latitude, longitude, altitude_m]: [f64; 3]) -> Vec<u8> {
    let status = with_header(WireFormat::Cdr, header).u8(0).u16(1);
    let position = status.f64s(&[latitude, longitude, altitude_m]);
    position.f64s(&[0.0; 9]).u8(0).finish()
}

/// `Float64`
pub fn number(value: f64) -> Vec<u8> {
    super::super::writer::Writer::new(WireFormat::Cdr).f64(value).finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::Decoder;
    use crate::messages::output::OutputSchema;
    use crate::units::Stamp;

    #[test]
    fn messages_are_read_back_by_their_schemas() {
        // Names of every length: alignment depends on it.
        for frame in ["", "a", "ab", "abc", "abcd", "abcde"] {
            let header = Header { stamp: Some(Stamp(5)), frame_id: frame.into() };
            for (kind, bytes, path, expected) in [
                (RANGE, altitude(&header, 2.5), "range", 2.5),
                (IMU, attitude(&header, [0.0, 0.0, 0.6, 0.8]), "orientation.w", 0.8),
                (NAV_SAT_FIX, position(&header, [60.0, 10.0, -3.0]), "altitude", -3.0),
                (FLOAT64, number(7.0), "data", 7.0),
            ] {
                let OutputSchema { name, encoding, data, message_encoding } =
                    kind.schema_in(WireFormat::Cdr);
                let decoder = Decoder::by_path(message_encoding, &name, encoding, &data);
                let decoder = decoder.expect(kind.name);
                let value = decoder.read(&bytes).expect(kind.name);
                assert_eq!(value.number(path), Some(expected), "{} {frame}", kind.name);
            }
        }
    }
}
