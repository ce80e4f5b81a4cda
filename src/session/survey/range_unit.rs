//! The unit of the ranges: values that no camera's seafloor can have are not in metres.

use crate::diagnostics::RangeFact;
use crate::messages::AltitudeCheck;
use crate::stats::{median, quantile};
use crate::units::{Altitude, SlantRange};
use crate::vehicle::Ping;

/// No camera sees the seafloor from farther away (m).
const MAX_SEEN_M: f64 = 30.0;
/// Share of the pings that may lie nearer all the same: spikes.
const SPIKES: f64 = 0.1;
/// Units of instruments: millimetres, centimetres, decimetres, feet (m).
const UNITS_M: [f64; 4] = [0.001, 0.01, 0.1, 0.3048];
/// Another range confirms a unit within this factor.
const AGREEMENT: f64 = 1.3;

/// Ranges (beams, else altitude) of pings.
pub fn ranges(pings: &[Ping]) -> Vec<f64> {
    let of_ping = |ping: &Ping| {
        let beams: Vec<f64> = ping.beams.iter().filter_map(|b| Some(b.range?.0)).collect();
        if beams.is_empty() { ping.altitude.map(|a| a.0).into_iter().collect() } else { beams }
    };
    pings.iter().flat_map(of_ping).collect()
}

/// Converts pings to metres, of which their unit has `unit_m`.
fn convert(pings: &mut [Ping], unit_m: f64) {
    for ping in pings {
        for beam in &mut ping.beams {
            beam.range = beam.range.map(|range| SlantRange(range.0 * unit_m));
        }
        ping.altitude = ping.altitude.map(|altitude| Altitude(altitude.0 * unit_m));
    }
}

/// Converts ranges that cannot be metres, where the messages' own altitude or another instrument
/// (its ranges) confirms the unit.
///
/// # Errors
/// The typical range, where nothing confirms a unit.
pub fn convert_implausible(
    pings: &mut [Ping],
    checks: &[AltitudeCheck],
    others: &[Vec<f64>],
) -> Result<Option<RangeFact>, f64> {
    let ranges = ranges(pings);
    if ranges.is_empty() || quantile(&ranges, SPIKES) <= MAX_SEEN_M {
        return Ok(None);
    }
    let typical = median(&ranges);
    let own = median(&checks.iter().map(|c| c.ratio / c.cosine).collect::<Vec<_>>());
    let of_others = others.iter().map(|other| median(other) / typical);
    let ratios: Vec<f64> = std::iter::once(own).chain(of_others).collect();
    let is_confirmed = |unit_m: &f64| {
        let agrees = |ratio: &f64| (AGREEMENT.recip()..AGREEMENT).contains(&(ratio / unit_m));
        ratios.iter().any(agrees)
    };
    let unit_m = UNITS_M.into_iter().find(is_confirmed).ok_or(typical)?;
    convert(pings, unit_m);
    Ok(Some(RangeFact::UnitInferred { unit_m, typical }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::Stamp;
    use crate::vehicle::RangeKind;

    #[test]
    fn a_unit_is_inferred_where_another_range_confirms_it_and_asked_for_otherwise() {
        let ping = |altitude: f64| Ping {
            stamp: Stamp(1),
            beams: Vec::new(),
            altitude: Some(Altitude(altitude)),
            velocity_m_per_s: None,
        };
        let of = |altitude: f64| vec![ping(altitude); 20];
        assert_eq!(convert_implausible(&mut of(2.5), &[], &[]), Ok(None));
        assert_eq!(convert_implausible(&mut of(2500.0), &[], &[]), Err(2500.0));
        let mut pings = of(2500.0);
        let found = convert_implausible(&mut pings, &[], &[vec![2.4; 9]]);
        assert_eq!(found, Ok(Some(RangeFact::UnitInferred { unit_m: 0.001, typical: 2500.0 })));
        assert_eq!(pings[0].altitude, Some(Altitude(2.5)));
        // The message's own altitude is in metres.
        let check = AltitudeCheck { ratio: 0.00924, cosine: 0.924, kind: RangeKind::Slant };
        let found = convert_implausible(&mut of(250.0), &[check], &[]);
        assert_eq!(found, Ok(Some(RangeFact::UnitInferred { unit_m: 0.01, typical: 250.0 })));
    }
}
