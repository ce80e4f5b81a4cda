//! One report of the range instrument, and the beams of known instruments.
//!
//! In: nothing but numbers already freed of "no return" markers. Out: *direction × slant range =
//! point on the seafloor*, in the instrument's space (z along its boresight). An altimeter is an
//! instrument with one beam.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::coordinates::{Direction, Dvl};
use crate::units::{Altitude, SlantRange, Stamp};

/// One sonar beam of one ping.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beam {
    /// where it looks
    pub direction: Direction<Dvl>,
    /// how far it went; `None` where nothing came back
    pub range: Option<SlantRange>,
}

/// One report of a DVL or an altimeter.
#[derive(Clone, Debug, PartialEq)]
pub struct Ping {
    /// when the ranges were true
    pub stamp: Stamp,
    /// none to five beams; none where the instrument gives only an altitude
    pub beams: Vec<Beam>,
    /// height over the floor where there is no beam to point with
    pub altitude: Option<Altitude>,
    /// of the instrument over the seafloor, along its own axes [m/s]
    pub velocity_m_per_s: Option<Vector3<f64>>,
}

impl Ping {
    /// Beams that came back.
    pub fn returns(&self) -> usize {
        self.beams.iter().filter(|b| b.range.is_some()).count()
    }
}

/// What the ranges in a message are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RangeKind {
    /// along the beams
    Slant,
    /// along the instrument's axis: slant × cos of the beam's angle
    Vertical,
    /// no beams: one height over the seafloor
    Altitude,
}

/// Beams at one angle around the boresight: x forward, y right, z down the axis.
#[derive(Clone, Debug, PartialEq)]
pub struct JanusArray {
    /// angle between a beam and the boresight [deg]
    pub janus_angle_deg: f64,
    /// azimuth of each beam in message order, from x towards y [deg]
    pub azimuths_deg: Vec<f64>,
}

impl JanusArray {
    /// Known instruments, by the name used in `rig.toml`. Sources: the makers' manuals.
    pub const KNOWN: &[(&str, f64, &[f64])] = &[
        ("waterlinked-a50", 22.5, &[135.0, -135.0, -45.0, 45.0]),
        ("waterlinked-a125", 22.5, &[135.0, -135.0, -45.0, 45.0]),
        ("teledyne-30-x", 30.0, &[-135.0, 45.0, 135.0, -45.0]),
        ("teledyne-30-plus", 30.0, &[180.0, 0.0, 90.0, -90.0]),
        ("nortek-25", 25.0, &[45.0, -45.0, -135.0, 135.0]),
        ("linkquest-22", 22.0, &[45.0, -45.0, -135.0, 135.0]),
        // Three beams; the maker's manual is silent on their azimuths, so these are a guess.
        ("nortek-nucleus", 20.0, &[0.0, 120.0, -120.0]),
    ];

    /// The instrument called `name`.
    pub fn named(name: &str) -> Option<Self> {
        Self::KNOWN.iter().find(|(n, ..)| *n == name).map(|(_, angle, azimuths)| Self {
            janus_angle_deg: *angle,
            azimuths_deg: azimuths.to_vec(),
        })
    }

    /// Unit vectors in message order.
    pub fn directions(&self) -> Vec<Direction<Dvl>> {
        let janus = self.janus_angle_deg.to_radians();
        self.azimuths_deg
            .iter()
            .filter_map(|azimuth| {
                let (y, x) = azimuth.to_radians().sin_cos();
                Direction::from_vector(nalgebra::Vector3::new(
                    janus.sin() * x,
                    janus.sin() * y,
                    janus.cos(),
                ))
            })
            .collect()
    }
}
