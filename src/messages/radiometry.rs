//! What a camera or a strobe was set to: exposure time, gain, power of the strobe. Units are the
//! sender's own: whether a number is a factor or counts decibels is for the pictures to say.

use super::{RadiometrySetting, Value, layout::Layout};

/// Name of a setting, and the fields it goes by (`ImageMetaData` of FLIR drivers, Blueye's
/// `CameraParameters`, and the like).
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
/// Fields of a message that is one number.
const BARE: &[&str] = &["data", "value"];

fn bare_name(topic: &str) -> Option<&'static str> {
    let topic = topic.to_ascii_lowercase();
    let says = |words: &[&str]| words.iter().any(|w| topic.contains(w));
    if says(&["exposure", "shutter"]) {
        Some("exposure")
    } else if says(&["gain", "iso"]) && says(&["cam", "image", "sensor"]) {
        Some("gain")
    } else if says(&["strobe", "flash", "lamp", "lumen"]) {
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
    bare_name(topic).is_some() && fields == 1 && BARE.iter().any(|f| layout.is_number(f))
}

pub fn matches_fields(layout: &Layout, topic: &str) -> bool {
    let found =
        SETTINGS.iter().filter(|(_, fields)| fields.iter().any(|f| layout.is_number(f))).count();
    found >= 2 || (found == 1 && bare_name(topic).is_some())
}

/// Settings by name; a bare number is named after its topic by the caller.
pub fn decode(value: &Value<'_>) -> Result<Vec<RadiometrySetting>, String> {
    if let Some(bare) = BARE.iter().find_map(|f| value.number(f)) {
        return Ok(vec![("value", bare)]);
    }
    let named = |(name, fields): &(&'static str, &[&str])| {
        Some((*name, fields.iter().find_map(|f| value.number(f))?))
    };
    Ok(SETTINGS.iter().filter_map(named).collect())
}
