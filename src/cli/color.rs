//! Colours for people at a terminal; plain text for files, pipes and those who set `NO_COLOR`.

use std::io::IsTerminal;

/// Whether words are coloured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Paint {
    on: bool,
}

impl Paint {
    /// No colours.
    pub const PLAIN: Self = Self { on: false };

    /// For results.
    pub fn of_stdout() -> Self {
        Self { on: std::io::stdout().is_terminal() && is_wanted() }
    }

    /// For diagnostics.
    pub fn of_stderr() -> Self {
        Self { on: std::io::stderr().is_terminal() && is_wanted() }
    }

    fn with(self, code: &str, words: &str) -> String {
        if self.on { format!("\x1b[{code}m{words}\x1b[0m") } else { words.into() }
    }

    /// What a line is about.
    pub fn name(self, words: &str) -> String {
        self.with("2", words)
    }

    /// What to look at first.
    pub fn strong(self, words: &str) -> String {
        self.with("1", words)
    }

    /// As it should be.
    pub fn good(self, words: &str) -> String {
        self.with("32", words)
    }

    /// To be read.
    pub fn warning(self, words: &str) -> String {
        self.with("33", words)
    }

    /// Red, green and blue of a camera's bands.
    pub fn band(self, band: usize, words: &str) -> String {
        self.with(["31", "32", "34"].get(band).copied().unwrap_or("0"), words)
    }
}

/// <https://no-color.org>, and terminals that know no colours.
fn is_wanted() -> bool {
    let is_set = |name: &str| std::env::var_os(name).is_some_and(|v| !v.is_empty());
    !is_set("NO_COLOR") && std::env::var_os("TERM").is_none_or(|t| t != "dumb")
}
