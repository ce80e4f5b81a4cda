//! Which corrected frames are shown on the seafloor in 3-D, and with how many points: few enough
//! that they are a small part of the output.

use std::collections::BTreeSet;

use crate::config::OutputConfig;
use crate::session::{CameraSession, FrameId, FrameRef};

/// Share of the images' bytes that clouds take at most.
const MAX_SHARE: f64 = 0.04;
/// Bytes of a point.
const POINT_BYTES: usize = 16;
/// Fewer points across show nothing.
const MIN_ACROSS: usize = 8;

/// Frames with a cloud.
pub struct Clouds {
    frames: BTreeSet<FrameId>,
    /// points across the image; 0 for no cloud
    pub across: usize,
}

/// Points across and down an image of this size.
pub fn points(across: usize, (width, height): (usize, usize)) -> (usize, usize) {
    let across = across.clamp(1, width.max(1));
    let down = (height as f64 * across as f64 / width.max(1) as f64).round() as usize;
    (across, down.max(1))
}

/// Bytes of a cloud.
fn bytes(across: usize, size: (usize, usize)) -> usize {
    let (across, down) = points(across, size);
    POINT_BYTES * across * down
}

impl Clouds {
    /// Those of a camera. They depend on all frames of the log, so that the parts of a log
    /// (`--shard`) agree.
    pub fn of(session: &CameraSession) -> Self {
        let (survey, config) = (&session.survey, &session.config.output);
        // A corrected image takes about as much as its source.
        let kept = if config.drop_raw { 1 } else { 2 };
        Self::new(&survey.frames, (survey.image_size, kept * survey.all_image_bytes), config)
    }

    /// `images`: bytes of all images of the output.
    fn new(
        frames: &[FrameRef],
        (size, images): ((usize, usize), u64),
        config: &OutputConfig,
    ) -> Self {
        let (wanted, interval_s) = (config.seafloor_points_across, config.seafloor_interval_s);
        if wanted == 0 {
            return Self { frames: BTreeSet::new(), across: 0 };
        }
        if interval_s == 0.0 {
            return Self { frames: frames.iter().map(|frame| frame.id).collect(), across: wanted };
        }
        let allowed = (MAX_SHARE * images as f64) as usize;
        let fits = |across: &usize| bytes(*across, size) <= allowed;
        let across = (MIN_ACROSS..=wanted).rev().find(fits).unwrap_or(MIN_ACROSS.min(wanted));
        let count = (allowed / bytes(across, size)).max(1);
        let span_s = frames.first().zip(frames.last());
        let span_s = span_s.map_or(0.0, |(first, last)| last.stamp.seconds_since(first.stamp));
        let interval_s = interval_s.max(span_s / count as f64);
        let mut chosen = BTreeSet::new();
        let mut last = None;
        for frame in frames {
            let is_due = last.is_none_or(|last| frame.stamp.seconds_since(last) >= interval_s);
            if is_due && chosen.len() < count {
                chosen.insert(frame.id);
                last = Some(frame.stamp);
            }
        }
        Self { frames: chosen, across }
    }

    /// Bytes of all clouds over images of this size.
    pub fn total_bytes(&self, size: (usize, usize)) -> u64 {
        if self.across == 0 { 0 } else { (self.frames.len() * bytes(self.across, size)) as u64 }
    }

    /// Whether a frame has a cloud.
    pub fn has(&self, frame: FrameId) -> bool {
        self.frames.contains(&frame)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::Stamp;

    fn chosen(count: u32, interval_ms: i64, image_bytes: u64, config: &OutputConfig) -> Clouds {
        let frame = |entry: u32| {
            let stamp = Stamp(i64::from(entry) * interval_ms * 1_000_000);
            FrameRef { id: FrameId { block: 0, entry }, stamp, logged: stamp }
        };
        let frames: Vec<FrameRef> = (0..count).map(frame).collect();
        let images = 2 * u64::from(count) * image_bytes;
        Clouds::new(&frames, ((1200, 900), images), config)
    }

    #[test]
    fn clouds_are_at_most_one_a_second_and_a_small_part_of_the_images() {
        let config = OutputConfig::default();
        let bytes_of = |clouds: &Clouds| clouds.frames.len() * bytes(clouds.across, (1200, 900));
        // Large images: every second, at full resolution.
        let large = chosen(100, 250, 1_000_000, &config);
        assert_eq!((large.frames.len(), large.across), (25, 64));
        // Smaller ones: rarer; small logs: coarser.
        for (count, size) in [(100, 40_000), (60, 4_000), (4, 10_000)] {
            let clouds = chosen(count, 500, size, &config);
            let share = bytes_of(&clouds) as f64 / (2.0 * f64::from(count) * size as f64);
            assert!(!clouds.frames.is_empty() && share <= MAX_SHARE, "{count} {size}: {share}");
        }
        let all = OutputConfig { seafloor_interval_s: 0.0, ..config.clone() };
        assert_eq!(chosen(60, 250, 4_000, &all).frames.len(), 60);
        let none = OutputConfig { seafloor_points_across: 0, ..config };
        assert_eq!(chosen(60, 250, 4_000, &none).across, 0);
    }
}
