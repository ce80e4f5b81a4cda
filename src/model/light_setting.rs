//! How a setting of camera or strobe acts on the light: as a factor (exposure time, linear gain,
//! power), in decibels or in stops.

use serde::{Deserialize, Serialize};

/// What a setting's number means.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LightLaw {
    /// light is proportional to it
    Factor,
    /// 20 mean ten times the light
    Decibel,
    /// one means twice the light
    Stop,
}

impl LightLaw {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Factor, Self::Decibel, Self::Stop];

    /// For people.
    pub fn word(self) -> &'static str {
        match self {
            Self::Factor => "a factor",
            Self::Decibel => "decibels",
            Self::Stop => "stops",
        }
    }

    /// Log of the light at a setting, up to a constant; `None` where the law does not allow the
    /// number.
    pub fn log_light(self, value: f64) -> Option<f64> {
        match self {
            Self::Factor => (value > 0.0).then(|| value.ln()),
            Self::Decibel => Some(value * std::f64::consts::LN_10 / 20.0),
            Self::Stop => Some(value * std::f64::consts::LN_2),
        }
    }
}

/// A setting that the frames' light follows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LightSettingFile {
    /// the topic it is on
    pub topic: String,
    /// its name there
    pub name: String,
    /// how it acts
    pub law: LightLaw,
    /// the setting that counts as gain 1
    pub reference: f64,
}

impl LightSettingFile {
    /// Log of the light at a setting over that at the reference.
    pub fn log_gain(&self, value: f64) -> f64 {
        self.law
            .log_light(value)
            .zip(self.law.log_light(self.reference))
            .map_or(0.0, |(v, r)| v - r)
    }
}
