//! Range instruments and the seafloor they measure.

use super::facts;

facts! {
    /// Facts about the messages of a range instrument.
    RangeFact {
        Info "wide-sonar-cone" WideCone,
            text("a wide sonar cone: its range is used as an altitude");
        Info "no-beams" NoBeams,
            text("messages list no beams; their altitude is used");
        Info "reports-without-beams" SomeWithoutBeams,
            text("reports without beams are ignored");
        Info "water-track" WaterTrack,
            text("water-track reports are ignored");
        Info "beam-directions-assumed" DirectionsAssumed {
            instrument: String,
            janus_angle_deg: f64,
        },
            text("messages have no beam directions; those of {instrument} ({janus_angle_deg}°) \
                  are assumed");
        Info "beam-azimuths-assumed" AzimuthsAssumed { instrument: String, janus_angle_deg: f64 },
            text("messages give the angle of the beams ({janus_angle_deg}°) and not their \
                  azimuths; those of {instrument} are assumed");
        Info "beam-vectors-swapped" VectorsSwapped { janus_angle_deg: f64 },
            text("beam_unit_vec has sine and cosine swapped ({:.1}° off the axis); \
                  {janus_angle_deg:.1}° is used", 90.0 - janus_angle_deg);
        Info "one-message-per-beam" MessagePerBeam { janus_angle_deg: f64 },
            text("one message per beam: {janus_angle_deg}° off the axis, azimuth by its \
                  orientation");
        Warning "range-unit-inferred" UnitInferred { unit_m: f64, typical: f64 },
            text("its ranges (typically {typical:.0}) cannot be metres; another range confirms a \
                  unit of {unit_m} m"),
            remedy("write `unit_m = {unit_m}` under [dvl] in a rig file");
        Warning "beams-all-equal" EqualBeams { pings: usize },
            text("all beams of {pings} pings have the same range: one number in several copies, \
                  which is used as an altitude; the seafloor is assumed level"),
            remedy("set the driver to send the range of each beam, or name another instrument with \
                    --dvl TOPIC");
        Warning "pings-repeated" Repeated { pings: usize },
            text("{pings} pings repeat the one before to the last digit: the instrument or its \
                  driver stood still, and they are not used"),
            remedy("check the driver: it should mark pings without an echo");
        Warning "altitude-frozen" AltitudeFrozen { messages: usize },
            text("its altitude is constant over {messages} messages: many drivers repeat the last \
                  good value"),
            remedy("name another instrument with --dvl TOPIC, or mark the value under \
                    dvl.bad_values in a rig file");
        Warning "range-limit" RangeLimit { ranges: usize, range_m: f64 },
            text("{ranges} ranges are exactly {range_m} m, the largest of all"),
            remedy("if that is the limit of the instrument and means no echo, write max_range_m = \
                    {range_m} under [dvl] in a rig file");
        Warning "ranges-look-vertical" LookVertical {
            altitude_ratio: f64,
            slant_ratio: f64,
            messages: usize,
        },
            text("its altitude is {altitude_ratio:.3} of the mean range over {messages} messages \
                  with all beams; slant ranges give {slant_ratio:.3}, vertical ones 1.000. They \
                  are read as slant and nothing is switched"),
            remedy("if the manual of the instrument says vertical, write `ranges = \"vertical\"` \
                    under [dvl] in a rig file (some drivers call the mean slant range altitude)");
        Warning "ranges-look-slant" LookSlant {
            altitude_ratio: f64,
            slant_ratio: f64,
            messages: usize,
        },
            text("its altitude is {altitude_ratio:.3} of the mean range over {messages} messages \
                  with all beams; slant ranges give {slant_ratio:.3}, vertical ones 1.000. They \
                  are read as vertical and nothing is switched"),
            remedy("if the manual of the instrument says slant, write `ranges = \"slant\"` under \
                    [dvl] in a rig file");
        Warning "ranges-contradict-altitude" ContradictAltitude {
            altitude_ratio: f64,
            slant_ratio: f64,
            messages: usize,
        },
            text("its altitude is {altitude_ratio:.3} of the mean range over {messages} messages \
                  with all beams: slant ranges give {slant_ratio:.3}, vertical ones 1.000"),
            remedy("check `ranges` and the beams under [dvl] in a rig file against the manual of \
                    the instrument");
        Info "seafloor-not-flat" NotFlat { residual_ratio: f64 },
            text("the seafloor is not flat: heights from echoes along the track are used \
                  (held-out echoes lie {residual_ratio:.2} times as far from them as from the \
                  plane)");
    }
}
