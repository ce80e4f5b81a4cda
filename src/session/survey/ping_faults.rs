//! Pings that are no measurements of their own: all beams equal, and the same ping again and again.

use super::checks::FROZEN_MESSAGES;
use crate::diagnostics::RangeFact;
use crate::messages::AltitudeCheck;
use crate::stats::median;
use crate::units::Altitude;
use crate::vehicle::Ping;

/// Share of the pings with several returns whose ranges are all equal, from which on the instrument
/// is taken to send one number in several copies.
const MIN_EQUAL_SHARE: f64 = 0.9;
/// Fewer pings are no evidence.
const MIN_PINGS: usize = 5;
/// Readings of this resolution and coarser may repeat by chance (m).
const COARSE_M: f64 = 0.01;
/// Fine readings that repeat this often in a row are one and the same.
const MIN_REPEATED: usize = 5;

/// Ranges of the beams with a return (m).
fn ranges(ping: &Ping) -> impl Iterator<Item = f64> + '_ {
    ping.beams.iter().filter_map(|beam| beam.range.map(|range| range.0))
}

/// Reads one number in several copies as the altitude it is: turns beams that are always all equal
/// into altitudes.
pub fn take_equal_beams(pings: &mut [Ping], checks: &[AltitudeCheck]) -> Option<RangeFact> {
    let several: Vec<&Ping> = pings.iter().filter(|p| p.returns() >= 3).collect();
    let is_equal = |ping: &&&Ping| {
        let first = ranges(ping).next();
        ranges(ping).all(|range| Some(range) == first)
    };
    let equal = several.iter().filter(is_equal).count();
    if equal < MIN_PINGS || (equal as f64) < MIN_EQUAL_SHARE * several.len() as f64 {
        return None;
    }
    // A slant range of level seafloor, unless the message's own altitude says otherwise.
    let stated = median(&checks.iter().map(|c| c.ratio).collect::<Vec<_>>());
    for ping in pings.iter_mut() {
        let count = ping.returns() as f64;
        let axis: nalgebra::Vector3<f64> = ping.beams.iter().map(|b| b.direction.vector()).sum();
        let cosine = axis.norm() / ping.beams.len().max(1) as f64;
        let ratio = if (0.8 * cosine..1.2).contains(&stated) { stated } else { cosine };
        let mean = ranges(ping).sum::<f64>() / count;
        ping.altitude = (count > 0.0).then_some(Altitude(mean * ratio)).or(ping.altitude);
        ping.beams.clear();
    }
    Some(RangeFact::EqualBeams { pings: equal })
}

/// Removes the ranges of pings that repeat the one before to the last digit, several times in a
/// row. The pings are in the order of time.
pub fn drop_repeated(pings: &mut [Ping]) -> Option<RangeFact> {
    let readings: Vec<Vec<Option<f64>>> = pings
        .iter()
        .map(|p| {
            let beams = p.beams.iter().map(|b| b.range.map(|r| r.0));
            beams.chain([p.altitude.map(|a| a.0)]).collect()
        })
        .collect();
    let is_fine = |range: &f64| {
        let steps = range / COARSE_M;
        (steps - steps.round()).abs() > 1e-3
    };
    let (mut first, mut dropped) = (0, 0);
    for run in readings.chunk_by(|a, b| a == b) {
        let has_fine = run[0].iter().flatten().any(is_fine);
        let least = if has_fine { MIN_REPEATED } else { FROZEN_MESSAGES };
        if run.len() >= least && run[0].iter().any(Option::is_some) {
            for ping in &mut pings[first + 1..first + run.len()] {
                ping.beams.iter_mut().for_each(|beam| beam.range = None);
                ping.altitude = None;
            }
            dropped += run.len() - 1;
        }
        first += run.len();
    }
    (dropped > 0).then_some(RangeFact::Repeated { pings: dropped })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::{SlantRange, Stamp};
    use crate::vehicle::{Beam, JanusArray};

    fn pings(ranges: impl Fn(usize) -> [f64; 4]) -> Vec<Ping> {
        let directions = JanusArray::named("waterlinked-a50").expect("known").directions();
        let ping = |i: usize| Ping {
            stamp: Stamp(i as i64),
            beams: directions
                .iter()
                .zip(ranges(i))
                .map(|(d, r)| Beam { direction: *d, range: Some(SlantRange(r)) })
                .collect(),
            altitude: None,
            velocity_m_per_s: None,
        };
        (0..40).map(ping).collect()
    }

    #[test]
    fn one_number_in_four_copies_is_an_altitude() {
        let mut copies = pings(|i| [2.0 + 0.011 * i as f64; 4]);
        let fact = take_equal_beams(&mut copies, &[]);
        assert_eq!(fact, Some(RangeFact::EqualBeams { pings: 40 }));
        let altitude = copies[0].altitude.expect("an altitude").0;
        assert!((altitude - 2.0 * 22.5f64.to_radians().cos()).abs() < 1e-9, "{altitude}");
        // Level seafloor now and then is no reason.
        let mut level = pings(|i| [2.0, 2.0, 2.0, 2.0 + 0.01 * (i % 3) as f64]);
        assert_eq!(take_equal_beams(&mut level, &[]), None);
        assert_eq!(level[0].returns(), 4);
    }

    #[test]
    fn repeated_pings_are_lost_and_coarse_ones_may_repeat() {
        let at = |i: usize| if (10..20).contains(&i) { 10 } else { i };
        let mut frozen = pings(|i| [1.9173, 2.0, 2.1, 2.2].map(|r| r + 0.0123 * at(i) as f64));
        assert_eq!(drop_repeated(&mut frozen), Some(RangeFact::Repeated { pings: 9 }));
        assert_eq!((frozen[10].returns(), frozen[11].returns(), frozen[20].returns()), (4, 0, 4));
        let mut coarse = pings(|i| [1.9, 2.0, 2.1, 2.2].map(|r| r + 0.01 * at(i) as f64));
        assert_eq!(drop_repeated(&mut coarse), None);
    }
}
