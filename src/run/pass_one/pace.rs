//! Choice of the frames of pass one, and of the neighbours they are matched with.

use std::collections::BTreeSet;

use crate::session::{CameraSession, FrameRef};
use crate::stats;

/// Consecutive frames in a window; overlap needs neighbours.
const WINDOW_FRAMES: usize = 12;
/// Frames nearer in time share seafloor, pings and altitude, and add no information (s) …
const STEP_S: f64 = 0.5;
/// … but at low altitude the seafloor leaves the image sooner (s per m).
const STEP_S_PER_M: f64 = 0.5;
/// Frames from which interval and altitude are estimated.
const PROBED_FRAMES: usize = 40;
/// Steps of the altitude range per log unit, in the choice of windows: smaller differences decide
/// nothing.
const RANGE_STEPS: f64 = 10.0;

/// Frames of one of several logs, so that all together have no more than `max_frames`: as many of
/// each log, or a window of some logs, evenly spread from the first on.
pub fn share_of_log(max_frames: usize, log: usize, logs: usize) -> usize {
    let windows = (max_frames / WINDOW_FRAMES).max(1);
    if logs <= windows {
        return max_frames / logs.max(1);
    }
    let before = |log: usize| (log * windows).div_ceil(logs);
    if before(log + 1) > before(log) { WINDOW_FRAMES.min(max_frames) } else { 0 }
}

/// Frames that pass one uses, as indices: all, or windows of neighbours. The log is divided into
/// as many parts as there are windows; in each part the window is chosen whose altitude varies
/// most, as that identifies the attenuation. The altitude is NaN where no seafloor is known.
pub fn chosen_frames(altitude_m: &[f64], max_frames: usize) -> BTreeSet<usize> {
    let total = altitude_m.len();
    if total <= max_frames {
        return (0..total).collect();
    }
    let parts = (max_frames / WINDOW_FRAMES).max(1);
    let length = (max_frames / parts).min(total);
    let spread = |first: usize| {
        let altitudes = altitude_m[first..first + length].iter().filter(|a| a.is_finite());
        let (min, max, known) =
            altitudes.fold((f64::INFINITY, 0f64, 0), |(l, m, n), a| (l.min(*a), m.max(*a), n + 1));
        // Frames without a seafloor count against a window.
        let range = ((max / min).ln() * RANGE_STEPS).round() / RANGE_STEPS;
        if known == 0 { 0.0 } else { range * f64::from(known) }
    };
    (0..parts)
        .flat_map(|part| {
            let (begin, end) = (part * total / parts, (part + 1) * total / parts);
            let firsts = (begin..=(end - length).max(begin))
                .step_by(length / 2)
                .map(|first| first.min(total - length));
            let best = firsts.fold((0.0, begin), |best, first| {
                if spread(first) > best.0 { (spread(first), first) } else { best }
            });
            best.1..best.1 + length
        })
        .collect()
}

/// How a camera is thinned out that is fast for the motion of the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pace {
    /// only every n-th frame is considered; fewer are left out where the log is short
    pub step: usize,
    /// considered frames from one to the next that it is matched with
    pub spacing: usize,
}

impl Pace {
    fn new(interval_s: f64, altitude_m: f64, frames: usize, max_frames: usize) -> Self {
        let step_s = STEP_S.min(STEP_S_PER_M * altitude_m);
        let apart = if interval_s > 0.0 { (step_s / interval_s + 0.01) as usize } else { 1 };
        let step = apart.min(frames / max_frames.max(1)).max(1);
        Self { step, spacing: (apart / step).max(1) }
    }

    /// A step that meets both kinds of frames of a camera that lights every other one.
    pub fn odd(self) -> Self {
        Self { step: self.step - usize::from(self.step.is_multiple_of(2)), ..self }
    }

    pub fn of(session: &CameraSession, max_frames: usize) -> Self {
        let frames = &session.survey.frames;
        let mut stamps: Vec<i64> = frames.iter().map(|f| f.stamp.0).collect();
        stamps.sort_unstable();
        let intervals_s: Vec<f64> =
            stamps.windows(2).map(|w| (w[1] - w[0]) as f64 * 1e-9).collect();
        let probed = frames.iter().step_by(frames.len().div_ceil(PROBED_FRAMES).max(1));
        let altitudes_m: Vec<f64> = probed.map(|f| altitude_m(session, f)).collect();
        let interval_s = stats::median(&intervals_s);
        Self::new(interval_s, stats::median(&altitudes_m), frames.len(), max_frames)
    }
}

/// Altitude of the camera over the seafloor (m); NaN where no seafloor is known.
pub fn altitude_m(session: &CameraSession, frame: &FrameRef) -> f64 {
    let plane = session.seafloor(frame.stamp);
    plane.map_or(f64::NAN, |plane| session.flat_view(&plane).camera_altitude_m())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fast_camera_is_thinned_out_where_the_log_is_long() {
        assert_eq!(Pace::new(1.0, 2.0, 4000, 60), Pace { step: 1, spacing: 1 });
        assert_eq!(Pace::new(1.0 / 30.0, 2.0, 40_000, 60), Pace { step: 15, spacing: 1 });
        assert_eq!(Pace::new(0.1, 0.3, 4000, 60), Pace { step: 1, spacing: 1 });
        assert_eq!(
            Pace::new(0.1, 2.0, 400, 400),
            Pace { step: 1, spacing: 5 },
            "all are used, those apart are matched"
        );
        assert_eq!(Pace::new(f64::NAN, 2.0, 1, 60), Pace { step: 1, spacing: 1 });
    }

    #[test]
    fn several_logs_share_the_frames_of_one() {
        let shares = |max_frames: usize, logs: usize| {
            (0..logs).map(|log| share_of_log(max_frames, log, logs)).collect::<Vec<_>>()
        };
        assert_eq!((shares(400, 1), shares(400, 2)), (vec![400], vec![200, 200]));
        for (max_frames, logs) in [(400, 33), (400, 34), (400, 1000), (60, 7), (5, 3)] {
            let shares = shares(max_frames, logs);
            let total: usize = shares.iter().sum();
            assert!(total <= max_frames && 2 * total > max_frames && shares[0] > 0, "{shares:?}");
        }
    }

    #[test]
    fn windows_are_spread_and_bounded() {
        let swing = |frames: usize| {
            (0..frames)
                .map(|i| if (20_000..20_030).contains(&i) { 1.0 + i as f64 % 30.0 } else { 2.0 })
                .collect::<Vec<f64>>()
        };
        assert_eq!(chosen_frames(&swing(10), 400).len(), 10);
        let chosen = chosen_frames(&swing(50_000), 400);
        assert!(chosen.len() <= 400 && chosen.len() > 380, "{}", chosen.len());
        assert!(
            chosen.iter().any(|i| *i < 2000) && chosen.iter().any(|i| *i > 48_000),
            "all of the log is covered"
        );
        assert!(
            (20_000..20_030).filter(|i| chosen.contains(i)).count() >= WINDOW_FRAMES,
            "a change of altitude is covered"
        );
        let runs = chosen.iter().zip(chosen.iter().skip(1)).filter(|(a, b)| **b == **a + 1).count();
        assert!(runs * 10 > chosen.len() * 8, "neighbours stay together");
    }
}
