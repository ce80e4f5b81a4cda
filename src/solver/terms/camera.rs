//! The camera's own terms, as far as a setup asks for them.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::black_level::BlackLevel;
use super::frame_gain::FrameGain;
use super::gain_law::GainLaw;
use super::response::ResponseTerm;
use super::vignetting::Vignetting;
use super::{Equation, Row, Term};
use crate::image::Bands;
use crate::model::Metered;
use crate::solver::Setup;
use crate::solver::camera::{FrameGains, ReadingCurve, VIGNETTING_TERMS};

/// Least standard deviation of gains that evidence arrives at (log light).
const MIN_GAIN_STD: f64 = 5e-4;
/// Residual that a solve begins with (log light).
const FIRST_RESIDUAL: f64 = 0.02;

/// The camera's terms of one problem.
#[derive(Default)]
pub struct CameraTerms<'s> {
    gain: Option<RandomGain>,
    band_gain: Option<RandomGain>,
    law: Option<GainLaw<'s>>,
    vignetting: Option<Vignetting>,
    response: Option<ResponseTerm>,
    black_level: Option<BlackLevel>,
    /// the curve that the state of response and black level amounts to
    curve: ReadingCurve,
    bands: usize,
}

/// Gains with their variance.
struct RandomGain {
    term: FrameGain,
    /// τ (log light)
    std: f64,
    is_estimated: bool,
}

/// Values of the camera's unknowns.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CameraSolution {
    /// per frame and band: log gain, without the law's part
    pub log_gains: Vec<Bands>,
    /// standard deviations of the gains: shared by the bands, and each band's own (log light)
    pub gain_std: [f64; 2],
    /// κ and κ' (see `gain_law`)
    pub law: [f64; 2],
    /// v₁ to v₃
    pub vignetting: [f64; VIGNETTING_TERMS],
    /// black level and transfer curve
    pub curve: ReadingCurve,
}

impl<'s> CameraTerms<'s> {
    pub fn new(setup: &Setup<'s>) -> Self {
        let Some(camera) = setup.camera else { return Self::default() };
        let bands = setup.bands;
        let gain = |of_band: bool| camera.gains.and_then(|g| RandomGain::new(&g, bands, of_band));
        Self {
            gain: gain(false),
            band_gain: if bands == 3 { gain(true) } else { None },
            law: camera.law.map(|metered| GainLaw { bands, metered }),
            vignetting: camera.vignetting.then_some(Vignetting),
            response: camera
                .response
                .then_some(ResponseTerm { coefficients: camera.start.coefficients }),
            black_level: camera
                .black_level
                .then_some(BlackLevel { bands, level: camera.start.black_level }),
            curve: camera.start.clone(),
            bands,
        }
    }

    /// Terms whose derivatives all bands share.
    pub fn common(&self) -> impl Iterator<Item = &dyn Term> {
        let gain = self.gain.iter().map(|g| &g.term as &dyn Term);
        gain.chain(self.vignetting.iter().map(|term| term as &dyn Term))
    }

    /// The others; those that are linearised about a state come last.
    pub fn of_band(&self) -> impl Iterator<Item = &dyn Term> {
        self.linear_of_band().chain(self.states())
    }

    fn linear_of_band(&self) -> impl Iterator<Item = &dyn Term> {
        let gain = self.band_gain.iter().map(|g| &g.term as &dyn Term);
        gain.chain(self.law.iter().map(|term| term as &dyn Term))
    }

    fn states(&self) -> impl Iterator<Item = &dyn Term> {
        let response = self.response.iter().map(|term| term as &dyn Term);
        response.chain(self.black_level.iter().map(|term| term as &dyn Term))
    }

    pub fn has_states(&self) -> bool {
        self.response.is_some() || self.black_level.is_some() || !self.curve.is_identity()
    }

    /// Black level and transfer curve in hand.
    pub fn curve(&self) -> &ReadingCurve {
        &self.curve
    }

    /// Derivatives by the steps of response and black level; `first` is the first unknown of
    /// `of_band`.
    pub fn state_row(&self, first: usize, equation: &Equation, band: usize, row: &mut Row) {
        let mut at = first + self.linear_of_band().map(Term::columns).sum::<usize>();
        for term in self.states() {
            row.begin_term(at);
            term.jacobian(equation, band, row);
            at += term.columns();
        }
    }

    /// Takes the steps of response and black level.
    pub fn apply(&mut self, first: usize, values: &mut [f64]) {
        let mut at = first + self.linear_of_band().map(Term::columns).sum::<usize>();
        let (mut coefficients, mut level) = (self.curve.coefficients, self.curve.black_level);
        if let Some(term) = &mut self.response {
            term.apply(&mut values[at..at + term.columns()]);
            (coefficients, at) = (term.coefficients, at + term.columns());
        }
        if let Some(term) = &mut self.black_level {
            term.apply(&mut values[at..at + term.columns()]);
            level = term.level;
        }
        self.curve = self.curve.with(level, coefficients);
    }

    /// Variances of the gains by evidence (MacKay), and the weights that hold the gains, which are
    /// in units of the residual. `firsts`: first unknowns of `common` and `of_band`.
    pub fn update_gains(
        &mut self,
        firsts: [usize; 2],
        values: &DVector<f64>,
        factor: &Cholesky<f64, Dyn>,
        residual: f64,
    ) {
        for (gain, first) in [&mut self.gain, &mut self.band_gain].into_iter().zip(firsts) {
            if let Some(gain) = gain {
                gain.update(first, values, factor, residual);
            }
        }
    }

    /// The solved values. `firsts` as in `update_gains`.
    pub fn solution(&self, frames: usize, firsts: [usize; 2], values: &[f64]) -> CameraSolution {
        let gain = |f: usize, b: usize| {
            let of = |gain: &Option<RandomGain>, first: usize| {
                gain.as_ref().map_or(0.0, |g| values[first + g.term.unknown(f, b)])
            };
            of(&self.gain, firsts[0]) + of(&self.band_gain, firsts[1])
        };
        let of_gain = |g: &Option<RandomGain>| g.as_ref().map_or(0, |g| g.term.columns());
        let after_gain = firsts[0] + of_gain(&self.gain);
        let after_band_gain = firsts[1] + of_gain(&self.band_gain);
        let mut found = CameraSolution {
            log_gains: (0..frames)
                .map(|f| std::array::from_fn(|b| if b < self.bands { gain(f, b) } else { 0.0 }))
                .collect(),
            gain_std: [&self.gain, &self.band_gain].map(|g| g.as_ref().map_or(0.0, |g| g.std)),
            curve: self.curve.clone(),
            ..CameraSolution::default()
        };
        if let Some(law) = &self.law {
            let law = &values[after_band_gain..after_band_gain + law.columns()];
            found.law.iter_mut().zip(law).for_each(|(of_law, value)| *of_law = *value);
        }
        if self.vignetting.is_some() {
            found.vignetting = std::array::from_fn(|k| values[after_gain + k]);
        }
        found
    }
}

impl CameraSolution {
    /// The gains that the law gives to a frame of such mean readings.
    pub fn by_law(&self, metered: &Metered, bands: usize) -> Bands {
        let gain = |b: usize| self.law[0] * metered.brightness + self.law[1] * metered.color[b];
        std::array::from_fn(|b| if b < bands { gain(b) } else { 0.0 })
    }
}

impl RandomGain {
    fn new(gains: &FrameGains<'_>, bands: usize, of_band: bool) -> Option<Self> {
        let std = gains.std[usize::from(of_band)];
        let mean = |m: &Bands| m[..bands].iter().sum::<f64>() / bands as f64;
        let means = if of_band {
            let own = |m: &Bands| (0..bands).map(|b| m[b] - mean(m)).collect::<Vec<_>>();
            gains.means.iter().flat_map(own).collect()
        } else {
            gains.means.iter().map(mean).collect()
        };
        let term = FrameGain {
            frames: gains.means.len(),
            bands: if of_band { bands } else { 1 },
            means,
            hold_weight: (FIRST_RESIDUAL / std).powi(2),
        };
        (std > 0.0).then_some(Self { term, std, is_estimated: gains.is_estimated })
    }

    fn update(
        &mut self,
        first: usize,
        values: &DVector<f64>,
        factor: &Cholesky<f64, Dyn>,
        residual: f64,
    ) {
        if self.is_estimated {
            let columns = self.term.columns();
            let own: Vec<f64> =
                (0..columns).map(|k| values[first + k] - self.term.mean(k)).collect();
            let mut unit = DMatrix::zeros(values.len(), columns);
            (0..columns).for_each(|k| unit[(first + k, k)] = 1.0);
            factor.solve_mut(&mut unit);
            let covariance = unit.rows(first, columns).into_owned();
            self.std = evidence(&own, &covariance, self.term.bands, (residual, self.std));
        }
        self.term.hold_weight = (residual / self.std).powi(2);
    }
}

/// τ² = Σ v² / (n − tr(C) s² / τ²). A ramp along the log is nearly a gauge (reflectance, beam
/// pattern and gain share it), so it is left out.
fn evidence(
    values: &[f64],
    covariance: &DMatrix<f64>,
    bands: usize,
    (residual, std): (f64, f64),
) -> f64 {
    let frames = values.len() / bands;
    let mut ramp = DVector::from_fn(frames, |f, _| f as f64 - (frames as f64 - 1.0) / 2.0);
    ramp /= ramp.norm().max(1e-12);
    let (mut sum, mut trace) = (0.0, 0.0);
    for b in 0..bands {
        let of_ramp: f64 = (0..frames).map(|f| ramp[f] * values[f * bands + b]).sum();
        for f in 0..frames {
            sum += (values[f * bands + b] - of_ramp * ramp[f]).powi(2);
            trace += covariance[(f * bands + b, f * bands + b)];
            let along: f64 =
                (0..frames).map(|g| ramp[g] * covariance[(f * bands + b, g * bands + b)]).sum();
            trace -= ramp[f] * along;
        }
    }
    let free = (bands * frames.saturating_sub(1)) as f64 - trace * (residual / std).powi(2);
    (sum / free.max(1.0)).sqrt().max(MIN_GAIN_STD)
}
