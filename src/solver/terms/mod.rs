//! The unknowns of the joint solve, one file per term.
//!
//! Adding a term: its file, and its place in [`Terms`] (field, `new`, `list`). Terms whose
//! derivatives are the same in all bands are listed apart: the normal equations treat them once.

pub mod attenuation;
pub mod backscatter;
pub mod beam;
mod black_level;
mod camera;
pub mod daylight;
pub mod exponent;
pub mod frame_gain;
pub mod gain_law;
pub mod geometry;
mod response;
#[cfg(test)]
mod tests;
pub mod tilt;
mod vignetting;

use nalgebra::{DMatrix, DVector};

use super::Setup;
use super::equation::Equation;
use super::equation::{LightState, LogBeam};
use super::row::Row;
use crate::image::Bands;
use attenuation::Attenuation;
use backscatter::BackscatterTerm;
use beam::Beam;
pub use camera::CameraSolution;
use camera::CameraTerms;
use daylight::Daylight;
use exponent::Exponent;

/// A group of unknowns that enter the log radiance together.
pub trait Term: Sync {
    /// Number of unknowns.
    fn columns(&self) -> usize;

    /// Pushes the derivatives of the log radiance of one observation in one band.
    fn jacobian(&self, equation: &Equation, band: usize, row: &mut Row);

    /// Adds what is known of the unknowns beforehand: smoothness, a weak prior.
    fn prior(&self, _prior: &mut Prior<'_>) {}

    /// Takes the solved values over. A term that is linearised about its own state takes the step
    /// and leaves 0 behind.
    fn apply(&mut self, _values: &mut [f64]) {}

    /// Unknowns that stand at a bound and are held there, counted from the term's first.
    fn held(&self) -> Vec<usize> {
        Vec::new()
    }
}

/// What is known of the unknowns beforehand, as normal equations.
#[derive(Clone)]
pub struct PriorEquations {
    /// normal matrix
    pub matrix: DMatrix<f64>,
    /// right-hand side
    pub right: DVector<f64>,
}

impl PriorEquations {
    /// No knowledge of so many unknowns.
    pub fn none(unknowns: usize) -> Self {
        Self { matrix: DMatrix::zeros(unknowns, unknowns), right: DVector::zeros(unknowns) }
    }

    /// Adds a term's knowledge; `first` is its first unknown.
    pub fn add(&mut self, term: &dyn Term, first: usize) {
        term.prior(&mut Prior { equations: self, first });
    }
}

/// Prior equations of one term.
pub struct Prior<'m> {
    equations: &'m mut PriorEquations,
    /// the term's first unknown
    first: usize,
}

impl Prior<'_> {
    /// Adds `weight · (Σ coefficient · unknown)²`; unknowns are counted from the term's first.
    pub fn hold(&mut self, equation: &[(usize, f64)], weight: f64) {
        self.hold_to(equation, 0.0, weight);
    }

    /// Adds `weight · (Σ coefficient · unknown − value)²`.
    pub fn hold_to(&mut self, equation: &[(usize, f64)], value: f64, weight: f64) {
        for (p, a) in equation {
            self.equations.right[self.first + *p] += weight * a * value;
            for (q, b) in equation {
                self.equations.matrix[(self.first + *p, self.first + *q)] += weight * a * b;
            }
        }
    }
}

/// The terms of one problem, in the order of their unknowns.
pub struct Terms<'s> {
    pub(super) beam: Beam,
    pub(super) attenuation: Attenuation<'s>,
    pub(super) exponent: Option<Exponent>,
    pub(super) backscatter: Option<BackscatterTerm>,
    pub(super) daylight: Option<Daylight>,
    pub(super) camera: CameraTerms<'s>,
}

/// Terms with the first unknown of each.
pub struct TermList<'t> {
    /// the same derivatives in all bands
    common: Vec<(usize, &'t dyn Term)>,
    /// one band's own
    of_band: Vec<(usize, &'t dyn Term)>,
    unknowns: usize,
}

impl<'s> Terms<'s> {
    /// The terms that a setup asks for; `node_weight` is the weight of observations by node of the
    /// beam pattern's grid.
    pub fn new(setup: &Setup<'s>, node_weight: &[f64]) -> Self {
        Self {
            beam: Beam::new(setup.grid, node_weight, setup.config.beam_smoothness),
            attenuation: Attenuation::new(setup.bands, setup.segments),
            exponent: setup.fit_exponent.then_some(Exponent),
            backscatter: setup.scatter.map(|(start, _)| BackscatterTerm::new(setup.bands, *start)),
            daylight: setup.daylight.map(|_| Daylight::new(setup.bands, [0.0; 3])),
            camera: CameraTerms::new(setup),
        }
    }

    /// All terms. Daylight has another share in every band, and so has the beam then.
    pub fn list(&self) -> TermList<'_> {
        let mut list = TermList { common: Vec::new(), of_band: Vec::new(), unknowns: 0 };
        if self.daylight.is_some() {
            list.add(&self.beam);
        } else {
            list = list.with_common(&self.beam);
        }
        list = self.camera.common().fold(list, TermList::with_common);
        list.add(&self.attenuation);
        self.exponent.iter().for_each(|term| list.add(term));
        self.backscatter.iter().for_each(|term| list.add(term));
        self.daylight.iter().for_each(|term| list.add(term));
        self.camera.of_band().for_each(|term| list.add(term));
        list
    }

    /// First unknown of α; those of a band follow one another over time.
    pub fn first_attenuation(&self) -> usize {
        self.first_of_camera() + self.camera.common().map(Term::columns).sum::<usize>()
    }

    /// The exponent's unknown.
    pub fn exponent_unknown(&self) -> Option<usize> {
        self.exponent.as_ref().map(|_| self.first_attenuation() + self.attenuation.columns())
    }

    /// First unknown of backscatter.
    pub fn first_backscatter(&self) -> usize {
        self.first_attenuation() + self.attenuation.columns() + usize::from(self.exponent.is_some())
    }

    /// First unknown of the camera's terms that all bands share.
    pub fn first_of_camera(&self) -> usize {
        self.beam.columns()
    }

    /// First unknown of the camera's terms that differ between the bands.
    pub fn first_of_camera_bands(&self) -> usize {
        self.first_daylight() + self.daylight.as_ref().map_or(0, Term::columns)
    }

    /// First unknown of daylight.
    pub fn first_daylight(&self) -> usize {
        self.first_backscatter() + self.backscatter.as_ref().map_or(0, Term::columns)
    }

    /// Whether any term is linearised about its own state.
    pub fn has_states(&self) -> bool {
        self.backscatter.is_some() || self.camera.has_states()
    }

    /// Derivatives by the unknowns that are steps from a state.
    pub fn state_row(&self, equation: &Equation, band: usize, row: &mut Row) {
        row.clear();
        if let Some(term) = &self.backscatter {
            row.begin_term(self.first_backscatter());
            term.jacobian(equation, band, row);
        }
        self.camera.state_row(self.first_of_camera_bands(), equation, band, row);
    }

    /// Hands the solved values to the terms that are linearised about their own state.
    pub fn apply(&mut self, values: &mut [f64]) {
        let (first, of_camera) = (self.first_backscatter(), self.first_of_camera_bands());
        if let Some(term) = &mut self.backscatter {
            let columns = term.columns();
            term.apply(&mut values[first..first + columns]);
        }
        self.camera.apply(of_camera, values);
    }

    /// α of a frame (1/m).
    pub fn attenuation_of(&self, frame: u32, values: &[f64]) -> Bands {
        self.attenuation.at(frame, &values[self.first_attenuation()..])
    }

    /// Takes the step of daylight, which changes the sum that `light_state` describes.
    pub fn apply_daylight(&mut self, values: &mut [f64]) {
        let first = self.first_daylight();
        if let Some(term) = &mut self.daylight {
            term.apply(&mut values[first..first + term.columns()]);
        }
    }

    /// The solution as the sum over several lamps and daylight needs it, at one frame.
    pub fn light_state<'v>(
        &self,
        frame: u32,
        values: &[f64],
        log_beam: &'v LogBeam<'v>,
    ) -> LightState<'v> {
        LightState {
            bands: self.attenuation.bands(),
            log_daylight: self.daylight.as_ref().map(|term| term.log_strength),
            attenuation_per_m: self.attenuation_of(frame, values),
            exponent: self.exponent_unknown().map_or(0.0, |i| values[i]),
            log_beam,
        }
    }
}

impl<'t> TermList<'t> {
    /// A list of one common term.
    pub fn of(term: &'t dyn Term) -> Self {
        Self { common: Vec::new(), of_band: Vec::new(), unknowns: 0 }.with_common(term)
    }

    fn with_common(mut self, term: &'t dyn Term) -> Self {
        self.common.push((self.unknowns, term));
        self.unknowns += term.columns();
        self
    }

    /// Adds a term whose derivatives differ between the bands.
    pub fn add(&mut self, term: &'t dyn Term) {
        self.of_band.push((self.unknowns, term));
        self.unknowns += term.columns();
    }

    /// Number of unknowns.
    pub fn unknowns(&self) -> usize {
        self.unknowns
    }

    /// Derivatives that all bands share.
    pub fn common_row(&self, equation: &Equation, row: &mut Row) {
        row.clear();
        for (first, term) in &self.common {
            row.begin_term(*first);
            term.jacobian(equation, 0, row);
        }
    }

    /// One band's own derivatives.
    pub fn band_row(&self, equation: &Equation, band: usize, row: &mut Row) {
        row.clear();
        for (first, term) in &self.of_band {
            row.begin_term(*first);
            term.jacobian(equation, band, row);
        }
    }

    /// The prior of all terms, and a ridge for directions that nothing determines: the constant
    /// shared by beam pattern and reflectance.
    pub fn prior(&self) -> PriorEquations {
        let mut equations = PriorEquations::none(self.unknowns);
        equations.matrix.fill_diagonal(1e-6);
        for (first, term) in self.common.iter().chain(&self.of_band) {
            equations.add(*term, *first);
        }
        equations
    }

    /// Unknowns that stand at a bound.
    pub fn held(&self) -> Vec<usize> {
        let of_term = |(first, term): &(usize, &dyn Term)| {
            term.held().into_iter().map(|k| first + k).collect::<Vec<_>>()
        };
        self.common.iter().chain(&self.of_band).flat_map(of_term).collect()
    }
}
