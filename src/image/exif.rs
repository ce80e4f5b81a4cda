//! EXIF in image files: when and where a still was taken, which one it is, how it was exposed.

use std::io::Cursor;

use exif::experimental::Writer;
use exif::{Context, Exif, Field, In, Rational, Reader, Tag, Value};
use img_parts::{Bytes, DynImage, ImageEXIF};

/// What EXIF says of a still.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ExifFacts {
    /// `2026:05:01 10:00:00.123+00:00`; without a zone where the camera states none; may be empty
    pub taken_at: String,
    /// latitude and longitude, WGS 84 (deg)
    pub position_deg: Option<[f64; 2]>,
    /// below the sea surface (m)
    pub depth_m: Option<f64>,
    /// of the top of the image, from true north (deg)
    pub heading_deg: Option<f64>,
    /// to the seafloor (m)
    pub distance_m: Option<f64>,
    /// exposure time (s)
    pub exposure_s: Option<f64>,
    /// 32 hexadecimal digits; may be empty
    pub id: String,
}

/// Reads the EXIF of an image file (JPEG, PNG, TIFF, WebP); `None` where it has none.
pub fn read(file: &[u8]) -> Option<ExifFacts> {
    let exif = Reader::new().read_from_container(&mut Cursor::new(file)).ok()?;
    let depth_m = number(&exif, Tag::GPSAltitude).filter(|_| {
        let below = exif.get_field(Tag::GPSAltitudeRef, In::PRIMARY);
        below.is_some_and(|field| field.value.get_uint(0) == Some(1))
    });
    let angle = |tag, sign_tag, negative| {
        let [degrees, minutes, seconds] = numbers(&exif, tag).get(..3)?.try_into().ok()?;
        let angle: f64 = degrees + minutes / 60.0 + seconds / 3600.0;
        Some(if text(&exif, sign_tag)?.starts_with(negative) { -angle } else { angle })
    };
    let latitude = angle(Tag::GPSLatitude, Tag::GPSLatitudeRef, 'S');
    let longitude = angle(Tag::GPSLongitude, Tag::GPSLongitudeRef, 'W');
    let taken_at = text(&exif, Tag::DateTimeOriginal).map_or_else(String::new, |moment| {
        let part = text(&exif, Tag::SubSecTimeOriginal).map(|digits| format!(".{digits}"));
        let zone = text(&exif, Tag::OffsetTimeOriginal).unwrap_or_default();
        moment + &part.unwrap_or_default() + &zone
    });
    Some(ExifFacts {
        taken_at,
        position_deg: latitude.zip(longitude).map(|(latitude, longitude)| [latitude, longitude]),
        depth_m,
        heading_deg: number(&exif, Tag::GPSImgDirection),
        distance_m: number(&exif, Tag::SubjectDistance),
        exposure_s: number(&exif, Tag::ExposureTime),
        id: text(&exif, Tag::ImageUniqueID).unwrap_or_default(),
    })
}

/// The image file (JPEG, PNG or WebP) with this EXIF in place of what it had; its pixels stay as
/// they are.
///
/// # Errors
/// It is none of these, or damaged.
pub fn with_facts(file: Vec<u8>, facts: &ExifFacts) -> Result<Vec<u8>, String> {
    let fields = fields(facts);
    let mut writer = Writer::new();
    fields.iter().for_each(|field| writer.push_field(field));
    let mut block = Cursor::new(Vec::new());
    writer.write(&mut block, true).map_err(|e| e.to_string())?;
    let image = DynImage::from_bytes(Bytes::from(file)).map_err(|e| e.to_string())?;
    let mut image = image.ok_or("it is neither JPEG, PNG nor WebP")?;
    image.set_exif(Some(Bytes::from(block.into_inner())));
    Ok(image.encoder().bytes().to_vec())
}

fn fields(facts: &ExifFacts) -> Vec<Field> {
    let text = |text: &str| Value::Ascii(vec![text.as_bytes().to_vec()]);
    let ratio = |value: f64| Value::Rational(vec![rational(value)]);
    let mut values = vec![(Tag::Software, text(concat!("unwater ", env!("CARGO_PKG_VERSION"))))];
    // `YYYY:MM:DD HH:MM:SS`, the part of a second, the zone
    if let Some((moment, rest)) = facts.taken_at.split_at_checked(19) {
        values.push((Tag::DateTimeOriginal, text(moment)));
        let (part, zone) = rest.split_at(rest.find(['+', '-']).unwrap_or(rest.len()));
        let part = part.trim_start_matches('.');
        let found = [(Tag::SubSecTimeOriginal, part), (Tag::OffsetTimeOriginal, zone)];
        let found = found.into_iter().filter(|(_, words)| !words.is_empty());
        values.extend(found.map(|(tag, words)| (tag, text(words))));
    }
    if let Some([latitude, longitude]) = facts.position_deg {
        values.extend([
            (Tag::GPSMapDatum, text("WGS-84")),
            (Tag::GPSLatitudeRef, text(if latitude < 0.0 { "S" } else { "N" })),
            (Tag::GPSLatitude, sexagesimal(latitude.abs())),
            (Tag::GPSLongitudeRef, text(if longitude < 0.0 { "W" } else { "E" })),
            (Tag::GPSLongitude, sexagesimal(longitude.abs())),
        ]);
    }
    if let Some(depth_m) = facts.depth_m {
        values.push((Tag::GPSAltitudeRef, Value::Byte(vec![u8::from(depth_m >= 0.0)])));
        values.push((Tag::GPSAltitude, ratio(depth_m.abs())));
    }
    if let Some(heading_deg) = facts.heading_deg {
        values.push((Tag::GPSImgDirectionRef, text("T")));
        values.push((Tag::GPSImgDirection, ratio(heading_deg.rem_euclid(360.0))));
    }
    values.extend(facts.distance_m.map(|distance| (Tag::SubjectDistance, ratio(distance))));
    values.extend(facts.exposure_s.map(|exposure| (Tag::ExposureTime, ratio(exposure))));
    if !facts.id.is_empty() {
        values.push((Tag::ImageUniqueID, text(&facts.id)));
    }
    if values.iter().any(|(tag, _)| tag.context() == Context::Gps) {
        values.push((Tag::GPSVersionID, Value::Byte(vec![2, 3, 0, 0])));
    }
    values.extend(required());
    let field = |(tag, value)| Field { tag, ifd_num: In::PRIMARY, value };
    values.into_iter().map(field).collect()
}

/// Fields that the standard requires of every JPEG; they say nothing of the still.
fn required() -> [(Tag, Value); 7] {
    let undefined = |bytes: &[u8]| Value::Undefined(bytes.to_vec(), 0);
    let dots_per_inch = || Value::Rational(vec![Rational { num: 72, denom: 1 }]);
    [
        (Tag::XResolution, dots_per_inch()),
        (Tag::YResolution, dots_per_inch()),
        (Tag::ResolutionUnit, Value::Short(vec![2])),
        (Tag::YCbCrPositioning, Value::Short(vec![1])),
        (Tag::ExifVersion, undefined(b"0231")),
        (Tag::ComponentsConfiguration, undefined(&[1, 2, 3, 0])),
        (Tag::FlashpixVersion, undefined(b"0100")),
    ]
}

/// Degrees, minutes and seconds.
fn sexagesimal(degrees: f64) -> Value {
    // Rounded as a whole: 59.9999999 seconds would become 60.
    let micro_seconds = (degrees * 3600e6).round() as u64;
    let (minutes, rest) = (micro_seconds / 60_000_000, micro_seconds % 60_000_000);
    let whole = |number: u64| Rational { num: number as u32, denom: 1 };
    let seconds = Rational { num: rest as u32, denom: 1_000_000 };
    Value::Rational(vec![whole(minutes / 60), whole(minutes % 60), seconds])
}

/// To a millionth; to less where that is too large for 32 bits.
fn rational(value: f64) -> Rational {
    let denom = if value < 4000.0 { 1_000_000 } else { 100 };
    Rational { num: (value * f64::from(denom)).round() as u32, denom }
}

fn text(exif: &Exif, tag: Tag) -> Option<String> {
    let Value::Ascii(texts) = &exif.get_field(tag, In::PRIMARY)?.value else { return None };
    let text = String::from_utf8_lossy(texts.first()?);
    let text = text.trim_matches(['\0', ' ']);
    (!text.is_empty()).then(|| text.into())
}

fn numbers(exif: &Exif, tag: Tag) -> Vec<f64> {
    match exif.get_field(tag, In::PRIMARY).map(|field| &field.value) {
        Some(Value::Rational(ratios)) => ratios.iter().map(Rational::to_f64).collect(),
        _ => Vec::new(),
    }
}

fn number(exif: &Exif, tag: Tag) -> Option<f64> {
    numbers(exif, tag).first().copied().filter(|value| value.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{ImageShape, encode};

    #[test]
    fn facts_are_read_back_and_the_pixels_stay() {
        let facts = ExifFacts {
            taken_at: "2026:05:01 10:00:00.123+00:00".into(),
            position_deg: Some([-43.999_999_999_9, -179.5]),
            depth_m: Some(4512.25),
            heading_deg: Some(-90.0),
            distance_m: Some(2.125),
            exposure_s: Some(0.0008),
            id: "0123456789abcdef0123456789abcdef".into(),
        };
        let shape = ImageShape { width: 3, height: 2, bands: 1 };
        let file = encode::png(&[1, 2, 3, 4, 5, 6], shape, 8).expect("a PNG");
        let with = with_facts(file.clone(), &facts).expect("a PNG");
        let read = read(&with).expect("EXIF");
        let [latitude, longitude] = read.position_deg.expect("a position");
        assert!((latitude + 44.0).abs() < 1e-9 && longitude == -179.5, "{latitude} {longitude}");
        let heading_deg = Some(270.0);
        let position_deg = read.position_deg;
        assert_eq!(read, ExifFacts { heading_deg, position_deg, ..facts.clone() });
        // Once more: in place of the first, not beside it.
        let bare = ExifFacts { depth_m: None, heading_deg, position_deg: None, ..facts };
        let again = with_facts(with, &bare).expect("a PNG");
        assert_eq!(super::read(&again).expect("EXIF"), bare);
        let pixels = |file: &[u8]| image::load_from_memory(file).expect("an image").into_bytes();
        assert_eq!(pixels(&again), pixels(&file));
        assert!(with_facts(b"no image".to_vec(), &bare).is_err());
        assert_eq!(super::read(&file), None);
    }
}
