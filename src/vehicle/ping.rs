//! Pings of a DVL or altimeter, and the beam geometry of known instruments.
//!
//! *direction × slant range = point on the seafloor*, in DVL space (z along the boresight). An
//! altimeter is a DVL with one beam.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::coordinates::{Direction, Dvl};
use crate::units::{Altitude, SlantRange, Stamp};

/// One sonar beam of one ping.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beam {
    /// unit vector
    pub direction: Direction<Dvl>,
    /// `None` without a return
    pub range: Option<SlantRange>,
}

/// One measurement of a DVL or altimeter.
#[derive(Clone, Debug, PartialEq)]
pub struct Ping {
    /// time of the ranges
    pub stamp: Stamp,
    /// empty where the instrument reports an altitude only
    pub beams: Vec<Beam>,
    /// reported altitude, where there are no beams
    pub altitude: Option<Altitude>,
    /// of the instrument over ground, along its own axes (m/s)
    pub velocity_m_per_s: Option<Vector3<f64>>,
}

impl Ping {
    /// Number of beams with a return.
    pub fn returns(&self) -> usize {
        self.beams.iter().filter(|b| b.range.is_some()).count()
    }
}

/// Meaning of the ranges in a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RangeKind {
    /// along the beams
    Slant,
    /// projected onto the boresight: slant range × cosine of the beam angle
    Vertical,
    /// no beams: one altitude
    Altitude,
}

/// Janus configuration: beams at one angle to the boresight; x forward, y right, z along the
/// boresight.
#[derive(Clone, Debug, PartialEq)]
pub struct JanusArray {
    /// angle between beam and boresight (deg)
    pub janus_angle_deg: f64,
    /// azimuth of each beam in message order, from x towards y (deg)
    pub azimuths_deg: Vec<f64>,
}

impl JanusArray {
    /// Known instruments: name in `rig.toml`, Janus angle (deg), azimuths (deg). Sources: the
    /// vendors' manuals.
    pub const KNOWN: &[(&str, f64, &[f64])] = &[
        ("waterlinked-a50", 22.5, &[135.0, -135.0, -45.0, 45.0]),
        ("waterlinked-a125", 22.5, &[135.0, -135.0, -45.0, 45.0]),
        ("teledyne-30-x", 30.0, &[-135.0, 45.0, 135.0, -45.0]),
        ("teledyne-30-plus", 30.0, &[180.0, 0.0, 90.0, -90.0]),
        ("nortek-25", 25.0, &[45.0, -45.0, -135.0, 135.0]),
        ("linkquest-22", 22.0, &[45.0, -45.0, -135.0, 135.0]),
        // Three beams; azimuths assumed, the manual does not state them.
        ("nortek-nucleus", 20.0, &[0.0, 120.0, -120.0]),
    ];

    /// A known instrument by name.
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
