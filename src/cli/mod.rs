//! The command line: arguments to options, the selected subcommand, messages for people.

mod args;
mod color;
mod commands;
mod output;
mod progress;
mod summary;

use clap::{CommandFactory, Parser, Subcommand};

use crate::error::Result;
use commands::{
    compare, completions, config, correct, estimate, export, import, init, inspect, join, layout,
    man, mosaic, report, table, verify,
};
pub use output::Outcome;

/// Corrects dive logs for attenuation and strobe beam pattern.
///
/// Reads camera and DVL channels from an MCAP recording, estimates attenuation and beam pattern,
/// corrects every image, and writes a new MCAP that Foxglove and rerun play back.
#[derive(Debug, Parser)]
#[command(name = "unwater", version, max_term_width = 110, arg_required_else_help = true)]
pub struct Cli {
    /// the selected subcommand
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Estimate and correct: a dive log in, a corrected log out
    #[command(after_help = "Examples:\n  unwater correct dive.mcap\n  unwater correct dive.mcap \
                            -o clear.mcap --depth 16\n  unwater estimate dive.mcap && unwater \
                            correct dive_2.mcap --model dive.model.json\n  unwater correct \
                            dive_1.mcap dive_2.mcap -o corrected --resume\n\nExit status: 0 \
                            done; 1 failed, nothing written; 2 bad usage; 3 done, with losses \
                            that are listed. Of several logs it is the worst: 1 where one \
                            failed.")]
    Correct(correct::Args),
    /// Pass one alone: write a model that corrects this dive, or others of the same water and
    /// strobe
    #[command(after_help = "Examples:\n  unwater estimate dive.mcap -o model.json\n  unwater \
                            estimate dive_1.mcap dive_2.mcap -o two.model.json")]
    Estimate(estimate::Args),
    /// Show what a log holds, what is missing, and what would be done
    #[command(after_help = "Examples:\n  unwater inspect dive.mcap\n  unwater inspect dive.mcap \
                            --json | jq .plan.camera\n  unwater inspect dive.mcap --clocks")]
    Inspect(inspect::Args),
    /// Write one self-contained page (HTML) about a corrected log: numbers, figures, before and
    /// after
    #[command(after_help = "Examples:\n  unwater report dive.corrected.mcap\n  unwater report \
                            dive.corrected.mcap -o page.html --force")]
    Report(report::Args),
    /// Show one frame under every correction method, labelled, side by side (PNG)
    #[command(after_help = "Examples:\n  unwater compare dive.mcap --frame 12 -o sheet.png\n  \
                            unwater compare dive.mcap --model dive.model.json --at \
                            2025-10-09T08:53:25Z -o moment.png")]
    Compare(compare::Args),
    /// Lay a segment of frames over the seafloor: raw and corrected side by side (PNG), or
    /// georeferenced (GeoTIFF)
    #[command(after_help = "Examples:\n  unwater mosaic dive.corrected.mcap -o mosaic.png\n  \
                            unwater mosaic dive.corrected.mcap -S 2025-10-09T08:53:22Z -E \
                            2025-10-09T08:53:30Z -o segment.png\n\nWith -o MOSAIC.tif a GeoTIFF, \
                            where the log has a position.")]
    Mosaic(mosaic::Args),
    /// Write a data set for archives: corrected stills, lists for other programs, an iFDO record
    #[command(after_help = "Examples:\n  unwater export dive.corrected.mcap -o stills\n\nFor the \
                            iFDO record give --facts and --handle-prefix; docs/report.md lists \
                            the facts.")]
    Export(export::Args),
    /// Check a corrected log: undamaged, nothing of its input missing, and every corrected frame
    /// follows from its raw frame and the model
    #[command(after_help = "Examples:\n  unwater verify dive.corrected.mcap\n  unwater verify \
                            dive.corrected.mcap --against dive.mcap\n\nExit status: 0 as it must \
                            be; 1 something is wrong; 3 nothing wrong was found, but corrected \
                            frames could not be compared.")]
    Verify(verify::Args),
    /// Join the parts that `correct --shard` wrote: the bytes of the undivided run
    #[command(
        after_help = "Examples:\n  unwater estimate dive.mcap -o dive.model.json --force\n  \
                            unwater correct dive.mcap --model dive.model.json --shard 1/2\n  \
                            unwater correct dive.mcap --model dive.model.json --shard 2/2\n  \
                            unwater join dive.shard-1-of-2.mcap dive.shard-2-of-2.mcap -o \
                            joined.mcap"
    )]
    Join(join::Args),
    /// Print one row per corrected dive: frames, altitude, attenuation, whether it is identified
    #[command(after_help = "Examples:\n  unwater table dive.corrected.mcap\n  unwater table \
                            dive.corrected.mcap --csv > dives.csv")]
    Table(table::Args),
    /// Make a log of a folder of still images and a navigation table
    #[command(
        after_help = "Examples:\n  unwater import stills/images --table stills/images.csv -o \
                            stills.mcap --horizontal-fov 45\n\nThe columns are found by their \
                            names; docs/cruise.md lists them."
    )]
    Import(import::Args),
    /// Write a commented rig file with the facts of the log; what is missing is marked to be
    /// filled in
    #[command(after_help = "Examples:\n  unwater init dive.mcap -o rig.toml\n  unwater correct \
                            dive.mcap --rig rig.toml -o by_rig.mcap")]
    Init(init::Args),
    /// Print every setting with its effective value, unit and reason
    #[command(after_help = "Examples:\n  unwater config > unwater.toml\n  unwater config \
                            --config unwater.toml --depth 16")]
    Config(config::Args),
    /// Write a layout for Foxglove, or a script that opens rerun, with this log's topics laid out
    #[command(after_help = "Examples:\n  unwater layout dive.corrected.mcap --foxglove\n  \
                            unwater layout dive.corrected.mcap --rerun   # then: python \
                            dive.corrected.rerun.py")]
    Layout(layout::Args),
    /// Print a completion script for your shell
    #[command(after_help = "Examples:\n  unwater completions bash > unwater.bash\n  unwater \
                            completions zsh > _unwater")]
    Completions(completions::Args),
    /// Write man pages, one for each command
    #[command(after_help = "Example:\n  unwater man man1")]
    Man(man::Args),
}

impl Cli {
    /// Runs the selected subcommand. Results go to stdout, everything else to stderr.
    ///
    /// # Errors
    /// What went wrong, with the remedy.
    pub fn run(&self) -> Result<Outcome> {
        match &self.command {
            Command::Correct(args) => correct::run(args),
            Command::Estimate(args) => estimate::run(args),
            Command::Inspect(args) => inspect::run(args),
            Command::Import(args) => import::run(args),
            Command::Init(args) => init::run(args),
            Command::Report(args) => report::run(args),
            Command::Compare(args) => compare::run(args),
            Command::Mosaic(args) => mosaic::run(args),
            Command::Export(args) => export::run(args),
            Command::Verify(args) => verify::run(args),
            Command::Join(args) => join::run(args),
            Command::Table(args) => table::run(args),
            Command::Config(args) => config::run(args),
            Command::Layout(args) => layout::run(args),
            Command::Completions(args) => completions::run(args, Self::command()),
            Command::Man(args) => man::run(args, Self::command()),
        }
    }
}
