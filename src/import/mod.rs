//! A folder of still images and a navigation table → a log that every other command reads.
//!
//! The bytes of the images are kept as they are. Positions, altitudes, attitudes and depths become
//! messages at the time of each image. The vehicle's axes are forward, right, down; the camera
//! looks down with the top of its images forward, until a rig file says otherwise.
//!
//! The files depend on each other in this order: `table`, `row`, `from_exif`.

mod from_exif;
mod row;
mod table;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion};

use crate::config::OutputConfig;
use crate::error::{Error, Result};
use crate::image::{EncodedImage, decode, exif};
use crate::messages::Header;
use crate::messages::output::{
    CAMERA_INFO, COMPRESSED_IMAGE, FLOAT64, IMU, NAV_SAT_FIX, OutputType, RANGE, TRANSFORM,
    altitude, attitude, camera_info, compressed_image, number, position, transform,
};
use crate::messages::writer::WireFormat;
use crate::recording::{FileIdentity, NewAttachment, NewChannel, Output, OutputFile, Schema};
use crate::session::sha256;
use crate::units::Stamp;
use crate::vehicle::Camera;
pub use row::offset_s;
use row::{Row, rows};
use table::Table;

/// What is imported, and how.
#[derive(Clone, Debug, Default)]
pub struct Import {
    /// of the images
    pub folder: PathBuf,
    /// CSV, or an iFDO record in JSON
    pub table: PathBuf,
    /// of times without a zone (s)
    pub utc_offset_s: i64,
    /// of the camera in water (deg); without it, the calibration comes from a rig file
    pub horizontal_fov_deg: Option<f64>,
}

/// What was written.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Imported {
    /// images
    pub images: usize,
    /// images with an altitude
    pub with_altitude: usize,
    /// columns of the table that are used, with their meaning and unit
    pub columns: Vec<String>,
    /// files of the table that cannot be read as images
    pub missing: Vec<String>,
}

const CAMERA_FRAME: &str = "camera_optical";
const VEHICLE_FRAME: &str = "base_link";
const ALTIMETER_FRAME: &str = "altimeter";

/// Writes the log.
///
/// # Errors
/// The table cannot be read, no image is found, or the log cannot be written; then there is none.
pub fn import(wanted: &Import, target: &Path) -> Result<Imported> {
    let bad = |reason: String| Error::BadFile {
        path: wanted.table.clone(),
        what: "no navigation table",
        reason,
    };
    let text = std::fs::read_to_string(&wanted.table)
        .map_err(|source| Error::Read { path: wanted.table.clone(), source })?;
    let parsed = Table::parse(&text).map_err(bad)?;
    let (mut rows, mut columns) = rows(&parsed, wanted.utc_offset_s).map_err(bad)?;
    let exif = |file: &str| image(&wanted.folder, file).map(|f| exif::read(&f).unwrap_or_default());
    columns.extend(from_exif::complete(&mut rows, wanted.utc_offset_s, exif).map_err(bad)?);
    rows.sort_by(|a, b| (a.stamp_ns, &a.file).cmp(&(b.stamp_ns, &b.file)));
    ensure_no_image(&wanted.folder, &rows, target)?;
    let mut log = Log::create(wanted, target)?;
    let mut imported = Imported { columns, ..Imported::default() };
    for row in &rows {
        let image = image(&wanted.folder, &row.file);
        let Some((stamp_ns, image)) = row.stamp_ns.zip(image) else {
            imported.missing.push(row.file.clone());
            continue;
        };
        log.add(Stamp(stamp_ns), row, &image)?;
        imported.images += 1;
        imported.with_altitude += usize::from(row.altitude_m.is_some());
    }
    if imported.images == 0 {
        return Err(bad(format!("none of its files is an image in {}", wanted.folder.display())));
    }
    let first_ns = rows.iter().find_map(|row| row.stamp_ns);
    log.finish(&text, &imported, first_ns.unwrap_or_default())?;
    Ok(imported)
}

/// A file of the folder: by its path in the table, else by its name alone.
fn image(folder: &Path, name: &str) -> Option<Vec<u8>> {
    let bytes = paths(folder, name).find_map(|path| std::fs::read(path).ok())?;
    format(&bytes).is_some().then_some(bytes)
}

/// Where a file of the table may be.
fn paths(folder: &Path, name: &str) -> impl Iterator<Item = PathBuf> {
    let path = Path::new(name);
    let is_inside = path.components().all(|c| matches!(c, std::path::Component::Normal(_)));
    let by_path = is_inside.then(|| folder.join(path));
    by_path.into_iter().chain(path.file_name().map(|name| folder.join(name)))
}

/// Refuses a target that is one of the images, or another image of their folder.
fn ensure_no_image(folder: &Path, rows: &[Row], target: &Path) -> Result<()> {
    let Some(identity) = FileIdentity::of(target) else { return Ok(()) };
    let mut listed = rows.iter().flat_map(|row| paths(folder, &row.file));
    let is_listed = listed.any(|path| FileIdentity::of(&path).as_ref() == Some(&identity));
    let whole = |path: &Path| std::fs::canonicalize(path).ok();
    let is_inside =
        whole(target).zip(whole(folder)).is_some_and(|(file, folder)| file.starts_with(folder));
    let is_image = || std::fs::read(target).is_ok_and(|bytes| format(&bytes).is_some());
    if is_listed || (is_inside && is_image()) {
        return Err(Error::OutputIsInput { path: target.into() });
    }
    Ok(())
}

/// By its first bytes, the format of an image file.
fn format(bytes: &[u8]) -> Option<&'static str> {
    match bytes {
        [0xff, 0xd8, 0xff, ..] => Some("jpeg"),
        [0x89, b'P', b'N', b'G', ..] => Some("png"),
        [b'I', b'I', 42, 0, ..] | [b'M', b'M', 0, 42, ..] => Some("tiff"),
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => Some("webp"),
        _ => None,
    }
}

/// The log while it is written.
struct Log<'w> {
    wanted: &'w Import,
    out: Output,
    file: OutputFile,
    channels: BTreeMap<&'static str, NewChannel>,
}

impl<'w> Log<'w> {
    fn create(wanted: &'w Import, target: &Path) -> Result<Self> {
        let (out, file) = Output::create(target, "ros2", &OutputConfig::default())?;
        Ok(Self { wanted, out, file, channels: BTreeMap::new() })
    }

    fn write(
        &mut self,
        topic: &'static str,
        kind: OutputType,
        stamp: Stamp,
        data: &[u8],
    ) -> Result<()> {
        let channel = match self.channels.get(topic) {
            Some(channel) => *channel,
            None => {
                let schema = kind.schema_in(WireFormat::Cdr);
                let (name, encoding) = (schema.name, schema.encoding.into());
                let known = Schema { name, encoding, data: schema.data };
                let channel = self.out.add_channel(topic, schema.message_encoding, &known)?;
                self.channels.insert(topic, channel);
                channel
            }
        };
        let time = u64::try_from(stamp.0).unwrap_or(0);
        self.out.write(channel, time, time, data);
        self.put()
    }

    fn put(&mut self) -> Result<()> {
        while let Some(piece) = self.out.next_piece() {
            self.file.put(piece.into_bytes())?;
        }
        Ok(())
    }

    fn add(&mut self, stamp: Stamp, row: &Row, image: &[u8]) -> Result<()> {
        let header = |frame: &str| Header { stamp: Some(stamp), frame_id: frame.into() };
        if !self.channels.contains_key("/tf_static") {
            self.add_mounts(stamp)?;
        }
        if let Some(angles) = row.attitude_rad {
            let message = attitude(&header(VEHICLE_FRAME), ned_from_vehicle(angles));
            self.write("/imu", IMU, stamp, &message)?;
        }
        if let Some(altitude_m) = row.altitude_m {
            let message = altitude(&header(ALTIMETER_FRAME), altitude_m);
            self.write("/altimeter", RANGE, stamp, &message)?;
        }
        if let Some([latitude, longitude]) = row.position_deg {
            let height = row.depth_m.map_or(f64::NAN, |depth| -depth);
            let message = position(&header(VEHICLE_FRAME), [latitude, longitude, height]);
            self.write("/fix", NAV_SAT_FIX, stamp, &message)?;
        }
        if let Some(depth_m) = row.depth_m {
            self.write("/depth", FLOAT64, stamp, &number(depth_m))?;
        }
        let (header, format) = (header(CAMERA_FRAME), format(image).unwrap_or_default());
        let size = decode::size(&EncodedImage::Compressed { format, data: image });
        if let (Some(fov_deg), Some((width, height))) = (self.wanted.horizontal_fov_deg, size) {
            let camera = Camera::from_field_of_view(width, height, fov_deg);
            let message = camera_info(WireFormat::Cdr, &header, &camera);
            self.write("/camera/camera_info", CAMERA_INFO, stamp, &message)?;
        }
        let message = compressed_image(WireFormat::Cdr, &header, format, image);
        self.write("/camera/image_raw/compressed", COMPRESSED_IMAGE, stamp, &message)
    }

    /// Camera and altimeter at the vehicle's origin, looking down.
    fn add_mounts(&mut self, stamp: Stamp) -> Result<()> {
        let header = Header { stamp: Some(stamp), frame_id: VEHICLE_FRAME.into() };
        // Columns: the image's right, its bottom and the line of sight, in forward, right, down.
        let axes = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
        let rotation =
            UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
        let camera = Isometry3::from_parts(Translation3::identity(), rotation);
        for (child, pose) in [(CAMERA_FRAME, camera), (ALTIMETER_FRAME, Isometry3::identity())] {
            let message = transform(WireFormat::Cdr, &header, child, &pose);
            self.write("/tf_static", TRANSFORM, stamp, &message)?;
        }
        Ok(())
    }

    /// Adds the table and what was made of it.
    fn finish(mut self, table: &str, imported: &Imported, first_ns: i64) -> Result<()> {
        self.out.flush();
        self.put()?;
        let name = self.wanted.table.file_name().map(|n| n.to_string_lossy().into_owned());
        let name = name.unwrap_or_default();
        let time = u64::try_from(first_ns).unwrap_or(0);
        self.file.attach(&NewAttachment {
            log_time: time,
            create_time: time,
            name: &name,
            media_type: if name.ends_with(".json") { "application/json" } else { "text/csv" },
            data: table.as_bytes(),
        })?;
        let zone = self.wanted.utc_offset_s;
        let facts = [
            ("version", env!("CARGO_PKG_VERSION").to_string()),
            ("table", name.clone()),
            ("table_sha256", sha256(table.as_bytes())),
            ("columns", imported.columns.join("; ")),
            ("utc_offset_of_times_without_zone_s", zone.to_string()),
            ("missing_files", imported.missing.join(", ")),
        ];
        let facts = facts.into_iter().map(|(key, value)| (key.into(), value)).collect();
        self.file.metadata("unwater_import", &facts)?;
        self.file.finish(self.out.declarations())
    }
}

/// Rotation from forward, right, down to north, east, down, as x, y, z, w.
fn ned_from_vehicle([heading, pitch, roll]: [f64; 3]) -> [f64; 4] {
    UnitQuaternion::from_euler_angles(roll, pitch, heading).coords.into()
}
