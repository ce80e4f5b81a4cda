//! Typed diagnostics: facts about a log, a model or a run, each with a stable code, a severity,
//! its numbers, a text and, where something can be done, a remedy.
//!
//! Facts come in families, one file each, and one entry of `facts!` is all that a new one takes.
//! Code passes them on as values; text is rendered here only. In JSON:
//! `{"code", "severity", "topic", numbers by name, "text", "remedy"}`.

mod camera;
mod clock;
mod estimate;
mod mosaic;
mod mounts;
mod ranges;
mod recording;
mod uncorrected;
mod verify;

use std::fmt::{Display, Formatter};

use serde::{Deserialize, Serialize, Serializer};

pub use camera::CameraFact;
pub use clock::{ClockFact, OffsetUnknown};
pub use estimate::{EstimateFact, NoAnswer, NotIdentified};
pub use mosaic::MosaicFact;
pub use mounts::MountFact;
pub use ranges::RangeFact;
pub use recording::LogFact;
pub use uncorrected::{Reason, Uncorrected};
pub use verify::VerifyFact;

/// What a diagnostic means for the result.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Severity {
    /// something was assumed, chosen or mended
    #[default]
    Info,
    /// the result may be worse for it
    Warning,
    /// something is missing in the output: exit status 3
    Loss,
}

/// Declares a family of facts: per fact its severity, code, variant with its numbers, text and
/// remedy. Text and remedy are arguments of `format!`; fields are in scope. `<topic>` in a remedy
/// stands for the topic of the diagnostic.
macro_rules! facts {
    ($(#[$about:meta])* $family:ident { $(
        $(#[$doc:meta])*
        $severity:ident $code:literal $variant:ident $({ $($field:ident: $kind:ty),+ $(,)? })?,
        text($($text:tt)+) $(, remedy($($remedy:tt)+))?;
    )+ }) => {
        $(#[$about])*
        #[allow(missing_docs)] // the texts say it
        #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
        #[serde(tag = "code")]
        pub enum $family { $(
            $(#[$doc])*
            #[serde(rename = $code)]
            $variant $({ $($field: $kind),+ })?,
        )+ }

        #[allow(unused_variables)] // not every text has all numbers
        impl $family {
            /// The stable word for programs.
            pub fn code(&self) -> &'static str {
                match self { $( Self::$variant { .. } => $code, )+ }
            }

            /// What it means for the result.
            pub fn severity(&self) -> $crate::diagnostics::Severity {
                match self { $( Self::$variant { .. } => {
                    $crate::diagnostics::Severity::$severity
                } )+ }
            }

            /// What can be done about it.
            pub fn remedy(&self) -> Option<String> {
                match self { $( Self::$variant { $($($field),+)? } => {
                    None$(.or(Some(format!($($remedy)+))))?
                } )+ }
            }

            /// One of each, with empty numbers.
            #[cfg(test)]
            pub fn each() -> Vec<Self> {
                vec![$( Self::$variant { $($($field: Default::default()),+)? } ),+]
            }
        }

        #[allow(unused_variables)]
        impl std::fmt::Display for $family {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                match self { $( Self::$variant { $($($field),+)? } => {
                    write!(f, $($text)+)
                } )+ }
            }
        }
    };
}
use facts;

/// A fact of another version of this program, as far as its file has it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Recorded {
    #[serde(default)]
    code: String,
    #[serde(skip_serializing)]
    severity: Severity,
    #[serde(skip_serializing)]
    text: String,
    #[serde(default, skip_serializing)]
    remedy: Option<String>,
}

impl Recorded {
    fn code(&self) -> &str {
        &self.code
    }

    fn severity(&self) -> Severity {
        self.severity
    }

    fn remedy(&self) -> Option<String> {
        self.remedy.clone()
    }
}

impl Display for Recorded {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.text)
    }
}

/// Declares [`Fact`], one variant per family.
macro_rules! families {
    ($($family:ident),+) => {
        /// A fact of any family.
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(untagged)]
        #[allow(missing_docs)] // the families say it
        pub enum Fact { $($family($family)),+ }

        impl Fact {
            fn code(&self) -> &str {
                match self { $(Self::$family(fact) => fact.code()),+ }
            }

            fn severity(&self) -> Severity {
                match self { $(Self::$family(fact) => fact.severity()),+ }
            }

            fn remedy(&self) -> Option<String> {
                match self { $(Self::$family(fact) => fact.remedy()),+ }
            }
        }

        impl Display for Fact {
            fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
                match self { $(Self::$family(fact) => fact.fmt(f)),+ }
            }
        }

        $(impl From<$family> for Diagnostic {
            fn from(fact: $family) -> Self {
                Self { fact: Fact::$family(fact), topic: None, model_log: None }
            }
        })+
    };
}
// The last takes what none of the others can read.
families!(
    CameraFact,
    ClockFact,
    MountFact,
    RangeFact,
    LogFact,
    MosaicFact,
    VerifyFact,
    EstimateFact,
    NotIdentified,
    NoAnswer,
    Uncorrected,
    Recorded
);

/// A fact and what it is about.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Diagnostic {
    /// the fact
    #[serde(flatten)]
    pub fact: Fact,
    /// the topic it is about
    #[serde(default)]
    pub topic: Option<String>,
    /// the log the model was estimated from, where the fact is about that one and not about the
    /// log at hand
    #[serde(default)]
    pub model_log: Option<String>,
}

impl Diagnostic {
    /// A fact about a topic.
    pub fn on(topic: &str, fact: impl Into<Self>) -> Self {
        Self { topic: Some(topic.into()), ..fact.into() }
    }

    /// A text of a file that has no codes yet.
    pub fn of_text(severity: Severity, text: &str) -> Self {
        Recorded { severity, text: text.into(), ..Recorded::default() }.into()
    }

    /// The stable word for programs.
    pub fn code(&self) -> &str {
        self.fact.code()
    }

    /// What it means for the result.
    pub fn severity(&self) -> Severity {
        self.fact.severity()
    }

    /// What can be done about it.
    pub fn remedy(&self) -> Option<String> {
        let remedy = self.fact.remedy()?;
        Some(remedy.replace("<topic>", self.topic.as_deref().unwrap_or("TOPIC")))
    }

    /// Text and remedy in one line.
    pub fn with_remedy(&self) -> String {
        self.remedy().map_or_else(|| self.to_string(), |remedy| format!("{self}; {remedy}"))
    }

    /// Whether it is about frames that passed uncorrected.
    pub fn is_uncorrected(&self) -> bool {
        matches!(self.fact, Fact::Uncorrected(_))
    }

    /// Whether it is why attenuation is not identified.
    pub fn is_not_identified(&self) -> bool {
        matches!(self.fact, Fact::NotIdentified(_))
    }
}

impl Display for Diagnostic {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        // A recorded text has them already.
        if !matches!(self.fact, Fact::Recorded(_)) {
            if let Some(log) = &self.model_log {
                write!(f, "log of the model, {log}: ")?;
            }
            if let Some(topic) = &self.topic {
                write!(f, "{topic}: ")?;
            }
        }
        if matches!(self.fact, Fact::NotIdentified(_)) {
            f.write_str("attenuation is not identified: ")?;
        }
        self.fact.fmt(f)
    }
}

impl Serialize for Diagnostic {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Written<'d> {
            #[serde(flatten)]
            fact: &'d Fact,
            severity: Severity,
            #[serde(skip_serializing_if = "Option::is_none")]
            topic: Option<&'d str>,
            #[serde(skip_serializing_if = "Option::is_none")]
            model_log: Option<&'d str>,
            text: String,
            remedy: Option<String>,
        }
        let written = Written {
            fact: &self.fact,
            severity: self.severity(),
            topic: self.topic.as_deref(),
            model_log: self.model_log.as_deref(),
            text: self.to_string(),
            remedy: self.remedy(),
        };
        written.serialize(serializer)
    }
}

/// Diagnostics of a file of an earlier version, which has texts alone.
pub fn of_texts(infos: &[String], warnings: &[String]) -> Vec<Diagnostic> {
    let of = |texts: &[String], severity| -> Vec<Diagnostic> {
        texts.iter().map(|text| Diagnostic::of_text(severity, text)).collect()
    };
    [of(warnings, Severity::Warning), of(infos, Severity::Info)].concat()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    fn each() -> Vec<Diagnostic> {
        let mut all: Vec<Diagnostic> = Vec::new();
        all.extend(CameraFact::each().into_iter().map(Diagnostic::from));
        all.extend(ClockFact::each().into_iter().map(Diagnostic::from));
        all.extend(MountFact::each().into_iter().map(Diagnostic::from));
        all.extend(RangeFact::each().into_iter().map(Diagnostic::from));
        all.extend(MosaicFact::each().into_iter().map(Diagnostic::from));
        all.extend(LogFact::each().into_iter().map(Diagnostic::from));
        all.extend(EstimateFact::each().into_iter().map(Diagnostic::from));
        all.extend(NotIdentified::each().into_iter().map(Diagnostic::from));
        all.extend(NoAnswer::each().into_iter().map(Diagnostic::from));
        let of = |reason| Diagnostic::from(Uncorrected { frames: 3, reason });
        all.extend(Reason::each().into_iter().map(of));
        all
    }

    #[test]
    fn codes_are_unique_words_and_warnings_have_remedies() {
        let all = each();
        let codes: BTreeSet<&str> = all.iter().map(Diagnostic::code).collect();
        assert_eq!(codes.len(), all.len(), "two facts share a code");
        for d in &all {
            let is_word = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
            assert!(d.code().chars().all(is_word) && !d.to_string().is_empty(), "{d:?}");
            assert!(d.severity() == Severity::Info || d.remedy().is_some(), "{d:?}");
        }
    }

    #[test]
    fn every_fact_comes_back_from_json() {
        for mut d in each() {
            d.topic = Some("/dvl".into());
            d.model_log = (d.severity() == Severity::Warning).then(|| "other.mcap".into());
            let json = serde_json::to_value(&d).expect("JSON");
            assert_eq!(json["code"], d.code());
            assert_eq!(json["text"], d.to_string());
            assert_eq!(serde_json::from_value::<Diagnostic>(json).expect("a diagnostic"), d);
        }
    }

    #[test]
    fn numbers_stand_beside_the_text_and_the_topic_in_the_remedy() {
        let found = ClockFact::OffsetFound { offset_s: -0.25, std_s: 0.01, time_offset_s: 0.5 };
        let json = serde_json::to_value(Diagnostic::on("/dvl", found)).expect("JSON");
        assert_eq!((&json["offset_s"], &json["severity"]), (&(-0.25).into(), &"warning".into()));
        let remedy = json["remedy"].as_str().expect("a remedy");
        assert!(remedy.ends_with("\"/dvl\" = 0.50"), "{remedy}");
    }

    #[test]
    fn facts_of_another_version_keep_their_text() {
        let json = r#"{"code": "auto-exposure", "severity": "loss", "topic": "/cam", "gain": 2,
                       "text": "/cam: exposure varies", "remedy": "fix it"}"#;
        let d: Diagnostic = serde_json::from_str(json).expect("a diagnostic");
        assert_eq!((d.code(), d.severity()), ("auto-exposure", Severity::Loss));
        assert_eq!(
            (d.to_string().as_str(), d.remedy()),
            ("/cam: exposure varies", Some("fix it".into()))
        );
        let again = serde_json::to_string(&d).expect("JSON");
        assert_eq!(serde_json::from_str::<Diagnostic>(&again).expect("a diagnostic"), d);
    }
}
