//! Tests that need what is not in this repository: dives (`UNWATER_DATA`), the viewers' libraries
//! (`tests/playback/setup.sh`), Python's MCAP readers, headless Chromium. What is missing is found
//! out when the tests start, and the tests that need it are reported as ignored. Rust's own harness
//! cannot do that, libtest-mimic can.
#![allow(clippy::unwrap_used)]

#[path = "../it/support/mod.rs"]
mod support;

#[path = "../it/program.rs"]
mod program;

mod browser;
mod cruise;
mod dives;
mod playback;

fn main() {
    let arguments = libtest_mimic::Arguments::from_args();
    let trials = [browser::trials(), cruise::trials(), dives::trials(), playback::trials()];
    let trials = trials.into_iter().flatten().collect();
    libtest_mimic::run(&arguments, trials).exit();
}
