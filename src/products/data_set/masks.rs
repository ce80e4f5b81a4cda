//! Masks for COLMAP: which pixels of a still may have keypoints. From the masks of the log
//! (`--mask`).

use std::collections::BTreeMap;
use std::path::Path;

use super::super::dive::{CameraLog, CorrectedLog};
use super::super::messages::messages_by_id;
use super::super::write_whole;
use super::still::{Still, file_of};
use crate::correct::mask::{CAPPED, CLIPPED, OFF_SURFACE, OUTSIDE};
use crate::error::{Error, Result};
use crate::image::{ImageShape, encode};

/// In the folder of the data set.
pub const FOLDER: &str = "colmap/masks";
/// Pixels without keypoints: their light is not that of the seafloor, or not measured.
const LEFT_OUT: u8 = CLIPPED | CAPPED | OFF_SURFACE | OUTSIDE;

/// Writes `colmap/masks/NAME.png` (0 where a pixel is left out, else 255) for every still whose
/// mask the log has.
///
/// # Errors
/// The log cannot be read, or a file not written.
pub fn write(
    log: &CorrectedLog,
    camera: &CameraLog,
    stills: &[Still<'_>],
    folder: &Path,
) -> Result<()> {
    let records = log.mask_records(camera);
    if records.is_empty() {
        return Ok(());
    }
    let target = folder.join(FOLDER);
    std::fs::create_dir_all(&target)
        .map_err(|source| Error::Write { path: target.clone(), source })?;
    let names: BTreeMap<usize, &str> = stills.iter().map(|s| (s.index, s.name.as_str())).collect();
    let ids = records.keys().copied().collect();
    for message in messages_by_id(&log.scanned.recording, &ids) {
        let message = message?;
        let Some(name) = records.get(&message.id).and_then(|index| names.get(index)) else {
            continue;
        };
        let mask = file_of(log, &message)
            .and_then(|(file, _)| inverted(&file))
            .map_err(|reason| log.bad("a mask", reason))?;
        // COLMAP looks for the image's whole name, and .png.
        write_whole(&target.join(format!("{name}.png")), &mask)?;
    }
    Ok(())
}

/// From flags to a mask.
fn inverted(file: &[u8]) -> std::result::Result<Vec<u8>, String> {
    let flags = image::load_from_memory(file).map_err(|e| e.to_string())?.into_luma8();
    let (width, height) = (flags.width() as usize, flags.height() as usize);
    let used = |flags: &u8| if flags & LEFT_OUT == 0 { 255 } else { 0 };
    let mask: Vec<u8> = flags.as_raw().iter().map(used).collect();
    encode::png(&mask, ImageShape { width, height, bands: 1 }, 8)
}
