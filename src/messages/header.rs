//! Stamp and frame id of a message of any family.

use super::value::Value;
use crate::units::Stamp;

/// Stamp and frame id of a message.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Header {
    /// `None` where the message has no stamp or one of 0
    pub stamp: Option<Stamp>,
    /// without a leading slash
    pub frame_id: String,
}

/// Fields of the stamp: ROS, Foxglove and Blueye, bare, Gazebo, the Nucleus driver, WHOI.
const STAMPS: &[&str] = &[
    "header.stamp",
    "timestamp",
    "stamp",
    "header.timestamp",
    "system_timestamp",
    "ds_header.io_time",
];

/// Stamp and frame id of a message.
pub fn header(value: &Value<'_>) -> Header {
    let frame_id = value
        .text("header.frame_id")
        .or_else(|| value.text("frame_id"))
        .or_else(|| gazebo_frame(value))
        .unwrap_or("");
    Header {
        stamp: STAMPS.iter().find_map(|path| stamp(value.get(path)?)),
        frame_id: frame_id.trim_start_matches('/').into(),
    }
}

/// Frame id of the body whose attitude a message holds: of an odometry its child, else of the
/// header.
pub fn attitude_frame(value: &Value<'_>) -> String {
    value
        .text("child_frame_id")
        .map_or_else(|| header(value).frame_id, |s| s.trim_start_matches('/').into())
}

fn stamp(time: &Value<'_>) -> Option<Stamp> {
    let nanos = match time {
        Value::Record(_) => {
            let seconds = ["sec", "secs", "seconds"].iter().find_map(|f| time.integer(f))?;
            let nanos = ["nanosec", "nsec", "nsecs", "nanos", "nanoseconds"]
                .iter()
                .find_map(|f| time.integer(f))
                .unwrap_or(0);
            Stamp::from_sec_nanos(seconds, nanos).0
        }
        // A bare number since 1970; its magnitude gives the unit: ns, µs, ms, s.
        Value::Int(v) => match v.checked_ilog10().unwrap_or(0) {
            17.. => *v,
            14..17 => v.saturating_mul(1_000),
            11..14 => v.saturating_mul(1_000_000),
            8..11 => v.saturating_mul(1_000_000_000),
            _ => 0,
        },
        // RFC 3339 in protobuf's JSON
        Value::Text(v) => {
            let since =
                humantime::parse_rfc3339(v).ok()?.duration_since(std::time::UNIX_EPOCH).ok()?;
            i64::try_from(since.as_nanos()).ok()?
        }
        Value::Float(v) if (1e8..1e11).contains(v) => (v * 1e9) as i64,
        _ => 0,
    };
    (nanos > 0).then_some(Stamp(nanos))
}

/// `gz.msgs.Header` has its frame id in a list of key-value pairs.
fn gazebo_frame<'v>(value: &'v Value<'_>) -> Option<&'v str> {
    let pairs = value.list("header.data")?;
    let pair = pairs.iter().find(|p| p.text("key") == Some("frame_id"))?;
    match pair.list("value")?.first()? {
        Value::Text(frame) => Some(frame),
        _ => None,
    }
}
