//! Reading and validation of rig files: implausible values are rejected with their key.

use super::{DvlFacts, JanusArray, LampFacts, MountFacts, RigFile};
use crate::toml_file;

/// Larger than any vehicle; a larger translation was probably meant in millimetres (m).
const MAX_TRANSLATION_M: f64 = 50.0;

impl RigFile {
    /// Reads a rig file's text.
    ///
    /// # Errors
    /// The key and the reason; an unknown key names the nearest known one.
    pub fn from_toml(text: &str) -> Result<Self, String> {
        let rig: Self = toml_file::parse(text)?;
        rig.ensure_valid()?;
        Ok(rig)
    }

    /// Checks ranges of values and keys that exclude or require each other.
    ///
    /// # Errors
    /// The key and the reason.
    pub fn ensure_valid(&self) -> Result<(), String> {
        if let Some(key) = toml::Value::try_from(self).ok().and_then(|facts| not_finite(&facts)) {
            return Err(format!("{key} is not a finite number"));
        }
        let Self { camera, dvl, strobe, .. } = self;
        let is_positive = |value: Option<f64>| value.is_none_or(|v| v > 0.0);
        let checks = [
            (
                camera.width != Some(0) && camera.height != Some(0),
                "camera.width and camera.height must be above 0",
            ),
            (
                is_positive(camera.fx) && is_positive(camera.fy),
                "camera.fx and camera.fy must be above 0",
            ),
            (camera.fx.is_some() || camera.fy.is_none(), "camera.fy needs camera.fx"),
            (
                camera.horizontal_field_of_view_deg.is_none_or(|a| (1.0..179.0).contains(&a)),
                "camera.horizontal_field_of_view_deg must lie in 1 to 179",
            ),
            (
                camera.black_level.is_none_or(|l| l.bands().iter().all(|b| (0.0..0.5).contains(b))),
                "camera.black_level is a share of full scale, from 0 to below 0.5",
            ),
            (is_positive(camera.full_well_e), "camera.full_well_e must be above 0"),
            (
                camera.read_noise_e.is_none_or(|e| e >= 0.0),
                "camera.read_noise_e must not be below 0",
            ),
            (
                strobe.mount.is_none() || strobe.lamps.is_none(),
                "strobe.mount and strobe.lamps are mutually exclusive",
            ),
        ];
        let dvl_checks = dvl_checks(dvl);
        if let Some((_, reason)) = checks.iter().chain(&dvl_checks).find(|(ok, _)| !ok) {
            return Err((*reason).into());
        }
        if let Some(name) = dvl.beams.as_ref().filter(|name| JanusArray::named(name).is_none()) {
            let known: Vec<&str> = JanusArray::KNOWN.iter().map(|(name, ..)| *name).collect();
            return Err(format!("dvl.beams = {name:?} is not one of {}", known.join(", ")));
        }
        let mounts = [("camera", &camera.mount), ("dvl", &dvl.mount), ("strobe", &strobe.mount)];
        mounts.iter().try_for_each(|(of, mount)| {
            mount.as_ref().map_or(Ok(()), |m| ensure_plausible(&format!("{of}.mount"), m))
        })?;
        let lamps = strobe.lamps.iter().flatten();
        lamps.map(LampFacts::facts).try_for_each(|mount| ensure_plausible("strobe.lamps", &mount))
    }
}

fn dvl_checks(dvl: &DvlFacts) -> [(bool, &'static str); 8] {
    let in_order = dvl.min_range_m.zip(dvl.max_range_m).is_none_or(|(min, max)| min < max);
    [
        (
            dvl.janus_angle_deg.is_some() == dvl.azimuths_deg.is_some(),
            "dvl.janus_angle_deg and dvl.azimuths_deg need each other",
        ),
        (
            dvl.janus_angle_deg.is_none_or(|a| (1.0..80.0).contains(&a)),
            "dvl.janus_angle_deg must lie in 1 to 80",
        ),
        (
            dvl.azimuths_deg.as_ref().is_none_or(|a| a.len() >= 3),
            "dvl.azimuths_deg must have 3 values or more",
        ),
        (
            dvl.beams.is_none() || dvl.azimuths_deg.is_none(),
            "dvl.beams and dvl.azimuths_deg are mutually exclusive",
        ),
        (
            dvl.sound_speed_ratio.is_none_or(|r| (0.8..1.25).contains(&r)),
            "dvl.sound_speed_ratio must lie in 0.8 to 1.25: it is the actual speed of sound \
             divided by the one configured in the instrument",
        ),
        (in_order, "dvl.min_range_m must be below dvl.max_range_m"),
        (dvl.unit_m.is_none_or(|u| u > 0.0), "dvl.unit_m must be above 0"),
        (
            dvl.topic.is_some() || (dvl.path.is_none() && dvl.valid_path.is_none()),
            "dvl.path needs dvl.topic",
        ),
    ]
}

fn ensure_plausible(key: &str, mount: &MountFacts) -> Result<(), String> {
    if let Some(t) = mount.translation_m.iter().find(|t| t.abs() > MAX_TRANSLATION_M) {
        return Err(format!("{key}.translation_m is in metres; {t} m is larger than any vehicle"));
    }
    let is_unit = mount
        .rotation_xyzw
        .is_none_or(|q| (0.9..1.1).contains(&q.iter().map(|v| v * v).sum::<f64>().sqrt()));
    if is_unit {
        Ok(())
    } else {
        Err(format!("{key}.rotation_xyzw is not a unit quaternion x, y, z, w"))
    }
}

/// Key of the first number that is not finite.
fn not_finite(facts: &toml::Value) -> Option<String> {
    let below = |key: String, facts: &toml::Value| {
        not_finite(facts).map(|rest| if rest.is_empty() { key } else { format!("{key}.{rest}") })
    };
    match facts {
        toml::Value::Float(number) => (!number.is_finite()).then(String::new),
        toml::Value::Array(list) => list.iter().find_map(not_finite),
        toml::Value::Table(table) => {
            table.iter().find_map(|(key, facts)| below(key.clone(), facts))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unknown_key_names_its_neighbour() {
        for (text, nearest) in [
            ("[[strobe.lamps]]\nstrenght = 1.0", "strobe.lamps.strength"),
            ("[strobe]\nlamp = []", "strobe.lamps"),
            ("[dvl.mount]\ntranslation = [0.0, 0.0, 0.0]", "dvl.mount.translation_m"),
        ] {
            let error = RigFile::from_toml(text).expect_err(text);
            assert!(error.contains(&format!("did you mean `{nearest}`")), "{error}");
        }
    }

    #[test]
    fn implausible_values_are_rejected_with_their_key() {
        let check = |text: &str| toml::from_str::<RigFile>(text).expect("TOML").ensure_valid();
        assert_eq!(
            check(
                "[camera]\nfx = 695.0\n[dvl]\nbeams = \
                 \"waterlinked-a50\"\n[strobe.mount]\ntranslation_m = [-0.5, 0.0, \
                 0.0]\nrotation_xyzw = [0.0, 0.0, 0.0, 1.0]"
            ),
            Ok(())
        );
        for (text, key) in [
            ("[camera]\nfx = nan", "camera.fx"),
            ("[camera]\nfx = -5.0", "camera.fx"),
            ("[camera]\nvignetting = [nan, 0.0, 0.0]", "camera.vignetting"),
            (
                "[camera]\nhorizontal_field_of_view_deg = 200.0",
                "camera.horizontal_field_of_view_deg",
            ),
            ("[dvl]\nsound_speed_ratio = 1500.0", "dvl.sound_speed_ratio"),
            ("[dvl]\nbeams = \"waterlinked-a5\"", "waterlinked-a50"),
            (
                "[dvl]\njanus_angle_deg = -30.0\nazimuths_deg = [0.0, 120.0, 240.0]",
                "dvl.janus_angle_deg",
            ),
            ("[dvl]\npath = \"ranges\"", "dvl.topic"),
            (
                "[strobe.mount]\ntranslation_m = [-550.0, 0.0, 0.0]\nroll_pitch_yaw_deg = [180.0, \
                 0.0, 0.0]",
                "strobe.mount.translation_m",
            ),
            (
                "[camera.mount]\ntranslation_m = [0.0, 0.0, 0.0]\nrotation_xyzw = [0.0, 0.0, 0.0, \
                 0.0]",
                "camera.mount.rotation_xyzw",
            ),
            ("[[strobe.lamps]]\ntranslation_m = [0.0, inf, 0.0]", "strobe.lamps"),
            ("[time_offset_s]\n\"/dvl/data\" = nan", "time_offset_s./dvl/data"),
        ] {
            let error = check(text).expect_err(text);
            assert!(error.contains(key), "{text}: {error}");
        }
    }
}
