//! `model.json`: an [`ImagingModel`] as a small readable file, with what led to it.
//!
//! One can estimate on one dive and correct another. Keys may be added; those there keep their
//! meaning.

use std::collections::BTreeMap;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::{
    AttenuationOverTime, BackscatterFile, BeamGrid, BeamPattern, CameraFile, DaylightFile,
    EmpiricalModel, FrameGainFile, GeometryFile, ImagingModel, LightSettingFile, RegionLight,
    SpreadingModel, TiltsFile, Verdict,
};
use crate::config::{Estimator, Method, Spreading};
use crate::diagnostics::{self, Diagnostic, NoAnswer, NotIdentified};
use crate::image::tone::ContrastCurve;
use crate::recording::LogIdentity;
use crate::vehicle::StrobeSource;

/// The value of `format`.
pub const FORMAT: &str = "unwater-model";

/// What one estimator answered.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct EstimatorAnswer {
    /// α (1/m) per band; `None` where it could not tell
    pub attenuation_per_m: Option<Vec<f64>>,
    /// standard deviation of it (1/m)
    pub attenuation_std_per_m: Option<Vec<f64>>,
    /// matches, frames or observations it rests on
    pub observations: usize,
    /// robust spread of what is left over (log light)
    pub residual: Option<f64>,
    /// other numbers, by name
    pub details: BTreeMap<String, f64>,
    /// why there is no answer, for people
    pub note: Option<String>,
    /// the same for programs
    #[serde(skip_serializing_if = "Option::is_none")]
    pub no_answer: Option<Diagnostic>,
    /// what single images say (the paper's Fig. 8), a few hundred at most; of `pairs` alone
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub by_image: Vec<ImageAnswer>,
}

impl EstimatorAnswer {
    /// That there is no answer.
    pub fn none(why: NoAnswer) -> Self {
        Self { note: Some(why.to_string()), no_answer: Some(why.into()), ..Self::default() }
    }
}

/// What kind of number an attenuation is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum AttenuationKind {
    /// spreading is modelled: a property of the water
    Physical,
    /// spreading is part of it
    Effective,
}

impl AttenuationKind {
    /// Its name in files.
    pub fn word(self) -> &'static str {
        match self {
            Self::Physical => "physical",
            Self::Effective => "effective",
        }
    }
}

/// What the pairs of one image say.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ImageAnswer {
    /// when it was taken (ns)
    pub stamp_ns: i64,
    /// α (1/m) per band while BP ≈ 1
    pub before_beam_pattern_per_m: Vec<f64>,
    /// α (1/m) per band with the beam pattern known
    pub attenuation_per_m: Vec<f64>,
    /// sum of squared differences of path length: its weight in the mean (m²)
    pub weight_m2: f64,
}

/// The beam pattern's part.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BeamPatternFile {
    /// θ of the rows (deg)
    pub theta_deg: Vec<f64>,
    /// φ of the columns (deg)
    pub phi_deg: Vec<f64>,
    /// natural log of the gain, peak 0, `null` where never seen
    pub log_gain: Vec<Vec<Option<f64>>>,
}

/// Where the strobe was taken to sit; the beam pattern's angles are about its axes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StrobeFile {
    /// place in the camera's optical space (m)
    pub position_in_optical_m: [f64; 3],
    /// turn, optical_from_strobe, as a quaternion x, y, z, w
    pub rotation_xyzw: [f64; 4],
    /// the TF frame or file it came from, or `found`, `refined`, `camera` (nothing better was
    /// known)
    pub source: StrobeSource,
    /// standard deviation of the place along the vehicle's axes, where it was searched for (m)
    pub position_std_m: Option<[f64; 3]>,
    /// from where the search began to where it ended (m)
    pub moved_m: Option<f64>,
    /// the lamps, where there are several; the pose above is then the first's
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lamps: Vec<LampFile>,
}

/// One of several lamps.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LampFile {
    /// place from the first, along its axes (m)
    pub offset_m: [f64; 3],
    /// turn against the first, as a quaternion x, y, z, w
    pub rotation_xyzw: [f64; 4],
    /// share of the light
    pub share: f64,
}

/// How corrected light becomes codes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RenderingFile {
    /// the method it was chosen for
    #[serde(default)]
    pub method: Method,
    /// output = gain × corrected light, per band; exposure and white balance in one
    pub gain: Vec<f64>,
    /// median over the log of the factor each pixel is multiplied by before `gain`, per band
    pub median_correction: Vec<f64>,
    /// median over the log of corrected light before `gain`, per band; the limit of the gain refers
    /// to it. Empty in models of earlier versions
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub median_reflectance: Vec<f64>,
    /// light above this is bent towards white in 8-bit images; cut off at white where absent
    #[serde(default)]
    pub shoulder_from: Option<f64>,
    /// natural look: instead of it
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contrast_curve: Option<ContrastCurve>,
    /// pixel value of full scale of 16-bit images
    pub white_level: Option<u16>,
}

/// A log the model was estimated from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InputFile {
    /// file name
    pub name: String,
    /// SHA-256 of its files; empty where only a window was read
    pub sha256: String,
    /// SHA-256 of its index; empty in models of earlier versions
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub index_sha256: String,
    /// the camera's topic
    pub camera_topic: String,
    /// the range instrument's topic
    pub dvl_topic: String,
    /// frames used
    pub frames: usize,
    /// frames of a smaller mean light (share of full scale) were taken without the strobe, as
    /// every other one
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unlit_below: Option<f64>,
    /// its own attenuation (1/m) per band, where several logs are of different waters
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub attenuation_per_m: Option<Vec<f64>>,
    /// standard deviation of that (1/m)
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub attenuation_std_per_m: Option<Vec<f64>>,
}

/// Values of the bands with their standard deviations.
fn with_std(values: &[f64], std: impl Iterator<Item = Option<f64>>) -> String {
    let text = |(value, std): (&f64, Option<f64>)| match std {
        Some(std) => format!("{value:.4} ± {std:.4}"),
        None => format!("{value:.4} ± ?"),
    };
    values.iter().zip(std).map(text).collect::<Vec<_>>().join(" / ")
}

impl InputFile {
    /// Its own attenuation as text; `None` where the model has one for all logs.
    pub fn attenuation_text(&self) -> Option<String> {
        let (values, std) =
            (self.attenuation_per_m.as_ref()?, self.attenuation_std_per_m.as_ref()?);
        Some(with_std(values, std.iter().copied().map(Some)))
    }

    /// What identifies the log.
    pub fn identity(&self) -> LogIdentity {
        let Self { sha256, index_sha256, .. } = self.clone();
        LogIdentity { sha256, index_sha256 }
    }
}

/// What fits the log's light better than the camera's clock and the range instrument's mount as
/// they were given.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MountCheckFile {
    /// to add to the camera's stamps (s)
    pub clock_offset_s: f64,
    /// its standard deviation (s)
    pub clock_offset_std_s: f64,
    /// turn of the planes about the camera's x and y axes (deg)
    pub turn_deg: [f64; 2],
    /// standard deviations of those (deg)
    pub turn_std_deg: [f64; 2],
    /// residual as given, and with these (log light)
    pub residual: [f64; 2],
}

/// The whole file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModelFile {
    /// always [`FORMAT`]
    pub format: String,
    /// 1
    pub version: u32,
    /// the choice: none, strobe, paper, fit
    pub spreading: Spreading,
    /// p_a and p_s as used
    #[serde(default)]
    pub spreading_exponents: Option<[f64; 2]>,
    /// whether cos γ is modelled
    #[serde(default = "yes")]
    pub incidence: bool,
    /// α (1/m)
    pub attenuation_per_m: Vec<f64>,
    /// its standard deviation (1/m); `null` where the log cannot tell
    pub attenuation_std_per_m: Vec<Option<f64>>,
    /// `physical` where spreading is modelled, else `effective`
    pub attenuation_kind: AttenuationKind,
    /// whether the log can tell
    pub identified: bool,
    /// why not, for people
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub not_identified_because: Option<String>,
    /// the estimator whose answer stands above
    #[serde(default)]
    pub estimator: Estimator,
    /// every estimator's answer
    pub estimators: BTreeMap<Estimator, EstimatorAnswer>,
    /// BP
    pub beam_pattern: BeamPatternFile,
    /// where the light sits
    #[serde(default)]
    pub strobe: Option<StrobeFile>,
    /// what the log says against the camera's clock and the range instrument's mount
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mount_check: Option<MountCheckFile>,
    /// what the log shows of its camera; absent where nothing is out of the ordinary
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<CameraFile>,
    /// clock and mount that are used instead of those given
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub geometry: Option<GeometryFile>,
    /// tilts of planes that were assumed level
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tilts: Option<TiltsFile>,
    /// what the water scatters back; `null` where the log shows none
    #[serde(default)]
    pub backscatter: Option<BackscatterFile>,
    /// daylight on the seafloor; absent where the log shows none
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub daylight: Option<DaylightFile>,
    /// what attenuation and beam pattern leave of the light, where they do not explain it
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub residual_light: Option<RegionLight>,
    /// light by regions of the image, where it corrects held-out frames better than attenuation and
    /// beam pattern
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub empirical: Option<EmpiricalModel>,
    /// how much better than raw the correction is
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub verdict: Option<Verdict>,
    /// frames that got another amount of light (strobe drop-outs); all others have gain 1
    #[serde(default)]
    pub frame_gains: Vec<FrameGainFile>,
    /// settings of camera and strobe that the light of the frames follows; it is taken out
    #[serde(default)]
    pub light_settings: Vec<LightSettingFile>,
    /// diagnostics in sentences, for people
    #[serde(default)]
    pub warnings: Vec<String>,
    /// what the model rests on and why it may be wrong
    #[serde(default)]
    pub diagnostics: Vec<Diagnostic>,
    /// attenuation along the log: linear between these times; empty where it does not change
    #[serde(default)]
    pub segments: AttenuationOverTime,
    /// exposure and white balance
    pub rendering: RenderingFile,
    /// where it came from
    pub inputs: Vec<InputFile>,
}

fn yes() -> bool {
    true
}

impl BeamPatternFile {
    /// Writes a pattern down, to six decimals.
    pub fn of(beam: &BeamPattern) -> Self {
        let nodes = beam.nodes();
        let angles: Vec<f64> =
            (0..nodes.count).map(|i| rounded(nodes.angle(i).to_degrees())).collect();
        let log_gain = beam
            .by_node()
            .chunks(nodes.count)
            .map(|row| row.iter().map(|v| v.map(rounded)).collect())
            .collect();
        Self { theta_deg: angles.clone(), phi_deg: angles, log_gain }
    }

    fn pattern(&self) -> Result<BeamPattern, String> {
        let count = self.theta_deg.len();
        let square = count >= 2
            && self.phi_deg == self.theta_deg
            && self.log_gain.len() == count
            && self.log_gain.iter().all(|r| r.len() == count);
        let (Some(first), Some(last)) = (self.theta_deg.first(), self.theta_deg.last()) else {
            return Err("the beam pattern is empty".into());
        };
        let even = self.theta_deg.iter().enumerate().all(|(i, a)| {
            (a - (first + (last - first) * i as f64 / (count - 1) as f64)).abs() < 1e-3
        });
        if !square || !even || (first + last).abs() > 1e-3 || *last <= 0.0 {
            return Err("the beam pattern is not a square grid, evenly spaced and symmetric \
                        about 0°"
                .into());
        }
        let values: Vec<Option<f64>> = self.log_gain.iter().flatten().copied().collect();
        Ok(BeamPattern::from_nodes(BeamGrid::new(count, *last), &values))
    }
}

/// To nine decimals: enough for any use, and the same text on any machine.
fn rounded(v: f64) -> f64 {
    (v * 1e9).round() / 1e9
}

impl ModelFile {
    /// Reads the file's text.
    ///
    /// # Errors
    /// A sentence: not JSON, another format, impossible numbers.
    pub fn from_json(text: &str) -> Result<Self, String> {
        let mut file: Self = serde_json::from_str(text).map_err(|e| e.to_string())?;
        if file.format != FORMAT || file.version != 1 {
            return Err(format!(
                "format {:?} version {} is not {FORMAT:?} version 1",
                file.format, file.version
            ));
        }
        file.check()?;
        let bands = file.attenuation_per_m.len();
        file.imaging_model()?;
        let residual = file.residual_light.as_ref().map_or(Ok(()), |r| r.check(bands));
        residual.map_err(|what| format!("residual_light needs {what}"))?;
        file.empirical.as_ref().map_or(Ok(()), |e| e.check(bands))?;
        if file.diagnostics.is_empty() {
            let because = file.not_identified_because.iter();
            let because = because.map(|why| format!("attenuation is not identified: {why}"));
            let warnings: Vec<String> = file.warnings.iter().cloned().chain(because).collect();
            file.diagnostics = diagnostics::of_texts(&[], &warnings);
        }
        Ok(file)
    }

    /// The model for pass two.
    ///
    /// # Errors
    /// A sentence about the beam pattern.
    pub fn imaging_model(&self) -> Result<ImagingModel, String> {
        let bands =
            |values: &[f64]| std::array::from_fn(|b| values.get(b).copied().unwrap_or_default());
        let spreading = self.spreading_exponents.map_or_else(
            || SpreadingModel::of(self.spreading),
            |[a, s]| SpreadingModel { strobe_leg: a, camera_leg: s },
        );
        Ok(ImagingModel {
            bands: self.attenuation_per_m.len(),
            attenuation_per_m: bands(&self.attenuation_per_m),
            over_time: self.segments.clone(),
            spreading,
            incidence: self.incidence,
            beam_pattern: self.beam_pattern.pattern()?,
            backscatter: self.backscatter.as_ref().map(BackscatterFile::backscatter),
            daylight: self.daylight.as_ref().map(DaylightFile::daylight),
            residual: self.residual_light.clone().map(Arc::new),
            empirical: self.empirical.clone().map(Arc::new),
        })
    }

    /// The same with its diagnostics; `not_identified` is one of them.
    pub fn with_diagnostics(
        self,
        mut diagnostics: Vec<Diagnostic>,
        not_identified: Option<NotIdentified>,
    ) -> Self {
        let warnings = diagnostics.iter().map(Diagnostic::with_remedy).collect();
        let not_identified_because = not_identified.as_ref().map(ToString::to_string);
        diagnostics.extend(not_identified.map(Diagnostic::from));
        let identified = not_identified_because.is_none();
        Self { warnings, diagnostics, identified, not_identified_because, ..self }
    }

    /// Marks it as not identified, unless it is already.
    pub fn set_not_identified(&mut self, why: NotIdentified) {
        if std::mem::take(&mut self.identified) {
            self.not_identified_because = Some(why.to_string());
            self.diagnostics.push(why.into());
        }
    }

    /// Whether a physical estimator has an α; without one it is 0.
    pub fn has_attenuation(&self) -> bool {
        self.empirical.is_none() || self.attenuation_std_per_m.iter().any(Option::is_some)
    }

    /// α ± its standard deviation per band, for people.
    pub fn attenuation_text(&self) -> String {
        if !self.has_attenuation() {
            return "not known".into();
        }
        with_std(&self.attenuation_per_m, self.attenuation_std_per_m.iter().copied())
    }

    /// As text, keys in order, ending in a newline.
    ///
    /// # Errors
    /// It cannot be written as JSON.
    pub fn to_json(&self) -> serde_json::Result<String> {
        Ok(serde_json::to_string_pretty(self)? + "\n")
    }
}
