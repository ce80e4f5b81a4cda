//! What a survey holds against each other: ranges and altitudes, stamps and log times, pictures and
//! calibrations. It reports and switches nothing.

use crate::diagnostics::{CameraFact, ClockFact, Diagnostic, RangeFact};
use crate::messages::AltitudeCheck;
use crate::recording::Recording;
use crate::units::{SlantRange, Stamp};
use crate::vehicle::{Beam, Camera, Ping, RangeKind, RigFile};

use super::super::index::{ChannelScan, Scan};
use crate::coordinates::Direction;

/// Fewer messages say nothing.
const LEAST_MESSAGES: usize = 5;
/// Beams nearer to the axis than this make no difference between slant and vertical.
const LARGEST_COSINE: f64 = 0.98;
/// A clock this far from the recorder's is the device's own [s].
const DEVICE_CLOCK_S: f64 = 60.0;

/// So many equal readings are no measurement.
const FROZEN_MESSAGES: usize = 20;

/// Seconds that the rig file adds to a topic's stamps.
pub fn offset_s(rig_file: &RigFile, topic: &str) -> f64 {
    rig_file.time_offset_s.get(topic).copied().unwrap_or(0.0)
}

/// The calibration that fits pictures of this size, and whose topic shares most with theirs.
pub fn nearest_calibration(
    recording: &Recording,
    scan: &Scan,
    topic: &str,
    picture: Option<(usize, usize)>,
) -> Option<Camera> {
    let shared =
        |other: &str| other.split('/').zip(topic.split('/')).take_while(|(a, b)| a == b).count();
    let of_log = scan.channels.iter().filter_map(|(id, c)| {
        let name = &recording.channels.get(id)?.topic;
        Some((std::cmp::Reverse(shared(name)), name, c.camera?.for_image_size(picture)?))
    });
    of_log.min_by(|a, b| (a.0, a.1).cmp(&(b.0, b.1))).map(|(_, _, camera)| camera)
}

/// Places of depth pictures become beams, now that calibrations are known.
pub fn depths_to_beams(recording: &Recording, scan: &mut Scan, diagnostics: &mut Vec<Diagnostic>) {
    let with_depths: Vec<u16> =
        scan.channels.iter().filter(|(_, c)| !c.depths.is_empty()).map(|(id, _)| *id).collect();
    for id in with_depths {
        let topic = recording.channels.get(&id).map(|c| c.topic.clone()).unwrap_or_default();
        let size =
            scan.channels.get(&id).and_then(|c| c.depths.first()).map(|d| (d.width, d.height));
        let camera = nearest_calibration(recording, scan, &topic, size);
        let Some(channel) = scan.channels.get_mut(&id) else { continue };
        let Some(camera) = camera.zip(size).and_then(|(c, (w, h))| c.scaled_to(w, h)) else {
            diagnostics.push(Diagnostic::on(&topic, CameraFact::DepthWithoutCalibration));
            continue;
        };
        let depths = std::mem::take(&mut channel.depths);
        for ((ping, _), depth) in channel.pings.iter_mut().zip(depths) {
            let beam = |[u, v, z]: &[f64; 3]| {
                let (x, y) = camera.image_plane(*u, *v)?;
                let direction = Direction::from_vector(nalgebra::Vector3::new(x, y, 1.0))?;
                Some(Beam { direction, range: Some(SlantRange(z * (1.0 + x * x + y * y).sqrt())) })
            };
            ping.beams = depth.samples.iter().filter_map(beam).collect();
        }
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// The altitude of an instrument with four good beams is cos θ of their mean where they are slant,
/// and the mean itself where they are vertical.
pub fn slant_or_vertical(heights: &[AltitudeCheck]) -> Option<RangeFact> {
    let kind = heights.first()?.kind;
    if heights.len() < LEAST_MESSAGES {
        return None;
    }
    let altitude_ratio = median(heights.iter().map(|h| h.ratio).collect());
    let slant_ratio = median(heights.iter().map(|h| h.cosine).collect());
    let messages = heights.len();
    if slant_ratio > LARGEST_COSINE {
        return None;
    }
    if !(0.8 * slant_ratio..=1.2).contains(&altitude_ratio) {
        return Some(RangeFact::ContradictAltitude { altitude_ratio, slant_ratio, messages });
    }
    match (kind, altitude_ratio > (1.0 + slant_ratio) / 2.0) {
        (RangeKind::Slant, true) => {
            Some(RangeFact::LookVertical { altitude_ratio, slant_ratio, messages })
        }
        (RangeKind::Vertical, false) => {
            Some(RangeFact::LookSlant { altitude_ratio, slant_ratio, messages })
        }
        _ => None,
    }
}

/// Altitudes that do not change, and ranges that look like an instrument's limit.
pub fn ranges(pings: &[(Ping, Stamp)]) -> Vec<RangeFact> {
    let mut found = Vec::new();
    let altitudes: Vec<f64> = pings.iter().filter_map(|(p, _)| p.altitude.map(|a| a.0)).collect();
    let still = altitudes.chunk_by(|a, b| a == b).map(<[f64]>::len).max().unwrap_or(0);
    if still >= FROZEN_MESSAGES {
        found.push(RangeFact::AltitudeFrozen { messages: still });
    }
    let ranges: Vec<f64> = pings
        .iter()
        .flat_map(|(p, _)| p.beams.iter().filter_map(|b| b.range.map(|r| r.0)))
        .collect();
    let most = ranges.iter().copied().fold(0.0, f64::max);
    let at_most = ranges.iter().filter(|r| **r == most).count();
    if at_most >= FROZEN_MESSAGES && at_most < ranges.len() {
        found.push(RangeFact::RangeLimit { ranges: at_most, range_m: most });
    }
    found
}

/// Stamps that are missing, of another clock, that stand still or run backwards.
pub fn clock(channel: &ChannelScan, stamps: &[Stamp]) -> Vec<ClockFact> {
    let mut found = Vec::new();
    // A message type without any header is no surprise.
    if channel.unstamped > 0 && (channel.unstamped < channel.count || !channel.frame_id.is_empty())
    {
        found.push(ClockFact::Missing { missing: channel.unstamped, messages: channel.count });
    }
    if let Some(offset_s) = channel.clock_offset_s.filter(|o| o.abs() > DEVICE_CLOCK_S) {
        found.push(ClockFact::DeviceClock { offset_s });
    }
    let pairs = || stamps.iter().zip(stamps.iter().skip(1));
    let (same, back) =
        (pairs().filter(|(a, b)| a == b).count(), pairs().filter(|(a, b)| b < a).count());
    if same > 0 {
        found.push(ClockFact::Repeated { messages: same });
    }
    if back > 0 {
        found.push(ClockFact::Backwards { messages: back });
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::Altitude;

    #[test]
    fn ranges_against_altitude() {
        let heights = |ratio: f64, kind| vec![AltitudeCheck { ratio, cosine: 0.924, kind }; 8];
        assert_eq!(slant_or_vertical(&heights(0.925, RangeKind::Slant)), None);
        assert_eq!(slant_or_vertical(&heights(0.998, RangeKind::Vertical)), None);
        let found = |ratio, kind| slant_or_vertical(&heights(ratio, kind));
        let (slant_ratio, messages) = (0.924, 8);
        let vertical = RangeFact::LookVertical { altitude_ratio: 0.998, slant_ratio, messages };
        assert_eq!(found(0.998, RangeKind::Slant), Some(vertical));
        let slant = RangeFact::LookSlant { altitude_ratio: 0.925, slant_ratio, messages };
        assert_eq!(found(0.925, RangeKind::Vertical), Some(slant));
        let neither = RangeFact::ContradictAltitude { altitude_ratio: 2.0, slant_ratio, messages };
        assert_eq!(found(2.0, RangeKind::Slant), Some(neither));
        assert_eq!(slant_or_vertical(&heights(0.998, RangeKind::Slant)[..3]), None, "too few");
    }

    #[test]
    fn frozen_altitudes_and_limits_are_reported() {
        let pings = |altitude: Option<f64>, range: Option<f64>, n: usize| {
            let beam = range
                .map(|r| Beam { direction: Direction::boresight(), range: Some(SlantRange(r)) });
            vec![
                (
                    Ping {
                        stamp: Stamp(0),
                        beams: beam.into_iter().collect(),
                        altitude: altitude.map(Altitude),
                        velocity_m_per_s: None
                    },
                    Stamp(0)
                );
                n
            ]
        };
        let frozen = ranges(&pings(Some(1.85), None, 30));
        assert_eq!(frozen, [RangeFact::AltitudeFrozen { messages: 30 }]);
        let limited = [pings(None, Some(81.0), 30), pings(None, Some(2.0), 1)].concat();
        assert_eq!(ranges(&limited), [RangeFact::RangeLimit { ranges: 30, range_m: 81.0 }]);
        assert!(ranges(&pings(Some(1.85), Some(2.0), 5)).is_empty());
    }

    #[test]
    fn clocks_that_cannot_be_trusted_are_reported() {
        let channel = ChannelScan {
            count: 10,
            unstamped: 2,
            clock_offset_s: Some(-3.0e8),
            ..ChannelScan::default()
        };
        let expected = [
            ClockFact::Missing { missing: 2, messages: 10 },
            ClockFact::DeviceClock { offset_s: -3.0e8 },
            ClockFact::Repeated { messages: 1 },
            ClockFact::Backwards { messages: 1 },
        ];
        assert_eq!(clock(&channel, &[Stamp(5), Stamp(5), Stamp(4)]), expected);
        assert!(
            clock(&ChannelScan { count: 10, unstamped: 10, ..ChannelScan::default() }, &[])
                .is_empty(),
            "a bare number has no stamp"
        );
    }
}
