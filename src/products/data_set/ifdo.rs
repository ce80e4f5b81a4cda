//! The iFDO record (image FAIR digital object, version 2.2.1; valid against 2.0 to 2.2.1).

use serde_json::{Map, Value as Json, json};

use super::super::dive::CameraLog;
use super::facts::Facts;
use super::poses::CameraPoses;
use super::still::{Still, millimetres, utc, uuid};
use crate::image::Bands;
use crate::model::ModelFile;
use crate::vehicle::Distortion;

/// Version of the standard.
const VERSION: &str = "v2.2.1";
/// Its schema.
const SCHEMA: &str = "http://hdl.handle.net/20.500.12085/22aba7d7-c432-49ab-bebe-ee8ed4f70150";

/// Fields of the header that iFDO requires.
pub const REQUIRED: &[&str] = &[
    "image-set-name",
    "image-set-uuid",
    "image-set-handle",
    "image-set-ifdo-version",
    "image-datetime",
    "image-latitude",
    "image-longitude",
    "image-altitude-meters",
    "image-coordinate-reference-system",
    "image-coordinate-uncertainty-meters",
    "image-context",
    "image-project",
    "image-event",
    "image-platform",
    "image-sensor",
    "image-pi",
    "image-creators",
    "image-license",
    "image-copyright",
    "image-abstract",
];

/// What the record is made of.
pub struct Record<'r> {
    /// the camera
    pub camera: &'r CameraLog,
    /// name of the log, without its ending
    pub name: String,
    /// fingerprint of the raw log
    pub source: String,
    /// name of the camera
    pub sensor: &'r str,
    /// facts that no log contains
    pub facts: &'r Facts,
    /// where the files will be: `PREFIX/UUID`
    pub handle_prefix: Option<&'r str>,
    /// calibration and poses
    pub poses: Option<&'r CameraPoses>,
}

impl Record<'_> {
    /// The header.
    pub fn header(&self, stills: &[Still<'_>]) -> Map<String, Json> {
        let Self { camera, name, source, sensor, facts, .. } = self;
        let id = uuid(&format!("{source} {}", camera.fact("camera_topic")));
        let report = &camera.report;
        let protocol =
            format!("unwater {}: method {}, from {}", report.version, report.method, report.source);
        let mut header = Map::new();
        let mut set = |key: &str, value: Json| header.insert(key.into(), value);
        set("image-set-name", json!(name));
        if let Some(prefix) = self.handle_prefix {
            set("image-set-handle", json!(handle(prefix, &id)));
        }
        set("image-set-uuid", json!(id));
        set("image-set-ifdo-version", json!(VERSION));
        set("image-set-local-path", json!("images"));
        set("image-sensor", json!({ "name": sensor }));
        set("image-acquisition", json!("photo"));
        set("image-quality", json!("product"));
        set("image-illumination", json!(Illumination::of(&camera.model).of_set));
        set("image-marine-zone", json!("seafloor"));
        let bands = camera.model.attenuation_per_m.len();
        set("image-spectral-resolution", json!(if bands == 1 { "grayscale" } else { "rgb" }));
        set("image-photometric-calibration", photometry(&camera.model));
        if let Some(calibration) = self.poses.and_then(calibration) {
            set("image-camera-calibration-model", calibration);
        }
        set("image-curation-protocol", json!(protocol));
        if let Some(first) = stills.first() {
            set("image-datetime", json!(utc(first.record.stamp)));
        }
        if let Some(fix) = stills.iter().find_map(|s| s.fix) {
            set("image-latitude", json!(fix.latitude));
            set("image-longitude", json!(within_half_turn(fix.longitude)));
            set("image-coordinate-reference-system", json!("EPSG:4326"));
        }
        if let Some(depth_m) = stills.iter().find_map(|s| s.depth_m) {
            set("image-altitude-meters", json!(-millimetres(depth_m)));
        }
        header.extend(facts.fields());
        header
    }

    /// Required fields that neither log nor facts give.
    pub fn missing(&self, header: &Map<String, Json>) -> Vec<&'static str> {
        let of_header = REQUIRED.iter().filter(|key| !header.contains_key(**key)).copied();
        of_header.chain(self.handle_prefix.is_none().then_some("image-handle")).collect()
    }

    /// Header and items.
    pub fn document(&self, header: Map<String, Json>, stills: &[Still<'_>]) -> Json {
        let items: Map<String, Json> =
            stills.iter().map(|still| (still.name.clone(), self.item(still))).collect();
        json!({ "$schema": SCHEMA, "image-set-header": header, "image-set-items": items })
    }

    fn item(&self, still: &Still<'_>) -> Json {
        let mut item = json!({
            "image-datetime": utc(still.record.stamp),
            "image-uuid": still.uuid,
            "image-hash-sha256": still.hash,
        });
        if let Some(prefix) = self.handle_prefix {
            item["image-handle"] = json!(handle(prefix, &still.uuid));
        }
        if still.record.altitude_m.is_finite() {
            item["image-meters-above-ground"] = json!(millimetres(still.record.altitude_m));
        }
        if let Some(fix) = still.fix {
            item["image-latitude"] = json!(fix.latitude);
            item["image-longitude"] = json!(within_half_turn(fix.longitude));
        }
        if let Some(depth_m) = still.depth_m {
            item["image-altitude-meters"] = json!(-millimetres(depth_m));
        }
        if let Some(angles) = still.yaw_pitch_roll_deg() {
            for (name, angle) in ["yaw", "pitch", "roll"].iter().zip(angles) {
                item[format!("image-camera-{name}-degrees")] = json!(millimetres(angle));
            }
        }
        item
    }
}

fn handle(prefix: &str, id: &str) -> String {
    format!("{}/{id}", prefix.trim_end_matches('/'))
}

/// From −180° to 180°.
fn within_half_turn(longitude: f64) -> f64 {
    if longitude.abs() > 180.0 { longitude - 360.0 * longitude.signum() } else { longitude }
}

/// What lit the seafloor, in the words of the standard.
struct Illumination {
    of_set: &'static str,
    of_sequence: &'static str,
    description: &'static str,
}

impl Illumination {
    fn of(model: &ModelFile) -> Self {
        if model.daylight.is_some() {
            Self {
                of_set: "mixed light",
                of_sequence: "mixed",
                description: "strobe of the vehicle, and daylight; beam pattern and strength of \
                              daylight are in model.json",
            }
        } else {
            Self {
                of_set: "artificial light",
                of_sequence: "constant artificial",
                description: "strobe of the vehicle; its beam pattern is in model.json",
            }
        }
    }
}

/// All fields of the photometric calibration.
fn photometry(model: &ModelFile) -> Json {
    let known = if model.identified {
        "identified from this log"
    } else {
        "not identified: of this dive alone"
    };
    let water = format!(
        "{} attenuation coefficients in 1/m (red, green, blue): {}; {known}; see model.json",
        model.attenuation_kind.word(),
        model.attenuation_text(),
    );
    let gain = |band: usize| model.rendering.gain.get(band).or(model.rendering.gain.first());
    let gains: Bands = std::array::from_fn(|band| gain(band).copied().unwrap_or(1.0));
    let (lights, illumination) = ([1.0; 3], Illumination::of(model));
    // The standard has RGB in capitals; its Python package (ifdo 1.6) reads these two in small
    // letters only.
    json!({
        "photometric-sequence-white-balancing":
            "one factor per band for the whole image set, in linear light",
        "photometric-exposure-factor-RGB": gains,
        "photometric-exposure-factor-rgb": gains,
        "photometric-sequence-illumination-type": illumination.of_sequence,
        "photometric-sequence-illumination-description": illumination.description,
        "photometric-illumination-factor-RGB": lights,
        "photometric-illumination-factor-rgb": lights,
        "photometric-water-properties-description": water,
    })
}

/// All fields of the calibration; `None` for lenses that iFDO has no model of.
fn calibration(poses: &CameraPoses) -> Option<Json> {
    let camera = &poses.camera;
    let (kind, coefficients) = match camera.distortion {
        Distortion::None => ("rectilinear water", Vec::new()),
        Distortion::PlumbBob(d) => ("rectilinear water", d.to_vec()),
        Distortion::RationalPolynomial(d) => ("rectilinear water", d.to_vec()),
        Distortion::Equidistant(d) => ("fisheye water", d.to_vec()),
        Distortion::Fisheye62(_) | Distortion::FlatPort { .. } => return None,
    };
    let angle = |size: usize, f: f64| 2.0 * (size as f64 / 2.0 / f).atan().to_degrees();
    Some(json!({
        "calibration-model-type": kind,
        "calibration-focal-length-xy-pixel": [camera.fx, camera.fy],
        "calibration-principal-point-xy-pixel": [camera.cx, camera.cy],
        "calibration-distortion-coefficients": coefficients,
        "calibration-approximate-field-of-view-water-xy-degree":
            [angle(camera.width, camera.fx), angle(camera.height, camera.fy)],
        "calibration-model-extra-description":
            format!("for images of {} by {} pixels", camera.width, camera.height),
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::DaylightFile;

    #[test]
    fn daylight_beside_the_strobe_is_mixed_light() {
        let text = include_str!("../../../examples/model.json");
        let mut model = ModelFile::from_json(text).expect("a model");
        let words = |model: &ModelFile| {
            let of_sequence = photometry(model)["photometric-sequence-illumination-type"].clone();
            (Illumination::of(model).of_set, of_sequence)
        };
        assert_eq!(words(&model), ("artificial light", json!("constant artificial")));
        let three = vec![0.1; 3];
        model.daylight = Some(DaylightFile {
            strength: three.clone(),
            strength_std: three.clone(),
            median_share: three,
            held_out_improvement: 0.2,
        });
        assert_eq!(words(&model), ("mixed light", json!("mixed")));
    }
}
