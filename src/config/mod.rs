//! Every number that is a *choice*, with its unit, reason and default.
//!
//! All of them stand in one table, [`settings.rs`](self). A TOML file and options of the command
//! line are applied to the defaults and give a [`Config`], valid and complete. Facts about the
//! vehicle are not settings: they are in the rig. `unwater config` prints [`SETTINGS`] beside the
//! effective values; `--config` reads what it prints.

mod choices;
mod file;
mod settings;

use serde::{Deserialize, Serialize};

pub use self::choices::{
    Compression, Estimator, ImageFormat, JpegQuality, Look, Method, OutputEncoding,
    SelfCalibration, Spreading, StrobePosition, Switch, WhiteBalance,
};
pub(crate) use self::settings::settings;
use crate::image::transfer::Transfer;

/// A key of the configuration.
pub struct Setting {
    /// `section.key`
    pub key: &'static str,
    /// unit, or the values it accepts
    pub unit: &'static str,
    /// why it has its default, or what it trades off
    pub why: &'static str,
}

/// The type of a setting: with a default, or optional without one.
macro_rules! setting_type {
    ($type:ty = $default:expr) => { $type };
    ($type:ty) => { Option<$type> };
}

macro_rules! setting_default {
    ($default:expr) => {
        $default
    };
    () => {
        None
    };
}

macro_rules! define_sections {
    ($(
        $(#[$about:meta])*
        $section:ident: $Section:ident [$($options:tt)*] {
            $($key:ident: $type:ty $(= $default:expr)?, $unit:literal, $why:literal
                $(, must($rule:literal, $is_valid:expr))?
                $(, option($($option:tt)*))?
                $(, flag($($flag:tt)*))?;)*
        }
    )*) => {
        /// All settings.
        #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
        #[serde(default, deny_unknown_fields)]
        pub struct Config {
            $($(#[$about])* pub $section: $Section,)*
        }

        $(
            $(#[$about])*
            #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
            #[serde(default, deny_unknown_fields)]
            pub struct $Section {
                $(#[doc = concat!("`", $unit, "`: ", $why)]
                pub $key: setting_type!($type $(= $default)?),)*
            }

            impl Default for $Section {
                fn default() -> Self {
                    Self { $($key: setting_default!($($default)?)),* }
                }
            }
        )*

        /// Every setting, in the order of the file.
        pub const SETTINGS: &[Setting] = &[$($(Setting {
            key: concat!(stringify!($section), ".", stringify!($key)),
            unit: $unit,
            why: $why,
        }),*),*];

        impl Config {
            /// Checks each value against the rule of its setting.
            fn ensure_rules(&self) -> Result<(), String> {
                $($($(
                    let is_valid: fn(&$type) -> bool = $is_valid;
                    if !is_valid(&self.$section.$key) {
                        let key = concat!(stringify!($section), ".", stringify!($key));
                        return Err(format!("{key} must {}", $rule));
                    }
                )?)*)*
                Ok(())
            }
        }
    };
}

settings!(define_sections);

impl MatchingConfig {
    /// Factor by which an image is reduced for keypoint detection.
    pub fn reduction(&self, width: usize, height: usize) -> usize {
        width.max(height).div_ceil(self.detection_side_px).max(1)
    }
}
