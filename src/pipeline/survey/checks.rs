//! What a survey holds against each other: ranges and altitudes, stamps and log times. It reports and switches nothing.

use crate::messages::HeightCheck;
use crate::units::Stamp;
use crate::vehicle::{RangeKind, RigFile};

use super::super::scan::ChannelScan;

/// Fewer messages say nothing.
const LEAST_MESSAGES: usize = 5;
/// Beams nearer to the axis than this make no difference between slant and vertical.
const LARGEST_COSINE: f64 = 0.98;
/// A clock this far from the recorder's is the device's own [s].
const DEVICE_CLOCK_S: f64 = 60.0;

/// Seconds that the rig file adds to a topic's stamps.
pub fn offset_s(rig_file: &RigFile, topic: &str) -> f64 {
    rig_file.time_offset_s.get(topic).copied().unwrap_or(0.0)
}

fn median(mut values: Vec<f64>) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// The altitude of an instrument with four good beams is cos θ of their mean where they are slant, and the mean itself
/// where they are vertical.
pub fn slant_or_vertical(heights: &[HeightCheck]) -> Option<String> {
    let kind = heights.first()?.kind;
    if heights.len() < LEAST_MESSAGES {
        return None;
    }
    let ratio = median(heights.iter().map(|h| h.ratio).collect());
    let cosine = median(heights.iter().map(|h| h.cosine).collect());
    if cosine > LARGEST_COSINE {
        return None;
    }
    let numbers = format!("its altitude is {ratio:.3} of the mean range over {} messages with all beams", heights.len());
    let looks_vertical = ratio > (1.0 + cosine) / 2.0;
    let said = |is: &str| format!("slant ranges give {cosine:.3}, vertical ones 1.000. They are read as {is} and nothing is switched");
    if !(0.8 * cosine..=1.2).contains(&ratio) {
        return Some(format!("{numbers}: it fits neither; {}", said(if kind == RangeKind::Vertical { "vertical" } else { "slant" })));
    }
    match (kind, looks_vertical) {
        (RangeKind::Slant, true) => Some(format!(
            "{numbers}; {}. If the maker's manual says vertical, write `ranges = \"vertical\"` under [dvl] in rig.toml (some drivers call the mean slant range altitude)",
            said("slant")
        )),
        (RangeKind::Vertical, false) => {
            Some(format!("{numbers}; {}. If the maker's manual says slant, write `ranges = \"slant\"` under [dvl] in rig.toml", said("vertical")))
        }
        _ => None,
    }
}

/// Stamps that are missing, of another clock, that stand still or run backwards.
pub fn clock(channel: &ChannelScan, stamps: &[Stamp]) -> Vec<String> {
    let mut found = Vec::new();
    // A message type without any header is no surprise.
    if channel.unstamped > 0 && (channel.unstamped < channel.count || !channel.frame_id.is_empty()) {
        found.push(format!("{} of {} messages have no stamp or one of 0; the log's time is used for them", channel.unstamped, channel.count));
    }
    if let Some(offset) = channel.clock_offset_s.filter(|o| o.abs() > DEVICE_CLOCK_S) {
        found.push(format!("its stamps are {offset:+.1} s from the log's times: a device's own clock"));
    }
    let pairs = || stamps.iter().zip(stamps.iter().skip(1));
    let (same, back) = (pairs().filter(|(a, b)| a == b).count(), pairs().filter(|(a, b)| b < a).count());
    if same > 0 {
        found.push(format!("{same} messages have the stamp of the one before"));
    }
    if back > 0 {
        found.push(format!("{back} messages are stamped earlier than the one before"));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_against_altitude() {
        let heights = |ratio: f64, kind| vec![HeightCheck { ratio, cosine: 0.924, kind }; 8];
        assert_eq!(slant_or_vertical(&heights(0.925, RangeKind::Slant)), None);
        assert_eq!(slant_or_vertical(&heights(0.998, RangeKind::Vertical)), None);
        assert!(slant_or_vertical(&heights(0.998, RangeKind::Slant)).is_some_and(|w| w.contains("ranges = \"vertical\"")));
        assert!(slant_or_vertical(&heights(0.925, RangeKind::Vertical)).is_some_and(|w| w.contains("ranges = \"slant\"")));
        assert!(slant_or_vertical(&heights(2.0, RangeKind::Slant)).is_some_and(|w| w.contains("neither")));
        assert_eq!(slant_or_vertical(&heights(0.998, RangeKind::Slant)[..3]), None, "too few");
    }

    #[test]
    fn clocks_that_cannot_be_trusted_are_told() {
        let channel = ChannelScan { count: 10, unstamped: 2, clock_offset_s: Some(-3.0e8), ..ChannelScan::default() };
        let said = clock(&channel, &[Stamp(5), Stamp(5), Stamp(4)]).join("; ");
        for word in ["2 of 10", "device", "1 messages have the stamp", "1 messages are stamped earlier"] {
            assert!(said.contains(word), "{word}: {said}");
        }
        assert!(clock(&ChannelScan { count: 10, unstamped: 10, ..ChannelScan::default() }, &[]).is_empty(), "a bare number has no stamp");
    }
}
