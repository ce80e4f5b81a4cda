//! The seafloor below a frame: a plane through the DVL's hits of the pings around it (paper §IV-A).
//!
//! ```text
//! hit = mount · (direction × slant range), turned by the attitude between ping and frame
//! h = a u + b v + c + e t          heights h along the beams' mean axis, t = ping − frame
//! four returns or more: least squares; three: exact; one or two: level; none: no plane
//! ```
//!
//! Pings and frames are not simultaneous: a robot that pitches 2°/s between them has a tilted
//! plane, so hits are turned by the attitude where there is one, and the plane's height may change
//! and curve in time (without the curve, α is off by +0.002 per metre where a robot swings up and
//! down in 24 s). Where there is no attitude the slopes may, too. Normal equations in centred
//! coordinates: as good as SVD on the symmetric four-beam layout, and steadier. A return that the
//! others contradict grossly (an echo that came twice, a fish) is left out. In: pings, attitude,
//! mounts. Out: n·x = d in body space [m].

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Vector3};

use super::ping_store::PingStore;
use super::terrain::{Terrain, Way, foretold, heights, is_worth_it};
use crate::config::{SeafloorConfig, Switch};
use crate::coordinates::{Body, Direction, Point};
use crate::units::Stamp;
use crate::vehicle::{AttitudeTrack, Ping, Rig};

/// A return is gross where the others contradict it by this share of the height, and …
const GROSS_SHARE: f64 = 0.15;
/// … by so many times their own spread.
const GROSS_SCALES: f64 = 6.0;
/// More than this share of the returns is not left out, nor more in number: then it is the floor.
const MOST_GROSS: (f64, usize) = (0.25, 16);

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
    pub returns: usize,
    /// root mean square of the hits' heights over the plane [m]; NaN where nothing was left over
    pub residual_m: f64,
    /// the nearest ping's distance in time [s]
    pub nearest_ping_s: f64,
}

impl SeafloorPlane {
    /// Distance of the camera from the plane, along the normal [m].
    pub fn camera_altitude_m(&self, rig: &Rig) -> f64 {
        self.distance_m - self.normal.vector().dot(&rig.body_from_optical.origin().vector())
    }
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
    Implausible,
}

/// A hit on the seafloor in body space at the frame's time, and when it was made.
struct Hit {
    at: Vector3<f64>,
    offset_s: f64,
}

/// All pings of a log, in time order, with all that is needed to find planes.
#[derive(Clone, Debug, Default)]
pub struct SeafloorEstimator {
    pings: PingStore,
    attitude: AttitudeTrack,
    /// the instrument's way over the ground
    way: Way,
    /// whether the ground's relief is used
    uses_relief: bool,
}

impl SeafloorEstimator {
    /// Sorts the pings.
    pub fn new(pings: Vec<Ping>, attitude: AttitudeTrack) -> Self {
        Self { pings: PingStore::new(pings), attitude, way: Way::default(), uses_relief: false }
    }

    /// The attitude between them.
    pub fn attitude(&self) -> &AttitudeTrack {
        &self.attitude
    }

    /// The pings, in time order.
    pub fn all(&self) -> impl Iterator<Item = Ping> + '_ {
        self.pings.iter()
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.pings.len()
    }

    /// Finds the instrument's way, and decides whether the ground's relief is used: how well it
    /// foretells hits at some of `stamps`, over the plane.
    pub fn estimate_trajectory(
        &mut self,
        stamps: &[Stamp],
        rig: &Rig,
        config: &SeafloorConfig,
    ) -> Option<f64> {
        self.way = Way::of(&self.pings, &self.attitude, rig);
        if config.relief == Switch::Off {
            return None;
        }
        let some = stamps.iter().step_by(stamps.len().div_ceil(RELIEF_FRAMES).max(1));
        let foretold = foretold(some.filter_map(|stamp| {
            let plane = self.seafloor(*stamp, rig, config).ok()?;
            let altitude_m = plane.camera_altitude_m(rig);
            Some((heights(&self.pings, &self.way, &self.attitude, *stamp, &plane, rig), altitude_m))
        }));
        self.uses_relief = config.relief == Switch::On || foretold.is_some_and(is_worth_it);
        foretold.filter(|_| self.uses_relief)
    }

    /// A point of the body at a moment, in a world that is one for a stretch of pings without a
    /// gap: which stretch, and where [m]. Good to about a hundredth of the way between two moments.
    pub fn in_world(
        &self,
        stamp: Stamp,
        at: Point<Body>,
        rig: &Rig,
    ) -> Option<(u32, Vector3<f64>)> {
        let (stretch, instrument) = self.way.at(&self.pings, stamp)?;
        let from_instrument = at.vector() - rig.body_from_dvl.origin().vector();
        Some((stretch, instrument + self.attitude.world_from_body(stamp)? * from_instrument))
    }

    /// Heights over a frame's plane, where the relief is used and seen there.
    pub fn terrain(&self, stamp: Stamp, plane: &SeafloorPlane, rig: &Rig) -> Option<Terrain> {
        if !self.uses_relief {
            return None;
        }
        Terrain::new(heights(&self.pings, &self.way, &self.attitude, stamp, plane, rig), plane, rig)
    }

    /// The plane below the vehicle at `stamp`.
    ///
    /// # Errors
    /// Why there is none.
    pub fn seafloor(
        &self,
        stamp: Stamp,
        rig: &Rig,
        config: &SeafloorConfig,
    ) -> Result<SeafloorPlane, NoSeafloor> {
        let after = self.pings.before(stamp);
        let around = after.saturating_sub(config.pings_each_side)
            ..(after + config.pings_each_side).min(self.pings.len());
        let around: Vec<Ping> = around.map(|i| self.pings.get(i)).collect();
        let near: Vec<&Ping> = around
            .iter()
            .filter(|p| p.stamp.seconds_since(stamp).abs() <= config.ping_window_s)
            .collect();
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
        let camera_altitude = plane.camera_altitude_m(rig);
        let possible = camera_altitude > config.least_altitude_m
            && axis.is_none_or(|a| a.dot(&plane.normal.vector()) > 0.3);
        if possible {
            Ok(SeafloorPlane { nearest_ping_s: nearest_answer_s, ..plane })
        } else {
            Err(NoSeafloor::Implausible)
        }
    }

    /// Hits of the pings in body space at `stamp`; whether all could be turned by the attitude.
    fn hits(&self, near: &[&Ping], stamp: Stamp, rig: &Rig) -> (Vec<Hit>, bool) {
        let turns: Vec<_> =
            near.iter().map(|p| self.attitude.rotation_between(stamp, p.stamp)).collect();
        let turned = turns.iter().all(Option::is_some);
        let mut hits = Vec::new();
        for (ping, turn) in near.iter().zip(turns) {
            for beam in &ping.beams {
                if let Some(range) = beam.range {
                    let hit = rig.body_from_dvl.origin().vector()
                        + (rig.body_from_dvl * beam.direction).vector() * range.0;
                    let at = turn.filter(|_| turned).map_or(hit, |q| q * hit);
                    hits.push(Hit { at, offset_s: ping.stamp.seconds_since(stamp) });
                }
            }
        }
        (hits, turned)
    }

    /// One or two returns, or an altitude: a floor level by the attitude, else square to the
    /// instrument's axis.
    fn level(
        &self,
        near: &[&Ping],
        hits: &[Hit],
        stamp: Stamp,
        rig: &Rig,
        axis: Option<Vector3<f64>>,
    ) -> Option<SeafloorPlane> {
        let outward =
            axis.unwrap_or_else(|| (rig.body_from_optical * Direction::boresight()).vector());
        let normal = match self.attitude.vertical_in_body(stamp) {
            Some(vertical) if vertical.dot(&outward) < 0.0 => -vertical,
            Some(vertical) => vertical,
            None => outward,
        };
        // (distance along the normal, seconds from the frame)
        let mut distances: Vec<(f64, f64)> =
            hits.iter().map(|h| (normal.dot(&h.at), h.offset_s)).collect();
        if distances.is_empty() {
            let sensor = normal.dot(&rig.body_from_dvl.origin().vector());
            distances = near
                .iter()
                .filter_map(|p| Some((sensor + p.altitude?.0, p.stamp.seconds_since(stamp))))
                .collect();
        }
        let nearest = distances.iter().min_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))?.0;
        let (distance_m, residual_m) = in_time(&distances).unwrap_or((nearest, f64::NAN));
        Some(SeafloorPlane {
            normal: Direction::from_vector(normal)?,
            distance_m,
            support: Support::AssumedLevel,
            returns: distances.len(),
            residual_m,
            nearest_ping_s: 0.0,
        })
    }
}

/// A height at the frame's time from (height, seconds from the frame), and the root mean square of
/// what is left over; `None` where pings do not lie on both sides: a drift is never carried past
/// them. Two pings or more follow its slope, five or more its curvature as well: over the window a
/// swell would else be flattened by centimetres.
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
    let fitted = Fitted::without_gross(
        &design,
        &observed,
        median(&heights.iter().map(|h| h.0.abs()).collect::<Vec<_>>()),
    )?;
    Some((fitted.solution[0], fitted.residual_m))
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Heights by least squares.
struct Fitted {
    solution: DVector<f64>,
    /// of each height
    residuals: DVector<f64>,
    /// root mean square of what is left over [m]; NaN where nothing is
    residual_m: f64,
    /// heights used
    used: usize,
}

impl Fitted {
    /// Least squares over all rows but `left_out`.
    fn new(
        design: &DMatrix<f64>,
        heights: &DVector<f64>,
        left_out: &[usize],
    ) -> Option<(Self, Cholesky<f64, Dyn>)> {
        let (mut normal, mut right) = (design.transpose() * design, design.transpose() * heights);
        for i in left_out {
            let row = design.row(*i).transpose();
            normal -= &row * row.transpose();
            right -= row * heights[*i];
        }
        let normal = normal.cholesky()?;
        let solution = normal.solve(&right);
        let residuals = heights - design * &solution;
        let used = heights.len() - left_out.len();
        let squares: f64 =
            residuals.norm_squared() - left_out.iter().map(|i| residuals[*i].powi(2)).sum::<f64>();
        let spare = used.saturating_sub(design.ncols());
        let residual_m =
            if spare > 0 { (squares.max(0.0) / spare as f64).sqrt() } else { f64::NAN };
        Some((Self { solution, residuals, residual_m, used }, normal))
    }

    /// The same without the returns that the others contradict, the worst first; `height_m` is what
    /// gross is measured by.
    fn without_gross(design: &DMatrix<f64>, heights: &DVector<f64>, height_m: f64) -> Option<Self> {
        let mut left_out: Vec<usize> = Vec::new();
        let mut now = Self::new(design, heights, &[])?;
        let mut accepted = 0;
        // How far a return is from what the others alone would say.
        let apart = |(fitted, normal): &(Self, Cholesky<f64, Dyn>), i: usize| {
            let row = design.row(i).transpose();
            fitted.residuals[i].abs() / (1.0 - row.dot(&normal.solve(&row))).max(1e-6)
        };
        let most = MOST_GROSS.1.min((heights.len() as f64 * MOST_GROSS.0) as usize);
        // With fewer than two to spare the others say nothing of the worst.
        while left_out.len() < most && now.0.used >= design.ncols() + 2 {
            let mut kept: Vec<(f64, usize)> = (0..heights.len())
                .filter(|i| !left_out.contains(i))
                .map(|i| (apart(&now, i), i))
                .collect();
            kept.sort_by(|a, b| b.0.total_cmp(&a.0));
            let (worst_m, worst) = kept[0];
            if worst_m < GROSS_SHARE * height_m {
                break;
            }
            left_out.push(worst);
            let Some(without) = Self::new(design, heights, &left_out) else { break };
            // One may hide behind another: whether they are strays is seen when all are gone.
            let others: Vec<f64> =
                kept[1..].iter().map(|(_, i)| without.0.residuals[*i].abs()).collect();
            let stray_m = (GROSS_SHARE * height_m).max(GROSS_SCALES * 1.4826 * median(&others));
            let are_strays = left_out.iter().all(|i| without.0.residuals[*i].abs() > stray_m);
            // Without another one the rest must not agree as well: of two that contradict each
            // other nobody can say which is wrong.
            let agrees = |rival: &(f64, usize)| {
                let instead: Vec<usize> =
                    left_out.iter().copied().filter(|i| *i != worst).chain([rival.1]).collect();
                Self::new(design, heights, &instead).is_some_and(|(fitted, _)| {
                    fitted.residual_m < 2.0 * without.0.residual_m + 0.01 * height_m
                })
            };
            let is_certain =
                !kept[1..].iter().take_while(|rival| rival.0 > GROSS_SHARE * height_m).any(agrees);
            now = without;
            if are_strays && is_certain {
                accepted = left_out.len();
            }
        }
        Self::new(design, heights, &left_out[..accepted]).map(|(fitted, _)| fitted)
    }
}

/// Mean direction of all beams, also the lost ones: the instrument's axis in body space.
fn mean_axis(near: &[&Ping], rig: &Rig) -> Option<Vector3<f64>> {
    let sum: Vector3<f64> = near
        .iter()
        .flat_map(|p| &p.beams)
        .map(|b| (rig.body_from_dvl * b.direction).vector())
        .sum();
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
    let local: Vec<[f64; 4]> = hits
        .iter()
        .map(|h| h.at - centre)
        .zip(hits)
        .map(|(p, h)| [u.dot(&p), v.dot(&p), axis.dot(&p), h.offset_s])
        .collect();
    // Spread of the hits over the floor: the smaller axis of their ellipse must be seen, or a slope
    // is a guess.
    let (uu, vv, uv) = local.iter().fold((0.0, 0.0, 0.0), |(a, b, c), p| {
        (a + p[0] * p[0] / n, b + p[1] * p[1] / n, c + p[0] * p[1] / n)
    });
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
        (5.., true) if hits.len() >= 12 => {
            &[|_| 1.0, |p| p[0], |p| p[1], |p| p[3], |p| p[3] * p[3]]
        }
        (2.., true) if hits.len() >= 5 => &[|_| 1.0, |p| p[0], |p| p[1], |p| p[3]],
        (3.., false) if hits.len() >= 10 => {
            &[|_| 1.0, |p| p[0], |p| p[1], |p| p[3], |p| p[0] * p[3], |p| p[1] * p[3]]
        }
        (2.., false) if hits.len() >= 6 => &[|_| 1.0, |p| p[0], |p| p[1], |p| p[3]],
        _ => &[|_| 1.0, |p| p[0], |p| p[1]],
    };
    let design = DMatrix::from_fn(local.len(), columns.len(), |i, j| columns[j](&local[i]));
    let heights = DVector::from_iterator(local.len(), local.iter().map(|p| p[2]));
    let along_axis: Vec<f64> = hits.iter().map(|h| axis.dot(&h.at)).collect();
    let fitted = Fitted::without_gross(&design, &heights, median(&along_axis))?;
    let (offset, a, b) = (fitted.solution[0], fitted.solution[1], fitted.solution[2]);
    // h = offset + a u + b v  ⇔  (axis − a u − b v)·(x − centre) = offset
    let normal = axis - u * a - v * b;
    let length = normal.norm();
    Some(SeafloorPlane {
        normal: Direction::from_vector(normal)?,
        distance_m: (offset + normal.dot(&centre)) / length,
        support: if local.len() == 3 { Support::Exact } else { Support::LeastSquares },
        returns: fitted.used,
        residual_m: fitted.residual_m,
        nearest_ping_s: 0.0,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pings of four beams 25° off the axis, over a floor that slopes by 5° and 2 m below; one
    /// return may come twice as far.
    fn four_beams(pings: u32, wrong: &[(u32, usize)]) -> Vec<Hit> {
        let hit = |ping: u32, beam: usize| {
            let turn = std::f64::consts::FRAC_PI_2 * beam as f64 + 0.4;
            let direction = Vector3::new(
                25f64.to_radians().sin() * turn.cos(),
                25f64.to_radians().sin() * turn.sin(),
                25f64.to_radians().cos(),
            );
            let range_m = 2.0 / (direction.z + 5f64.to_radians().tan() * direction.x);
            let times = if wrong.contains(&(ping, beam)) { 2.0 } else { 1.0 };
            Hit {
                at: direction * range_m * times,
                offset_s: f64::from(ping) - f64::from(pings) / 2.0 + 0.5,
            }
        };
        (0..pings).flat_map(|ping| (0..4).map(move |beam| hit(ping, beam))).collect()
    }

    #[test]
    fn an_echo_that_came_twice_is_left_out() {
        let truth = Vector3::new(5f64.to_radians().tan(), 0.0, 1.0).normalize();
        let tilt_deg = |hits: &[Hit]| {
            let plane = fit(hits, Vector3::z(), true).expect("a plane");
            (plane.normal.vector().dot(&truth).min(1.0).acos().to_degrees(), plane.returns)
        };
        for wrong in [&[][..], &[(1, 2)], &[(0, 0)], &[(2, 1), (2, 2)], &[(1, 0), (3, 0)]] {
            let (off_deg, used) = tilt_deg(&four_beams(5, wrong));
            assert!(
                off_deg < 0.01 && used == 20 - wrong.len(),
                "{wrong:?}: off by {off_deg}°, {used} used"
            );
        }
        let three_beams: Vec<Hit> = four_beams(2, &[(1, 2)])
            .into_iter()
            .enumerate()
            .filter(|(i, _)| i % 4 != 3)
            .map(|(_, hit)| hit)
            .collect();
        assert_eq!(
            tilt_deg(&three_beams).1,
            6,
            "where nobody can say which is wrong, all are kept"
        );
        let heights: Vec<(f64, f64)> =
            (-4..4).map(|k| (if k == 1 { 4.0 } else { 2.0 }, f64::from(k) * 0.2 + 0.1)).collect();
        let (height_m, _) = in_time(&heights).expect("a height");
        assert!((height_m - 2.0).abs() < 1e-9, "{height_m}");
    }

    /// A vehicle that bobs by a metre in twelve seconds, seen by a bare altimeter eight times a
    /// second.
    #[test]
    fn a_bobbing_height_is_followed() {
        let height = |t: f64| 2.4 - (0.52 * t).cos();
        for centre in [0.0, 1.3, 6.0] {
            let pings: Vec<(f64, f64)> = (-8..8)
                .map(|k| 0.06 + f64::from(k) * 0.125)
                .map(|t| (height(centre + t), t))
                .collect();
            let (found, _) = in_time(&pings).expect("a height");
            assert!(
                (found - height(centre)).abs() < 0.002,
                "{found} at {centre} instead of {}",
                height(centre)
            );
        }
        assert!(
            in_time(&[(2.0, 0.1), (2.1, 0.2)]).is_none(),
            "a drift is not carried past the pings"
        );
    }
}
