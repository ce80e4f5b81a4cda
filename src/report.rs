//! What a run found and did: `report.json`.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::diagnostics::{self, Diagnostic, LogFact, Severity};
use crate::model::Verdict;
use crate::recording::Damage;

/// `report.json`: the result of a run for one camera.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Report {
    /// of the program
    pub version: String,
    /// name of the input file
    pub source: String,
    /// of the raw images
    pub camera_topic: String,
    /// of the corrected images
    pub corrected_topic: String,
    /// of the calibration in use; absent where the rig file has it
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera_info_topic: Option<String>,
    /// of the range instrument
    pub dvl_topic: String,
    /// correction method
    pub method: String,
    /// frames of the camera
    pub frames: usize,
    /// of these, corrected
    pub corrected: usize,
    /// of these, not corrected, by the text of the reason; with codes in `diagnostics`
    pub uncorrected: BTreeMap<String, usize>,
    /// frames by the support of their seafloor plane
    pub planes: BTreeMap<String, usize>,
    /// lowest and highest camera altitude of the corrected frames (m)
    pub camera_altitude_m: Option<[f64; 2]>,
    /// how much better than raw the correction is, on frames that pass one did not use
    #[serde(skip_serializing_if = "Option::is_none")]
    pub verdict: Option<Verdict>,
    /// shares of pixels, means over the corrected frames
    pub mean_shares: BTreeMap<String, f64>,
    /// assumptions, what may make the result worse, what is missing in the output
    pub diagnostics: Vec<Diagnostic>,
    /// what could not be read
    pub damage: Vec<Damage>,
    /// messages of the input in the output
    pub messages_copied: u64,
    /// messages that are new in the output
    pub messages_added: u64,
}

impl Report {
    /// Reads a report, also of an earlier version, which has texts and no codes.
    pub fn from_json(text: &str) -> serde_json::Result<Self> {
        #[derive(Default, Deserialize)]
        #[serde(default)]
        struct Texts {
            remarks: Vec<String>,
            warnings: Vec<String>,
        }
        let mut report: Self = serde_json::from_str(text)?;
        let Texts { remarks, warnings } = serde_json::from_str(text)?;
        report.diagnostics.extend(diagnostics::of_texts(&remarks, &warnings));
        Ok(report)
    }

    /// Diagnostics of one severity, in order.
    pub fn of(&self, severity: Severity) -> impl Iterator<Item = &Diagnostic> {
        self.diagnostics.iter().filter(move |d| d.severity() == severity)
    }

    /// Whether something is missing in the output: exit status 3.
    pub fn has_losses(&self) -> bool {
        self.of(Severity::Loss).next().is_some()
    }

    /// Makes damage a loss.
    pub fn count_damage(&mut self) {
        let places = self.damage.len();
        self.diagnostics.extend((places > 0).then_some(LogFact::Damage { places }.into()));
    }

    /// As JSON.
    ///
    /// # Errors
    /// It cannot be written as JSON.
    pub fn to_json(&self) -> serde_json::Result<String> {
        Ok(serde_json::to_string_pretty(self)? + "\n")
    }
}
