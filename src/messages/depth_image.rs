//! Depth images: `16UC1` in millimetres, `32FC1` in metres, and ROS's `compressedDepth` of both.
//!
//! Once the depth camera is calibrated, samples on a coarse grid become the beams of a ping. Zero,
//! NaN and infinities mean no depth. The schema is that of a camera image; the topic, the encoding
//! or the format string tells depth images apart.

use super::reading::{DepthSamples, PingReading, missing, size};
use super::value::Value;
use crate::vehicle::DvlFacts;

/// Columns and rows of the sampling grid.
const GRID: (usize, usize) = (5, 4);
/// Half the side of the window over which the median is taken (px).
const HALF_WINDOW_PX: usize = 2;
/// Length of the parameters before the PNG in `compressedDepth` (byte).
const HEADER_BYTES: usize = 12;

/// Whether an image message holds depth.
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
    let depth = Some(match value.text("format") {
        Some(format) => compressed(format, data)?,
        None => raw(value, data)?,
    });
    Ok(PingReading { depth, ..PingReading::of_beams(value, Vec::new()) })
}

fn raw(value: &Value<'_>, data: &[u8]) -> Result<DepthSamples, String> {
    let (width, height, step) =
        (size(value, "width")?, size(value, "height")?, size(value, "step")?);
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
    let depth_m = |x: usize, y: usize| {
        let at = y * step + x * bytes;
        let mut pixel = [0; 4];
        pixel[..bytes].copy_from_slice(&data[at..at + bytes]);
        if big_endian {
            pixel[..bytes].reverse();
        }
        if bytes == 4 {
            f64::from(f32::from_le_bytes(pixel))
        } else {
            f64::from(u32::from_le_bytes(pixel)) * 1e-3
        }
    };
    Ok(sampled(width, height, depth_m))
}

/// A PNG behind the parameters a and b. For `32FC1` its pixel values are quantised inverse depth:
/// depth = a / (value − b).
fn compressed(format: &str, data: &[u8]) -> Result<DepthSamples, String> {
    let (header, file) = data
        .split_at_checked(HEADER_BYTES)
        .ok_or("a compressedDepth message without its header")?;
    if !file.starts_with(&[0x89, b'P', b'N', b'G']) {
        return Err(format!(
            "depth as {format:?} is not supported; set the camera driver to PNG \
             (compressedDepth/format: png)"
        ));
    }
    let parameter = |at: usize| {
        header
            .get(at..at + 4)
            .and_then(|b| b.first_chunk())
            .map_or(f64::NAN, |b| f64::from(f32::from_le_bytes(*b)))
    };
    let (a, b) = (parameter(4), parameter(8));
    let (width, height, pixels) = crate::image::decode::grey16(file)?;
    let is_inverse = format.trim_start().starts_with("32FC1");
    let depth_m = |x: usize, y: usize| {
        let pixel = f64::from(pixels[y * width + x]);
        match (pixel > 0.0, is_inverse) {
            (false, _) => f64::NAN,
            (true, true) => a / (pixel - b),
            (true, false) => pixel * 1e-3,
        }
    };
    Ok(sampled(width, height, depth_m))
}

/// The median depth of a small window around each grid point. A window of which no more than half
/// the pixels have a depth gives no sample.
fn sampled(width: usize, height: usize, depth_m: impl Fn(usize, usize) -> f64) -> DepthSamples {
    let mut samples = Vec::new();
    for j in 0..GRID.1 {
        for i in 0..GRID.0 {
            let (u, v) = ((2 * i + 1) * width / (2 * GRID.0), (2 * j + 1) * height / (2 * GRID.1));
            let span = |at: usize, size: usize| {
                at.saturating_sub(HALF_WINDOW_PX)..(at + HALF_WINDOW_PX + 1).min(size)
            };
            let mut window: Vec<f64> = span(v, height)
                .flat_map(|y| span(u, width).map(move |x| (x, y)))
                .map(|(x, y)| depth_m(x, y))
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
