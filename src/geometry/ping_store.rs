//! Compact storage of all pings of a log: hours of diving have hundreds of thousands, and their
//! beam directions repeat.

use nalgebra::Vector3;

use crate::coordinates::{Direction, Dvl};
use crate::units::{Altitude, SlantRange, Stamp};
use crate::vehicle::{Beam, Ping};

/// Number of recent direction sets that a ping is compared with; drivers that send beams one by one
/// cycle through several.
const SETS_COMPARED: usize = 8;

/// One ping; missing values are NaN.
#[derive(Clone, Debug)]
struct Packed {
    stamp: Stamp,
    /// indices of the first range and the first direction, and the number of both
    first_range: u32,
    first_direction: u32,
    beams: u32,
    altitude_m: f64,
    velocity_m_per_s: Vector3<f64>,
}

/// Pings in time order: 56 bytes each and 8 per beam, against 240 for a [`Ping`] of four beams.
#[derive(Clone, Debug, Default)]
pub struct PingStore {
    pings: Vec<Packed>,
    ranges_m: Vec<f64>,
    directions: Vec<Direction<Dvl>>,
}

impl PingStore {
    /// Pings in any order.
    pub fn new(mut pings: Vec<Ping>) -> Self {
        pings.sort_by_key(|p| p.stamp);
        let mut log = Self { pings: Vec::with_capacity(pings.len()), ..Self::default() };
        let mut sets: Vec<(u32, u32)> = Vec::new();
        for ping in pings {
            let same = |(first, beams): &&(u32, u32)| {
                let set = log
                    .directions
                    .get(*first as usize..(first + beams) as usize)
                    .unwrap_or_default();
                set.iter().eq(ping.beams.iter().map(|b| &b.direction))
            };
            let existing = sets.iter().rev().take(SETS_COMPARED).find(same).copied();
            let (first_direction, beams) = existing.unwrap_or_else(|| {
                let set = (log.directions.len() as u32, ping.beams.len() as u32);
                log.directions.extend(ping.beams.iter().map(|b| b.direction));
                sets.push(set);
                set
            });
            log.pings.push(Packed {
                stamp: ping.stamp,
                first_range: log.ranges_m.len() as u32,
                first_direction,
                beams,
                altitude_m: ping.altitude.map_or(f64::NAN, |a| a.0),
                velocity_m_per_s: ping.velocity_m_per_s.unwrap_or(Vector3::repeat(f64::NAN)),
            });
            log.ranges_m.extend(ping.beams.iter().map(|b| b.range.map_or(f64::NAN, |r| r.0)));
        }
        log.ranges_m.shrink_to_fit();
        log
    }

    /// Number of pings.
    pub fn len(&self) -> usize {
        self.pings.len()
    }

    /// Time of the `i`-th ping.
    pub fn stamp(&self, i: usize) -> Stamp {
        self.pings[i].stamp
    }

    /// Number of pings before `stamp`.
    pub fn before(&self, stamp: Stamp) -> usize {
        self.pings.partition_point(|p| p.stamp < stamp)
    }

    /// The `i`-th ping.
    pub fn get(&self, i: usize) -> Ping {
        let p = &self.pings[i];
        let part = |first: u32| first as usize..(first + p.beams) as usize;
        let ranges = self.ranges_m[part(p.first_range)]
            .iter()
            .map(|r| Some(SlantRange(*r)).filter(|r| !r.0.is_nan()));
        let directions = self.directions[part(p.first_direction)].iter();
        Ping {
            stamp: p.stamp,
            beams: directions
                .zip(ranges)
                .map(|(direction, range)| Beam { direction: *direction, range })
                .collect(),
            altitude: Some(Altitude(p.altitude_m)).filter(|a| !a.0.is_nan()),
            velocity_m_per_s: Some(p.velocity_m_per_s).filter(|v| !v.x.is_nan()),
        }
    }

    /// Number of returns of the `i`-th ping.
    pub fn returns(&self, i: usize) -> usize {
        let p = &self.pings[i];
        self.ranges_m[p.first_range as usize..(p.first_range + p.beams) as usize]
            .iter()
            .filter(|r| !r.is_nan())
            .count()
    }

    /// All pings, in time order.
    pub fn iter(&self) -> impl Iterator<Item = Ping> + '_ {
        (0..self.len()).map(|i| self.get(i))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pings_are_restored_and_directions_stored_once() {
        let direction =
            |x: f64| Direction::from_vector(Vector3::new(x, 0.1, 1.0)).expect("a direction");
        let beam = |x: f64, range: Option<f64>| Beam {
            direction: direction(x),
            range: range.map(SlantRange),
        };
        let ping = |t: i64, beams: Vec<Beam>, altitude: Option<f64>, v: Option<f64>| Ping {
            stamp: Stamp(t),
            beams,
            altitude: altitude.map(Altitude),
            velocity_m_per_s: v.map(|x| Vector3::new(x, 0.0, -x)),
        };
        let four = |t: i64| {
            ping(
                t,
                vec![
                    beam(0.4, Some(t as f64 + 0.1)),
                    beam(-0.4, None),
                    beam(0.2, Some(2.0)),
                    beam(0.0, Some(3.0)),
                ],
                None,
                Some(0.5),
            )
        };
        let mut all = vec![
            four(5),
            ping(3, vec![], Some(1.5), None),
            four(1),
            ping(4, vec![beam(0.4, Some(2.5))], None, None),
            four(2),
            four(9),
        ];
        let log = PingStore::new(all.clone());
        all.sort_by_key(|p| p.stamp);
        assert_eq!(log.iter().collect::<Vec<_>>(), all);
        assert_eq!(log.directions.len(), 5, "a set of four and a set of one");
        assert_eq!((log.before(Stamp(3)), log.before(Stamp(100))), (2, 6));
    }
}
