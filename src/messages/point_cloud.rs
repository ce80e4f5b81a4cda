//! `sensor_msgs/PointCloud2` and `foxglove.PointCloud`: points at even intervals of the cloud
//! become the beams of a ping.

use nalgebra::Vector3;

use super::layout::Layout;
use super::reading::{PingReading, missing};
use super::value::Value;
use crate::coordinates::Direction;
use crate::units::SlantRange;
use crate::vehicle::{Beam, DvlFacts};

/// Most points used of one cloud: a plane fit needs few.
const MAX_POINTS: usize = 24;
/// `datatype` of a 32-bit float; a 64-bit float is the next.
const FLOAT32: i64 = 7;

pub fn matches(layout: &Layout, _topic: &str) -> bool {
    layout.has_all(&["fields.name", "fields.offset", "data"])
        && (layout.has("point_step") || layout.has("point_stride"))
}

/// Position of a coordinate in a point, and its size (byte).
#[derive(Clone, Copy)]
struct Coordinate {
    offset: usize,
    size: usize,
}

impl Coordinate {
    fn find(fields: &[Value<'_>], name: &str, step: usize) -> Result<Self, String> {
        let field = fields
            .iter()
            .find(|f| f.text("name") == Some(name))
            .ok_or_else(|| format!("the point cloud has no {name}"))?;
        let size = match field.integer("datatype").or(field.integer("type")) {
            Some(FLOAT32) => Some(4),
            Some(kind) if kind == FLOAT32 + 1 => Some(8),
            _ => None,
        };
        let (offset, size) =
            field.size("offset").zip(size).ok_or("the point cloud's coordinates are not floats")?;
        if offset.checked_add(size).is_none_or(|end| end > step) {
            return Err("the point cloud's coordinates lie outside its points".into());
        }
        Ok(Self { offset, size })
    }

    fn read(self, point: &[u8], big_endian: bool) -> f64 {
        let mut bytes = [0u8; 8];
        bytes[..self.size].copy_from_slice(&point[self.offset..self.offset + self.size]);
        if big_endian {
            bytes[..self.size].reverse();
        }
        if self.size == 8 {
            f64::from_le_bytes(bytes)
        } else {
            f64::from(f32::from_bits(u64::from_le_bytes(bytes) as u32))
        }
    }
}

pub fn decode(value: &Value<'_>, _facts: &DvlFacts) -> Result<PingReading, String> {
    let fields = value.list("fields").ok_or_else(|| missing("fields"))?;
    let data = value.bytes("data").ok_or_else(|| missing("data"))?;
    let step = ["point_step", "point_stride"].iter().find_map(|f| value.integer(f));
    let step = step
        .and_then(|s| usize::try_from(s).ok())
        .filter(|s| *s > 0)
        .ok_or_else(|| missing("point_step"))?;
    let big_endian = value.flag("is_bigendian").unwrap_or(false);
    let axis = |name: &str| Coordinate::find(fields, name, step);
    let axes = [axis("x")?, axis("y")?, axis("z")?];
    let beam = |point: &[u8]| {
        let p = Vector3::from(axes.map(|axis| axis.read(point, big_endian)));
        Direction::from_vector(p)
            .filter(|_| p.iter().all(|v| v.is_finite()))
            .map(|direction| Beam { direction, range: Some(SlantRange(p.norm())) })
    };
    // The first valid point of each interval.
    let interval = (data.len() / step).div_ceil(MAX_POINTS).max(1);
    let beams = data
        .chunks(step * interval)
        .filter_map(|part| part.chunks_exact(step).find_map(beam))
        .collect();
    Ok(PingReading::of_beams(value, beams))
}
