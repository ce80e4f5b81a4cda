//! Seafloor plane and terrain below a frame, from the DVL returns of the pings around it (paper
//! §IV-A).
//!
//! ```text
//! x = mount · (direction × slant range), rotated by the attitude between ping and frame
//! four returns or more: least squares; three: exact; one or two: level; none: no plane
//! ```
//!
//! Pings and frames are not simultaneous, and a vehicle that pitches at 2°/s in between would tilt
//! the plane; returns are therefore rotated by the attitude where the log has one. In: pings,
//! attitude, extrinsics. Out: n·x = d in body space (m).

use nalgebra::{Isometry3, Vector3};

use super::ping_store::PingStore;
use super::plane::{NoSeafloor, SeafloorPlane, Support};
use super::plane_fit::{Return, distance_at_frame, fit_plane};
use super::terrain::{MIN_RETURNS, PlaneAxes, Terrain, TerrainSample, prediction_ratio};
use super::trajectory::Trajectory;
use crate::config::{SeafloorConfig, Switch};
use crate::coordinates::{Body, Direction, Point};
use crate::units::Stamp;
use crate::vehicle::{AttitudeTrack, Ping, Rig};

/// Frames used for the cross-validation of the terrain.
const TERRAIN_FRAMES: usize = 40;
/// Terrain is used where its cross-validated error is at most this share of the plane's.
const MAX_PREDICTION_RATIO: f64 = 0.75;
/// Returns further away in time lie outside the image, and drift displaces them (s).
const TERRAIN_WINDOW_S: f64 = 12.0;
/// Minimum cosine between the plane's normal and the beams' mean axis.
const MIN_AXIS_COS: f64 = 0.3;

/// All pings of a log, with attitude and trajectory.
#[derive(Clone, Debug, Default)]
pub struct SeafloorEstimator {
    pings: PingStore,
    attitude: AttitudeTrack,
    trajectory: Trajectory,
    uses_terrain: bool,
}

impl SeafloorEstimator {
    /// Pings in any order. Without a trajectory, and so without terrain.
    pub fn new(pings: Vec<Ping>, attitude: AttitudeTrack) -> Self {
        Self { pings: PingStore::new(pings), attitude, ..Self::default() }
    }

    /// Attitude of the body over time.
    pub fn attitude(&self) -> &AttitudeTrack {
        &self.attitude
    }

    /// All pings, in time order.
    pub fn all(&self) -> impl Iterator<Item = Ping> + '_ {
        self.pings.iter()
    }

    /// Number of pings.
    pub fn count(&self) -> usize {
        self.pings.len()
    }

    /// Estimates the trajectory, and decides by cross-validation at some of `stamps` whether the
    /// terrain is used. Returns the ratio of the errors with terrain and with the plane where it
    /// is.
    pub fn estimate_trajectory(
        &mut self,
        stamps: &[Stamp],
        rig: &Rig,
        config: &SeafloorConfig,
    ) -> Option<f64> {
        self.trajectory = Trajectory::integrate(&self.pings, &self.attitude, rig);
        if config.relief == Switch::Off {
            return None;
        }
        let some = stamps.iter().step_by(stamps.len().div_ceil(TERRAIN_FRAMES).max(1));
        let ratio = prediction_ratio(some.filter_map(|stamp| {
            let plane = self.below_vehicle(*stamp, rig, config).ok()?;
            let axes = PlaneAxes::new(&plane, rig);
            Some((self.terrain_samples(*stamp, &axes, rig), plane.camera_altitude_m(rig)))
        }));
        self.uses_terrain =
            config.relief == Switch::On || ratio.is_some_and(|r| r < MAX_PREDICTION_RATIO);
        ratio.filter(|_| self.uses_terrain)
    }

    /// A point of the body in the world (m), and the segment of the trajectory within which world
    /// positions are comparable. Drift is about 1 % of the distance travelled.
    pub fn in_world(
        &self,
        stamp: Stamp,
        at: Point<Body>,
        rig: &Rig,
    ) -> Option<(u32, Vector3<f64>)> {
        let (segment, pose) = self.world_from_body(stamp, rig)?;
        Some((segment, (pose * nalgebra::Point3::from(at.vector())).coords))
    }

    /// Pose of the body in the world, and the segment of the trajectory.
    pub fn world_from_body(&self, stamp: Stamp, rig: &Rig) -> Option<(u32, Isometry3<f64>)> {
        let (segment, dvl) = self.trajectory.at(&self.pings, stamp)?;
        let rotation = self.attitude.world_from_body(stamp)?;
        let at = dvl - rotation * rig.body_from_dvl.origin().vector();
        let world_from_vehicle = Isometry3::from_parts(at.into(), rotation);
        let vehicle_from_body = rig.vehicle_from_body(stamp).unwrap_or_else(Isometry3::identity);
        Some((segment, world_from_vehicle * vehicle_from_body))
    }

    /// Terrain over a frame's plane, where it is used and there are enough returns.
    pub fn terrain(&self, stamp: Stamp, plane: &SeafloorPlane, rig: &Rig) -> Option<Terrain> {
        if !self.uses_terrain {
            return None;
        }
        let vehicle_from_body = rig.vehicle_from_body(stamp);
        let in_vehicle = vehicle_from_body.map_or(*plane, |pose| plane.seen_from(&pose.inverse()));
        let axes = PlaneAxes::new(&in_vehicle, rig);
        let terrain = Terrain::new(self.terrain_samples(stamp, &axes, rig), axes)?;
        Some(match vehicle_from_body {
            Some(pose) => terrain.seen_from(&pose),
            None => terrain,
        })
    }

    /// All returns around a frame, over its plane.
    fn terrain_samples(&self, stamp: Stamp, axes: &PlaneAxes, rig: &Rig) -> Vec<TerrainSample> {
        let pings = &self.pings;
        let dvl = rig.body_from_dvl.origin().vector();
        let (first, last) = (
            pings.before(stamp.plus_seconds(-TERRAIN_WINDOW_S)),
            pings.before(stamp.plus_seconds(TERRAIN_WINDOW_S)),
        );
        let here = self.trajectory.at(pings, stamp);
        let nearest = (first..last).filter(|i| pings.returns(*i) >= MIN_RETURNS).min_by(|a, b| {
            let gap = |i: usize| pings.stamp(i).seconds_since(stamp).abs();
            gap(*a).total_cmp(&gap(*b))
        });
        let mut samples = Vec::new();
        for i in first..last {
            let ping = pings.get(i);
            let shift = match (here, self.trajectory.at_ping(i)) {
                (Some((segment, position)), Some((s, p))) if s == segment => {
                    self.attitude.world_from_body(stamp).map(|q| q.inverse() * (p - position))
                }
                _ if Some(i) == nearest => Some(Vector3::zeros()),
                _ => None,
            };
            let rotation = self
                .attitude
                .rotation_between(stamp, ping.stamp)
                .or_else(|| (Some(i) == nearest).then(Default::default));
            let (Some(shift), Some(rotation)) = (shift, rotation) else { continue };
            for (b, beam) in ping.beams.iter().enumerate() {
                let Some(range) = beam.range else { continue };
                let at = dvl
                    + shift
                    + rotation * ((rig.body_from_dvl * beam.direction).vector() * range.0);
                if let Some((u, v, height_m)) = axes.project(&at) {
                    let offset_s = ping.stamp.seconds_since(stamp);
                    samples.push(TerrainSample { ping: i, beam: b, u, v, height_m, offset_s });
                }
            }
        }
        samples
    }

    /// The plane below the vehicle at `stamp`, in the body.
    ///
    /// # Errors
    /// Too few pings or returns, or an implausible plane.
    pub fn seafloor(
        &self,
        stamp: Stamp,
        rig: &Rig,
        config: &SeafloorConfig,
    ) -> Result<SeafloorPlane, NoSeafloor> {
        let plane = self.below_vehicle(stamp, rig, config)?;
        Ok(rig.vehicle_from_body(stamp).map_or(plane, |pose| plane.seen_from(&pose)))
    }

    /// As [`Self::seafloor`], in the vehicle, also where the camera moves in it.
    ///
    /// # Errors
    /// As [`Self::seafloor`].
    pub fn below_vehicle(
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
        let has_range = |p: &&&Ping| p.returns() > 0 || p.altitude.is_some();
        let nearest_s = near.iter().map(gap).fold(f64::INFINITY, f64::min);
        if nearest_s > config.max_ping_gap_s {
            let nearest_s = around.iter().map(|p| gap(&p)).fold(f64::INFINITY, f64::min);
            return Err(NoSeafloor::NoPing { nearest_s });
        }
        let nearest_ping_s = near.iter().filter(has_range).map(gap).fold(f64::INFINITY, f64::min);
        if nearest_ping_s > config.max_ping_gap_s {
            return Err(NoSeafloor::NoReturn);
        }
        let (returns, is_rotated) = self.returns(&near, stamp, rig);
        let axis = mean_axis(&near, rig);
        // A single beam that sways with the vehicle draws no plane.
        let has_slopes = near.iter().any(|ping| ping.beams.len() > 1);
        let plane = axis
            .filter(|_| has_slopes)
            .and_then(|axis| fit_plane(&returns, axis, is_rotated))
            .or_else(|| {
                let normal = self.level_normal(stamp, rig, axis);
                level_plane(&near, &returns, stamp, rig, normal)
            })
            .ok_or(NoSeafloor::NoReturn)?;
        let is_plausible = plane.camera_altitude_m(rig) > config.least_altitude_m
            && axis.is_none_or(|a| a.dot(&plane.normal.vector()) > MIN_AXIS_COS);
        if is_plausible {
            Ok(SeafloorPlane { nearest_ping_s, ..plane })
        } else {
            Err(NoSeafloor::Implausible)
        }
    }

    /// Returns of the pings in body space at `stamp`, and whether all were rotated by the attitude.
    fn returns(&self, near: &[&Ping], stamp: Stamp, rig: &Rig) -> (Vec<Return>, bool) {
        let rotations: Vec<_> =
            near.iter().map(|p| self.attitude.rotation_between(stamp, p.stamp)).collect();
        let is_rotated = rotations.iter().all(Option::is_some);
        let mut returns = Vec::new();
        for (ping, rotation) in near.iter().zip(rotations) {
            for beam in &ping.beams {
                if let Some(range) = beam.range {
                    let at = rig.body_from_dvl.origin().vector()
                        + (rig.body_from_dvl * beam.direction).vector() * range.0;
                    let at = rotation.filter(|_| is_rotated).map_or(at, |q| q * at);
                    returns.push(Return { at, offset_s: ping.stamp.seconds_since(stamp) });
                }
            }
        }
        (returns, is_rotated)
    }

    /// Normal of a seafloor that is level by the attitude, or else perpendicular to the beams' mean
    /// axis (without beams: to the optical axis).
    fn level_normal(&self, stamp: Stamp, rig: &Rig, axis: Option<Vector3<f64>>) -> Vector3<f64> {
        let outward =
            axis.unwrap_or_else(|| (rig.body_from_optical * Direction::boresight()).vector());
        match self.attitude.vertical_in_body(stamp) {
            Some(vertical) if vertical.dot(&outward) < 0.0 => -vertical,
            Some(vertical) => vertical,
            None => outward,
        }
    }
}

/// A plane of given normal through one or two returns, or at an altitude.
fn level_plane(
    near: &[&Ping],
    returns: &[Return],
    stamp: Stamp,
    rig: &Rig,
    normal: Vector3<f64>,
) -> Option<SeafloorPlane> {
    // (distance along the normal [m], time offset [s])
    let mut distances: Vec<(f64, f64)> =
        returns.iter().map(|r| (normal.dot(&r.at), r.offset_s)).collect();
    if distances.is_empty() {
        let sensor = normal.dot(&rig.body_from_dvl.origin().vector());
        distances = near
            .iter()
            .filter_map(|p| Some((sensor + p.altitude?.0, p.stamp.seconds_since(stamp))))
            .collect();
    }
    let nearest = distances.iter().min_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))?.0;
    let (distance_m, residual_m) = distance_at_frame(&distances).unwrap_or((nearest, f64::NAN));
    Some(SeafloorPlane {
        normal: Direction::from_vector(normal)?,
        distance_m,
        support: Support::AssumedLevel,
        returns: distances.len(),
        residual_m,
        nearest_ping_s: 0.0,
    })
}

/// Mean direction of all beams in body space, beams without a return included.
fn mean_axis(near: &[&Ping], rig: &Rig) -> Option<Vector3<f64>> {
    let sum: Vector3<f64> = near
        .iter()
        .flat_map(|p| &p.beams)
        .map(|b| (rig.body_from_dvl * b.direction).vector())
        .sum();
    (sum.norm() > 1e-6).then(|| sum.normalize())
}
