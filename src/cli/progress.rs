//! A bar per step on a terminal, with rate and time left; nothing elsewhere.

use std::sync::Mutex;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::pipeline::{Progress, Step};

/// The bar of the step at hand.
pub struct Bar {
    quiet: bool,
    bar: Mutex<Option<ProgressBar>>,
}

impl Bar {
    /// Hidden where the user wants quiet; indicatif hides it where stderr is no terminal.
    pub fn new(quiet: bool) -> Self {
        Self { quiet, bar: Mutex::new(None) }
    }

    fn with(&self, act: impl FnOnce(&mut Option<ProgressBar>)) {
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
        let template = format!("{name:<19} {{wide_bar}} {{pos}}/{{len}} {unit}, {{per_sec:.1}}, {{eta}} left");
        let target = if self.quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
        let bar = ProgressBar::with_draw_target(Some(total as u64), target);
        bar.set_style(ProgressStyle::with_template(&template).unwrap_or_else(|_no_template| ProgressStyle::default_bar()));
        self.with(|slot| *slot = Some(bar));
    }

    fn advance(&self, units: usize) {
        self.with(|slot| slot.iter().for_each(|b| b.inc(units as u64)));
    }

    fn end(&self) {
        self.with(|slot| slot.take().iter().for_each(ProgressBar::finish_and_clear));
    }
}
