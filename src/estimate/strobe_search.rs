//! Position of a strobe that was not measured, from the log itself.
//!
//! The residual of the joint solve depends on it: an error of 0.2 m fore and aft nearly doubles it.
//! The position is a linearised unknown of the solve; a step is taken where the residual falls
//! ([`minimize`]), and the beam pattern is solved again there. The orientation does not matter, as
//! the grid of the beam pattern represents it. Without a given position the search begins at the
//! best of a few around the camera. In: tracks. Out: the position in body coordinates (m), its
//! standard deviation, and the residual.

use nalgebra::Vector3;

use super::Dataset;

use crate::config::{EstimateConfig, SelfCalibration, StrobePosition};
use crate::diagnostics::MountFact;
use crate::model::BeamGrid;
use crate::solver::terms::geometry::strobe_position;
use crate::solver::{Minimum, Problem, SETTLED, Setup, Track, minimize, sample_path, thinned};
use crate::vehicle::{Lamps, StrobeSource};

/// Distance from the camera of the positions that a search may begin at (m).
const FIRST_RING_M: f64 = 0.6;
/// Observations that determine three numbers well enough.
const MAX_OBSERVATIONS: usize = 16_000;

/// The position that was found.
#[derive(Clone, Debug)]
pub struct StrobeFit {
    /// its mount: position found, orientation as at the start
    pub lamps: Lamps,
    /// standard deviation of the position, per body axis (m)
    pub std_m: [f64; 3],
    /// residual of the solve at the start, and where it was found (log light)
    pub residual: [f64; 2],
    /// from the start to where it was found (m)
    pub moved_m: f64,
}

impl StrobeFit {
    /// Standard deviation of the position (m).
    fn distance_std_m(&self) -> f64 {
        self.std_m.iter().map(|s| s * s).sum::<f64>().sqrt()
    }
}

/// The position that is used, and where it is from.
#[derive(Clone, Debug)]
pub struct StrobePlacement {
    /// its mount
    pub lamps: Lamps,
    /// `found` or `refined`, where it is the result of a search
    pub source: Option<StrobeSource>,
    /// the search, where there was one
    pub search: Option<StrobeFit>,
    /// why the position is unreliable
    pub warning: Option<MountFact>,
}

impl StrobePlacement {
    /// As given, without a search.
    pub fn kept(lamps: Lamps) -> Self {
        Self { lamps, source: None, search: None, warning: None }
    }

    /// Where a search found the strobe of a given position that was kept: far from it, though not
    /// surely.
    pub fn moved(&self) -> Option<Self> {
        let found = self.search.as_ref().filter(|_| self.source.is_none())?;
        let is_far = found.moved_m > CONTRADICTION_M && found.distance_std_m() < UNSURE_M;
        is_far.then(|| Self { source: Some(StrobeSource::Refined), ..Self::kept(found.lamps) })
    }
}

/// A position closer than this, or than three standard deviations, does not contradict the given
/// one (m).
const CONTRADICTION_M: f64 = 0.06;
/// A contradiction is this many standard deviations away, and leaves at most this share of the
/// residual.
const SURE: f64 = 3.0;
const MAX_RESIDUAL: f64 = 0.9;
/// Where a given position is only checked, shorter steps end the search (m).
const CHECKED_M: f64 = CONTRADICTION_M / 10.0;
/// A position with a larger standard deviation is not used (m).
const UNSURE_M: f64 = 0.15;

/// Finds, refines or checks the strobe's position. `is_known`: whether `data.lamps` is a measured
/// pose; where it is not, it is the camera's. `begun` is the result of an earlier search.
pub fn place_strobe(
    data: &Dataset<'_>,
    is_known: bool,
    begun: Option<Lamps>,
    config: &EstimateConfig,
) -> StrobePlacement {
    let start = data.lamps;
    let kept = |warning: Option<MountFact>, search| StrobePlacement {
        lamps: start,
        source: None,
        search,
        warning,
    };
    let choice = match (config.strobe_position, is_known) {
        (StrobePosition::Auto, false) => StrobePosition::Find,
        (chosen, _) => chosen,
    };
    let unknown = || (!is_known).then_some(MountFact::StrobeUnknown);
    // At constant altitude the beam pattern compensates for any position.
    let cannot_tell = data.tracks.len() < config.least_pairs || !data.altitude_varies(config);
    if choice == StrobePosition::Fixed || cannot_tell {
        return kept(unknown(), None);
    }
    // Fewer rounds suffice. A coarser beam pattern does not: it shifts the position by centimetres.
    let nodes = BeamGrid::new(config.beam_nodes, config.beam_limit_deg);
    let setup = Setup { rounds: 5, ..data.setup(nodes, config) };
    let settled = if choice == StrobePosition::Auto { CHECKED_M } else { SETTLED };
    // `find` does not use the given position.
    let from = if choice == StrobePosition::Find {
        start.moved_to(data.body_from_optical.origin().vector())
    } else {
        start
    };
    let begin = begun.or((choice != StrobePosition::Find).then_some(start));
    let found = search_strobe(data.tracks, &setup, (from, begin), settled);
    let Some(found) = found else { return kept(unknown(), None) };
    let std = found.distance_std_m();
    let is_sure = std.is_finite() && std < UNSURE_M;
    let take = |source| StrobePlacement {
        lamps: found.lamps,
        source: Some(source),
        search: Some(found.clone()),
        warning: None,
    };
    match choice {
        StrobePosition::Find if is_sure => take(StrobeSource::Found),
        StrobePosition::Refine if is_sure => take(StrobeSource::Refined),
        StrobePosition::Find | StrobePosition::Refine => kept(unknown(), Some(found)),
        _ if is_sure && is_contradiction(&found, std) => {
            let is_replaced = config.self_calibration == SelfCalibration::Auto;
            let warning = Some(contradiction(&found, std, is_replaced));
            if is_replaced {
                return StrobePlacement { warning, ..take(StrobeSource::Refined) };
            }
            kept(warning, Some(found))
        }
        _ => kept(None, Some(found)),
    }
}

/// Whether a search contradicts the place it began at. `std`: of the place that was found (m).
fn is_contradiction(found: &StrobeFit, std: f64) -> bool {
    found.moved_m > CONTRADICTION_M.max(SURE * std)
        && found.residual[1] < MAX_RESIDUAL * found.residual[0]
}

fn contradiction(found: &StrobeFit, std_m: f64, is_replaced: bool) -> MountFact {
    let (moved_m, residual) = (found.moved_m, found.residual);
    let position_in_body_m = found.lamps.origin().vector().into();
    if is_replaced {
        MountFact::StrobeReplaced { moved_m, position_in_body_m, std_m, residual }
    } else {
        MountFact::StrobeContradicted { moved_m, position_in_body_m, std_m, residual }
    }
}

/// Searches from `from`, which is a mere guess unless there is a position to begin at: then
/// positions beside it are tried first. Steps shorter than `settled` end it (m). `None` where
/// the log does not hold the solve.
fn search_strobe(
    tracks: &[Track],
    setup: &Setup<'_>,
    (from, begin): (Lamps, Option<Lamps>),
    settled: f64,
) -> Option<StrobeFit> {
    let tracks = thinned(tracks, MAX_OBSERVATIONS);
    let at = |position: Vector3<f64>| from.moved_to(position);
    let solved = |position: Vector3<f64>| {
        let mut problem = Problem::new(&tracks, setup, at(position), &sample_path)?;
        let solution = problem.solve(setup.rounds)?;
        Some((problem, solution))
    };
    let mut start = begin.unwrap_or(from).origin().vector();
    let mut first_residual = None;
    if begin.is_none() {
        let mut residual = solved(start)?.1.residual;
        first_residual = Some(residual);
        // Beside it, perpendicular to where it looks.
        let rotation = from.isometry().rotation;
        let (right, down) = (rotation * Vector3::x(), rotation * Vector3::y());
        for offset in [right, -right, down, -down] {
            let candidate = from.origin().vector() + offset * FIRST_RING_M;
            if let Some((_, solution)) = solved(candidate).filter(|(_, s)| s.residual < residual) {
                (start, residual) = (candidate, solution.residual);
            }
        }
    }
    let evaluate = |position: Vector3<f64>| {
        let (problem, solution) = solved(position)?;
        let parameters = strobe_position(at(position), &sample_path);
        Some((solution.residual, problem.parameter_step(&tracks, &parameters, &solution)?))
    };
    let Minimum { point, std, residual: [first, last] } = minimize(start, settled, &evaluate)?;
    Some(StrobeFit {
        lamps: at(point),
        std_m: std.into(),
        residual: [first_residual.unwrap_or(first), last],
        moved_m: (point - from.origin().vector()).norm(),
    })
}
