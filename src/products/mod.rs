//! Products from corrected logs: the report page ([`page`]), one frame under every method
//! ([`sheet`]), a mosaic of the seafloor ([`mosaic`]), a data set of stills for archives
//! ([`data_set`]), one row per dive ([`dive_table`]),
//! and whether a corrected log is what it must be ([`verify`]).
//!
//! Read-only: nothing computed here enters a corrected log.

pub mod data_set;
mod display;
pub mod dive;
pub mod dive_table;
mod messages;
pub mod mosaic;
pub mod page;
mod places;
pub mod sheet;
pub mod verify;

use std::path::Path;

use crate::error::{Error, Result};
use crate::estimate::{FrameSamples, Matchable, matches};
use crate::run::bench::Bench;

/// Writes a file atomically: under a temporary name in its folder, then renamed.
///
/// # Errors
/// The file cannot be written; an existing file is then unchanged.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    let failed = |source| Error::Write { path: path.into(), source };
    let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let temporary = path.with_file_name(format!(".{name}.{}.part", std::process::id()));
    let written =
        std::fs::write(&temporary, bytes).and_then(|()| std::fs::rename(&temporary, path));
    written.map_err(|source| {
        let _removed = std::fs::remove_file(&temporary);
        failed(source)
    })
}

/// Keypoint matches between two frames, as pairs of indices.
fn match_frames(bench: &Bench, a: &FrameSamples, b: &FrameSamples, seed: u64) -> Vec<(u32, u32)> {
    let matching = &bench.session.config.matching;
    let camera = &bench.session.survey.rig.camera;
    let side = camera.width.max(camera.height);
    let reduction = side.div_ceil(matching.detection_side_px).max(1) as f64;
    let inlier = matching.inlier_px * reduction / camera.fx;
    matches(&matchable(a), &matchable(b), matching, inlier, seed)
}

fn matchable(samples: &FrameSamples) -> Matchable<'_> {
    Matchable { keypoints: &samples.keypoints, places: &samples.places }
}
