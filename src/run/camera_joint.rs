//! Whether a camera moves in its vehicle as the transforms of the log say: some servos are
//! commanded and never turn. The images decide.

use super::dvl_yaw::fit_model_and_yaw;
use super::fit::Fit;
use crate::config::SelfCalibration;
use crate::diagnostics::{Diagnostic, Fact, MountFact, NotIdentified};
use crate::error::Result;
use crate::model::{GeometryFile, Verdict};
use crate::parallel::Threads;
use crate::session::{CameraSession, Options, Progress};

/// A joint is held where that makes the agreement of the same point at least this much better.
const MAX_RATIO: f64 = 0.8;

/// Of the same point by the physical model, on held-out frames. The residual of a solve says less:
/// free gains of frames take up what is wrong with the geometry.
fn agreement(fit: &Result<Fit>) -> f64 {
    let verdict = fit.as_ref().ok().and_then(|fit| fit.model.verdict.as_ref());
    verdict.and_then(|v| v.of(Verdict::FULL)?.agreement).unwrap_or(f64::INFINITY)
}

/// Estimates a model. Where the camera sits on a joint that moves, estimates another with the joint
/// held still, and returns the one that fits the images better.
///
/// # Errors
/// A log cannot be read, or attenuation cannot be estimated.
pub fn fit_model_and_joint(
    logs: &[&CameraSession],
    options: &Options,
    threads: &Threads,
    progress: &dyn Progress,
) -> Result<Fit> {
    let given = fit_model_and_yaw(logs, options, threads, progress);
    let mode = options.config.estimate.self_calibration;
    let moves = logs.iter().any(|log| log.survey.rig.camera_motion.is_some());
    if mode == SelfCalibration::Off || !moves {
        return given;
    }
    let still = GeometryFile { is_camera_held: true, ..GeometryFile::default() };
    let held = |log: &&CameraSession| {
        let mut held = (*log).clone();
        held.survey.take_geometry(&still, &log.config.seafloor);
        held
    };
    let held: Vec<CameraSession> = logs.iter().map(held).collect();
    let held_logs: Vec<&CameraSession> = held.iter().collect();
    let other = fit_model_and_yaw(&held_logs, options, threads, progress);
    // Light of lamps that stay with the vehicle fits better, too, over a camera that is held.
    let stay = |d: &Diagnostic| matches!(d.fact, Fact::MountFact(MountFact::LampsStay { .. }));
    let lamps_stay = logs.iter().any(|log| log.survey.diagnostics.iter().any(stay));
    let is_clear = !lamps_stay || other.as_ref().is_ok_and(|fit| fit.model.identified);
    let agreement = [agreement(&other), agreement(&given)];
    if !is_clear || agreement[0] >= MAX_RATIO * agreement[1] {
        return given;
    }
    let is_replaced = mode == SelfCalibration::Auto;
    let mut fit = if is_replaced { other? } else { given? };
    if is_replaced {
        fit.model.geometry.get_or_insert_with(GeometryFile::default).is_camera_held = true;
    } else {
        fit.model.set_not_identified(NotIdentified::MountContradicted);
    }
    let diagnostic = Diagnostic::from(MountFact::JointContradicted { agreement });
    fit.model.warnings.push(diagnostic.with_remedy());
    fit.model.diagnostics.push(diagnostic);
    Ok(fit)
}
