//! Offsets between the clocks of camera, range instrument and attitude sensor, estimated from the
//! data. They are reported and never applied.
//!
//! - Camera and DVL: two points of the seafloor that two frames share are equally far apart in
//!   metres, at any altitude. Altitudes come from pings, so the distances agree best where the
//!   stamps of the pings fit those of the frames.
//! - Attitude and DVL: the normal of a ping's plane, rotated into the world by the attitude at its
//!   time, is constant.
//!
//! Both residuals are evaluated on a grid of offsets. An offset is estimated where the residual has
//! one sharp minimum inside the grid; constant altitude and attitude determine none.

use nalgebra::Vector3;

use super::pass_one::{Collected, PassOne};
use crate::config::SeafloorConfig;
use crate::diagnostics::{ClockFact, Diagnostic, OffsetUnknown};
use crate::error::Result;
use crate::estimate::MatchedPair;
use crate::geometry::{SeafloorEstimator, SeafloorPlane, SeafloorPoint, View};
use crate::parallel::{Threads, ordered_map};
use crate::session::survey::Survey;
use crate::session::{CameraSession, Options, Silent};
use crate::units::Stamp;
use crate::vehicle::{AttitudeTrack, Ping, Rig, RigFile};

/// Half width of the grid of offsets (s).
const MAX_OFFSET_S: f64 = 3.0;
/// Step of the grid (s).
const STEP_S: f64 = 0.05;
/// Largest uncertainty of an offset, at three standard deviations (s).
const MAX_UNCERTAINTY_S: f64 = 0.1;
/// Fewest observations.
const MIN_OBSERVATIONS: usize = 12;
/// Smallest share of the observations that an offset may keep to be compared with others.
const MIN_SHARE: f64 = 0.7;
/// Most points used per pair of frames.
const MAX_POINTS: usize = 60;
/// Duration over which the slope of the seafloor is assumed constant (s).
const SEGMENT_S: f64 = 20.0;

/// An estimated offset.
#[derive(Clone, Debug, PartialEq)]
pub enum ClockOffset {
    /// the data determine it
    Estimated {
        /// to be added to the stamps (s)
        offset_s: f64,
        /// standard deviation (s)
        std_s: f64,
    },
    /// the data do not determine it
    Unknown(OffsetUnknown),
}

impl ClockOffset {
    /// Whether it differs from 0 significantly.
    pub fn is_off(&self) -> bool {
        let Self::Estimated { offset_s, std_s } = self else { return false };
        offset_s.abs() > (3.0 * std_s).max(STEP_S)
    }
}

/// Offsets of the clocks of a log.
#[derive(Clone, Debug, PartialEq)]
pub struct ClockOffsets {
    /// to be added to the range instrument's stamps, so that they fit the camera's
    pub ranges: ClockOffset,
    /// to be added to the attitude's, so that they fit both; those of the range instrument alone
    /// where the images determine nothing
    pub attitude: ClockOffset,
}

impl ClockOffsets {
    /// Per topic: its offset and the line of a rig file that corrects it, or that there is none.
    pub fn diagnostics(&self, survey: &Survey, rig: &RigFile) -> Vec<Diagnostic> {
        let of = |topic: &String, offset: &ClockOffset| {
            let fact = match *offset {
                ClockOffset::Estimated { offset_s, std_s } if offset.is_off() => {
                    let time_offset_s = rig.time_offset_s.get(topic).unwrap_or(&0.0) + offset_s;
                    ClockFact::OffsetFound { offset_s, std_s, time_offset_s }
                }
                ClockOffset::Estimated { offset_s, std_s } => ClockFact::Agrees { offset_s, std_s },
                ClockOffset::Unknown(reason) => ClockFact::Unknown { reason },
            };
            Diagnostic::on(topic, fact)
        };
        let attitude = survey.attitude_topic.iter().map(|topic| of(topic, &self.attitude));
        [of(&survey.dvl_topic, &self.ranges)].into_iter().chain(attitude).collect()
    }
}

/// Estimates the offsets between the clocks of a log.
///
/// # Errors
/// The log cannot be read.
pub fn clock_offsets(log: &CameraSession, options: &Options) -> Result<ClockOffsets> {
    let threads = Threads::new(options.threads);
    let seafloor = &options.config.seafloor;
    let config = &options.config;
    let max_frames = config.estimate.max_frames;
    let progress = &Silent;
    let collected =
        PassOne { session: log, config, max_frames, threads: &threads, progress }.collect()?;
    let (pings, rig) = (&log.survey.pings, &log.survey.rig);
    // Pairs share frames: about as many are independent as there are frames.
    let per_frame = collected.pairs.len() as f64 / collected.frames.len().max(1) as f64;
    let ranges = offset(&threads, per_frame.max(1.0), |shift| {
        scale_residuals(&collected, &shifted(pings, shift), rig, seafloor)
    })?;
    let normals = normals(pings, rig, seafloor);
    let of_attitude =
        offset(&threads, 1.0, |shift| normal_residuals(&normals, pings.attitude(), shift))?;
    let attitude = match (&ranges, of_attitude) {
        // The attitude's offset is relative to the pings'.
        (
            ClockOffset::Estimated { offset_s: a, std_s: b },
            ClockOffset::Estimated { offset_s, std_s },
        ) => ClockOffset::Estimated { offset_s: offset_s + a, std_s: std_s.hypot(*b) },
        (_, alone) => alone,
    };
    Ok(ClockOffsets { ranges, attitude })
}

/// The offset with the smallest mean square residual. `residuals` returns one per observation, or
/// `None`; one in `per_independent` of them is independent.
fn offset(
    threads: &Threads,
    per_independent: f64,
    residuals: impl Fn(f64) -> Vec<Option<f64>> + Sync,
) -> Result<ClockOffset> {
    let steps = (MAX_OFFSET_S / STEP_S) as i32;
    let mut curve: Vec<(f64, Vec<Option<f64>>)> = Vec::new();
    let at = |step: i32| (f64::from(step) * STEP_S, residuals(f64::from(step) * STEP_S));
    ordered_map(
        -steps..=steps,
        16,
        |_| 1,
        threads,
        at,
        |point| -> Result<()> {
            curve.push(point);
            Ok(())
        },
    )?;
    Ok(minimum(&curve, per_independent))
}

fn minimum(curve: &[(f64, Vec<Option<f64>>)], per_independent: f64) -> ClockOffset {
    let most = curve.iter().map(|(_, m)| m.iter().flatten().count()).max().unwrap_or(0);
    let independent = most as f64 / per_independent;
    if most < MIN_OBSERVATIONS {
        return ClockOffset::Unknown(OffsetUnknown::FewObservations);
    }
    // Wrong matches and boulders: residuals beyond three robust standard deviations are limited to
    // that.
    let median_size = |residuals: &[Option<f64>]| {
        let mut sizes: Vec<f64> = residuals.iter().flatten().map(|m| m.abs()).collect();
        sizes.sort_by(f64::total_cmp);
        sizes.get(sizes.len() / 2).copied().unwrap_or(f64::INFINITY)
    };
    let enough = |residuals: &[Option<f64>]| {
        residuals.iter().flatten().count() as f64 >= MIN_SHARE * most as f64
    };
    let compared: Vec<&(f64, Vec<Option<f64>>)> = curve.iter().filter(|(_, m)| enough(m)).collect();
    let limit =
        3.0 * 1.4826 * compared.iter().map(|(_, m)| median_size(m)).fold(f64::INFINITY, f64::min);
    let mean_square = |residuals: &[Option<f64>]| {
        let (sum, count) = residuals
            .iter()
            .flatten()
            .fold((0.0, 0.0), |(s, n), m| (s + m.abs().min(limit).powi(2), n + 1.0));
        sum / count
    };
    let points: Vec<(f64, f64)> =
        compared.iter().map(|(shift, m)| (*shift, mean_square(m))).collect();
    let Some(best) = (0..points.len()).min_by(|a, b| points[*a].1.total_cmp(&points[*b].1)) else {
        return ClockOffset::Unknown(OffsetUnknown::FewObservations);
    };
    if best == 0 || best + 1 == points.len() || points[best].1 <= 0.0 {
        return ClockOffset::Unknown(OffsetUnknown::NoMinimum);
    }
    let (low, here, high) = (points[best - 1].1, points[best].1, points[best + 1].1);
    let curvature = low - 2.0 * here + high;
    let offset_s = points[best].0
        + if curvature > 0.0 { 0.5 * STEP_S * (low - high) / curvature } else { 0.0 };
    // Offsets whose residual is larger by less than chance are not distinguished.
    let worse = here * (1.0 + 9.0 / independent);
    let farthest =
        points.iter().filter(|p| p.1 <= worse).map(|p| (p.0 - offset_s).abs()).fold(0.0, f64::max);
    // From the curvature of the residual over a wider span.
    let wide = |k: usize| {
        Some((points.get(best.checked_sub(k)?)?.1 + points.get(best + k)?.1) / 2.0 - here)
    };
    let per_s2 = wide(4).map_or(0.0, |rise| rise / (4.0 * STEP_S).powi(2));
    let std_s = if per_s2 > 0.0 { (here / (independent * per_s2)).sqrt() } else { f64::INFINITY };
    if farthest > MAX_UNCERTAINTY_S + STEP_S || 3.0 * std_s > MAX_UNCERTAINTY_S {
        return ClockOffset::Unknown(OffsetUnknown::Flat);
    }
    ClockOffset::Estimated { offset_s, std_s }
}

fn shifted(pings: &SeafloorEstimator, shift_s: f64) -> SeafloorEstimator {
    let moved = pings.all().map(|p| Ping { stamp: p.stamp.plus_seconds(shift_s), ..p }).collect();
    SeafloorEstimator::new(moved, pings.attitude().clone())
}

/// Per pair of frames: log ratio of the extents of the seafloor points that both show.
fn scale_residuals(
    seen: &Collected,
    pings: &SeafloorEstimator,
    rig: &Rig,
    config: &SeafloorConfig,
) -> Vec<Option<f64>> {
    let planes: Vec<Option<SeafloorPlane>> =
        seen.frames.iter().map(|f| pings.seafloor(f.stamp, rig, config).ok()).collect();
    let of_pair = |pair: &MatchedPair| {
        let (plane_a, plane_b) = (planes[pair.a].as_ref()?, planes[pair.b].as_ref()?);
        let (view_a, view_b) = (
            View { camera: &rig.camera, rig, plane: plane_a, terrain: None },
            View { camera: &rig.camera, rig, plane: plane_b, terrain: None },
        );
        let (places_a, places_b) = (&seen.frames[pair.a].places, &seen.frames[pair.b].places);
        let every = pair.keypoints.len().div_ceil(MAX_POINTS);
        let (mut a, mut b) = (Vec::new(), Vec::new());
        for (i, j) in pair.keypoints.iter().step_by(every) {
            let (p, q) = (places_a.get(*i as usize)?, places_b.get(*j as usize)?);
            if let (
                Some(SeafloorPoint { position: p, .. }),
                Some(SeafloorPoint { position: q, .. }),
            ) = (view_a.seafloor_point_of_ray(p.0, p.1), view_b.seafloor_point_of_ray(q.0, q.1))
            {
                a.push(p.vector());
                b.push(q.vector());
            }
        }
        Some((spread(&a)? / spread(&b)?).ln()).filter(|m| m.is_finite())
    };
    seen.pairs.iter().map(of_pair).collect()
}

/// Root mean square distance from the centroid (m); `None` for fewer than six points.
fn spread(points: &[Vector3<f64>]) -> Option<f64> {
    let n = points.len() as f64;
    let centroid = points.iter().sum::<Vector3<f64>>() / n;
    (points.len() >= 6)
        .then(|| (points.iter().map(|p| (p - centroid).norm_squared()).sum::<f64>() / n).sqrt())
}

/// Normals of single pings in body space.
fn normals(
    pings: &SeafloorEstimator,
    rig: &Rig,
    config: &SeafloorConfig,
) -> Vec<(Stamp, Vector3<f64>)> {
    let of_ping = |ping: Ping| {
        let stamp = ping.stamp;
        let alone = SeafloorEstimator::new(vec![ping], AttitudeTrack::default());
        Some((stamp, alone.below_vehicle(stamp, rig, config).ok()?.normal.vector()))
    };
    pings.all().filter(|p| p.returns() >= 4).filter_map(of_ping).collect()
}

/// Per ping: distance of its normal in the world from the mean of its segment (rad), with the
/// attitude later by `shift_s`.
fn normal_residuals(
    normals: &[(Stamp, Vector3<f64>)],
    attitude: &AttitudeTrack,
    shift_s: f64,
) -> Vec<Option<f64>> {
    let in_world = |(stamp, normal): &(Stamp, Vector3<f64>)| {
        Some(attitude.world_from_body(stamp.plus_seconds(-shift_s))? * normal)
    };
    let segment = |stamp: Stamp| {
        normals.first().map_or(0, |first| (stamp.seconds_since(first.0) / SEGMENT_S) as i64)
    };
    let mut residuals = Vec::new();
    for group in normals.chunk_by(|a, b| segment(a.0) == segment(b.0)) {
        let world: Vec<Option<Vector3<f64>>> = group.iter().map(in_world).collect();
        let count = world.iter().flatten().count().max(1) as f64;
        let mean = world.iter().flatten().sum::<Vector3<f64>>() / count;
        residuals.extend(world.iter().map(|n| n.map(|n| (n - mean).norm())));
    }
    residuals
}
