//! Groups of options that several commands share, and what they make of their values.

use std::path::{Path, PathBuf};

use clap::Args;

use super::output::Outcome;
use crate::config::{
    Compression, Config, EstimateConfig, Estimator, ImageFormat, JpegQuality, LightConfig, Look,
    Method, OutputConfig, OutputEncoding, RenderConfig, SelfCalibration, Spreading, StrobePosition,
    Switch, settings,
};
use crate::error::{Error, Result};
use crate::image::transfer::Transfer;
use crate::model::ModelFile;
use crate::recording::Window;
use crate::session::{Options, Selection};
use crate::vehicle::RigFile;

/// A group of options that set values of the configuration.
pub trait SettingOptions {
    /// Sets the values that were given.
    fn apply(&self, config: &mut Config);
}

macro_rules! define_options {
    ($(
        $(#[$about:meta])*
        $section:ident: $Section:ident [$($options:tt)*] { $($settings:tt)* }
    )*) => {
        $(define_options_of_section! { $section: $Section [$($options)*] { $($settings)* } })*
    };
}

macro_rules! define_options_of_section {
    ($section:ident: $Section:ident [] { $($settings:tt)* }) => {};
    ($section:ident: $Section:ident [$Options:ident $(, $heading:literal)?] {
        $($key:ident: $type:ty $(= $default:expr)?, $unit:literal, $why:literal
            $(, must($($rule:tt)*))?
            $(, option($option:literal, $value:literal, $help:literal))?
            $(, flag($flag:literal, $flag_help:literal))?;)*
    }) => {
        #[doc = concat!("Options that set values of [`", stringify!($Section), "`].")]
        #[derive(Debug, Args, Default, PartialEq)]
        $(#[command(next_help_heading = $heading)])?
        pub struct $Options {
            $($(
                #[doc = $help]
                #[arg(long = $option, value_name = $value)]
                pub $key: Option<$type>,
            )?
            $(
                #[doc = $flag_help]
                #[arg(long = $flag)]
                pub $key: bool,
            )?)*
        }

        impl SettingOptions for $Options {
            fn apply(&self, config: &mut Config) {
                let section: &mut $Section = &mut config.$section;
                $($(set($option, self.$key.as_ref(), &mut section.$key);)?
                $(set($flag, self.$key.then_some(&true), &mut section.$key);)?)*
            }
        }
    };
}

settings!(define_options);

/// Sets a value where its option was given. (A macro repeats only what names the option.)
fn set<V: Clone + Into<T>, T>(_option: &str, value: Option<&V>, setting: &mut T) {
    if let Some(value) = value {
        *setting = value.clone().into();
    }
}

/// The settings: a file, and options that any command with settings takes.
#[derive(Debug, Args, Default)]
pub struct SettingArgs {
    /// Settings (TOML); `unwater config` prints them all
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    #[command(flatten)]
    pub light: LightOptions,
    #[command(flatten)]
    pub threads: ThreadArgs,
}

impl SettingArgs {
    /// Defaults, overridden by the file, overridden by options.
    pub fn config(&self, options: &[&dyn SettingOptions]) -> Result<Config> {
        let mut config = match &self.config {
            None => Config::default(),
            Some(path) => Config::from_toml(&read(path)?).map_err(|reason| Error::BadFile {
                path: path.clone(),
                what: "invalid setting",
                reason,
            })?,
        };
        self.light.apply(&mut config);
        options.iter().for_each(|group| group.apply(&mut config));
        config.ensure_valid().map_err(Error::Usage)?;
        Ok(config)
    }
}

/// How a dive log is read: settings, rig, channels and time window.
#[derive(Debug, Args, Default)]
pub struct LogArgs {
    #[command(flatten)]
    pub settings: SettingArgs,
    /// Facts about the vehicle (TOML), which override the log's; `unwater init` writes one
    #[arg(long, value_name = "FILE")]
    pub rig: Option<PathBuf>,
    /// The camera's image topic, where the log has several
    #[arg(long, value_name = "TOPIC")]
    pub camera: Option<String>,
    /// The topic of the DVL or altimeter
    #[arg(long, value_name = "TOPIC")]
    pub dvl: Option<String>,
    /// The TF frame of the strobe
    #[arg(long, value_name = "NAME")]
    pub strobe_frame: Option<String>,
    #[command(flatten)]
    pub window: WindowArgs,
}

impl LogArgs {
    /// Options of a run that reads the log.
    pub fn options(&self, options: &[&dyn SettingOptions]) -> Result<Options> {
        let config = self.settings.config(options)?;
        let rig =
            match &self.rig {
                None => RigFile::default(),
                Some(path) => RigFile::from_toml(&read(path)?).map_err(|reason| {
                    Error::BadFile { path: path.clone(), what: "invalid fact", reason }
                })?,
            };
        let selection = Selection {
            camera: self.camera.clone(),
            dvl: self.dvl.clone(),
            strobe_frame: self.strobe_frame.clone(),
        };
        let (window, threads) = (self.window.window()?, self.settings.threads.threads);
        Ok(Options { config, rig, selection, window, threads, ..Options::default() })
    }
}

/// How a corrected log is read.
#[derive(Debug, Args, Default)]
pub struct CorrectedLogArgs {
    /// The camera's image topic, where several were corrected
    #[arg(long, value_name = "TOPIC")]
    pub camera: Option<String>,
    #[command(flatten)]
    pub window: WindowArgs,
    #[command(flatten)]
    pub threads: ThreadArgs,
}

impl CorrectedLogArgs {
    /// Options of a run that reads the log.
    pub fn options(&self) -> Result<Options> {
        let (window, threads) = (self.window.window()?, self.threads.threads);
        Ok(Options { window, threads, ..Options::default() })
    }
}

/// A window in log time.
#[derive(Debug, Args, Default)]
pub struct WindowArgs {
    /// Begin here (log time, inclusive): nanoseconds or RFC 3339
    #[arg(short = 'S', long, value_name = "TIME", value_parser = moment)]
    pub start: Option<u64>,
    /// End here (log time, exclusive)
    #[arg(short = 'E', long, value_name = "TIME", value_parser = moment)]
    pub end: Option<u64>,
}

impl WindowArgs {
    fn window(&self) -> Result<Option<Window>> {
        if (self.start, self.end) == (None, None) {
            return Ok(None);
        }
        let window = Window { start: self.start.unwrap_or(0), end: self.end.unwrap_or(u64::MAX) };
        if window.start >= window.end {
            Err(Error::Usage("-S must be before -E".into()))
        } else {
            Ok(Some(window))
        }
    }
}

/// Size of the thread pool.
#[derive(Debug, Args, Default)]
pub struct ThreadArgs {
    /// Number of threads; 0 uses all cores. The output's bytes do not depend on it
    #[arg(short = 'j', long, value_name = "N", default_value_t = 0, value_parser = thread_count)]
    pub threads: usize,
}

/// How a result is written.
#[derive(Debug, Args, Default)]
pub struct OutputArgs {
    /// Overwrite the output
    #[arg(long)]
    pub force: bool,
    /// Print errors and results only
    #[arg(short, long)]
    pub quiet: bool,
}

/// What losses mean for the exit status.
#[derive(Debug, Args, Default)]
pub struct LossArgs {
    /// Exit with 0 instead of 3 where losses are listed
    #[arg(long)]
    pub accept_losses: bool,
}

impl LossArgs {
    /// How the command ended.
    pub fn outcome(&self, outcome: Outcome) -> Outcome {
        match outcome {
            Outcome::DoneWithLosses if self.accept_losses => Outcome::Done,
            other => other,
        }
    }
}

/// Reads the model of `--model`.
pub fn read_model(path: Option<&Path>) -> Result<Option<ModelFile>> {
    let Some(path) = path else { return Ok(None) };
    ModelFile::from_json(&read(path)?).map(Some).map_err(|reason| Error::BadFile {
        path: path.into(),
        what: "invalid model",
        reason,
    })
}

/// Reads a text file.
pub fn read(path: &Path) -> Result<String> {
    std::fs::read_to_string(path).map_err(|source| Error::Read { path: path.into(), source })
}

/// More threads than any machine has cores.
const MAX_THREADS: usize = 1024;

fn thread_count(text: &str) -> std::result::Result<usize, String> {
    let count = text.parse().ok().filter(|n| *n <= MAX_THREADS);
    count.ok_or_else(|| format!("a number from 0 (all cores) to {MAX_THREADS} is expected"))
}

/// Parses nanoseconds or RFC 3339.
pub fn moment(text: &str) -> std::result::Result<u64, String> {
    if let Ok(nanos) = text.parse() {
        return Ok(nanos);
    }
    let time = humantime::parse_rfc3339_weak(text).map_err(|_not_a_time| {
        format!("{text:?} is neither nanoseconds nor RFC 3339 (2026-05-01T10:00:00Z)")
    })?;
    let since_epoch = time
        .duration_since(std::time::UNIX_EPOCH)
        .map_err(|_early| format!("{text:?} is before 1970"))?;
    u64::try_from(since_epoch.as_nanos()).map_err(|_late| format!("{text:?} is too late"))
}

#[cfg(test)]
mod tests {
    use clap::{Args as _, ValueEnum};

    use super::*;
    use crate::config::SETTINGS;

    #[test]
    fn units_list_the_values_that_options_accept() {
        let command = EstimateOptions::augment_args(clap::Command::new("settings"));
        let command = OutputOptions::augment_args(RenderOptions::augment_args(command));
        let mut checked = 0;
        for option in command.get_arguments().filter(|a| a.get_num_args().is_none()) {
            let values = option.get_possible_values();
            let id = option.get_id().as_str();
            let is_enum = !values.is_empty() && option.get_action().takes_values();
            let Some(setting) = SETTINGS.iter().find(|s| is_enum && s.key.ends_with(id)) else {
                continue;
            };
            let names: Vec<&str> =
                values.iter().map(clap::builder::PossibleValue::get_name).collect();
            assert_eq!(names.join(" | "), setting.unit, "{}", setting.key);
            checked += 1;
        }
        assert_eq!(checked, 13);
        assert_eq!(Switch::value_variants().len(), 3);
    }
}
