//! Serialises images, calibrations, plots and log lines.

use super::super::header::Header;
use super::super::writer::{WireFormat, Writer};
use crate::diagnostics::{Diagnostic, Severity};
use crate::units::Stamp;
use crate::vehicle::Camera;

/// A line of `/unwater/log`.
pub struct LogLine {
    severity: Severity,
    /// `unwater`; for a diagnostic with its code, `unwater.no-ping`
    name: String,
    text: String,
}

impl LogLine {
    /// A line that is not a diagnostic.
    pub fn info(text: String) -> Self {
        Self { severity: Severity::Info, name: "unwater".into(), text }
    }

    /// A diagnostic with its remedy.
    pub fn of(diagnostic: &Diagnostic) -> Self {
        let name = format!("unwater.{}", diagnostic.code());
        Self { severity: diagnostic.severity(), name, text: diagnostic.with_remedy() }
    }
}

/// Seconds and nanoseconds.
pub(super) fn time(stamp: Stamp) -> (i32, u32) {
    (stamp.0.div_euclid(1_000_000_000) as i32, stamp.0.rem_euclid(1_000_000_000) as u32)
}

/// A message that begins with the header of the source frame.
pub fn with_header(wire: WireFormat, header: &Header) -> Writer {
    let (sec, nanosec) = time(header.stamp.unwrap_or_default());
    Writer::new(wire).header(sec, nanosec, &header.frame_id)
}

/// As [`with_header`]; in protobuf the frame id has the field number `frame_id`.
pub(super) fn with_header_at(wire: WireFormat, header: &Header, frame_id: u32) -> Writer {
    let (sec, nanosec) = time(header.stamp.unwrap_or_default());
    match wire {
        WireFormat::Protobuf => {
            Writer::new(wire).time(sec, nanosec).at(frame_id).text(&header.frame_id)
        }
        WireFormat::Cdr | WireFormat::Ros1 => with_header(wire, header),
    }
}

/// `CompressedImage`; `format` is `jpeg` or `png`.
pub fn compressed_image(wire: WireFormat, header: &Header, format: &str, data: &[u8]) -> Vec<u8> {
    with_header_at(wire, header, 4).at(3).text(format).at(2).bytes(data).finish()
}

/// Pixels of a raw image, little-endian.
pub struct RawImage<'a> {
    /// (px)
    pub width: usize,
    /// (px)
    pub height: usize,
    /// as in `sensor_msgs/image_encodings`
    pub encoding: &'a str,
    /// length of a row (byte)
    pub step: usize,
    /// rows from top to bottom
    pub data: &'a [u8],
}

/// `Image`.
pub fn image(wire: WireFormat, header: &Header, image: &RawImage<'_>) -> Vec<u8> {
    let size = with_header_at(wire, header, 7)
        .at(3)
        .fixed32(image.height as u32)
        .at(2)
        .fixed32(image.width as u32)
        .at(4)
        .text(image.encoding);
    // Foxglove's message has no byte order: it is little-endian.
    let order = if wire == WireFormat::Protobuf { size } else { size.u8(0) };
    order.at(5).fixed32(image.step as u32).bytes(image.data).finish()
}

/// `CameraInfo`.
pub fn camera_info(wire: WireFormat, header: &Header, camera: &Camera) -> Vec<u8> {
    let Camera { fx, fy, cx, cy, .. } = *camera;
    let message = with_header_at(wire, header, 9)
        .at(3)
        .fixed32(camera.height as u32)
        .at(2)
        .fixed32(camera.width as u32)
        .at(4)
        .text(camera.distortion.name())
        .f64_sequence(&camera.distortion.coefficients())
        .f64_array(&[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0])
        .f64_array(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
        .f64_array(&[fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]);
    match wire {
        WireFormat::Protobuf => message.finish(),
        // no binning, no region of interest
        WireFormat::Cdr | WireFormat::Ros1 => (0..6).fold(message, |w, _| w.u32(0)).u8(0).finish(),
    }
}

/// `Float64MultiArray` with one labelled dimension; label and numbers in protobuf.
pub fn multi_array(wire: WireFormat, label: &str, values: &[f64]) -> Vec<u8> {
    let n = values.len() as u32;
    let message = match wire {
        WireFormat::Protobuf => Writer::new(wire).text(label),
        WireFormat::Cdr | WireFormat::Ros1 => {
            Writer::new(wire).u32(1).text(label).u32(n).u32(n).u32(0)
        }
    };
    message.f64_sequence(values).finish()
}

/// `Log`.
pub fn log(wire: WireFormat, stamp: Stamp, line: &LogLine) -> Vec<u8> {
    let (sec, nanosec) = time(stamp);
    let LogLine { severity, name, text } = line;
    let level = match (wire, severity) {
        (WireFormat::Cdr, Severity::Info) => 20,
        (WireFormat::Cdr, _) => 30,
        (WireFormat::Ros1 | WireFormat::Protobuf, Severity::Info) => 2,
        (WireFormat::Ros1, _) => 4,
        (WireFormat::Protobuf, _) => 3,
    };
    let message = match wire {
        WireFormat::Ros1 => Writer::new(wire).header(sec, nanosec, ""),
        WireFormat::Cdr | WireFormat::Protobuf => Writer::new(wire).time(sec, nanosec),
    };
    let message = message.u8(level);
    // Empty are the file, the function, the line and the topics.
    match wire {
        WireFormat::Cdr => message.text(name).text(text).text("").text("").u32(0),
        WireFormat::Ros1 => message.text(name).text(text).text("").text("").u32(0).u32(0),
        WireFormat::Protobuf => message.text(text).text(name).text("").fixed32(0),
    }
    .finish()
}
