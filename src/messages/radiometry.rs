//! Exposure time, gain and strobe power, in the sender's unit. Whether a gain is a factor or in
//! decibels is estimated from the images.

use super::layout::Layout;
use super::reading::RadiometrySetting;
use super::value::Value;

/// Name of a setting, and its field names (`ImageMetaData` of FLIR drivers, Blueye's
/// `CameraParameters` and others).
const SETTINGS: &[(&str, &[&str])] = &[
    (
        "exposure",
        &[
            "exposure_time",
            "exposure",
            "exposure_us",
            "exposure_time_us",
            "exposure_ms",
            "exposure_s",
            "shutter",
            "shutter_time",
        ],
    ),
    (
        "gain",
        &["gain", "gain_db", "analog_gain", "analogue_gain", "camera_gain", "relative_gain", "iso"],
    ),
    (
        "strobe",
        &[
            "strobe_power",
            "strobe_energy",
            "strobe_intensity",
            "flash_power",
            "lamp_power",
            "light_power",
        ],
    ),
];
/// Field of a message of one number.
const BARE: &[&str] = &["data", "value"];

fn name_by_topic(topic: &str) -> Option<&'static str> {
    let topic = topic.to_ascii_lowercase();
    let has = |words: &[&str]| words.iter().any(|w| topic.contains(w));
    if has(&["exposure", "shutter"]) {
        Some("exposure")
    } else if has(&["gain", "iso"]) && has(&["cam", "image", "sensor"]) {
        Some("gain")
    } else if has(&["strobe", "flash", "lamp", "lumen"]) {
        Some("strobe")
    } else {
        None
    }
}

pub fn matches_bare(layout: &Layout, topic: &str) -> bool {
    let fields = layout
        .root()
        .iter()
        .filter(|(name, _)| !matches!(&**name, "header" | "stamp" | "timestamp"))
        .count();
    name_by_topic(topic).is_some() && fields == 1 && BARE.iter().any(|f| layout.is_number(f))
}

pub fn matches_fields(layout: &Layout, topic: &str) -> bool {
    let found =
        SETTINGS.iter().filter(|(_, fields)| fields.iter().any(|f| layout.is_number(f))).count();
    found >= 2 || (found == 1 && name_by_topic(topic).is_some())
}

/// Seconds in the unit of an exposure, where the name of its field or topic states one.
pub fn exposure_unit_s(layout: &Layout, topic: &str) -> Option<f64> {
    let fields = SETTINGS.iter().find(|(name, _)| *name == "exposure")?.1;
    let field = fields.iter().find(|field| layout.is_number(field)).copied();
    let bare = || Some(topic).filter(|topic| name_by_topic(topic) == Some("exposure"));
    let name = field.or_else(bare)?.to_ascii_lowercase();
    let units = [("_us", 1e-6), ("_ms", 1e-3), ("_s", 1.0)];
    units.into_iter().find(|(ending, _)| name.ends_with(ending)).map(|(_, unit_s)| unit_s)
}

/// Settings by name; the caller names a bare number after its topic.
pub fn decode(value: &Value<'_>) -> Result<Vec<RadiometrySetting>, String> {
    if let Some(bare) = BARE.iter().find_map(|f| value.number(f)) {
        return Ok(vec![("value", bare)]);
    }
    let named = |(name, fields): &(&'static str, &[&str])| {
        Some((*name, fields.iter().find_map(|f| value.number(f))?))
    };
    Ok(SETTINGS.iter().filter_map(named).collect())
}
