//! Pages of corrected logs in headless Chromium, with node and playwright-core (`NODE_PATH`).
use std::path::{Path, PathBuf};
use std::process::Command;

use libtest_mimic::{Failed, Trial};

use crate::program::{CorrectedDive, pages_of_poorer_logs, ran, text};
use crate::support::ensure;

fn in_chromium(pages: &[&Path]) -> Result<(), Failed> {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/report_page.cjs");
    let ran = Command::new("node").arg(script).args(pages).output()?;
    ensure(ran.status.success(), String::from_utf8_lossy(&ran.stderr).into_owned())
}

fn has_chromium() -> bool {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/report_page.cjs");
    Command::new("node").args([script, "--probe"]).output().is_ok_and(|ran| ran.status.success())
}

fn pages_open() -> Result<(), Failed> {
    let made = CorrectedDive::get();
    let page = made.path("opened.html");
    ran(&["report", text(&made.path("out.mcap")), "-o", text(&page), "--force"])?;
    in_chromium(&[&page])?;
    let poorer = pages_of_poorer_logs()?;
    in_chromium(&poorer.iter().map(|(page, _)| page.as_path()).collect::<Vec<_>>())
}

fn pages_of_dives_open(data: &Path) -> Result<(), Failed> {
    let folder = tempfile::tempdir()?;
    let mut pages = Vec::new();
    for log in [
        "rendered/A/A_clear_flat_raw16",
        "stonefish/sf_w020_square_srgb",
        "real/auv_set02",
        "real/auv_set07",
        "real/towed_port",
    ] {
        let name = log.rsplit('/').next().unwrap_or(log);
        let (out, page) = (
            folder.path().join(format!("{name}.mcap")),
            folder.path().join(format!("{name}.html")),
        );
        ran(&["correct", text(&data.join(format!("{log}.mcap"))), "-o", text(&out), "-q"])?;
        ran(&["report", text(&out), "-o", text(&page)])?;
        ensure(
            std::fs::metadata(&page)?.len() < 6 << 20,
            format!("{name}: the page is too large"),
        )?;
        pages.push(page);
    }
    in_chromium(&pages.iter().map(PathBuf::as_path).collect::<Vec<_>>())
}

pub fn trials() -> Vec<Trial> {
    let data = std::env::var_os("UNWATER_DATA").map(PathBuf::from).filter(|d| d.is_dir());
    let has_chromium = has_chromium();
    let no_data = data.is_none();
    let data = data.unwrap_or_default();
    if !has_chromium {
        eprintln!("Chromium, node or playwright-core is missing: no tests in a browser");
    }
    vec![
        Trial::test("browser: pages open", pages_open).with_ignored_flag(!has_chromium),
        Trial::test("browser: pages of the dives open", move || pages_of_dives_open(&data))
            .with_ignored_flag(!has_chromium || no_data),
    ]
}
