//! Normal equations: built track by track, the track's log reflectance ρ eliminated in closed form.
//!
//! A track contributes Σ w x xᵀ − (Σ w x)(Σ w x)ᵀ / Σ w per band.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};

use super::equation::Equation;
use super::row::Row;
use super::terms::backscatter::HOLDING;
use super::terms::{PriorEquations, TermList};
use crate::image::Bands;
use crate::parallel::par_map;

/// Parts of the sums: enough for the cores there are, few enough that adding up their matrices
/// costs little. Fixed, so that the result does not depend on the number of threads.
const PARTS: usize = 4;

/// Bits of a word.
const WORD: usize = u64::BITS as usize;

/// Weighted linear equations of tracks.
#[derive(Clone, Copy)]
pub struct LinearSystem<'p> {
    /// the equations of all tracks, track by track
    pub equations: &'p [Equation],
    /// end of each track in `equations`
    pub ends: &'p [usize],
    /// per equation and band
    pub weights: &'p [Bands],
    /// 1 or 3
    pub bands: usize,
    /// the unknowns
    pub terms: &'p TermList<'p>,
}

/// A normal matrix, of which the lower triangle is filled, and its right-hand side.
pub struct Normal {
    /// lower triangle
    pub matrix: DMatrix<f64>,
    /// right-hand side
    pub right: DVector<f64>,
    /// per unknown: Σ w x of the current track, by band
    sums: Vec<Bands>,
    /// a bit per unknown: whether the current track has it
    touched: Vec<u64>,
    /// those it has, in order, with their sums
    of_track: Vec<(usize, Bands)>,
    common: Row,
    own: Row,
}

impl<'p> LinearSystem<'p> {
    /// Ranges of the tracks in the equations.
    pub fn tracks(&self) -> impl Iterator<Item = Range<usize>> + use<'p> {
        let ends = self.ends.iter().copied();
        std::iter::once(0).chain(ends.clone()).zip(ends).map(|(a, b)| a..b)
    }

    /// Normal matrix and right-hand side of all tracks, added to `prior`.
    pub fn normal_equations(&self, prior: PriorEquations) -> (DMatrix<f64>, DVector<f64>) {
        let unknowns = prior.right.len();
        let mut sums = Normal::new(prior);
        let of_part = |tracks: &[Range<usize>]| {
            let mut part = Normal::new(PriorEquations::none(unknowns));
            tracks.iter().for_each(|track| part.add(self, track.clone()));
            part
        };
        for part in self.in_parts(of_part) {
            sums.matrix += part.matrix;
            sums.right += part.right;
        }
        for i in self.terms.held() {
            sums.matrix[(i, i)] += sums.matrix[(i, i)] * HOLDING;
        }
        (sums.matrix, sums.right)
    }

    /// What the unknowns contribute to an equation, by band.
    pub fn predict(&self, equation: &Equation, values: &[f64], row: &mut Row) -> Bands {
        self.terms.common_row(equation, row);
        let common = row.dot(values);
        std::array::from_fn(|b| {
            if b >= self.bands {
                return 0.0;
            }
            self.terms.band_row(equation, b, row);
            common + row.dot(values)
        })
    }

    /// y − prediction: log reflectance as one observation alone gives it.
    pub fn log_reflectance(&self, equation: &Equation, values: &[f64], row: &mut Row) -> Bands {
        let predicted = self.predict(equation, values, row);
        std::array::from_fn(|b| equation.y[b] - predicted[b])
    }

    /// y − ρ − prediction per equation and band, in log c, scaled up for the degree of freedom that
    /// ρ takes.
    pub fn residuals(&self, values: &[f64]) -> Vec<Bands> {
        let of_part = |tracks: &[Range<usize>]| {
            let mut row = Row::default();
            let of_track = |track| self.residuals_of(track, values, &mut row);
            tracks.iter().flat_map(of_track).collect::<Vec<_>>()
        };
        self.in_parts(of_part).concat()
    }

    fn residuals_of(&self, track: &Range<usize>, values: &[f64], row: &mut Row) -> Vec<Bands> {
        let (equations, weights) = (&self.equations[track.clone()], &self.weights[track.clone()]);
        let freedom = (track.len() as f64 / (track.len() as f64 - 1.0)).sqrt();
        let mut residuals: Vec<Bands> =
            equations.iter().map(|e| self.log_reflectance(e, values, row)).collect();
        for b in 0..self.bands {
            let (mut total, mut mean) = (0.0, 0.0);
            for (residual, weight) in residuals.iter().zip(weights) {
                total += weight[b];
                mean += weight[b] * residual[b];
            }
            for (residual, equation) in residuals.iter_mut().zip(equations) {
                residual[b] = (residual[b] - mean / total.max(1e-12))
                    * freedom
                    * equation.reading.direct_share[b];
            }
        }
        residuals
    }

    /// Work on all tracks in a fixed number of parts.
    pub fn in_parts<R: Send>(&self, work: impl Fn(&[Range<usize>]) -> R + Sync) -> Vec<R> {
        let tracks: Vec<Range<usize>> = self.tracks().collect();
        par_map(tracks.chunks(tracks.len().div_ceil(PARTS).max(1)).collect(), work)
    }
}

impl Normal {
    /// Begins with what is known beforehand.
    pub fn new(PriorEquations { matrix, right }: PriorEquations) -> Self {
        let unknowns = right.len();
        Self {
            matrix,
            right,
            sums: vec![[0.0; 3]; unknowns],
            touched: vec![0; unknowns.div_ceil(WORD)],
            of_track: Vec::new(),
            common: Row::default(),
            own: Row::default(),
        }
    }

    /// Adds one track with its reflectance eliminated.
    pub fn add(&mut self, system: &LinearSystem<'_>, track: Range<usize>) {
        let bands = system.bands;
        let (mut common, mut own) =
            (std::mem::take(&mut self.common), std::mem::take(&mut self.own));
        let (mut total, mut total_y) = ([0.0; 3], [0.0; 3]);
        let weighted = system.equations[track.clone()].iter().zip(&system.weights[track]);
        for (equation, weight) in weighted {
            system.terms.common_row(equation, &mut common);
            self.add_common(&common, weight, &equation.y, bands);
            for b in 0..bands {
                let (w, y) = (weight[b], equation.y[b]);
                system.terms.band_row(equation, b, &mut own);
                for (k, (p, x)) in own.iter().enumerate() {
                    self.right[*p] += w * x * y;
                    self.add_products((*p, w * x), &common);
                    self.add_products((*p, w * x), &own[..k]);
                    self.matrix[(*p, *p)] += w * x * x;
                    self.sum(*p, |of| if of == b { w * x } else { 0.0 });
                }
                total[b] += w;
                total_y[b] += w * y;
            }
        }
        self.eliminate(&total, &total_y);
        (self.common, self.own) = (common, own);
    }

    fn add_common(&mut self, row: &Row, weight: &Bands, y: &Bands, bands: usize) {
        let of_all = weight[..bands].iter().sum::<f64>();
        for (k, (p, x)) in row.iter().enumerate() {
            self.right[*p] += x * (0..bands).map(|b| weight[b] * y[b]).sum::<f64>();
            self.add_products((*p, of_all * x), &row[..k]);
            self.matrix[(*p, *p)] += of_all * x * x;
            self.sum(*p, |b| if b < bands { weight[b] * x } else { 0.0 });
        }
    }

    /// Adds products of one derivative, with its weight, with others of the same equation.
    fn add_products(&mut self, (p, weighted): (usize, f64), others: &[(usize, f64)]) {
        for (q, z) in others {
            // Two lamps that light a point from the same direction share nodes of the beam: such a
            // pair counts both ways.
            let times = if p == *q { 2.0 } else { 1.0 };
            self.matrix[(p.max(*q), p.min(*q))] += times * weighted * z;
        }
    }

    /// Subtracts (Σ w x)(Σ w x)ᵀ / Σ w of the current track.
    fn eliminate(&mut self, total: &Bands, total_y: &Bands) {
        let per_total = total.map(|t| if t > 1e-12 { 1.0 / t } else { 0.0 });
        self.gather();
        let unknowns = self.matrix.nrows();
        for (k, (p, x)) in self.of_track.iter().enumerate() {
            let x: Bands = std::array::from_fn(|b| x[b] * per_total[b]);
            self.right[*p] -= x[0] * total_y[0] + x[1] * total_y[1] + x[2] * total_y[2];
            // Down a column, as the matrix lies in memory.
            let column = &mut self.matrix.as_mut_slice()[p * unknowns..][..unknowns];
            for (q, z) in &self.of_track[k..] {
                column[*q] -= x[0] * z[0] + x[1] * z[1] + x[2] * z[2];
            }
        }
    }

    /// Takes the sums of the current track. Bits have the order that a sort would give.
    fn gather(&mut self) {
        self.of_track.clear();
        for (n, word) in self.touched.iter_mut().enumerate() {
            while *word != 0 {
                let unknown = n * WORD + word.trailing_zeros() as usize;
                self.of_track.push((unknown, std::mem::take(&mut self.sums[unknown])));
                *word &= *word - 1;
            }
        }
    }

    /// Adds to Σ w x of an unknown.
    fn sum(&mut self, unknown: usize, of_band: impl Fn(usize) -> f64) {
        self.touched[unknown / WORD] |= 1 << (unknown % WORD);
        self.sums[unknown].iter_mut().enumerate().for_each(|(b, sum)| *sum += of_band(b));
    }
}
