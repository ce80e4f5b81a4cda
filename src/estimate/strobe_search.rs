//! The strobe that nobody measured: its place from the log itself.
//!
//! No public recording holds a strobe's pose, but the residual of the joint solve knows it: 0.2 m
//! fore-and-aft nearly doubles it. The place, three numbers, joins the unknowns to first order; a
//! step is taken where the residual falls (`descent`), the pattern solved anew at each place. The
//! orientation does not matter: the pattern's grid takes it up. From nothing, the search begins at
//! the best of a few places around the camera. In: tracks. Out: the place in body space [m], its
//! standard deviation, and the residual there.

use nalgebra::Vector3;

use super::Samples;
use super::descent::{Lowest, SETTLED, descend};
use super::joint::{PathFor, Problem, Setting, strobe_places};
use super::tracks::Track;
use crate::config::{EstimateConfig, StrobePosition};
use crate::model::BeamGrid;
use crate::vehicle::Lamps;

/// Places tried around the camera before the search begins [m].
const FIRST_RING_M: f64 = 0.6;
/// Observations that hold three numbers well enough; more only cost time.
pub const MOST_OBSERVATIONS: usize = 16_000;

/// Where the light was found.
#[derive(Clone, Debug)]
pub struct StrobeFit {
    /// its mount: found place, orientation as at the start
    pub lamps: Lamps,
    /// standard deviation of the place, per body axis [m]
    pub std_m: [f64; 3],
    /// residual of the solve at the start, and where it was found [log light]
    pub residual: [f64; 2],
    /// from the start to where it was found [m]
    pub moved_m: f64,
}

/// Where the light is taken to sit, and how that came about.
#[derive(Clone, Debug)]
pub struct StrobePlacement {
    /// its mount
    pub lamps: Lamps,
    /// `found` or `refined`, where it was searched for and taken
    pub source: Option<&'static str>,
    /// the search, where there was one
    pub search: Option<StrobeFit>,
    /// what the user must know
    pub warning: Option<String>,
}

/// A place that moved less than this, or less than three standard deviations, does not contradict
/// the given one [m].
const CONTRADICTION_M: f64 = 0.06;
/// A given place is only checked: shorter steps hardly add up to a contradiction [m].
const CHECKED_M: f64 = CONTRADICTION_M / 10.0;
/// A place less sure than this is not found [m].
const UNSURE_M: f64 = 0.15;

/// Finds, refines or checks the strobe's place. `is_known` says whether `samples.lamps` is a
/// measured pose; where it is not, it is the camera's. `begun` is where a search has found it
/// already.
pub fn place_strobe(
    samples: &Samples<'_>,
    is_known: bool,
    begun: Option<Lamps>,
    config: &EstimateConfig,
) -> StrobePlacement {
    let start = samples.lamps;
    let kept = |warning: Option<String>, search| StrobePlacement {
        lamps: start,
        source: None,
        search,
        warning,
    };
    let choice = match (config.strobe_position, is_known) {
        (StrobePosition::Auto, false) => StrobePosition::Find,
        (chosen, _) => chosen,
    };
    let at_camera = "where the strobe sits is not known, and the log cannot tell: the light is \
                     taken to sit at the camera, which biases attenuation; write [strobe.mount] \
                     into a rig file";
    let unknown = || (!is_known).then(|| String::from(at_camera));
    // From one height the pattern takes up any place of the strobe.
    let cannot_tell = samples.tracks.len() < config.least_pairs || !samples.altitude_varies(config);
    if choice == StrobePosition::Fixed || cannot_tell {
        return kept(unknown(), None);
    }
    // Fewer rounds hold three numbers as well. A coarser pattern does not: its edges pull the place
    // by centimetres.
    let nodes = BeamGrid::new(config.beam_nodes, config.beam_limit_deg);
    let setting = Setting { rounds: 5, ..samples.setting(nodes, config) };
    let settled = if choice == StrobePosition::Auto { CHECKED_M } else { SETTLED };
    // Found is what was found without the given place.
    let from = if choice == StrobePosition::Find {
        start.moved_to(samples.body_from_optical.origin().vector())
    } else {
        start
    };
    let begin = begun.or((choice != StrobePosition::Find).then_some(start));
    let found = search_strobe(samples.tracks, &setting, (from, begin), settled, &|o, mount| {
        samples.path_from(o, mount)
    });
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
        StrobePosition::Find if is_sure => take("found"),
        StrobePosition::Refine if is_sure => take("refined"),
        StrobePosition::Find | StrobePosition::Refine => kept(unknown(), Some(found)),
        _ if is_sure
            && found.moved_m > CONTRADICTION_M.max(3.0 * std)
            && found.residual[1] < 0.9 * found.residual[0] =>
        {
            let p = found.lamps.origin().vector();
            let sentence = format!(
                "the log contradicts the strobe's given place: it fits better {:.2} m away, at \
                 [{:.3}, {:.3}, {:.3}] in the vehicle (± {std:.3} m; residual {:.4} instead of \
                 {:.4}); use it with --strobe-position refine",
                found.moved_m, p.x, p.y, p.z, found.residual[1], found.residual[0]
            );
            kept(Some(sentence), Some(found))
        }
        _ => kept(None, Some(found)),
    }
}

/// Searches from `from`, which is a mere guess unless there is a place to begin at: then places
/// beside it are tried first. Steps shorter than `settled` end it [m]. `None` where the log does
/// not hold the solve.
fn search_strobe(
    tracks: &[Track],
    setting: &Setting<'_>,
    (from, begin): (Lamps, Option<Lamps>),
    settled: f64,
    paths: &PathFor<'_>,
) -> Option<StrobeFit> {
    let observations: usize = tracks.iter().map(Vec::len).sum();
    let every = observations.div_ceil(MOST_OBSERVATIONS).max(1);
    let some: Vec<Track> = tracks.iter().step_by(every).cloned().collect();
    let at = |place: Vector3<f64>| from.moved_to(place);
    let mut place = begin.unwrap_or(from).origin().vector();
    let mut at_start = None;
    if begin.is_none() {
        let residual_at = |place: Vector3<f64>| -> Option<f64> {
            Some(Problem::new(&some, setting, at(place), paths)?.solve(setting.rounds)?.residual)
        };
        let mut residual = residual_at(place)?;
        at_start = Some(residual);
        // Beside it, square to where it looks.
        let (right, down) =
            (from.isometry().rotation * Vector3::x(), from.isometry().rotation * Vector3::y());
        for offset in [right, -right, down, -down] {
            let candidate = from.origin().vector() + offset * FIRST_RING_M;
            if let Some(r) = residual_at(candidate).filter(|r| *r < residual) {
                (place, residual) = (candidate, r);
            }
        }
    }
    let asked_at = |place: Vector3<f64>| {
        let mut problem = Problem::new(&some, setting, at(place), paths)?;
        let solution = problem.solve(setting.rounds)?;
        Some((
            solution.residual,
            problem.place_step(&some, &strobe_places(at(place), paths), &solution)?,
        ))
    };
    let Lowest { place, std, residual: [first, last] } = descend(place, settled, &asked_at)?;
    let moved_m = (place - from.origin().vector()).norm();
    Some(StrobeFit {
        lamps: at(place),
        std_m: std.into(),
        residual: [at_start.unwrap_or(first), last],
        moved_m,
    })
}
