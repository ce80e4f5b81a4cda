//! Consistency checks: ranges and altitudes, stamps and log times. They report and change nothing.

use super::super::index::ChannelIndex;
use crate::diagnostics::{ClockFact, RangeFact};
use crate::messages::AltitudeCheck;
use crate::stats::median;
use crate::units::Stamp;
use crate::vehicle::{Ping, RangeKind};

/// Fewer messages are no evidence.
const MIN_MESSAGES: usize = 5;
/// Beams nearer to the axis than this make no difference between slant and vertical.
const MAX_COSINE: f64 = 0.98;
/// A clock this far from the recorder's is the device's own (s).
const DEVICE_CLOCK_S: f64 = 60.0;

/// This many equal readings in a row are no measurement.
pub const FROZEN_MESSAGES: usize = 20;

/// The altitude of an instrument with four good beams is cos θ of their mean where they are slant,
/// and the mean itself where they are vertical.
pub fn slant_or_vertical(heights: &[AltitudeCheck]) -> Option<RangeFact> {
    let kind = heights.first()?.kind;
    if heights.len() < MIN_MESSAGES {
        return None;
    }
    let altitude_ratio = median(&heights.iter().map(|h| h.ratio).collect::<Vec<_>>());
    let slant_ratio = median(&heights.iter().map(|h| h.cosine).collect::<Vec<_>>());
    let messages = heights.len();
    if slant_ratio > MAX_COSINE {
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
    let max = ranges.iter().copied().fold(0.0, f64::max);
    let at_max = ranges.iter().filter(|r| **r == max).count();
    if at_max >= FROZEN_MESSAGES && at_max < ranges.len() {
        found.push(RangeFact::RangeLimit { ranges: at_max, range_m: max });
    }
    found
}

/// Stamps that are missing, of another clock, that stand still or run backwards.
pub fn clock(channel: &ChannelIndex, stamps: &[Stamp]) -> Vec<ClockFact> {
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
    use crate::coordinates::Direction;
    use crate::units::{Altitude, SlantRange};
    use crate::vehicle::Beam;

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
        let channel = ChannelIndex {
            count: 10,
            unstamped: 2,
            clock_offset_s: Some(-3.0e8),
            ..ChannelIndex::default()
        };
        let expected = [
            ClockFact::Missing { missing: 2, messages: 10 },
            ClockFact::DeviceClock { offset_s: -3.0e8 },
            ClockFact::Repeated { messages: 1 },
            ClockFact::Backwards { messages: 1 },
        ];
        assert_eq!(clock(&channel, &[Stamp(5), Stamp(5), Stamp(4)]), expected);
        assert!(
            clock(&ChannelIndex { count: 10, unstamped: 10, ..ChannelIndex::default() }, &[])
                .is_empty(),
            "a bare number has no stamp"
        );
    }
}
