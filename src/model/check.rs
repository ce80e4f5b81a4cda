//! Whether the numbers of a `model.json` can be those of a model: their count per band, and limits.
//!
//! JSON has no NaN and no infinity, so what is left are lists of another length, signs and sizes
//! that make no light. A sentence names the key and what it needs.

use super::{
    AttenuationOverTime, BackscatterFile, CameraFile, DaylightFile, FrameGainFile, GeometryFile,
    LightSettingFile, ModelFile, RenderingFile, StrobeFile, TiltsFile,
};
use crate::vehicle::MAX_LAMPS;

/// What a number must be: least, largest, and the same in words.
type Limits = (f64, f64, &'static str);

const FINITE: Limits = (f64::MIN, f64::MAX, "finite numbers");
const NOT_NEGATIVE: Limits = (0.0, f64::MAX, "numbers of 0 or more");
const POSITIVE: Limits = (f64::MIN_POSITIVE, f64::MAX, "numbers above 0");
/// No water takes more light (1/m); red in the open sea 0.5, in a harbour 5.
const ATTENUATION: Limits = (-50.0, 50.0, "attenuations of water, −50 to 50 per metre");
const SPREADING: Limits = (-10.0, 10.0, "exponents from −10 to 10");
/// Light beyond e^±50 is none, or more than a sun.
const LOG_LIGHT: Limits = (-50.0, 50.0, "logarithms from −50 to 50");
const BLACK_LEVEL: Limits = (0.0, 0.9, "shares of full scale from 0 to 0.9");
const DIRECTION: Limits = (-180.0, 180.0, "angles from −180° to 180°");
const ALTITUDE_FACTOR: Limits = (0.1, 10.0, "factors from 0.1 to 10");
const TILT: Limits = (-90.0, 90.0, "angles from −90° to 90°");
/// As in the TF tree.
const WITHIN_VEHICLE: Limits = (-50.0, 50.0, "lengths within 50 m");
/// A quaternion of another length is none.
const QUATERNION_NORM: (f64, f64) = (0.99, 1.01);

impl ModelFile {
    /// Whether all numbers are possible.
    ///
    /// # Errors
    /// A sentence about the first that is not.
    pub(super) fn check(&self) -> Result<(), String> {
        let bands = self.attenuation_per_m.len();
        if !matches!(bands, 1 | 3) {
            return Err(format!("attenuation_per_m has {bands} numbers; a model has 1 band or 3"));
        }
        of_bands("attenuation_per_m", &self.attenuation_per_m, bands, ATTENUATION)?;
        let std: Vec<f64> = self.attenuation_std_per_m.iter().map(|s| s.unwrap_or(0.0)).collect();
        of_bands("attenuation_std_per_m", &std, bands, NOT_NEGATIVE)?;
        let exponents = self.spreading_exponents.unwrap_or_default();
        within("spreading_exponents", &exponents, SPREADING)?;
        within("beam_pattern.theta_deg", &self.beam_pattern.theta_deg, DIRECTION)?;
        let seen = self.beam_pattern.log_gain.iter().flatten().flatten();
        within("beam_pattern.log_gain", &seen.copied().collect::<Vec<f64>>(), LOG_LIGHT)?;
        rendering(&self.rendering, bands)?;
        self.strobe.as_ref().map_or(Ok(()), strobe)?;
        self.geometry.as_ref().map_or(Ok(()), geometry)?;
        self.camera.as_ref().map_or(Ok(()), |c| camera(c, bands))?;
        self.backscatter.as_ref().map_or(Ok(()), |b| backscatter(b, bands))?;
        self.daylight.as_ref().map_or(Ok(()), |d| daylight(d, bands))?;
        self.tilts.as_ref().map_or(Ok(()), tilts)?;
        segments(&self.segments, bands)?;
        let unlit: Vec<f64> = self.inputs.iter().filter_map(|input| input.unlit_below).collect();
        within("inputs.unlit_below", &unlit, POSITIVE)?;
        self.light_settings.iter().try_for_each(light_setting)?;
        self.frame_gains.iter().try_for_each(frame_gain)
    }
}

/// A list of one number per band.
fn of_bands(key: &str, values: &[f64], bands: usize, limits: Limits) -> Result<(), String> {
    if values.len() == bands {
        return within(key, values, limits);
    }
    Err(format!("{key} has {} numbers, and the model {bands} bands", values.len()))
}

fn within(key: &str, values: &[f64], (from, to, what): Limits) -> Result<(), String> {
    match values.iter().find(|v| !(from..=to).contains(*v)) {
        Some(wrong) => Err(format!("{key} needs {what}; it has {wrong}")),
        None => Ok(()),
    }
}

fn rotation(key: &str, xyzw: &[f64; 4]) -> Result<(), String> {
    let norm = xyzw.iter().map(|v| v * v).sum::<f64>().sqrt();
    let (from, to) = QUATERNION_NORM;
    if (from..=to).contains(&norm) {
        return Ok(());
    }
    Err(format!("{key} needs a quaternion of length 1; that of {xyzw:?} is {norm}"))
}

fn rendering(file: &RenderingFile, bands: usize) -> Result<(), String> {
    of_bands("rendering.gain", &file.gain, bands, POSITIVE)?;
    of_bands("rendering.median_correction", &file.median_correction, bands, POSITIVE)?;
    // Absent in models of earlier versions.
    if !file.median_reflectance.is_empty() {
        of_bands("rendering.median_reflectance", &file.median_reflectance, bands, NOT_NEGATIVE)?;
    }
    let shoulder = file.shoulder_from.into_iter().collect::<Vec<_>>();
    within("rendering.shoulder_from", &shoulder, POSITIVE)?;
    if file.white_level == Some(0) {
        return Err("rendering.white_level needs a pixel value above 0".into());
    }
    Ok(())
}

fn strobe(file: &StrobeFile) -> Result<(), String> {
    within("strobe.position_in_optical_m", &file.position_in_optical_m, WITHIN_VEHICLE)?;
    rotation("strobe.rotation_xyzw", &file.rotation_xyzw)?;
    if file.lamps.len() > MAX_LAMPS {
        return Err(format!("strobe.lamps has {} lamps, more than {MAX_LAMPS}", file.lamps.len()));
    }
    for lamp in &file.lamps {
        within("strobe.lamps.offset_m", &lamp.offset_m, WITHIN_VEHICLE)?;
        rotation("strobe.lamps.rotation_xyzw", &lamp.rotation_xyzw)?;
        within("strobe.lamps.share", &[lamp.share], POSITIVE)?;
    }
    Ok(())
}

fn geometry(file: &GeometryFile) -> Result<(), String> {
    let turned = file.dvl_rotation_xyzw.as_ref();
    turned.map_or(Ok(()), |xyzw| rotation("geometry.dvl_rotation_xyzw", xyzw))
}

fn camera(file: &CameraFile, bands: usize) -> Result<(), String> {
    if let Some(level) = &file.black_level {
        of_bands("camera.black_level", level, bands, BLACK_LEVEL)?;
    }
    if let Some(vignetting) = &file.vignetting {
        within("camera.vignetting.coefficients", &vignetting.coefficients, LOG_LIGHT)?;
    }
    if let Some(law) = &file.gain_law {
        of_bands("camera.gain_law.log_level", &law.log_level, bands, LOG_LIGHT)?;
        let strengths = [law.exposure, law.white_balance];
        within("camera.gain_law.exposure and white_balance", &strengths, LOG_LIGHT)?;
    }
    file.response_table().map(drop).map_err(|reason| format!("camera.response: {reason}"))
}

fn backscatter(file: &BackscatterFile, bands: usize) -> Result<(), String> {
    let BackscatterFile { strength_per_m, strength_std_per_m, attenuation_per_m, .. } = file;
    of_bands("backscatter.strength_per_m", strength_per_m, bands, NOT_NEGATIVE)?;
    of_bands("backscatter.strength_std_per_m", strength_std_per_m, bands, NOT_NEGATIVE)?;
    of_bands("backscatter.attenuation_per_m", attenuation_per_m, bands, ATTENUATION)?;
    of_bands("backscatter.median_share", &file.median_share, bands, FINITE)
}

fn daylight(file: &DaylightFile, bands: usize) -> Result<(), String> {
    of_bands("daylight.strength", &file.strength, bands, NOT_NEGATIVE)?;
    of_bands("daylight.strength_std", &file.strength_std, bands, NOT_NEGATIVE)?;
    of_bands("daylight.median_share", &file.median_share, bands, FINITE)
}

fn tilts(file: &TiltsFile) -> Result<(), String> {
    within("tilts.median_deg", &file.median_deg, TILT)?;
    file.frames.iter().try_for_each(|f| {
        within("tilts.frames.tilt_deg", &f.tilt_deg, TILT)?;
        within("tilts.frames.altitude_factor", &[f.altitude_factor], ALTITUDE_FACTOR)
    })
}

fn segments(over_time: &AttenuationOverTime, bands: usize) -> Result<(), String> {
    for node in &over_time.0 {
        let (alpha, std) = (&node.attenuation_per_m, &node.attenuation_std_per_m);
        of_bands("segments.attenuation_per_m", alpha, bands, ATTENUATION)?;
        of_bands("segments.attenuation_std_per_m", std, bands, NOT_NEGATIVE)?;
    }
    if over_time.0.windows(2).any(|pair| pair[0].stamp_ns >= pair[1].stamp_ns) {
        return Err("segments.stamp_ns needs times that increase".into());
    }
    Ok(())
}

fn light_setting(file: &LightSettingFile) -> Result<(), String> {
    if file.law.log_light(file.reference).is_some() {
        return Ok(());
    }
    Err(format!("light_settings.reference of {} is {}: no light", file.name, file.reference))
}

fn frame_gain(file: &FrameGainFile) -> Result<(), String> {
    within("frame_gains.gain", &[file.gain], POSITIVE)?;
    within("frame_gains.balance", &file.balance.unwrap_or([1.0; 3]), POSITIVE)?;
    within("frame_gains.range_factor", &[file.range_factor], POSITIVE)?;
    within("frame_gains.range_tilt", &file.range_tilt, LOG_LIGHT)
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;

    /// The model of the examples with a part changed or added; why it is refused.
    fn refusal(pointer: &str, value: Value) -> Option<String> {
        let text = include_str!("../../examples/model.json");
        let mut document: Value = serde_json::from_str(text).expect("JSON");
        if let Some(part) = document.pointer_mut(pointer) {
            *part = value;
        } else {
            document[pointer.trim_start_matches('/')] = value;
        }
        ModelFile::from_json(&document.to_string()).err()
    }

    #[test]
    fn impossible_numbers_are_refused_by_name() {
        let daylight = |strength: Value| {
            let three = [0.1, 0.1, 0.1];
            let (median_share, held_out_improvement) = (three, 0.2);
            json!({ "strength": strength, "strength_std": three, "median_share": median_share,
                    "held_out_improvement": held_out_improvement })
        };
        let backscatter = |strength: Value| {
            let three = [0.1, 0.1, 0.1];
            json!({ "strength_per_m": strength, "strength_std_per_m": three,
                    "attenuation_per_m": three, "shape": [1.0, 0.5], "median_share": three,
                    "held_out_improvement": 0.2 })
        };
        let node = |stamp_ns: i64, alpha: f64| {
            json!({ "stamp_ns": stamp_ns, "attenuation_per_m": [alpha, alpha, alpha],
                    "attenuation_std_per_m": [0.0, 0.0, 0.0] })
        };
        let strobe = |at: [f64; 3], w: f64| {
            json!({ "position_in_optical_m": at, "rotation_xyzw": [0.0, 0.0, 0.0, w],
                    "source": "found" })
        };
        assert_eq!(refusal("/strobe", strobe([0.5, 0.0, 0.0], 1.0)), None);
        assert_eq!(refusal("/daylight", daylight(json!([0.1, 0.0, 0.3]))), None);
        assert_eq!(refusal("/backscatter", backscatter(json!([0.1, 0.0, 0.3]))), None);
        assert_eq!(refusal("/segments", json!([node(1, 0.2), node(2, 0.3)])), None);
        let input = json!({ "name": "a.mcap", "sha256": "", "camera_topic": "/camera",
                            "dvl_topic": "/dvl", "frames": 20, "unlit_below": -0.1 });
        let cases = [
            ("/daylight", daylight(json!([0.1])), "daylight.strength has 1 numbers"),
            (
                "/daylight",
                daylight(json!([0.1, -1.0, 0.1])),
                "daylight.strength needs numbers of 0",
            ),
            ("/backscatter", backscatter(json!([])), "backscatter.strength_per_m has 0"),
            ("/segments", json!([node(1, 90.0)]), "segments.attenuation_per_m needs"),
            ("/segments", json!([node(2, 0.2), node(2, 0.3)]), "segments.stamp_ns"),
            ("/attenuation_per_m", json!([0.1, 0.2]), "attenuation_per_m has 2"),
            ("/attenuation_per_m", json!([0.1, 0.2, 51.0]), "attenuation_per_m needs"),
            ("/attenuation_std_per_m", json!([null, 0.1]), "attenuation_std_per_m has 2"),
            ("/rendering/gain", json!([1.0, 0.0, 1.0]), "rendering.gain needs numbers above 0"),
            ("/rendering/white_level", json!(0), "rendering.white_level"),
            ("/spreading_exponents", json!([2.0, 300.0]), "spreading_exponents"),
            ("/beam_pattern/log_gain/0/0", json!(900.0), "beam_pattern.log_gain"),
            ("/strobe", strobe([0.0, 0.0, 0.0], 0.0), "strobe.rotation_xyzw needs a quaternion"),
            ("/strobe", strobe([0.0, 0.0, 700.0], 1.0), "strobe.position_in_optical_m needs"),
            ("/camera", json!({ "black_level": [0.1], "residual": [0.0, 0.0] }), "camera.black"),
            ("/geometry", json!({ "dvl_rotation_xyzw": [1, 1, 1, 1] }), "geometry.dvl_rotation"),
            ("/tilts", json!({ "median_deg": [0.0, 95.0], "frames": [] }), "tilts.median_deg"),
            ("/inputs", json!([input]), "inputs.unlit_below needs numbers above 0"),
            ("/frame_gains", json!([{ "stamp_ns": 1, "gain": 0.0 }]), "frame_gains.gain"),
        ];
        for (pointer, value, expected) in cases {
            let refused = refusal(pointer, value).unwrap_or_default();
            assert!(refused.starts_with(expected), "{expected}: {refused:?}");
        }
        let law = json!([{ "topic": "/s", "name": "gain", "law": "factor", "reference": 0.0 }]);
        let refused = refusal("/light_settings", law).expect("no light");
        assert!(refused.contains("of gain is 0: no light"), "{refused}");
    }
}
