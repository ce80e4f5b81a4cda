//! What was found, what was done, what was not and why: `report.json`, and text for people.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::diagnostics::{self, Diagnostic, LogFact, Severity};
use crate::recording::Damage;

/// The account of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Report {
    /// version of the program
    pub version: String,
    /// input file's name
    pub source: String,
    /// topics used
    pub camera_topic: String,
    /// where corrected frames went
    pub corrected_topic: String,
    /// the range instrument's topic
    pub dvl_topic: String,
    /// method
    pub method: String,
    /// frames of the camera
    pub frames: usize,
    /// of these, corrected
    pub corrected: usize,
    /// of these, not corrected, by reason
    pub uncorrected: BTreeMap<String, usize>,
    /// frames by what held their plane
    pub planes: BTreeMap<String, usize>,
    /// lowest and highest camera altitude of the corrected frames [m]
    pub camera_altitude_m: Option<[f64; 2]>,
    /// mean shares over the corrected frames
    pub mean_shares: BTreeMap<String, f64>,
    /// what was assumed, what may make the result worse, what is missing in the output
    pub diagnostics: Vec<Diagnostic>,
    /// what could not be read
    pub damage: Vec<Damage>,
    /// messages copied and messages added
    pub messages_copied: u64,
    /// see `messages_copied`
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

    /// Whether something was lost on the way: the third state between done and failed.
    pub fn has_losses(&self) -> bool {
        self.of(Severity::Loss).next().is_some()
    }

    /// Makes damage a loss.
    pub fn count_damage(&mut self) {
        let places = self.damage.len();
        self.diagnostics.extend((places > 0).then_some(LogFact::Damage { places }.into()));
    }

    /// As JSON.
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).unwrap_or_default() + "\n"
    }
}
