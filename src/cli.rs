//! Words on the command line → options → a run → words for people and an exit status.

mod commands;
mod init;
mod layout;
mod paint;
mod papers;
mod products;
mod progress;
mod summary;

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};

use crate::config::{
    Compression, Config, Estimator, ImageFormat, Method, OutputEncoding, Spreading, StrobePosition,
    Switch, with_nearest_key,
};
use crate::error::{Error, Result};
use crate::image::transfer::Transfer;
use crate::recording::Window;
use crate::session::{Options, Selection};
use crate::vehicle::RigFile;

pub use commands::run;
pub use layout::LayoutArgs;
pub use papers::{CompletionsArgs, ManArgs};

/// How a command ended; `main` turns it into an exit status.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// 0
    Done,
    /// 3: done, with losses that are listed
    DoneWithLosses,
}

/// Takes the water out of dive logs.
///
/// Reads camera and DVL channels from an MCAP recording, estimates what the water and the strobe
/// did to the light, corrects every image, and writes a new MCAP that Foxglove and rerun play back.
#[derive(Debug, Parser)]
#[command(name = "unwater", version, max_term_width = 110, arg_required_else_help = true)]
pub struct Cli {
    /// what to do
    #[command(subcommand)]
    pub command: Command,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Estimate and correct: a dive log in, a corrected log out
    #[command(after_help = "Examples:\n  unwater correct dive.mcap\n  unwater correct dive.mcap \
                            -o clear.mcap --depth 16\n  unwater estimate dive.mcap && unwater \
                            correct dive_2.mcap --model dive.model.json\n\nExit status: 0 done; \
                            1 failed, nothing written; 2 bad usage; 3 done, with losses that are \
                            listed.")]
    Correct(Correct),
    /// Pass one alone: write a model that corrects this dive, or others of the same water and
    /// strobe
    #[command(after_help = "Examples:\n  unwater estimate dive.mcap -o model.json\n  unwater \
                            estimate dive_1.mcap dive_2.mcap -o two.model.json")]
    Estimate(EstimateArgs),
    /// Show what a log holds, what is missing, and what would be done
    #[command(after_help = "Examples:\n  unwater inspect dive.mcap\n  unwater inspect dive.mcap \
                            --json | jq .plan.camera\n  unwater inspect dive.mcap --clocks")]
    Inspect(Inspect),
    /// Write one self-contained page (HTML) about a corrected log: numbers, figures, before and
    /// after
    #[command(after_help = "Examples:\n  unwater report dive.corrected.mcap\n  unwater report \
                            dive.corrected.mcap -o page.html --force")]
    Report(ReportArgs),
    /// Show one frame under every correction method, labelled, side by side (PNG)
    #[command(after_help = "Examples:\n  unwater compare dive.mcap --frame 12 -o sheet.png\n  \
                            unwater compare dive.mcap --model dive.model.json --at \
                            2025-10-09T08:53:25Z -o moment.png")]
    Compare(CompareArgs),
    /// Lay a stretch of frames over the seafloor: raw and corrected side by side (PNG), or
    /// georeferenced (GeoTIFF)
    #[command(after_help = "Examples:\n  unwater mosaic dive.corrected.mcap -o mosaic.png\n  \
                            unwater mosaic dive.corrected.mcap -S 2025-10-09T08:53:22Z -E \
                            2025-10-09T08:53:30Z -o stretch.png\n\nWith -o MOSAIC.tif a GeoTIFF, \
                            where the log has a position.")]
    Mosaic(MosaicArgs),
    /// Write a data set an archive takes: corrected stills, a table (CSV), an iFDO record
    #[command(after_help = "Examples:\n  unwater export dive.corrected.mcap -o stills")]
    Export(ExportArgs),
    /// Write a commented rig file with what the log knows, the rest marked to be filled in
    #[command(after_help = "Examples:\n  unwater init dive.mcap -o rig.toml\n  unwater correct \
                            dive.mcap --rig rig.toml -o by_rig.mcap")]
    Init(Init),
    /// Print every setting with its effective value, unit and reason
    #[command(after_help = "Examples:\n  unwater config > unwater.toml\n  unwater config \
                            --config unwater.toml --depth 16")]
    Config(ConfigArgs),
    /// Write a layout for Foxglove, or a script that opens rerun, with this log's topics laid out
    #[command(after_help = "Examples:\n  unwater layout dive.corrected.mcap --foxglove\n  \
                            unwater layout dive.corrected.mcap --rerun   # then: python \
                            dive.corrected.rerun.py")]
    Layout(LayoutArgs),
    /// Print a script that completes words in your shell
    #[command(after_help = "Examples:\n  unwater completions bash > unwater.bash\n  unwater \
                            completions zsh > _unwater")]
    Completions(CompletionsArgs),
    /// Write man pages, one for each command
    #[command(after_help = "Example:\n  unwater man man1")]
    Man(ManArgs),
}

/// `correct`
#[derive(Debug, Args)]
pub struct Correct {
    /// The dive log
    #[arg(value_name = "IN.mcap")]
    pub input: PathBuf,
    /// Where the corrected log goes [default: IN.corrected.mcap beside IN]
    #[arg(short, long, value_name = "OUT.mcap")]
    pub output: Option<PathBuf>,
    /// Use a model estimated before, from this dive or another (pass two alone)
    #[arg(long, value_name = "MODEL.json")]
    pub model: Option<PathBuf>,
    /// Print the report as JSON
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub shared: Shared,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub estimate: EstimateOptions,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub render: RenderOptions,
}

/// `estimate`
#[derive(Debug, Args)]
pub struct EstimateArgs {
    /// The dive logs: one, or several of the same dive, camera and strobe
    #[arg(value_name = "IN.mcap", required = true)]
    pub inputs: Vec<PathBuf>,
    /// Where the model goes [default: IN.model.json beside the first IN; - for stdout]
    #[arg(short, long, value_name = "MODEL.json")]
    pub output: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub shared: Shared,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub estimate: EstimateOptions,
}

/// `inspect`
#[derive(Debug, Args)]
pub struct Inspect {
    /// The log
    #[arg(value_name = "IN.mcap")]
    pub input: PathBuf,
    /// One JSON document instead of text
    #[arg(long)]
    pub json: bool,
    /// Look in pictures and ranges for offsets between the clocks; takes as long as estimating
    #[arg(long)]
    pub clocks: bool,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub shared: Shared,
}

/// `init`
#[derive(Debug, Args)]
pub struct Init {
    /// The log
    #[arg(value_name = "IN.mcap")]
    pub input: PathBuf,
    /// Where the rig file goes (- for stdout)
    #[arg(short, long, value_name = "RIG.toml", default_value = "rig.toml")]
    pub output: PathBuf,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub shared: Shared,
}

/// `report`
#[derive(Debug, Args)]
pub struct ReportArgs {
    /// A log that `unwater correct` wrote
    #[arg(value_name = "OUT.mcap")]
    pub input: PathBuf,
    /// Where the page goes [default: OUT.html beside OUT]
    #[arg(short, long, value_name = "REPORT.html")]
    pub output: Option<PathBuf>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub run: LookOptions,
}

/// `compare`
#[derive(Debug, Args)]
pub struct CompareArgs {
    /// The dive log
    #[arg(value_name = "IN.mcap")]
    pub input: PathBuf,
    /// Where the sheet goes
    #[arg(short, long, value_name = "SHEET.png")]
    pub output: PathBuf,
    /// Use a model estimated before
    #[arg(long, value_name = "MODEL.json")]
    pub model: Option<PathBuf>,
    /// The frame nearest to this moment: nanoseconds or RFC 3339
    #[arg(long, value_name = "TIME", value_parser = moment, required_unless_present = "frame", conflicts_with = "frame")]
    pub at: Option<u64>,
    /// The frame by its number, the first is 0
    #[arg(long, value_name = "N")]
    pub frame: Option<usize>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub shared: Shared,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub estimate: EstimateOptions,
}

/// `mosaic`
#[derive(Debug, Args)]
pub struct MosaicArgs {
    /// A log that `unwater correct` wrote
    #[arg(value_name = "OUT.mcap")]
    pub input: PathBuf,
    /// Where the mosaic goes: .png, or .tif for a GeoTIFF of the corrected strip
    #[arg(short, long, value_name = "MOSAIC.png")]
    pub output: PathBuf,
    /// The camera's image topic, where several were corrected
    #[arg(long, value_name = "TOPIC")]
    pub camera: Option<String>,
    /// Begin here (log time, inclusive): nanoseconds or RFC 3339
    #[arg(short = 'S', long, value_name = "TIME", value_parser = moment)]
    pub start: Option<u64>,
    /// End here (log time, exclusive)
    #[arg(short = 'E', long, value_name = "TIME", value_parser = moment)]
    pub end: Option<u64>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub run: LookOptions,
}

/// `export`
#[derive(Debug, Args)]
pub struct ExportArgs {
    /// A log that `unwater correct` wrote
    #[arg(value_name = "OUT.mcap")]
    pub input: PathBuf,
    /// The folder to write into
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// Fields of the iFDO header that no log knows (TOML): image-pi, image-license, …
    #[arg(long, value_name = "FACTS.toml")]
    pub facts: Option<PathBuf>,
    /// The camera's image topic, where several were corrected
    #[arg(long, value_name = "TOPIC")]
    pub camera: Option<String>,
    /// Begin here (log time, inclusive): nanoseconds or RFC 3339
    #[arg(short = 'S', long, value_name = "TIME", value_parser = moment)]
    pub start: Option<u64>,
    /// End here (log time, exclusive)
    #[arg(short = 'E', long, value_name = "TIME", value_parser = moment)]
    pub end: Option<u64>,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub run: LookOptions,
}

/// Options of the commands that make pictures of a corrected log.
#[derive(Debug, Args, Default)]
pub struct LookOptions {
    /// Cores to use; 0 means all. The output's bytes do not depend on it
    #[arg(short = 'j', long, value_name = "N", default_value_t = 0, value_parser = threads)]
    pub threads: usize,
    /// Overwrite the output
    #[arg(long)]
    pub force: bool,
    /// Say nothing but errors
    #[arg(short, long)]
    pub quiet: bool,
}

/// `config`
#[derive(Debug, Args)]
pub struct ConfigArgs {
    #[command(flatten)]
    #[allow(missing_docs)]
    pub shared: Shared,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub estimate: EstimateOptions,
    #[command(flatten)]
    #[allow(missing_docs)]
    pub render: RenderOptions,
}

/// Options that every command takes.
#[derive(Debug, Args, Default)]
pub struct Shared {
    /// Settings (TOML); `unwater config` prints them all
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Facts about the vehicle (TOML), which win over the log's; `unwater init` writes one
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
    /// Begin here (log time, inclusive): nanoseconds or RFC 3339
    #[arg(short = 'S', long, value_name = "TIME", value_parser = moment)]
    pub start: Option<u64>,
    /// End here (log time, exclusive)
    #[arg(short = 'E', long, value_name = "TIME", value_parser = moment)]
    pub end: Option<u64>,
    /// Cores to use; 0 means all. The output's bytes do not depend on it
    #[arg(short = 'j', long, value_name = "N", default_value_t = 0, value_parser = threads)]
    pub threads: usize,
    /// Overwrite the output
    #[arg(long)]
    pub force: bool,
    /// Say nothing but errors and results
    #[arg(short, long)]
    pub quiet: bool,
    /// Say more
    #[arg(short, long, action = clap::ArgAction::Count)]
    pub verbose: u8,
    /// How codes become light: auto, linear, srgb, gamma:G
    #[arg(long, value_name = "T")]
    pub transfer: Option<Transfer>,
}

/// Options of pass one.
#[derive(Debug, Args, Default, PartialEq)]
#[command(next_help_heading = "Estimating")]
pub struct EstimateOptions {
    /// How attenuation is estimated
    #[arg(long, value_enum, value_name = "NAME")]
    pub estimator: Option<Estimator>,
    /// How the strobe's light spreads
    #[arg(long, value_enum, value_name = "NAME")]
    pub spreading: Option<Spreading>,
    /// What is done about where the strobe sits
    #[arg(long, value_enum, value_name = "NAME")]
    pub strobe_position: Option<StrobePosition>,
    /// Whether light that the water scatters back is modelled
    #[arg(long, value_enum, value_name = "WHEN")]
    pub backscatter: Option<Switch>,
    /// Whether attenuation may change along the log
    #[arg(long, value_enum, value_name = "WHEN")]
    pub drift: Option<Switch>,
    /// Standard deviation of attenuation that is enough [1/m]; pass one takes more frames until
    /// then
    #[arg(long, value_name = "STD")]
    pub precision: Option<f64>,
    /// Frames that pass one looks at, at most
    #[arg(long, value_name = "N")]
    pub max_frames: Option<usize>,
}

/// Options of pass two.
#[derive(Debug, Args, Default)]
#[command(next_help_heading = "Correcting and writing")]
pub struct RenderOptions {
    /// What is removed (Fig. 10 of the paper); or a baseline to compare with (Fig. 4)
    #[arg(long, value_enum, value_name = "NAME")]
    pub method: Option<Method>,
    /// Undo lens distortion as well
    #[arg(long)]
    pub rectify: bool,
    /// Add a picture of bits beside each corrected one: clipped, gain capped, off the surface,
    /// unseen beam
    #[arg(long)]
    pub mask: bool,
    /// Container of corrected images
    #[arg(long, value_enum, value_name = "FORMAT")]
    pub image_format: Option<ImageFormat>,
    /// 1 to 100
    #[arg(long, value_name = "Q")]
    pub jpeg_quality: Option<u8>,
    /// 8 (sRGB-coded) or 16 (linear) bits
    #[arg(long, value_name = "BITS")]
    pub depth: Option<u8>,
    /// Encoding of the messages that are added
    #[arg(long, value_enum, value_name = "NAME")]
    pub output_encoding: Option<OutputEncoding>,
    /// Compression of chunks
    #[arg(long, value_enum, value_name = "NAME")]
    pub compression: Option<Compression>,
    /// Leave out the corrected camera's own images
    #[arg(long)]
    pub drop_raw: bool,
    /// Keep only input topics that match; what unwater adds stays
    #[arg(long, value_name = "TOPIC_REGEX")]
    pub only: Option<String>,
}

/// More threads than this no machine has cores for.
const MOST_THREADS: usize = 1024;

/// A number of threads.
fn threads(word: &str) -> std::result::Result<usize, String> {
    let count = word.parse().ok().filter(|n| *n <= MOST_THREADS);
    count.ok_or_else(|| format!("a number from 0 (all cores) to {MOST_THREADS} is expected"))
}

/// Nanoseconds or RFC 3339.
fn moment(word: &str) -> std::result::Result<u64, String> {
    if let Ok(nanos) = word.parse() {
        return Ok(nanos);
    }
    let time = humantime::parse_rfc3339_weak(word).map_err(|_not_a_time| {
        format!("{word:?} is neither nanoseconds nor RFC 3339 (2026-05-01T10:00:00Z)")
    })?;
    let since = time
        .duration_since(std::time::UNIX_EPOCH)
        .map_err(|_early| format!("{word:?} lies before 1970"))?;
    u64::try_from(since.as_nanos()).map_err(|_late| format!("{word:?} is too far off"))
}

/// The stretch that -S and -E leave.
fn window(start: Option<u64>, end: Option<u64>) -> Result<Option<Window>> {
    if (start, end) == (None, None) {
        return Ok(None);
    }
    let window = Window { start: start.unwrap_or(0), end: end.unwrap_or(u64::MAX) };
    if window.start >= window.end {
        Err(Error::Usage("-S must lie before -E".into()))
    } else {
        Ok(Some(window))
    }
}

impl Shared {
    /// Said → meant.
    ///
    /// # Errors
    /// A file cannot be read, or says what cannot be meant.
    pub fn options(&self, estimate: &EstimateOptions, render: &RenderOptions) -> Result<Options> {
        let read = |path: &PathBuf| {
            std::fs::read_to_string(path)
                .map_err(|source| Error::Read { path: path.clone(), source })
        };
        let mut config = match &self.config {
            None => Config::default(),
            Some(path) => Config::from_toml(&read(path)?).map_err(|reason| Error::BadFile {
                path: path.clone(),
                what: "a setting",
                reason,
            })?,
        };
        let rig = match &self.rig {
            None => RigFile::default(),
            Some(path) => {
                let known = "camera dvl strobe width height fx fy cx cy distortion_model \
                             distortion horizontal_field_of_view_deg mount beams janus_angle_deg \
                             azimuths_deg sound_speed_ratio ranges min_range_m max_range_m \
                             bad_values topic path valid_path unit_m medium vignetting flat_field \
                             response full_well_e read_noise_e time_offset_s translation_m \
                             rotation_xyzw roll_pitch_yaw_deg";
                let bad = |reason| Error::BadFile { path: path.clone(), what: "a fact", reason };
                let rig: RigFile = toml::from_str(&read(path)?)
                    .map_err(|e| bad(with_nearest_key(&e, known.split(' '))))?;
                rig.ensure_valid().map_err(bad)?;
                rig
            }
        };
        fn set<T: Copy>(target: &mut T, said: Option<T>) {
            if let Some(said) = said {
                *target = said;
            }
        }
        set(&mut config.light.transfer, self.transfer);
        set(&mut config.estimate.estimator, estimate.estimator);
        set(&mut config.estimate.spreading, estimate.spreading);
        set(&mut config.estimate.strobe_position, estimate.strobe_position);
        set(&mut config.estimate.backscatter, estimate.backscatter);
        set(&mut config.estimate.drift, estimate.drift);
        set(&mut config.estimate.precision_per_m, estimate.precision);
        set(&mut config.estimate.max_frames, estimate.max_frames);
        set(&mut config.render.method, render.method);
        set(&mut config.render.image_format, render.image_format);
        set(&mut config.render.jpeg_quality, render.jpeg_quality);
        set(&mut config.render.depth, render.depth);
        set(&mut config.output.encoding, render.output_encoding);
        set(&mut config.output.compression, render.compression);
        config.render.rectify |= render.rectify;
        config.render.mask |= render.mask;
        config.output.drop_raw |= render.drop_raw;
        if render.only.is_some() {
            config.output.only.clone_from(&render.only);
        }
        config.ensure_valid().map_err(Error::Usage)?;
        let window = window(self.start, self.end)?;
        let selection = Selection {
            camera: self.camera.clone(),
            dvl: self.dvl.clone(),
            strobe_frame: self.strobe_frame.clone(),
        };
        Ok(Options { config, rig, selection, window, threads: self.threads, force: self.force })
    }
}
