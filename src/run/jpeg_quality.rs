//! Quality of corrected images where the source is JPEG: that of the source, or so much lower that
//! the corrected images are hardly larger. Light that is raised brings up the noise of the source,
//! whose bytes show no more of the seafloor.

use std::collections::BTreeSet;

use super::camera_model::CameraModel;
use super::corrector::Corrector;
use super::prepared_model::Rendering;
use crate::config::JpegQuality;
use crate::error::Result;
use crate::image::{Container, encode};
use crate::parallel::Threads;
use crate::recording::{FrameId, Message};
use crate::session::CameraSession;

/// Frames that are encoded to see how large they are.
const PROBED: usize = 4;
/// Bytes of the corrected images over those of their sources, at most.
pub const MAX_GROWTH: f64 = 1.03;
/// Qualities below that of the source that are probed; sizes are linear between them.
const BELOW: [u8; 3] = [0, 10, 20];

/// The quality of a run's corrected images: the one that is set, or one that fits this log.
///
/// # Errors
/// The log cannot be read.
pub fn jpeg_quality(
    session: &CameraSession,
    model: &CameraModel,
    rendering: Rendering<'_>,
    threads: &Threads,
) -> Result<u8> {
    let (survey, chosen) = (&session.survey, session.config.render.jpeg_quality);
    let highest = chosen.for_source(survey.jpeg_quality);
    if chosen != JpegQuality::Auto || survey.jpeg_quality.is_none() {
        return Ok(highest);
    }
    let corrector = Corrector::new(session, model, rendering);
    let at = |k: usize| survey.frames.get((2 * k + 1) * survey.frames.len() / (2 * PROBED));
    let probed: BTreeSet<FrameId> = (0..PROBED).filter_map(|k| Some(at(k)?.id)).collect();
    let sizes = |message: Message| sizes(session, &corrector, &message, highest);
    let mut total = [0; 1 + BELOW.len()];
    session.for_frames(&probed, threads, sizes, |sizes| {
        let sizes = sizes.unwrap_or_default();
        total.iter_mut().zip(sizes).for_each(|(total, size)| *total += size);
        Ok(())
    })?;
    // Images that the input's chunks compress further count as what they take there.
    let taken = session.recording.length() as f64 / survey.all_image_bytes.max(1) as f64;
    let [source, at_qualities @ ..] = total.map(|bytes| bytes as f64);
    Ok(fitting(highest, at_qualities, MAX_GROWTH * taken.min(1.0) * source))
}

/// Bytes of a frame's source, and of its corrected image at each quality.
fn sizes(
    session: &CameraSession,
    corrector: &Corrector<'_>,
    message: &Message,
    highest: u8,
) -> Option<[usize; 1 + BELOW.len()]> {
    let image = session.read(message).ok()?;
    let frame = session.frame(&image, Vec::new()).ok()?;
    let corrected = corrector.correct(&frame, Vec::new()).ok()?;
    let is_subsampled = frame.pixels.coding.container == Container::Jpeg { subsampled: true };
    let mut sizes = [message.data().len(); 1 + BELOW.len()];
    for (size, below) in sizes[1..].iter_mut().zip(BELOW) {
        let quality = highest.saturating_sub(below).max(1);
        let (samples, shape) = (&corrected.samples, corrected.shape);
        *size = encode::jpeg(samples, shape, quality, is_subsampled).ok()?.len();
    }
    Some(sizes)
}

/// The highest quality whose images take at most so many bytes, of those that were probed and those
/// between them; the lowest where none does.
fn fitting(highest: u8, sizes: [f64; BELOW.len()], allowed: f64) -> u8 {
    let size = |below: u8| {
        let k = BELOW.windows(2).position(|pair| below <= pair[1]).unwrap_or(BELOW.len() - 2);
        let share = f64::from(below - BELOW[k]) / f64::from(BELOW[k + 1] - BELOW[k]);
        sizes[k] + share * (sizes[k + 1] - sizes[k])
    };
    let lowest = BELOW[BELOW.len() - 1];
    let below = (0..=lowest).find(|below| size(*below) <= allowed).unwrap_or(lowest);
    highest.saturating_sub(below).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quality_falls_no_further_than_the_size_asks_for() {
        let sizes = [1500.0, 1000.0, 800.0];
        let at = |allowed: f64| fitting(90, sizes, allowed);
        assert_eq!([at(2000.0), at(1500.0), at(1499.0), at(1000.0)], [90, 90, 89, 80]);
        assert_eq!([at(900.0), at(800.0), at(10.0)], [75, 70, 70]);
        assert_eq!(fitting(5, sizes, 10.0), 1);
    }
}
