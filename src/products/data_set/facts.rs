//! Facts that no log contains: fields of the iFDO header, from a TOML file.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json};

use crate::toml_file;

/// A person, a project, a licence.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Named {
    /// as people write it
    pub name: String,
    /// of a page about it
    #[serde(skip_serializing_if = "Option::is_none")]
    pub uri: Option<String>,
}

/// A group of fields that is copied as it is.
type Group = BTreeMap<String, Json>;

macro_rules! fields {
    ($($(#[$about:meta])* $name:ident: $type:ty,)*) => {
        /// Fields of the iFDO header, by its names in kebab case.
        #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
        #[serde(default, rename_all = "kebab-case")]
        pub struct Facts {
            $($(#[$about])* #[serde(skip_serializing_if = "Option::is_none")]
            pub $name: Option<$type>,)*
        }
    };
}

fields! {
    /// name of the image set
    image_set_name: String,
    /// a page about the image set
    image_set_handle: String,
    /// project around the project
    image_context: Named,
    /// project, expedition or cruise
    image_project: Named,
    /// station, dive
    image_event: Named,
    /// vehicle
    image_platform: Named,
    /// camera
    image_sensor: Named,
    /// principal investigator
    image_pi: Named,
    /// all who took part
    image_creators: Vec<Named>,
    /// licence
    image_license: Named,
    /// statement, person or office
    image_copyright: String,
    /// what, when, where, why and how
    image_abstract: String,
    /// of a typical image (deg)
    image_latitude: f64,
    /// of a typical image (deg)
    image_longitude: f64,
    /// of a typical image, negative below the sea surface (m)
    image_altitude_meters: f64,
    /// as `EPSG:4326`
    image_coordinate_reference_system: String,
    /// of all positions (m)
    image_coordinate_uncertainty_meters: f64,
    /// mapping, stationary, survey, exploration, experiment or sampling
    image_deployment: String,
    /// satellite, beacon, transponder or reconstructed
    image_navigation: String,
    /// 3D camera, calibrated camera, laser marker or optical flow
    image_scale_reference: String,
    /// order of magnitude of a pixel
    image_pixel_magnitude: String,
    /// timer, manual or mixed
    image_capture_mode: String,
    /// none, baited or light
    image_fauna_attraction: String,
    /// of camera and lens
    image_acquisition_settings: Group,
    /// of the housing
    image_camera_housing_viewport: Group,
    /// of a flat port
    image_flatport_parameters: Group,
    /// of a dome port
    image_domeport_parameters: Group,
    /// aims of the study
    image_objective: String,
    /// habitat
    image_target_environment: String,
    /// period
    image_target_timescale: String,
    /// extent of the area
    image_spatial_constraints: String,
    /// extent in time
    image_temporal_constraints: String,
    /// of the camera's clock
    image_time_synchronisation: String,
    /// how file names are made
    image_item_identification_scheme: String,
    /// turbidity, blocked view
    image_visual_constraints: String,
}

/// Values that iFDO allows for a field.
const ALLOWED: [(&str, &[&str]); 6] = [
    (
        "image-deployment",
        &["mapping", "stationary", "survey", "exploration", "experiment", "sampling"],
    ),
    ("image-navigation", &["satellite", "beacon", "transponder", "reconstructed"]),
    ("image-scale-reference", &["3D camera", "calibrated camera", "laser marker", "optical flow"]),
    ("image-pixel-magnitude", &["km", "hm", "dam", "m", "cm", "mm", "µm"]),
    ("image-capture-mode", &["timer", "manual", "mixed"]),
    ("image-fauna-attraction", &["none", "baited", "light"]),
];

/// Ranges that iFDO allows for a number.
const RANGES: [(&str, [f64; 2]); 3] = [
    ("image-latitude", [-90.0, 90.0]),
    ("image-longitude", [-180.0, 180.0]),
    ("image-coordinate-uncertainty-meters", [0.0, f64::MAX]),
];

impl Facts {
    /// Reads a file of facts.
    ///
    /// # Errors
    /// A sentence: which key is unknown or has a value that iFDO does not allow.
    pub fn from_toml(text: &str) -> Result<Self, String> {
        let facts: Self = toml_file::parse(text)?;
        let fields = facts.fields();
        for (key, allowed) in ALLOWED {
            let value = fields.get(key).and_then(Json::as_str);
            if let Some(value) = value.filter(|v| !allowed.contains(v)) {
                let allowed = allowed.join(", ");
                return Err(format!("`{key}` is \"{value}\"; iFDO allows {allowed}"));
            }
        }
        for (key, [low, high]) in RANGES {
            let value = fields.get(key).and_then(Json::as_f64);
            if let Some(value) = value.filter(|v| !(low..=high).contains(v)) {
                return Err(format!("`{key}` is {value}, which iFDO does not allow"));
            }
        }
        let names = fields.iter().filter(|(_, value)| value.is_object() || value.is_array());
        for (key, value) in names {
            let all = value.as_array().map_or_else(|| vec![value], |list| list.iter().collect());
            if all.iter().any(|v| v.get("name").is_some_and(|name| name == "")) {
                return Err(format!("`{key}` needs a name"));
            }
        }
        Ok(facts)
    }

    /// The fields that are given.
    pub fn fields(&self) -> Map<String, Json> {
        match serde_json::to_value(self) {
            Ok(Json::Object(fields)) => fields,
            _ => Map::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn facts_that_ifdo_does_not_know_are_named() {
        let facts = Facts::from_toml(
            "image-pi = { name = \"A\" }\nimage-acquisition-settings = { ISO = 100 }\n",
        );
        let facts = facts.expect("facts");
        assert_eq!(facts.fields()["image-acquisition-settings"]["ISO"], 100);
        for (text, word) in [
            ("image-licence = { name = \"CC0\" }", "image-license"),
            ("image-pi = \"A\"", "invalid type"),
            ("image-pi = { uri = \"https://a\" }", "name"),
            ("image-deployment = \"dive\"", "survey"),
            ("image-latitude = 91.0", "does not allow"),
        ] {
            let error = Facts::from_toml(text).expect_err(text);
            assert!(error.contains(word), "{text}: {error}");
        }
    }
}
