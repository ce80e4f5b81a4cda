//! What a survey holds against each other: ranges and altitudes, stamps and log times, pictures and
//! calibrations. It reports and switches nothing.

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
pub fn depths_to_beams(recording: &Recording, scan: &mut Scan, warnings: &mut Vec<String>) {
    let with_depths: Vec<u16> =
        scan.channels.iter().filter(|(_, c)| !c.depths.is_empty()).map(|(id, _)| *id).collect();
    for id in with_depths {
        let topic = recording.channels.get(&id).map(|c| c.topic.clone()).unwrap_or_default();
        let size =
            scan.channels.get(&id).and_then(|c| c.depths.first()).map(|d| (d.width, d.height));
        let camera = nearest_calibration(recording, scan, &topic, size);
        let Some(channel) = scan.channels.get_mut(&id) else { continue };
        let Some(camera) = camera.zip(size).and_then(|(c, (w, h))| c.scaled_to(w, h)) else {
            warnings.push(format!(
                "{topic}: depth pictures without a calibration that fits them; they are not used"
            ));
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
pub fn slant_or_vertical(heights: &[AltitudeCheck]) -> Option<String> {
    let kind = heights.first()?.kind;
    if heights.len() < LEAST_MESSAGES {
        return None;
    }
    let ratio = median(heights.iter().map(|h| h.ratio).collect());
    let cosine = median(heights.iter().map(|h| h.cosine).collect());
    if cosine > LARGEST_COSINE {
        return None;
    }
    let numbers = format!(
        "its altitude is {ratio:.3} of the mean range over {} messages with all beams",
        heights.len()
    );
    let looks_vertical = ratio > (1.0 + cosine) / 2.0;
    let said = |is: &str| {
        format!(
            "slant ranges give {cosine:.3}, vertical ones 1.000. They are read as {is} and \
             nothing is switched"
        )
    };
    if !(0.8 * cosine..=1.2).contains(&ratio) {
        return Some(format!(
            "{numbers}: it fits neither; {}",
            said(if kind == RangeKind::Vertical { "vertical" } else { "slant" })
        ));
    }
    match (kind, looks_vertical) {
        (RangeKind::Slant, true) => Some(format!(
            "{numbers}; {}. If the maker's manual says vertical, write `ranges = \"vertical\"` \
             under [dvl] in rig.toml (some drivers call the mean slant range altitude)",
            said("slant")
        )),
        (RangeKind::Vertical, false) => Some(format!(
            "{numbers}; {}. If the maker's manual says slant, write `ranges = \"slant\"` under \
             [dvl] in rig.toml",
            said("vertical")
        )),
        _ => None,
    }
}

/// Altitudes that stand still, and ranges that look like an instrument's limit.
pub fn ranges(pings: &[(Ping, Stamp)]) -> Vec<String> {
    let mut found = Vec::new();
    let altitudes: Vec<f64> = pings.iter().filter_map(|(p, _)| p.altitude.map(|a| a.0)).collect();
    let still = altitudes.chunk_by(|a, b| a == b).map(<[f64]>::len).max().unwrap_or(0);
    if still >= FROZEN_MESSAGES {
        found.push(format!(
            "its altitude stands still for {still} messages: many drivers freeze it at the last \
             good value"
        ));
    }
    let ranges: Vec<f64> = pings
        .iter()
        .flat_map(|(p, _)| p.beams.iter().filter_map(|b| b.range.map(|r| r.0)))
        .collect();
    let most = ranges.iter().copied().fold(0.0, f64::max);
    let at_most = ranges.iter().filter(|r| **r == most).count();
    if at_most >= FROZEN_MESSAGES && at_most < ranges.len() {
        found.push(format!(
            "{at_most} ranges are exactly {most} m, the largest of all: if that is the \
             instrument's limit and means no echo, write max_range_m = {most} under [dvl] in \
             rig.toml"
        ));
    }
    found
}

/// Stamps that are missing, of another clock, that stand still or run backwards.
pub fn clock(channel: &ChannelScan, stamps: &[Stamp]) -> Vec<String> {
    let mut found = Vec::new();
    // A message type without any header is no surprise.
    if channel.unstamped > 0 && (channel.unstamped < channel.count || !channel.frame_id.is_empty())
    {
        found.push(format!(
            "{} of {} messages have no stamp or one of 0; the log's time is used for them",
            channel.unstamped, channel.count
        ));
    }
    if let Some(offset) = channel.clock_offset_s.filter(|o| o.abs() > DEVICE_CLOCK_S) {
        found.push(format!(
            "its stamps are {offset:+.1} s from the log's times: a device's own clock"
        ));
    }
    let pairs = || stamps.iter().zip(stamps.iter().skip(1));
    let (same, back) =
        (pairs().filter(|(a, b)| a == b).count(), pairs().filter(|(a, b)| b < a).count());
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
    use crate::units::Altitude;

    #[test]
    fn ranges_against_altitude() {
        let heights = |ratio: f64, kind| vec![AltitudeCheck { ratio, cosine: 0.924, kind }; 8];
        assert_eq!(slant_or_vertical(&heights(0.925, RangeKind::Slant)), None);
        assert_eq!(slant_or_vertical(&heights(0.998, RangeKind::Vertical)), None);
        assert!(
            slant_or_vertical(&heights(0.998, RangeKind::Slant))
                .is_some_and(|w| w.contains("ranges = \"vertical\""))
        );
        assert!(
            slant_or_vertical(&heights(0.925, RangeKind::Vertical))
                .is_some_and(|w| w.contains("ranges = \"slant\""))
        );
        assert!(
            slant_or_vertical(&heights(2.0, RangeKind::Slant))
                .is_some_and(|w| w.contains("neither"))
        );
        assert_eq!(slant_or_vertical(&heights(0.998, RangeKind::Slant)[..3]), None, "too few");
    }

    #[test]
    fn frozen_altitudes_and_limits_are_told() {
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
        assert!(ranges(&pings(Some(1.85), None, 30))[0].contains("stands still"));
        let limited = [pings(None, Some(81.0), 30), pings(None, Some(2.0), 1)].concat();
        assert!(ranges(&limited)[0].contains("max_range_m = 81"));
        assert!(ranges(&pings(Some(1.85), Some(2.0), 5)).is_empty());
    }

    #[test]
    fn clocks_that_cannot_be_trusted_are_told() {
        let channel = ChannelScan {
            count: 10,
            unstamped: 2,
            clock_offset_s: Some(-3.0e8),
            ..ChannelScan::default()
        };
        let said = clock(&channel, &[Stamp(5), Stamp(5), Stamp(4)]).join("; ");
        for word in
            ["2 of 10", "device", "1 messages have the stamp", "1 messages are stamped earlier"]
        {
            assert!(said.contains(word), "{word}: {said}");
        }
        assert!(
            clock(&ChannelScan { count: 10, unstamped: 10, ..ChannelScan::default() }, &[])
                .is_empty(),
            "a bare number has no stamp"
        );
    }
}
