//! The joint problem of one strobe mount: equations, weights, and the rounds of the solve.

use nalgebra::DVector;

use super::camera::ReadingCurve;
use super::covariance::{Segments, covariance};
use super::equation::Equation;
use super::normal::LinearSystem;
use super::reweight::reweight;
use super::row::Row;
use super::terms::daylight::Daylight as DaylightTerm;
use super::terms::geometry::{Geometry, Parameter};
use super::terms::tilt::{AXES, Tilt};
use super::terms::{CameraSolution, Term, TermList, Terms};
use super::{Observation, PathFor, Setup, Track};
use crate::geometry::LightPath;
use crate::image::Bands;
use crate::model::{Backscatter, BeamPattern, Daylight, ImagingModel, Removal, SpreadingModel};
use crate::parallel::par_map;
use crate::stats;
use crate::vehicle::Lamps;

/// b stays below this quantile of c / S: hardly a point is darker than the water before it.
const DARKEST: f64 = 0.02;
/// Fewest tracks of a solve, and fewest observations for so many unknowns.
const MIN_TRACKS: usize = 30;
const MIN_OBSERVATIONS_PER_UNKNOWN: usize = 2;
const MAX_COUNTED_UNKNOWNS: usize = 100;
/// Regions of a frame whose errors are independent.
const INDEPENDENT_REGIONS: f64 = 20.0;

/// The linear problem of one strobe mount.
pub struct Problem<'s> {
    pub(super) setup: Setup<'s>,
    pub(super) equations: Vec<Equation>,
    /// end of each track in `equations`
    pub(super) ends: Vec<usize>,
    pub(super) terms: Terms<'s>,
    weights: Vec<Bands>,
}

/// Values of the unknowns, and the robust spread of the residuals (log light).
pub struct Solution {
    pub(super) values: DVector<f64>,
    /// robust spread of the residuals (log light)
    pub residual: f64,
}

/// A solution in terms of the model.
#[derive(Clone)]
pub struct Fit {
    /// α (1/m), the mean over the frames
    pub attenuation_per_m: Bands,
    /// b_Λ and the shape of S_Λ
    pub backscatter: Backscatter,
    /// BP
    pub beam: BeamPattern,
    /// daylight, in the unit of BP
    pub daylight: Option<Daylight>,
}

/// A step of parameters that lowers the residuals most, with standard deviations, in their units.
#[derive(Clone, Debug)]
pub struct ParameterStep {
    /// per parameter
    pub step: Vec<f64>,
    /// per parameter
    pub std: Vec<f64>,
}

/// One observation with its light path, and its index among all observations.
type WithPath<'t> = (usize, &'t Observation, LightPath);

impl<'s> Problem<'s> {
    /// Sets the problem up for a strobe mount; `None` where too little is observed.
    pub fn new(
        tracks: &[Track],
        setup: &Setup<'s>,
        lamps: Lamps,
        paths: &PathFor<'_>,
    ) -> Option<Self> {
        let views = light_paths(tracks, setup, lamps, paths);
        let mut node_weight = vec![0.0; setup.grid.count * setup.grid.count];
        let angles = views.iter().flatten().flat_map(|(_, _, path)| path.all_angles());
        angles.flat_map(|a| setup.grid.weights(a)).for_each(|(n, w)| node_weight[n] += w);
        // Only observed nodes are unknowns; observations at others are left out.
        let mut terms = Terms::new(setup, &node_weight);
        let is_solved = |node: usize| terms.beam.unknown(node).is_some();
        let (mut equations, mut ends) = (Vec::new(), Vec::with_capacity(tracks.len()));
        for of_track in views {
            let start = equations.len();
            equations.extend(of_track.into_iter().filter_map(|(source, o, path)| {
                Equation::new(setup, &is_solved, o, &path, source)
            }));
            if equations.len() - start < 2 {
                equations.truncate(start);
            } else {
                ends.push(equations.len());
            }
        }
        equations.iter_mut().enumerate().for_each(|(i, equation)| equation.index = i);
        let unknowns = (terms.beam.columns() + setup.bands).min(MAX_COUNTED_UNKNOWNS);
        if equations.len() < MIN_OBSERVATIONS_PER_UNKNOWN * unknowns || ends.len() < MIN_TRACKS {
            return None;
        }
        if let Some(term) = &mut terms.backscatter {
            term.max_strength_per_m = darkest(&equations, &term.state);
        }
        if let (Some(term), Some(share)) = (&mut terms.daylight, setup.daylight) {
            *term = DaylightTerm::new(setup.bands, begun_daylight(&equations, &share));
        }
        let weights = equations.iter().map(|e| e.reading.direct_share.map(|d| d * d)).collect();
        Some(Self { setup: *setup, equations, ends, terms, weights })
    }

    /// The equations with given terms and the weights of the last round.
    pub(super) fn system<'p>(&'p self, terms: &'p TermList<'p>) -> LinearSystem<'p> {
        LinearSystem {
            equations: &self.equations,
            ends: &self.ends,
            weights: &self.weights,
            bands: self.setup.bands,
            terms,
        }
    }

    /// Reweighted least squares; keeps the weights of the last round.
    pub fn solve(&mut self, rounds: usize) -> Option<Solution> {
        let unknowns = self.terms.list().unknowns();
        let mut solution = None;
        self.linearize_light(&mut DVector::zeros(unknowns));
        for _ in 0..rounds.max(1) {
            let list = self.terms.list();
            let system = self.system(&list);
            let (normal, right) = system.normal_equations(list.prior());
            let factor = normal.cholesky()?;
            let mut values = factor.solve(&right);
            let residuals = system.residuals(values.as_slice());
            let (weights, residual) = reweight(&self.equations, &residuals, self.setup.bands);
            self.weights = weights;
            let firsts = self.firsts_of_camera();
            self.terms.camera.update_gains(firsts, &values, &factor, residual);
            self.linearize_reading(&mut values);
            self.linearize_light(&mut values);
            solution = Some(Solution { values, residual });
        }
        solution
    }

    /// Segments for the jackknife.
    pub fn segments(&self) -> Segments {
        Segments::new(self.setup.independence, self.setup.segments)
    }

    /// First unknowns of the camera's terms: those that all bands share, and the others.
    fn firsts_of_camera(&self) -> [usize; 2] {
        [self.terms.first_of_camera(), self.terms.first_of_camera_bands()]
    }

    /// What a solution says of the camera.
    pub fn camera(&self, solution: &Solution) -> CameraSolution {
        let (frames, values) = (self.setup.independence.frames, solution.values.as_slice());
        self.terms.camera.solution(frames, self.firsts_of_camera(), values)
    }

    /// The light of several lamps and daylight adds up: its logarithm is made linear about a
    /// solution.
    fn linearize_light(&mut self, values: &mut DVector<f64>) {
        let has_daylight = self.terms.daylight.is_some();
        if !has_daylight && self.equations.iter().all(|e| e.path.legs.is_empty()) {
            return;
        }
        self.terms.apply_daylight(values.as_mut_slice());
        let (terms, values) = (&self.terms, values.as_slice());
        let log_beam = |nodes: &[(usize, f64)]| terms.beam.log_gain(nodes, values);
        for equation in &mut self.equations {
            equation.linearize_light(&terms.light_state(equation.frame, values, &log_beam));
        }
    }

    /// Takes the steps in backscatter, black level and transfer curve, and linearises the equations
    /// about the solution.
    fn linearize_reading(&mut self, values: &mut DVector<f64>) {
        if !self.terms.has_states() {
            return;
        }
        let direct = self.log_direct(values.as_slice());
        self.terms.apply(values.as_mut_slice());
        let backscatter = self.backscatter();
        let state: (_, &ReadingCurve) = (&backscatter, self.terms.camera.curve());
        for (equation, log_direct) in self.equations.iter_mut().zip(direct) {
            equation.linearize_reading(&log_direct, state, self.setup.bands);
        }
    }

    /// Log of the direct light less geometry that a solution predicts, per equation and band.
    fn log_direct(&self, values: &[f64]) -> Vec<Bands> {
        let list = self.terms.list();
        let system = self.system(&list);
        let predicted = par_map(self.equations.iter().collect(), |e| {
            system.predict(e, values, &mut Row::default())
        });
        let mut row = Row::default();
        let mut by_steps = |equation: &Equation, band: usize| {
            self.terms.state_row(equation, band, &mut row);
            row.dot(values)
        };
        let mut direct = vec![[0.0; 3]; self.equations.len()];
        for track in system.tracks() {
            for b in 0..self.setup.bands {
                let total: f64 = track.clone().map(|i| self.weights[i][b]).sum();
                let weighted =
                    |i: usize| self.weights[i][b] * (self.equations[i].y[b] - predicted[i][b]);
                let reflectance = track.clone().map(weighted).sum::<f64>() / total.max(1e-12);
                for i in track.clone() {
                    direct[i][b] = reflectance + predicted[i][b] - by_steps(&self.equations[i], b);
                }
            }
        }
        direct
    }

    /// Backscatter by the last solution.
    pub(super) fn backscatter(&self) -> Backscatter {
        self.terms.backscatter.as_ref().map_or(Backscatter::NONE, |term| term.state)
    }

    /// Daylight in the unit of a beam pattern that was made from these nodes.
    pub(super) fn daylight(&self, by_node: &[Option<f64>], beam: &BeamPattern) -> Option<Daylight> {
        let term = self.terms.daylight.as_ref()?;
        let in_unit_of_nodes = Daylight { log_strength: term.log_strength };
        Some(in_unit_of_nodes.shifted(-beam.level_of(by_node)?))
    }

    /// A solution as a model, without standard deviations.
    pub fn fit(&self, solution: &Solution) -> Fit {
        let (attenuation, first) = (&self.terms.attenuation, self.terms.first_attenuation());
        let weights = attenuation.mean_weights();
        let node = |b: usize, k: usize| solution.values[first + attenuation.unknown(b, k)];
        let mean = |b: usize| weights.iter().enumerate().map(|(k, w)| w * node(b, k)).sum();
        let by_node = self.terms.beam.by_node(solution.values.as_slice());
        let beam = BeamPattern::from_nodes(self.setup.grid, &by_node);
        Fit {
            attenuation_per_m: std::array::from_fn(|b| {
                if b < self.setup.bands { mean(b) } else { 0.0 }
            }),
            backscatter: self.backscatter(),
            daylight: self.daylight(&by_node, &beam),
            beam,
        }
    }

    /// The solution as an imaging model without backscatter; α is the mean over the frames.
    pub fn imaging_model(&self, solution: &Solution) -> ImagingModel {
        let Fit { attenuation_per_m, beam, daylight, .. } = self.fit(solution);
        let exponent = self.terms.exponent_unknown().map(|i| solution.values[i]);
        let spreading = SpreadingModel {
            strobe_leg: exponent.unwrap_or(self.setup.spreading.strobe_leg),
            ..self.setup.spreading
        };
        ImagingModel {
            bands: self.setup.bands,
            attenuation_per_m,
            over_time: Default::default(),
            spreading,
            incidence: self.setup.config.incidence,
            beam_pattern: beam,
            backscatter: None,
            daylight,
            residual: None,
            empirical: None,
        }
    }

    /// Parameters of the geometry as one more term, differentiated at a solution.
    pub fn differentiate(
        &self,
        tracks: &[Track],
        parameters: &[Parameter<'_>],
        solution: &Solution,
    ) -> Geometry {
        let model = self.imaging_model(solution);
        let observations: Vec<&Observation> = tracks.iter().flatten().collect();
        let log_radiance = |equation: &Equation, path: &LightPath| {
            let alpha = self.terms.attenuation_of(equation.frame, solution.values.as_slice());
            model.log_radiance_in(&alpha, path, Removal::FULL)
        };
        Geometry::new(parameters, &self.equations, &observations, &log_radiance)
    }

    /// The step of parameters that lowers the residuals most, to first order, with everything else
    /// free.
    pub fn parameter_step(
        &self,
        tracks: &[Track],
        parameters: &[Parameter<'_>],
        solution: &Solution,
    ) -> Option<ParameterStep> {
        let geometry = self.differentiate(tracks, parameters, solution);
        let mut list = self.terms.list();
        let first = list.unknowns();
        list.add(&geometry);
        let system = self.system(&list);
        let (normal, right) = system.normal_equations(list.prior());
        let values = normal.cholesky()?.solve(&right);
        let covariance = covariance(&system, &self.segments(), first)?;
        Some(ParameterStep {
            step: (0..parameters.len()).map(|k| values[first + k]).collect(),
            std: (0..parameters.len()).map(|k| covariance[(k, k)].sqrt()).collect(),
        })
    }

    /// Tilts of the frames as one more term; see `tilt_steps`.
    pub fn tilt_term<'t>(
        &self,
        solution: &Solution,
        (derivatives, state, stds): (&'t Geometry, &'t [[f64; AXES]], [f64; 2]),
    ) -> Tilt<'t> {
        let frames = self.setup.independence.frames;
        // Errors are common to regions of a frame: so many of its observations are one.
        let together = self.equations.len() as f64 / (INDEPENDENT_REGIONS * frames as f64);
        let hold_weights = stds.map(|std| (solution.residual / std).powi(2) * together.max(1.0));
        Tilt { frames, derivatives, state, hold_weights }
    }

    /// Steps of the tilts about the camera's x and y axes (rad) that lower the residuals most, to
    /// first order, with everything else free: of the tilt that all planes share, then of each
    /// frame's own. `parameters` tilt an observation's own frame; `stds` are standard deviations of
    /// the shared tilt and of the frames' own, `state` the tilts in hand (rad).
    pub fn tilt_steps(
        &self,
        tracks: &[Track],
        parameters: &[Parameter<'_>],
        solution: &Solution,
        (state, stds): (&[[f64; AXES]], [f64; 2]),
    ) -> Option<Vec<[f64; AXES]>> {
        let derivatives = &self.differentiate(tracks, parameters, solution);
        let tilt = self.tilt_term(solution, (derivatives, state, stds));
        let mut list = self.terms.list();
        let first = list.unknowns();
        list.add(&tilt);
        let (normal, right) = self.system(&list).normal_equations(list.prior());
        let values = normal.cholesky()?.solve(&right);
        let steps = values.as_slice()[first..first + tilt.columns()].chunks_exact(AXES);
        Some(steps.map(|step| std::array::from_fn(|axis| step[axis])).collect())
    }

    /// Log reflectance by one observation's own light, and its share of direct light: the
    /// prediction of a solution for any observation.
    pub fn reflectance_by(
        &self,
        solution: &Solution,
        o: &Observation,
        lamps: Lamps,
        paths: &PathFor<'_>,
    ) -> Option<(Bands, Bands)> {
        let path = paths(o, lamps).filter(|p| is_inside(&self.setup, p))?;
        let state = self.backscatter();
        let scatter = self.setup.scatter.map(|(_, scatter)| (&state, scatter));
        let setup = Setup { scatter, ..self.setup };
        let is_solved = |node: usize| self.terms.beam.unknown(node).is_some();
        let mut equation = Equation::new(&setup, &is_solved, o, &path, 0)?;
        let values = solution.values.as_slice();
        let log_beam = |nodes: &[(usize, f64)]| self.terms.beam.log_gain(nodes, values);
        if !equation.path.legs.is_empty() || self.terms.daylight.is_some() {
            equation.linearize_light(&self.terms.light_state(equation.frame, values, &log_beam));
        }
        let list = self.terms.list();
        let log_reflectance =
            self.system(&list).log_reflectance(&equation, values, &mut Row::default());
        Some((log_reflectance, equation.reading.direct_share))
    }
}

/// Light paths of all observations, by track; those outside the beam pattern's grid are left out.
fn light_paths<'t>(
    tracks: &'t [Track],
    setup: &Setup<'_>,
    lamps: Lamps,
    paths: &PathFor<'_>,
) -> Vec<Vec<WithPath<'t>>> {
    let mut source = 0;
    let numbered = tracks.iter().map(|track| {
        source += track.len();
        (source - track.len(), track)
    });
    let numbered: Vec<(usize, &Track)> = numbered.collect();
    let of_track = |first: usize, track: &'t Track| {
        let with_path =
            |(i, o)| Some((first + i, o, paths(o, lamps).filter(|path| is_inside(setup, path))?));
        track.iter().enumerate().filter_map(with_path).collect()
    };
    par_map(numbered, |(first, track)| of_track(first, track))
}

/// Whether all directions of a light path lie on the beam pattern's grid.
fn is_inside(setup: &Setup<'_>, path: &LightPath) -> bool {
    path.all_angles().all(|a| setup.grid.holds(a))
}

/// log d for which daylight has this share of the light of the median equation, the beam pattern
/// and the water being unknown.
fn begun_daylight(equations: &[Equation], share: &Bands) -> Bands {
    let lamps: Vec<f64> = equations.iter().map(|e| e.path.geometry[0]).collect();
    let level = stats::median(&lamps);
    share.map(|s| level + (s / (1.0 - s)).ln())
}

/// The largest b that the darkest observations allow (1/m).
fn darkest(equations: &[Equation], state: &Backscatter) -> Bands {
    let unit = Backscatter { strength_per_m: [1.0; 3], ..*state };
    std::array::from_fn(|b| {
        let ratio = |e: &Equation| {
            f64::from(e.reading.log_color[b]).exp() / unit.light(&e.reading.scatter)[b].max(1e-12)
        };
        let ratios: Vec<f64> = equations.iter().map(ratio).collect();
        stats::quantile(&ratios, DARKEST)
    })
}
