//! Whether the range instrument is turned about its own axis against its mount. Seafloor planes of
//! single pings then contradict roll and pitch of the attitude sensor; whether the instrument or
//! that sensor is turned, the images decide.

use nalgebra::{UnitQuaternion, Vector3};

use super::fit::{Fit, fit_model, joint_residual};
use crate::config::{SeafloorConfig, SelfCalibration};
use crate::diagnostics::{Diagnostic, MountFact, NotIdentified};
use crate::error::Result;
use crate::geometry::SeafloorEstimator;
use crate::model::GeometryFile;
use crate::parallel::Threads;
use crate::session::{CameraSession, Options, Progress};
use crate::stats;
use crate::units::Stamp;
use crate::vehicle::{AttitudeTrack, Ping};

/// Most pings that are compared.
const MAX_PINGS: usize = 500;
/// Fewest pings.
const MIN_PINGS: usize = 30;
/// Smallest turn: smaller ones change the planes little (deg).
const MIN_YAW_DEG: f64 = 20.0;
/// Step of the search, and of its refinement (deg).
const STEP_DEG: i32 = 5;
/// The turn explains at least this share of the disagreement.
const MAX_RESIDUAL_RATIO: f64 = 0.5;
/// Duration over which the slope of the seafloor is assumed constant (s).
const SEGMENT_S: f64 = 20.0;

/// A turn about the instrument's axis by which its planes agree with the attitude.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Yaw {
    /// from the given mount (deg)
    deg: f64,
    /// median angle between a ping's plane and the mean plane of its segment in the world, as given
    /// and turned (deg)
    residual_deg: [f64; 2],
}

/// Estimates a model as [`fit_model`] does. Where the planes show a turn about the instrument's
/// axis, estimates another with it, and returns the one that fits the images better.
///
/// # Errors
/// As [`fit_model`].
pub fn fit_model_and_yaw(
    logs: &[&CameraSession],
    options: &Options,
    threads: &Threads,
    progress: &dyn Progress,
) -> Result<Fit> {
    let given = fit_model(logs, options, threads, progress);
    let mode = options.config.estimate.self_calibration;
    // A mount of the rig file is kept.
    let is_replaced = mode == SelfCalibration::Auto && options.rig.dvl.mount.is_none();
    let found = logs.first().filter(|_| mode != SelfCalibration::Off);
    let Some(yaw) = found.and_then(|log| yaw(log, &options.config.seafloor)) else { return given };
    let turned: Vec<CameraSession> = logs.iter().map(|log| turned(log, yaw.deg)).collect();
    let turned_logs: Vec<&CameraSession> = turned.iter().collect();
    let other = fit_model(&turned_logs, options, threads, progress);
    let Yaw { deg: yaw_deg, residual_deg } = yaw;
    let is_better = joint_residual(&other) < joint_residual(&given);
    let mut fit = if is_better && is_replaced { other? } else { given? };
    let rotation = turned_logs[0].survey.rig.body_from_dvl.isometry().rotation;
    let rotation_xyzw: [f64; 4] = rotation.coords.into();
    let fact = if is_better {
        MountFact::DvlTurned { yaw_deg, residual_deg, rotation_xyzw }
    } else {
        MountFact::AttitudeTurned { yaw_deg, residual_deg }
    };
    if is_better && !is_replaced {
        fit.model.set_not_identified(NotIdentified::MountContradicted);
    } else if is_better {
        let geometry = fit.model.geometry.get_or_insert_with(GeometryFile::default);
        geometry.dvl_rotation_xyzw.get_or_insert(rotation_xyzw);
    }
    let topic = &logs[0].survey.dvl_topic;
    let diagnostic = Diagnostic::on(topic, fact);
    fit.model.warnings.push(diagnostic.with_remedy());
    fit.model.diagnostics.push(diagnostic);
    Ok(fit)
}

fn about_axis(deg: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), deg.to_radians())
}

/// The log with its instrument turned about its axis.
fn turned(log: &CameraSession, deg: f64) -> CameraSession {
    let mut turned = log.clone();
    let rotation = turned.survey.rig.body_from_dvl.isometry().rotation * about_axis(deg);
    let rotation = Some(rotation.coords.into());
    let geometry = GeometryFile { dvl_rotation_xyzw: rotation, ..GeometryFile::default() };
    turned.survey.take_geometry(&geometry, &log.config.seafloor);
    turned
}

/// The turn that the planes of single pings and the attitude show.
fn yaw(log: &CameraSession, config: &SeafloorConfig) -> Option<Yaw> {
    let (pings, rig) = (&log.survey.pings, &log.survey.rig);
    let step = pings.count().div_ceil(MAX_PINGS).max(1);
    let of_ping = |ping: Ping| {
        let stamp = ping.stamp;
        let world_from_body = pings.attitude().world_from_body(stamp)?;
        let alone = SeafloorEstimator::new(vec![ping], AttitudeTrack::default());
        let normal = alone.below_vehicle(stamp, rig, config).ok()?.normal.vector();
        Some((stamp, world_from_body, rig.body_from_dvl.isometry().rotation.inverse() * normal))
    };
    let complete = pings.all().step_by(step).filter(|p| p.returns() >= 4);
    let normals: Vec<_> = complete.filter_map(of_ping).collect();
    if normals.len() < MIN_PINGS {
        return None;
    }
    let residual = |deg: f64| {
        let body_from_dvl = rig.body_from_dvl.isometry().rotation * about_axis(deg);
        let in_world: Vec<(Stamp, Vector3<f64>)> =
            normals.iter().map(|(stamp, q, n)| (*stamp, q * (body_from_dvl * n))).collect();
        scatter_deg(&in_world)
    };
    let scan = |degs: Vec<i32>| {
        let of = degs.into_iter().map(|deg| (f64::from(deg), residual(f64::from(deg))));
        of.min_by(|a, b| a.1.total_cmp(&b.1))
    };
    let coarse = scan((-180..180).step_by(STEP_DEG as usize).collect())?.0 as i32;
    let (deg, least) = scan((coarse - STEP_DEG..=coarse + STEP_DEG).collect())?;
    let as_given = residual(0.0);
    let is_turned = deg.abs() >= MIN_YAW_DEG && least < MAX_RESIDUAL_RATIO * as_given;
    is_turned.then_some(Yaw { deg, residual_deg: [as_given, least] })
}

/// Median angle between normals and the mean of their segment (deg).
fn scatter_deg(normals: &[(Stamp, Vector3<f64>)]) -> f64 {
    let segment = |stamp: Stamp| {
        normals.first().map_or(0, |first| (stamp.seconds_since(first.0) / SEGMENT_S) as i64)
    };
    let mut distances = Vec::new();
    for group in normals.chunk_by(|a, b| segment(a.0) == segment(b.0)) {
        let mean = group.iter().map(|(_, n)| n).sum::<Vector3<f64>>() / group.len() as f64;
        distances.extend(group.iter().map(|(_, n)| (n - mean).norm()));
    }
    stats::median(&distances).to_degrees()
}
