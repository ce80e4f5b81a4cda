//! The corrected strip as a GeoTIFF: 8-bit RGBA, north up, in WGS 84 (EPSG:4326), without
//! compression.
//!
//! A mosaic is some tens of metres wide: on that scale degrees are even, and no map projection is
//! needed.

use super::{Laid, Mosaic};
use crate::error::{Error, Result};
use crate::products::pictures::codes_as_shown;
use crate::products::places::{Fix, M_PER_DEG, Places, east_north, fix_at};

use super::by_matches::{Pair, Rigid};

/// Where on Earth the mosaic's world lies.
pub struct Position {
    /// the fix that metres are counted from
    origin: Fix,
    /// east and north of the world's origin from there [m]
    shift: [f64; 2],
    /// to turn the world by, so that y points north [rad]
    pub turn_rad: f64,
    /// root mean square distance between fixes and mosaic [m]
    misfit_m: f64,
    topic: String,
}

/// A way shorter than so many misfits tells no direction.
const LEAST_WAY: f64 = 5.0;

/// The position by the fixes of the log: a shift, and a turn where the world's axes are nobody's.
pub fn position(laid: &[Laid], places: &Places, is_level_known: bool) -> Result<Position> {
    let none = || {
        Error::Image(
            "the log has no position (sensor_msgs/NavSatFix or the like) near these frames, so \
             the mosaic has no place on Earth; give a name that ends in .png"
                .into(),
        )
    };
    let (topic, fixes) = places.best_fixes().ok_or_else(none)?;
    let origin = *fixes.first().ok_or_else(none)?;
    let of = |l: &Laid| {
        let t = l.world_from_body.translation.vector;
        Some(([t.x, t.y], east_north(&fix_at(fixes, l.stamp)?, &origin)))
    };
    let pairs: Vec<Pair> = laid.iter().filter_map(of).collect();
    if pairs.is_empty() {
        return Err(none());
    }
    let mut turn_rad = 0.0;
    if !is_level_known {
        let rigid = Rigid::fitted(&pairs);
        turn_rad = rigid.map_or(0.0, |r| r.turn_rad());
        let misfit = misfit(&pairs, turn_rad);
        let (first, last) = (pairs[0].1, pairs[pairs.len() - 1].1);
        if rigid.is_none() || (last[0] - first[0]).hypot(last[1] - first[1]) < LEAST_WAY * misfit.1
        {
            return Err(Error::Image(
                "the log has no heading, and its positions are too close together to tell one; \
                 give a name that ends in .png"
                    .into(),
            ));
        }
    }
    let (shift, misfit_m) = misfit(&pairs, turn_rad);
    Ok(Position { origin, shift, turn_rad, misfit_m, topic: topic.clone() })
}

/// The median shift from turned places to fixes, and the root mean square of what is left.
fn misfit(pairs: &[Pair], turn_rad: f64) -> ([f64; 2], f64) {
    let (sin, cos) = turn_rad.sin_cos();
    let off: Vec<[f64; 2]> = pairs
        .iter()
        .map(|(p, q)| [q[0] - (cos * p[0] - sin * p[1]), q[1] - (sin * p[0] + cos * p[1])])
        .collect();
    let shift = [0, 1].map(|k| {
        let mut values: Vec<f64> = off.iter().map(|o| o[k]).collect();
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    });
    let square =
        off.iter().map(|o| (o[0] - shift[0]).powi(2) + (o[1] - shift[1]).powi(2)).sum::<f64>()
            / off.len() as f64;
    (shift, square.sqrt())
}

/// A value of a tag.
enum Value {
    Shorts(Vec<u16>),
    Longs(Vec<u32>),
    Doubles(Vec<f64>),
    Text(String),
}

impl Value {
    /// TIFF's number of the type, count, bytes.
    fn parts(&self) -> (u16, usize, Vec<u8>) {
        match self {
            Self::Shorts(v) => (3, v.len(), v.iter().flat_map(|x| x.to_le_bytes()).collect()),
            Self::Longs(v) => (4, v.len(), v.iter().flat_map(|x| x.to_le_bytes()).collect()),
            Self::Doubles(v) => (12, v.len(), v.iter().flat_map(|x| x.to_le_bytes()).collect()),
            Self::Text(t) => {
                let bytes: Vec<u8> = t.bytes().filter(u8::is_ascii).chain([0]).collect();
                (2, bytes.len(), bytes)
            }
        }
    }
}

/// The file's bytes.
pub fn file(mosaic: &Mosaic, position: &Position) -> Vec<u8> {
    let (grid, strip) = (&mosaic.grid, &mosaic.corrected);
    let codes = codes_as_shown(&strip.image);
    let bands = strip.image.bands;
    let pixel = |(i, p): (usize, &[u8])| {
        let alpha = if strip.from[i] > 0 { 255 } else { 0 };
        [p[0], p[1.min(bands - 1)], p[2.min(bands - 1)], alpha]
    };
    let pixels: Vec<u8> = codes.chunks_exact(bands).enumerate().flat_map(pixel).collect();
    // Degrees of the upper left corner, and of a pixel.
    let scale = [1.0 / (M_PER_DEG * position.origin.latitude.to_radians().cos()), 1.0 / M_PER_DEG];
    let west = position.origin.longitude + (grid.corner[0] + position.shift[0]) * scale[0];
    let north = position.origin.latitude + (grid.corner[1] + position.shift[1]) * scale[1];
    let says = format!(
        "{}; placed by {}, {:.2} m rms from its fixes",
        mosaic.source, position.topic, position.misfit_m
    );
    let (width, height) = (grid.width as u32, grid.height as u32);
    // Tags in rising order. GeoKeys: geographic, pixel is area, WGS 84.
    let geo_keys = vec![1, 1, 0, 3, 1024, 0, 1, 2, 1025, 0, 1, 1, 2048, 0, 1, 4326];
    let tags: Vec<(u16, Value)> = vec![
        (256, Value::Longs(vec![width])),
        (257, Value::Longs(vec![height])),
        (258, Value::Shorts(vec![8; 4])),
        (259, Value::Shorts(vec![1])),
        (262, Value::Shorts(vec![2])),
        (270, Value::Text(says)),
        (273, Value::Longs(vec![8])),
        (277, Value::Shorts(vec![4])),
        (278, Value::Longs(vec![height])),
        (279, Value::Longs(vec![pixels.len() as u32])),
        (284, Value::Shorts(vec![1])),
        (305, Value::Text(concat!("unwater ", env!("CARGO_PKG_VERSION")).into())),
        (338, Value::Shorts(vec![2])),
        (33550, Value::Doubles(vec![scale[0] * grid.m_per_px, scale[1] * grid.m_per_px, 0.0])),
        (33922, Value::Doubles(vec![0.0, 0.0, 0.0, west, north, 0.0])),
        (34735, Value::Shorts(geo_keys)),
    ];
    written(&pixels, &tags)
}

/// Head, pixels, long values, directory.
fn written(pixels: &[u8], tags: &[(u16, Value)]) -> Vec<u8> {
    let mut out = vec![b'I', b'I', 42, 0, 0, 0, 0, 0];
    out.extend_from_slice(pixels);
    let mut entries = Vec::new();
    for (tag, value) in tags {
        let (kind, count, mut bytes) = value.parts();
        let mut entry: Vec<u8> = [tag.to_le_bytes(), kind.to_le_bytes()].concat();
        entry.extend((count as u32).to_le_bytes());
        if bytes.len() <= 4 {
            bytes.resize(4, 0);
            entry.extend(bytes);
        } else {
            out.resize(out.len().next_multiple_of(8), 0);
            entry.extend((out.len() as u32).to_le_bytes());
            out.extend(bytes);
        }
        entries.push(entry);
    }
    out.resize(out.len().next_multiple_of(8), 0);
    let directory = (out.len() as u32).to_le_bytes();
    out[4..8].copy_from_slice(&directory);
    out.extend((entries.len() as u16).to_le_bytes());
    out.extend(entries.concat());
    out.extend([0; 4]);
    out
}
