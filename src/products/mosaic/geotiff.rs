//! The corrected strip as a GeoTIFF: 8-bit RGBA, north up, WGS 84 (EPSG:4326), uncompressed.
//!
//! Over some tens of metres degrees are uniform, so that no map projection is needed.

use super::by_matches::{Pair, Rigid};
use super::grid::{Grid, PlacedFrame, Strip};
use crate::error::{Error, Result};
use crate::products::display::srgb_of_rendered;
use crate::products::places::{Fix, M_PER_DEG, Places, east_north, fix_at};
use crate::stats::median;

/// Georeference of the mosaic's world.
pub struct Georeference {
    /// origin of the metric coordinates
    origin: Fix,
    /// east and north of the world's origin from there (m)
    translation: [f64; 2],
    /// rotation of the world about the vertical such that y points north (rad)
    pub yaw_rad: f64,
    /// root mean square residual of the fixes (m)
    residual_m: f64,
    topic: String,
}

/// A track shorter than this multiple of the residual does not determine a heading.
const MIN_TRACK: f64 = 5.0;

/// Georeference from the position fixes of the log: a translation, and a rotation where the log has
/// no attitude.
pub fn georeference(
    frames: &[PlacedFrame],
    places: &Places,
    has_attitude: bool,
) -> Result<Georeference> {
    let none = || {
        Error::Image(
            "the log has no position (sensor_msgs/NavSatFix or the like) near these frames, so \
             the mosaic cannot be georeferenced; use an output name ending in .png"
                .into(),
        )
    };
    let (topic, fixes) = places.best_fixes().ok_or_else(none)?;
    let origin = *fixes.first().ok_or_else(none)?;
    let of = |f: &PlacedFrame| {
        let t = f.world_from_body.translation.vector;
        Some(([t.x, t.y], east_north(&fix_at(fixes, f.stamp)?, &origin)))
    };
    let pairs: Vec<Pair> = frames.iter().filter_map(of).collect();
    if pairs.is_empty() {
        return Err(none());
    }
    let mut yaw_rad = 0.0;
    if !has_attitude {
        let rigid = Rigid::fitted(&pairs);
        yaw_rad = rigid.map_or(0.0, |r| r.angle_rad());
        let (_, residual_m) = translation(&pairs, yaw_rad);
        let (first, last) = (pairs[0].1, pairs[pairs.len() - 1].1);
        if rigid.is_none()
            || (last[0] - first[0]).hypot(last[1] - first[1]) < MIN_TRACK * residual_m
        {
            return Err(Error::Image(
                "the log has no heading, and its positions are too close together to determine \
                 it; use an output name ending in .png"
                    .into(),
            ));
        }
    }
    let (translation, residual_m) = translation(&pairs, yaw_rad);
    Ok(Georeference { origin, translation, yaw_rad, residual_m, topic: topic.clone() })
}

/// Median translation from rotated positions to fixes, and the root mean square residual (m).
fn translation(pairs: &[Pair], yaw_rad: f64) -> ([f64; 2], f64) {
    let (sin, cos) = yaw_rad.sin_cos();
    let offsets: Vec<[f64; 2]> = pairs
        .iter()
        .map(|(p, q)| [q[0] - (cos * p[0] - sin * p[1]), q[1] - (sin * p[0] + cos * p[1])])
        .collect();
    let shift = [0, 1].map(|k| median(&offsets.iter().map(|o| o[k]).collect::<Vec<_>>()));
    let square =
        offsets.iter().map(|o| (o[0] - shift[0]).powi(2) + (o[1] - shift[1]).powi(2)).sum::<f64>()
            / offsets.len() as f64;
    (shift, square.sqrt())
}

/// Value of a TIFF tag.
enum Value {
    Shorts(Vec<u16>),
    Longs(Vec<u32>),
    Doubles(Vec<f64>),
    Text(String),
}

impl Value {
    /// TIFF type number, count, bytes.
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

/// The contents of the file.
pub fn encode(source: &str, grid: &Grid, strip: &Strip, georeference: &Georeference) -> Vec<u8> {
    let samples = srgb_of_rendered(&strip.image);
    let bands = strip.image.bands;
    let pixel = |(i, p): (usize, &[u8])| {
        let alpha = if strip.frame_numbers[i] > 0 { 255 } else { 0 };
        [p[0], p[1.min(bands - 1)], p[2.min(bands - 1)], alpha]
    };
    let pixels: Vec<u8> = samples.chunks_exact(bands).enumerate().flat_map(pixel).collect();
    // Degrees per metre, and coordinates of the upper left corner.
    let scale =
        [1.0 / (M_PER_DEG * georeference.origin.latitude.to_radians().cos()), 1.0 / M_PER_DEG];
    let west =
        georeference.origin.longitude + (grid.corner[0] + georeference.translation[0]) * scale[0];
    let north =
        georeference.origin.latitude + (grid.corner[1] + georeference.translation[1]) * scale[1];
    let description = format!(
        "{source}; georeferenced by {}, {:.2} m rms residual",
        georeference.topic, georeference.residual_m
    );
    let (width, height) = (grid.width as u32, grid.height as u32);
    // Tags in ascending order. GeoKeys: geographic, pixel is area, WGS 84.
    let geo_keys = vec![1, 1, 0, 3, 1024, 0, 1, 2, 1025, 0, 1, 1, 2048, 0, 1, 4326];
    let tags: Vec<(u16, Value)> = vec![
        (256, Value::Longs(vec![width])),
        (257, Value::Longs(vec![height])),
        (258, Value::Shorts(vec![8; 4])),
        (259, Value::Shorts(vec![1])),
        (262, Value::Shorts(vec![2])),
        (270, Value::Text(description)),
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
    write_tiff(&pixels, &tags)
}

/// Header, pixels, values longer than four bytes, directory.
fn write_tiff(pixels: &[u8], tags: &[(u16, Value)]) -> Vec<u8> {
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
