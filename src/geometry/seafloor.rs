//! The seafloor below a frame: a plane through the DVL's hits of the pings around it (paper §IV-A).
//!
//! ```text
//! hit = mount · (direction × slant range), turned by the attitude between ping and frame
//! h = a u + b v + c + e t          heights h along the beams' mean axis, t = ping − frame
//! four returns or more: least squares; three: exact; one or two: level; none: no plane
//! ```
//!
//! Pings and frames are not simultaneous: a robot that pitches 2°/s between them has a tilted plane, so
//! hits are turned by the attitude where there is one, and the plane's height may change and curve in time
//! (without the curve, α is off by +0.002 per metre where a robot swings up and down in 24 s).
//! Where there is no attitude the slopes may, too. Normal equations in centred coordinates: as good as SVD on
//! the symmetric four-beam layout, and steadier. In: pings, attitude, mounts. Out: n·x = d in body space [m].

use nalgebra::{DMatrix, DVector, Vector3};

use super::relief::{Relief, Way, foretold, heights, is_worth_it};
use crate::config::{SeafloorConfig, Switch};
use crate::spaces::{Body, Direction, Point};
use crate::units::Stamp;
use crate::vehicle::{AttitudeTrack, Ping, Rig};

/// Frames at which the relief is tried.
const RELIEF_FRAMES: usize = 40;

/// How many returns held the plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Support {
    /// four returns or more
    LeastSquares,
    /// three
    Exact,
    /// one or two, or an altitude alone: the floor is taken to be level
    AssumedLevel,
}

impl Support {
    /// One word for tables and channels.
    pub fn word(self) -> &'static str {
        match self {
            Self::LeastSquares => "least squares",
            Self::Exact => "exact",
            Self::AssumedLevel => "assumed level",
        }
    }
}

/// n·x = d with n pointing from the vehicle into the floor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeafloorPlane {
    /// n
    pub normal: Direction<Body>,
    /// d: distance from the body's origin [m]
    pub distance_m: f64,
    /// what holds it
    pub support: Support,
    /// hits used
    pub hits: usize,
    /// root mean square of the hits' heights over the plane [m]; NaN where nothing was left over
    pub residual_m: f64,
    /// the nearest ping's distance in time [s]
    pub nearest_ping_s: f64,
}

/// Why there is no plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NoSeafloor {
    /// no ping near enough in time; the gap to the nearest [s], infinite where there is none at all
    NoPing {
        /// [s]
        nearest_s: f64,
    },
    /// pings, but no return
    NoReturn,
    /// the plane passes through the vehicle or stands upright
    Impossible,
}

/// A hit on the seafloor in body space at the frame's time, and when it was made.
struct Hit {
    at: Vector3<f64>,
    offset_s: f64,
}

/// All pings of a log, in time order, with all that is needed to find planes.
#[derive(Clone, Debug, Default)]
pub struct Pings {
    pings: Vec<Ping>,
    attitude: AttitudeTrack,
    /// the instrument's way over the ground
    way: Way,
    /// whether the ground's relief is used
    uses_relief: bool,
}

impl Pings {
    /// Sorts the pings.
    pub fn new(mut pings: Vec<Ping>, attitude: AttitudeTrack) -> Self {
        pings.sort_by_key(|p| p.stamp);
        Self { pings, attitude, way: Way::default(), uses_relief: false }
    }

    /// The attitude between them.
    pub fn attitude(&self) -> &AttitudeTrack {
        &self.attitude
    }

    /// The pings.
    pub fn all(&self) -> &[Ping] {
        &self.pings
    }

    /// Finds the instrument's way, and decides whether the ground's relief is used: how well it foretells hits at some of
    /// `stamps`, over the plane.
    pub fn find_way(&mut self, stamps: &[Stamp], rig: &Rig, config: &SeafloorConfig) -> Option<f64> {
        self.way = Way::of(&self.pings, &self.attitude, rig);
        if config.relief == Switch::Off {
            return None;
        }
        let some = stamps.iter().step_by(stamps.len().div_ceil(RELIEF_FRAMES).max(1));
        let foretold = foretold(some.filter_map(|stamp| {
            let plane = self.seafloor(*stamp, rig, config).ok()?;
            let altitude_m = plane.distance_m - plane.normal.vector().dot(&rig.body_from_optical.origin().vector());
            Some((heights(&self.pings, &self.way, &self.attitude, *stamp, &plane, rig), altitude_m))
        }));
        self.uses_relief = config.relief == Switch::On || foretold.is_some_and(is_worth_it);
        foretold.filter(|_| self.uses_relief)
    }

    /// A point of the body at a moment, in a world that is one for a stretch of pings without a gap: which stretch, and
    /// where [m]. Good to about a hundredth of the way between two moments.
    pub fn in_world(&self, stamp: Stamp, at: Point<Body>, rig: &Rig) -> Option<(u32, Vector3<f64>)> {
        let (stretch, instrument) = self.way.at(&self.pings, stamp)?;
        let from_instrument = at.vector() - rig.body_from_dvl.origin().vector();
        Some((stretch, instrument + self.attitude.world_from_body(stamp)? * from_instrument))
    }

    /// Heights over a frame's plane, where the relief is used and seen there.
    pub fn relief(&self, stamp: Stamp, plane: &SeafloorPlane, rig: &Rig) -> Option<Relief> {
        if !self.uses_relief {
            return None;
        }
        Relief::new(heights(&self.pings, &self.way, &self.attitude, stamp, plane, rig), plane, rig)
    }

    /// The plane below the vehicle at `stamp`.
    ///
    /// # Errors
    /// Why there is none.
    pub fn seafloor(&self, stamp: Stamp, rig: &Rig, config: &SeafloorConfig) -> Result<SeafloorPlane, NoSeafloor> {
        let after = self.pings.partition_point(|p| p.stamp < stamp);
        let around = &self.pings[after.saturating_sub(config.pings_each_side)..(after + config.pings_each_side).min(self.pings.len())];
        let near: Vec<&Ping> = around.iter().filter(|p| p.stamp.seconds_since(stamp).abs() <= config.ping_window_s).collect();
        let gap = |p: &&Ping| p.stamp.seconds_since(stamp).abs();
        let answered = |p: &&&Ping| p.returns() > 0 || p.altitude.is_some();
        let nearest_s = near.iter().map(gap).fold(f64::INFINITY, f64::min);
        if nearest_s > config.max_ping_gap_s {
            let nearest_s = around.iter().map(|p| gap(&p)).fold(f64::INFINITY, f64::min);
            return Err(NoSeafloor::NoPing { nearest_s });
        }
        let nearest_answer_s = near.iter().filter(answered).map(gap).fold(f64::INFINITY, f64::min);
        if nearest_answer_s > config.max_ping_gap_s {
            return Err(NoSeafloor::NoReturn);
        }
        let (hits, turned) = self.hits(&near, stamp, rig);
        let axis = mean_axis(&near, rig);
        let fitted = axis.and_then(|axis| fit(&hits, axis, turned));
        let plane = match fitted {
            Some(plane) => Some(plane),
            None => self.level(&near, &hits, stamp, rig, axis),
        };
        let plane = plane.ok_or(NoSeafloor::NoReturn)?;
        let camera_altitude = plane.distance_m - plane.normal.vector().dot(&rig.body_from_optical.origin().vector());
        let possible = camera_altitude > config.least_altitude_m && axis.is_none_or(|a| a.dot(&plane.normal.vector()) > 0.3);
        if possible { Ok(SeafloorPlane { nearest_ping_s: nearest_answer_s, ..plane }) } else { Err(NoSeafloor::Impossible) }
    }

    /// Hits of the pings in body space at `stamp`; whether all could be turned by the attitude.
    fn hits(&self, near: &[&Ping], stamp: Stamp, rig: &Rig) -> (Vec<Hit>, bool) {
        let turns: Vec<_> = near.iter().map(|p| self.attitude.turn(stamp, p.stamp)).collect();
        let turned = turns.iter().all(Option::is_some);
        let mut hits = Vec::new();
        for (ping, turn) in near.iter().zip(turns) {
            for beam in &ping.beams {
                if let Some(range) = beam.range {
                    let hit = rig.body_from_dvl.origin().vector() + (rig.body_from_dvl * beam.direction).vector() * range.0;
                    let at = turn.filter(|_| turned).map_or(hit, |q| q * hit);
                    hits.push(Hit { at, offset_s: ping.stamp.seconds_since(stamp) });
                }
            }
        }
        (hits, turned)
    }

    /// One or two returns, or an altitude: a floor level by the attitude, else square to the instrument's axis.
    fn level(&self, near: &[&Ping], hits: &[Hit], stamp: Stamp, rig: &Rig, axis: Option<Vector3<f64>>) -> Option<SeafloorPlane> {
        let outward = axis.unwrap_or_else(|| (rig.body_from_optical * Direction::boresight()).vector());
        let normal = match self.attitude.vertical_in_body(stamp) {
            Some(vertical) if vertical.dot(&outward) < 0.0 => -vertical,
            Some(vertical) => vertical,
            None => outward,
        };
        // (distance along the normal, seconds from the frame)
        let mut distances: Vec<(f64, f64)> = hits.iter().map(|h| (normal.dot(&h.at), h.offset_s)).collect();
        if distances.is_empty() {
            let sensor = normal.dot(&rig.body_from_dvl.origin().vector());
            distances = near.iter().filter_map(|p| Some((sensor + p.altitude?.0, p.stamp.seconds_since(stamp)))).collect();
        }
        let nearest = distances.iter().min_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))?.0;
        let (distance_m, residual_m) = in_time(&distances).unwrap_or((nearest, f64::NAN));
        Some(SeafloorPlane {
            normal: Direction::from_vector(normal)?,
            distance_m,
            support: Support::AssumedLevel,
            hits: distances.len(),
            residual_m,
            nearest_ping_s: 0.0,
        })
    }
}

/// A height at the frame's time from (height, seconds from the frame), and the root mean square of what is left over;
/// `None` where pings do not lie on both sides: a drift is never carried past them. Two pings or more follow its slope,
/// five or more its curvature as well: over the window a swell would else be flattened by centimetres.
fn in_time(heights: &[(f64, f64)]) -> Option<(f64, f64)> {
    let straddled = heights.iter().any(|h| h.1 <= 0.0) && heights.iter().any(|h| h.1 >= 0.0);
    let mut times: Vec<f64> = heights.iter().map(|h| h.1).collect();
    times.dedup();
    let powers = if times.len() >= 5 { 3 } else { 2 };
    if !straddled || times.len() < 2 {
        return None;
    }
    let design = DMatrix::from_fn(heights.len(), powers, |i, j| heights[i].1.powi(j as i32));
    let observed = DVector::from_iterator(heights.len(), heights.iter().map(|h| h.0));
    let solution = (design.transpose() * &design).cholesky()?.solve(&(design.transpose() * &observed));
    let spare = heights.len() - powers;
    let left_over = (&observed - &design * &solution).norm_squared();
    Some((solution[0], if spare > 0 { (left_over / spare as f64).sqrt() } else { f64::NAN }))
}

/// Mean direction of all beams, also the lost ones: the instrument's axis in body space.
fn mean_axis(near: &[&Ping], rig: &Rig) -> Option<Vector3<f64>> {
    let sum: Vector3<f64> = near.iter().flat_map(|p| &p.beams).map(|b| (rig.body_from_dvl * b.direction).vector()).sum();
    (sum.norm() > 1e-6).then(|| sum.normalize())
}

/// The plane through the hits; `None` where they do not span one.
fn fit(hits: &[Hit], axis: Vector3<f64>, turned: bool) -> Option<SeafloorPlane> {
    if hits.len() < 3 {
        return None;
    }
    // u and v square to the axis, height h along it.
    let u = axis.cross(&if axis.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() }).normalize();
    let v = axis.cross(&u);
    let n = hits.len() as f64;
    let centre = hits.iter().map(|h| h.at).sum::<Vector3<f64>>() / n;
    let local: Vec<[f64; 4]> = hits.iter().map(|h| h.at - centre).zip(hits).map(|(p, h)| [u.dot(&p), v.dot(&p), axis.dot(&p), h.offset_s]).collect();
    // Spread of the hits over the floor: the smaller axis of their ellipse must be seen, or a slope is a guess.
    let (uu, vv, uv) = local.iter().fold((0.0, 0.0, 0.0), |(a, b, c), p| (a + p[0] * p[0] / n, b + p[1] * p[1] / n, c + p[0] * p[1] / n));
    let smaller = ((uu + vv) / 2.0 - (((uu - vv) / 2.0).powi(2) + uv * uv).sqrt()).max(0.0).sqrt();
    let larger = ((uu + vv) / 2.0 + (((uu - vv) / 2.0).powi(2) + uv * uv).sqrt()).sqrt();
    if smaller < 0.15 * larger.max(0.1) {
        return None;
    }
    let times = {
        let mut t: Vec<f64> = hits.iter().map(|h| h.offset_s).collect();
        t.dedup();
        t
    };
    let straddled = times.iter().any(|t| *t <= 0.0) && times.iter().any(|t| *t >= 0.0);
    let columns: &[fn(&[f64; 4]) -> f64] = match (times.len(), turned) {
        (1, _) => &[|_| 1.0, |p| p[0], |p| p[1]],
        _ if !straddled => &[|_| 1.0, |p| p[0], |p| p[1]],
        (5.., true) if hits.len() >= 12 => &[|_| 1.0, |p| p[0], |p| p[1], |p| p[3], |p| p[3] * p[3]],
        (2.., true) if hits.len() >= 5 => &[|_| 1.0, |p| p[0], |p| p[1], |p| p[3]],
        (3.., false) if hits.len() >= 10 => &[|_| 1.0, |p| p[0], |p| p[1], |p| p[3], |p| p[0] * p[3], |p| p[1] * p[3]],
        (2.., false) if hits.len() >= 6 => &[|_| 1.0, |p| p[0], |p| p[1], |p| p[3]],
        _ => &[|_| 1.0, |p| p[0], |p| p[1]],
    };
    let design = DMatrix::from_fn(local.len(), columns.len(), |i, j| columns[j](&local[i]));
    let heights = DVector::from_iterator(local.len(), local.iter().map(|p| p[2]));
    let normal_matrix = design.transpose() * &design;
    let solution = normal_matrix.cholesky()?.solve(&(design.transpose() * &heights));
    let residuals = &heights - &design * &solution;
    let (offset, a, b) = (solution[0], solution[1], solution[2]);
    // h = offset + a u + b v  ⇔  (axis − a u − b v)·(x − centre) = offset
    let normal = axis - u * a - v * b;
    let length = normal.norm();
    let spare = local.len().saturating_sub(columns.len());
    Some(SeafloorPlane {
        normal: Direction::from_vector(normal)?,
        distance_m: (offset + normal.dot(&centre)) / length,
        support: if local.len() == 3 { Support::Exact } else { Support::LeastSquares },
        hits: local.len(),
        residual_m: if spare > 0 { (residuals.norm_squared() / spare as f64).sqrt() } else { f64::NAN },
        nearest_ping_s: 0.0,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A vehicle that bobs by a metre in twelve seconds, seen by a bare altimeter eight times a second.
    #[test]
    fn a_bobbing_height_is_followed() {
        let height = |t: f64| 2.4 - (0.52 * t).cos();
        for centre in [0.0, 1.3, 6.0] {
            let pings: Vec<(f64, f64)> = (-8..8).map(|k| 0.06 + f64::from(k) * 0.125).map(|t| (height(centre + t), t)).collect();
            let (found, _) = in_time(&pings).expect("a height");
            assert!((found - height(centre)).abs() < 0.002, "{found} at {centre} instead of {}", height(centre));
        }
        assert!(in_time(&[(2.0, 0.1), (2.1, 0.2)]).is_none(), "a drift is not carried past the pings");
    }
}
