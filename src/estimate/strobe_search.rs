//! The strobe that nobody measured: its place from the log itself.
//!
//! No public recording holds a strobe's pose, but the residual of the joint solve knows it: 0.2 m
//! fore-and-aft nearly doubles it. The place, three numbers, joins the unknowns to first order; a
//! step is taken where the residual falls (`descent`), the pattern solved again at each place. The
//! orientation does not matter: the pattern's grid takes it up. From nothing, the search begins at
//! the best of a few places around the camera. In: tracks. Out: the place in body space (m), its
//! standard deviation, and the residual there.

use nalgebra::Vector3;

use super::Dataset;

use crate::config::{EstimateConfig, SelfCalibration, StrobePosition};
use crate::diagnostics::MountFact;
use crate::model::BeamGrid;
use crate::solver::terms::geometry::strobe_position;
use crate::solver::{Minimum, Problem, SETTLED, Setup, Track, minimize, sample_path, thinned};
use crate::vehicle::{Lamps, StrobeSource};

/// Places tried around the camera before the search begins (m).
const FIRST_RING_M: f64 = 0.6;
/// Observations that hold three numbers well enough; more only cost time.
const MAX_OBSERVATIONS: usize = 16_000;

/// Where the light was found.
#[derive(Clone, Debug)]
pub struct StrobeFit {
    /// its mount: found place, orientation as at the start
    pub lamps: Lamps,
    /// standard deviation of the place, per body axis (m)
    pub std_m: [f64; 3],
    /// residual of the solve at the start, and where it was found (log light)
    pub residual: [f64; 2],
    /// from the start to where it was found (m)
    pub moved_m: f64,
}

/// Where the light is taken to sit, and how that came about.
#[derive(Clone, Debug)]
pub struct StrobePlacement {
    /// its mount
    pub lamps: Lamps,
    /// `found` or `refined`, where it was searched for and taken
    pub source: Option<StrobeSource>,
    /// the search, where there was one
    pub search: Option<StrobeFit>,
    /// why the position is not to be trusted
    pub warning: Option<MountFact>,
}

impl StrobePlacement {
    /// As given, without a search.
    pub fn kept(lamps: Lamps) -> Self {
        Self { lamps, source: None, search: None, warning: None }
    }
}

/// A place that moved less than this, or less than three standard deviations, does not contradict
/// the given one (m).
const CONTRADICTION_M: f64 = 0.06;
/// A contradiction is this many standard deviations away, and leaves at most this share of the
/// residual.
const SURE: f64 = 3.0;
const MAX_RESIDUAL: f64 = 0.9;
/// A given place is only checked: shorter steps hardly add up to a contradiction (m).
const CHECKED_M: f64 = CONTRADICTION_M / 10.0;
/// A place less sure than this is not found (m).
const UNSURE_M: f64 = 0.15;

/// Finds, refines or checks the strobe's place. `is_known` says whether `data.lamps` is a
/// measured pose; where it is not, it is the camera's. `begun` is where a search has found it
/// already.
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
    // From one height the pattern takes up any place of the strobe.
    let cannot_tell = data.tracks.len() < config.least_pairs || !data.altitude_varies(config);
    if choice == StrobePosition::Fixed || cannot_tell {
        return kept(unknown(), None);
    }
    // Fewer rounds hold three numbers as well. A coarser pattern does not: its edges pull the place
    // by centimetres.
    let nodes = BeamGrid::new(config.beam_nodes, config.beam_limit_deg);
    let setup = Setup { rounds: 5, ..data.setup(nodes, config) };
    let settled = if choice == StrobePosition::Auto { CHECKED_M } else { SETTLED };
    // Found is what was found without the given place.
    let from = if choice == StrobePosition::Find {
        start.moved_to(data.body_from_optical.origin().vector())
    } else {
        start
    };
    let begin = begun.or((choice != StrobePosition::Find).then_some(start));
    let found = search_strobe(data.tracks, &setup, (from, begin), settled);
    let Some(found) = found else { return kept(unknown(), None) };
    let std = found.std_m.iter().map(|s| s * s).sum::<f64>().sqrt();
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
