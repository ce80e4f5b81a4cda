//! Whether a correction makes a dive better, measured on frames that its model did not see.

use serde::{Deserialize, Serialize};

/// What is compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum VerdictMeasure {
    /// spread of the log light of one point over frames, over the spread between points
    #[default]
    SamePoint,
    /// evenness over regions of the image and frames
    Evenness,
}

impl VerdictMeasure {
    /// What it is called in texts.
    pub fn word(self) -> &'static str {
        match self {
            Self::SamePoint => "agreement",
            Self::Evenness => "evenness",
        }
    }
}

/// Figures of raw light or of one correction; the smaller the better.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct VerdictFigures {
    /// `raw`, `full`, or the form of an empirical model
    pub name: String,
    /// of the same point; mean of the bands
    #[serde(skip_serializing_if = "Option::is_none")]
    pub agreement: Option<f64>,
    /// robust spread of the log of red and of blue over green, the larger
    #[serde(skip_serializing_if = "Option::is_none")]
    pub chroma: Option<f64>,
    /// robust spread of the log of green
    #[serde(skip_serializing_if = "Option::is_none")]
    pub light: Option<f64>,
    /// 95 % quantile of the distance of log red over green from its median
    #[serde(skip_serializing_if = "Option::is_none")]
    pub worst: Option<f64>,
}

impl VerdictFigures {
    /// The figure that decides; infinite where nothing was measured. Where both were measured,
    /// their geometric mean.
    pub fn score(&self) -> f64 {
        let evenness = self.chroma.zip(self.light).map(|(chroma, light)| chroma + light);
        let both = self.agreement.zip(evenness).map(|(agreement, even)| (agreement * even).sqrt());
        let score = both.or(self.agreement).or(evenness);
        score.filter(|s| s.is_finite()).unwrap_or(f64::INFINITY)
    }

    /// The same with the evenness of another measurement of it; both are needed.
    #[must_use]
    pub fn with_evenness(self, of: Option<&Self>) -> Self {
        match of.filter(|even| even.score().is_finite() && self.agreement.is_some()) {
            Some(even) => {
                Self { chroma: even.chroma, light: even.light, worst: even.worst, ..self }
            }
            None => Self { name: self.name, ..Self::default() },
        }
    }
}

/// The comparison, and the correction that was chosen by it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Verdict {
    /// what is compared
    pub measure: VerdictMeasure,
    /// name of the correction that is used
    pub used: String,
    /// held-out frames
    pub frames: usize,
    /// raw light first, then corrections, the simplest last
    pub figures: Vec<VerdictFigures>,
}

impl Verdict {
    /// Name of the physical model.
    pub const FULL: &str = "full";

    /// Figures by name.
    pub fn of(&self, name: &str) -> Option<&VerdictFigures> {
        self.figures.iter().find(|f| f.name == name)
    }

    /// For people: "agreement of the same point: 0.38 raw, 0.09 corrected".
    pub fn text(&self) -> Option<String> {
        let (raw, used) = (self.of("raw")?, self.of(&self.used)?);
        let evenness = || {
            Some(format!(
                "of colour: {:.2} raw, {:.2} corrected; of brightness: {:.2} raw, {:.2} corrected",
                raw.chroma?, used.chroma?, raw.light?, used.light?
            ))
        };
        match self.measure {
            VerdictMeasure::SamePoint => {
                let also = evenness().map_or_else(String::new, |text| format!("; evenness {text}"));
                let (raw, used) = (raw.agreement?, used.agreement?);
                Some(format!("of the same point: {raw:.2} raw, {used:.2} corrected{also}"))
            }
            VerdictMeasure::Evenness => evenness(),
        }
    }
}
