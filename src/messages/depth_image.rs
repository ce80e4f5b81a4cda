//! Depth pictures: `16UC1` in millimetres, `32FC1` in metres, and ROS's `compressedDepth` of both.
//!
//! A sensor of ranges like any other once it has a calibration: a few places of the picture become
//! beams of a ping. 0, NaN and infinities mean no depth. The shape is that of a picture; the topic
//! or the format string says that it is depth.

use super::{DepthSamples, PingReading, Value, header, missing};
use crate::units::Stamp;
use crate::vehicle::{DvlFacts, Ping};

/// Places across and down that are looked at.
const GRID: (usize, usize) = (5, 4);
/// Half the side of the window whose median is taken [px].
const REACH: usize = 2;
/// `compressedDepth` puts its parameters before the file.
const HEADER_BYTES: usize = 12;

/// Whether a picture's message is one of depth.
pub fn is_depth(value: &Value<'_>, topic: &str) -> bool {
    let named = topic.to_ascii_lowercase().contains("depth");
    match (value.text("encoding"), value.text("format")) {
        (Some(encoding), _) => {
            matches!(encoding, "32FC1") || (named && matches!(encoding, "16UC1" | "mono16"))
        }
        (None, Some(format)) => format.contains("compressedDepth"),
        _ => false,
    }
}

pub fn decode(value: &Value<'_>, _facts: &DvlFacts) -> Result<PingReading, String> {
    let data = value.bytes("data").ok_or_else(|| missing("data"))?;
    let pixels = match value.text("format") {
        Some(format) => compressed(format, data)?,
        None => raw(value, data)?,
    };
    let ping = Ping {
        stamp: header(value).stamp.unwrap_or(Stamp(0)),
        beams: Vec::new(),
        altitude: None,
        velocity_m_per_s: None,
    };
    Ok(PingReading { ping: Some(ping), depth: Some(pixels), ..PingReading::default() })
}

fn raw(value: &Value<'_>, data: &[u8]) -> Result<DepthSamples, String> {
    let size = |field: &str| {
        value.integer(field).and_then(|v| usize::try_from(v).ok()).ok_or_else(|| missing(field))
    };
    let (width, height, step) = (size("width")?, size("height")?, size("step")?);
    let encoding = value.text("encoding").ok_or_else(|| missing("encoding"))?;
    let big_endian = value.flag("is_bigendian").unwrap_or(false);
    let bytes = if encoding == "32FC1" { 4 } else { 2 };
    let row = width.checked_mul(bytes).filter(|row| *row <= step);
    let needed = row.and_then(|row| step.checked_mul(height.checked_sub(1)?)?.checked_add(row));
    if needed.is_none_or(|n| n > data.len()) {
        return Err(format!(
            "{width}×{height} {encoding} with step {step} does not fit its {} bytes",
            data.len()
        ));
    }
    let depth = |x: usize, y: usize| {
        let at = y * step + x * bytes;
        let mut code = [0; 4];
        code[..bytes].copy_from_slice(&data[at..at + bytes]);
        if big_endian {
            code[..bytes].reverse();
        }
        if bytes == 4 {
            f64::from(f32::from_le_bytes(code))
        } else {
            f64::from(u32::from_le_bytes(code)) * 1e-3
        }
    };
    Ok(sampled(width, height, depth))
}

/// PNG behind the parameters; of `32FC1` it holds inverse depth, quantised: depth = a / (code − b).
fn compressed(format: &str, data: &[u8]) -> Result<DepthSamples, String> {
    let (header, file) = data
        .split_at_checked(HEADER_BYTES)
        .ok_or("a compressedDepth message without its header")?;
    if !file.starts_with(&[0x89, b'P', b'N', b'G']) {
        return Err(format!(
            "depth as {format:?} is not read; let the camera driver write PNG \
             (compressedDepth/format: png)"
        ));
    }
    let float = |at: usize| {
        header
            .get(at..at + 4)
            .and_then(|b| b.first_chunk())
            .map_or(f64::NAN, |b| f64::from(f32::from_le_bytes(*b)))
    };
    let (a, b) = (float(4), float(8));
    let (width, height, codes) = crate::image::decode::grey16(file)?;
    let inverse = format.trim_start().starts_with("32FC1");
    let depth = |x: usize, y: usize| {
        let code = f64::from(codes[y * width + x]);
        match (code > 0.0, inverse) {
            (false, _) => f64::NAN,
            (true, true) => a / (code - b),
            (true, false) => code * 1e-3,
        }
    };
    Ok(sampled(width, height, depth))
}

/// The median of a small window around each place of a coarse grid; a place with too few depths is
/// left out.
fn sampled(width: usize, height: usize, depth: impl Fn(usize, usize) -> f64) -> DepthSamples {
    let mut samples = Vec::new();
    for j in 0..GRID.1 {
        for i in 0..GRID.0 {
            let (u, v) = ((2 * i + 1) * width / (2 * GRID.0), (2 * j + 1) * height / (2 * GRID.1));
            let around =
                |at: usize, size: usize| at.saturating_sub(REACH)..(at + REACH + 1).min(size);
            let mut window: Vec<f64> = around(v, height)
                .flat_map(|y| around(u, width).map(move |x| (x, y)))
                .map(|(x, y)| depth(x, y))
                .collect();
            let all = window.len();
            window.retain(|z| z.is_finite() && *z > 0.0);
            window.sort_by(f64::total_cmp);
            if 2 * window.len() > all {
                samples.push([u as f64, v as f64, window[window.len() / 2]]);
            }
        }
    }
    DepthSamples { width, height, samples }
}
