//! `sensor_msgs/PointCloud2` and `foxglove.PointCloud`: some points, spread over the cloud, become
//! beams of a ping.

use nalgebra::Vector3;

use super::{PingReading, Value, header, layout::Layout, missing};
use crate::coordinates::Direction;
use crate::units::{SlantRange, Stamp};
use crate::vehicle::{Beam, DvlFacts, Ping};

/// Points taken of one cloud: a plane needs few.
const POINTS: usize = 24;
/// `datatype` of a 32-bit float; 64 bits are the next.
const FLOAT32: i64 = 7;

pub fn matches(layout: &Layout, _topic: &str) -> bool {
    layout.has_all(&["fields.name", "fields.offset", "data"])
        && (layout.has("point_step") || layout.has("point_stride"))
}

pub fn decode(value: &Value<'_>, _facts: &DvlFacts) -> Result<PingReading, String> {
    let fields = value.list("fields").ok_or_else(|| missing("fields"))?;
    let data = value.bytes("data").ok_or_else(|| missing("data"))?;
    let step = ["point_step", "point_stride"]
        .iter()
        .find_map(|f| value.integer(f))
        .and_then(|v| usize::try_from(v).ok());
    let step = step.filter(|s| *s > 0).ok_or_else(|| missing("point_step"))?;
    let big_endian = value.flag("is_bigendian").unwrap_or(false);
    // Offset and bytes of x, y, z.
    let mut axes = [(0, 0); 3];
    for (axis, name) in axes.iter_mut().zip(["x", "y", "z"]) {
        let field = fields
            .iter()
            .find(|f| f.text("name") == Some(name))
            .ok_or_else(|| format!("the point cloud has no {name}"))?;
        let kind = field.integer("datatype").or(field.integer("type"));
        let bytes = kind
            .filter(|k| *k == FLOAT32 || *k == FLOAT32 + 1)
            .map(|k| if k == FLOAT32 { 4 } else { 8 });
        let offset = field.integer("offset").and_then(|v| usize::try_from(v).ok());
        let (offset, bytes) =
            offset.zip(bytes).ok_or("the point cloud's coordinates are no floats")?;
        if offset.checked_add(bytes).is_none_or(|end| end > step) {
            return Err("the point cloud's coordinates lie outside its points".into());
        }
        *axis = (offset, bytes);
    }
    let point = |chunk: &[u8]| {
        let coordinate = |(offset, bytes): (usize, usize)| {
            let mut code = [0u8; 8];
            code[..bytes].copy_from_slice(&chunk[offset..offset + bytes]);
            if big_endian {
                code[..bytes].reverse();
            }
            if bytes == 8 {
                f64::from_le_bytes(code)
            } else {
                f64::from(f32::from_bits(u64::from_le_bytes(code) as u32))
            }
        };
        let p = Vector3::from(axes.map(coordinate));
        Direction::from_vector(p)
            .filter(|_| p.iter().all(|v| v.is_finite()))
            .map(|direction| Beam { direction, range: Some(SlantRange(p.norm())) })
    };
    // The first point that is one, of each of so many stretches of the cloud.
    let count = data.len() / step;
    let stretch = count.div_ceil(POINTS).max(1);
    let beams = data
        .chunks(step * stretch)
        .filter_map(|part| part.chunks_exact(step).find_map(point))
        .collect();
    let ping = Ping {
        stamp: header(value).stamp.unwrap_or(Stamp(0)),
        beams,
        altitude: None,
        velocity_m_per_s: None,
    };
    Ok(PingReading { ping: Some(ping), ..PingReading::default() })
}
