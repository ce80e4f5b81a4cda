//! A bar per step on a terminal, with rate and time left, and what it took when it is over; nothing
//! elsewhere.

use std::sync::Mutex;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};

use super::color::Paint;
use super::summary::duration;
use crate::session::{Progress, Step};

/// The bar of the step at hand.
pub struct Bar {
    quiet: bool,
    /// the bar, the step's name and what it counts
    bar: Mutex<Option<(ProgressBar, [&'static str; 2])>>,
}

impl Bar {
    /// Hidden where the user wants quiet; indicatif hides it where stderr is no terminal.
    pub fn new(quiet: bool) -> Self {
        Self { quiet, bar: Mutex::new(None) }
    }

    fn with(&self, act: impl FnOnce(&mut Option<(ProgressBar, [&'static str; 2])>)) {
        if let Ok(mut bar) = self.bar.lock() {
            act(&mut bar);
        }
    }
}

impl Progress for Bar {
    fn begin(&self, step: Step, total: usize) {
        let (name, unit) = match step {
            Step::Estimate => ("pass 1: sampling", "frames"),
            Step::Match => ("pass 1: matching", "pairs"),
            Step::Correct => ("pass 2: correcting", "frames"),
        };
        let paint = Paint::of_stderr();
        let drawn = if paint == Paint::PLAIN { "{wide_bar}" } else { "{wide_bar:.cyan/dim}" };
        let template = format!(
            "{} {drawn} {{pos}}/{{len}} {unit}, {{per_second}}, {{eta}} left",
            paint.name(&format!("{name:<19}"))
        );
        let target =
            if self.quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
        let bar = ProgressBar::with_draw_target(Some(total as u64), target);
        let style = ProgressStyle::with_template(&template)
            .unwrap_or_else(|_no_template| ProgressStyle::default_bar());
        // A rate as the summary has it: 2.4 a second, not 2.4183/s.
        bar.set_style(style.progress_chars("━━─").with_key(
            "per_second",
            |state: &ProgressState, w: &mut dyn std::fmt::Write| {
                let _infallible = write!(w, "{:.1} a second", state.per_sec());
            },
        ));
        self.with(|slot| *slot = Some((bar, [name, unit])));
    }

    fn advance(&self, units: usize) {
        self.with(|slot| slot.iter().for_each(|(b, _)| b.inc(units as u64)));
    }

    fn end(&self) {
        self.with(|slot| {
            let Some((bar, [name, unit])) = slot.take() else { return };
            let (is_seen, took) = (!bar.is_hidden(), bar.elapsed());
            bar.finish_and_clear();
            if is_seen {
                let (done, seconds) = (bar.position(), took.as_secs_f64().max(1e-9));
                let name = Paint::of_stderr().name(&format!("{name:<19}"));
                eprintln!(
                    "{name} {done} {unit} in {}, {:.1} a second",
                    duration(took),
                    done as f64 / seconds
                );
            }
        });
    }
}
