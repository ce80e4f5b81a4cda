//! The equations of the joint solve: built track by track with ρ eliminated, solved, and weighed
//! anew.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};

use super::{LEAST_DIRECT_SHARE, LegRow, NOISE_CLASSES, Problem, Row, Solution};
use crate::model::{SHAPES, log_sum};
use crate::parallel::par_map;
use crate::stats;

/// A held unknown is this much stiffer than the rows make it.
const HOLDING: f64 = 1e6;
/// Weight of the second difference of α in time: it bends by 0.005 per metre from node to node, for
/// a misfit of 0.01.
const TIME_BENDS: f64 = 4.0;
/// Weight of the first: no more than holds a stretch that no track tells of.
const TIME_STEPS: f64 = 1e-3;

/// The work is split into so many parts: enough for the cores there are, few enough that adding up
/// their matrices costs little.
const PARTS: usize = 4;

/// Weight that holds η and ζ where they are, in case no light tells of them.
const SHAPE_HELD: f64 = 1e-3;

impl Problem<'_> {
    /// Reweighted least squares; keeps the weights for what follows.
    pub fn solve(&mut self, rounds: usize) -> Option<Solution> {
        let smooth = self.smoothness();
        let mut solution = None;
        self.add_up_all(&DVector::zeros(self.columns.count()));
        for _ in 0..rounds.max(1) {
            let (normal, right) = self.normal_equations(&smooth);
            let values = normal.cholesky()?.solve(&right);
            let misfits = self.misfits(&values);
            let (weights, residual) = reweighted(&self.rows, &misfits, self.setting.bands);
            self.weights = weights;
            let values = self.begin_anew(values);
            self.add_up_all(&values);
            solution = Some(Solution { values, residual });
        }
        solution
    }

    /// The light of several lamps adds up: its logarithm is made linear about a solution, in all
    /// rows.
    fn add_up_all(&mut self, values: &DVector<f64>) {
        if self.rows.iter().all(|r| r.legs.is_empty()) {
            return;
        }
        let mut rows = std::mem::take(&mut self.rows);
        rows.iter_mut().for_each(|row| self.add_up(row, values));
        self.rows = rows;
    }

    /// log Σ_k e^{u_k} ≈ Σ_k s_k u_k + what is left over, u_k = B_k − α ℓ_k + geometry of lamp k,
    /// s_k its share of the light.
    pub(super) fn add_up(&self, row: &mut Row, values: &DVector<f64>) {
        if row.legs.is_empty() {
            return;
        }
        let bands = self.setting.bands;
        let beam = |leg: &LegRow| {
            leg.nodes
                .iter()
                .filter_map(|(n, w)| Some(w * values[self.columns.beam_node(*n)?]))
                .sum::<f64>()
        };
        let alpha: [f64; 3] = std::array::from_fn(|b| {
            if b < bands { self.attenuation_of(row.frame, b, values) } else { 0.0 }
        });
        let exponent = self.columns.exponent().map_or(0.0, |i| values[i]);
        // Without geometry, as far as it is no unknown.
        let of_leg =
            |l: &LegRow, b: usize| beam(l) - alpha[b] * l.length_m - exponent * l.length_m.ln();
        let said: Vec<[f64; 3]> =
            row.legs.iter().map(|l| std::array::from_fn(|b| of_leg(l, b))).collect();
        let sums: [f64; 3] = std::array::from_fn(|b| {
            log_sum(row.legs.iter().zip(&said).map(move |(l, s)| l.log_geometry + s[b]))
        });
        // One share for all bands: the offset makes each band exact at the solution.
        let share = |k: usize| {
            (0..bands).map(|b| (row.legs[k].log_geometry + said[k][b] - sums[b]).exp()).sum::<f64>()
                / bands as f64
        };
        let shares: Vec<f64> = (0..row.legs.len()).map(share).collect();
        let before = row.geometry;
        row.length_m = row.seafloor_to_camera_m;
        row.log_strobe_leg = row.legs.iter().zip(&shares).map(|(l, s)| s * l.length_m.ln()).sum();
        row.geometry = sums;
        for (k, (leg, share)) in row.legs.iter().zip(&shares).enumerate() {
            for (slot, (node, weight)) in row.nodes[4 * k..4 * k + 4].iter_mut().zip(leg.nodes) {
                *slot = (node, share * weight);
            }
            row.length_m += share * leg.length_m;
            row.geometry.iter_mut().zip(said[k]).for_each(|(g, s)| *g -= share * s);
        }
        (0..3).for_each(|b| row.y[b] += before[b] - row.geometry[b]);
    }

    /// α of a frame by a solution [1/m].
    pub(super) fn attenuation_of(&self, frame: u32, band: usize, values: &DVector<f64>) -> f64 {
        let node = |k: usize| values[self.columns.attenuation(band, k)];
        match self.setting.drift {
            None => node(0),
            Some(drift) => {
                let (k, share) = drift.places[frame as usize];
                if share > 0.0 { (1.0 - share) * node(k) + share * node(k + 1) } else { node(k) }
            }
        }
    }

    /// Takes the step in what scatters back, and makes the rows linear about the solution.
    fn begin_anew(&mut self, mut values: DVector<f64>) -> DVector<f64> {
        if self.setting.glow.is_none() {
            return values;
        }
        let direct: Vec<[f64; 3]> = {
            let said = par_map(self.rows.iter().collect(), |r| self.modelled(r, &values));
            let by_glow = |r: &Row, b: usize| {
                self.columns
                    .of_band(&self.setting, &self.back, r, b)
                    .iter()
                    .filter(|(i, _)| *i >= self.columns.glow_begins())
                    .map(|(i, x)| x * values[*i])
                    .sum::<f64>()
            };
            let mut direct = vec![[0.0; 3]; self.rows.len()];
            for track in self.tracks() {
                for b in 0..self.setting.bands {
                    let total: f64 = track.clone().map(|i| self.weights[i][b]).sum();
                    let reflectance = track
                        .clone()
                        .map(|i| self.weights[i][b] * (self.rows[i].y[b] - said[i][b]))
                        .sum::<f64>()
                        / total.max(1e-12);
                    for i in track.clone() {
                        direct[i][b] = reflectance + said[i][b] - by_glow(&self.rows[i], b);
                    }
                }
            }
            direct
        };
        for b in 0..self.setting.bands {
            if let Some(i) = self.columns.glow(b) {
                let (step, now) =
                    (std::mem::take(&mut values[i]), &mut self.back.strength_per_m[b]);
                let wanted = *now + if self.held[b] { step * HOLDING } else { step };
                *now = wanted.clamp(0.0, self.most_scattered[b]);
                // At a bound its column is held, or it would go on taking part of α with it.
                self.held[b] = *now != wanted;
            }
        }
        let step = std::array::from_fn(|k| {
            self.columns.shape(k).map_or(0.0, |i| std::mem::take(&mut values[i]))
        });
        self.back.reshape(step);
        for (row, log_direct) in self.rows.iter_mut().zip(direct) {
            let scattered = self.back.light(&row.glow);
            for b in 0..self.setting.bands {
                let direct =
                    (log_direct[b] + row.geometry[b]).exp().max(LEAST_DIRECT_SHARE * scattered[b]);
                let all = direct + scattered[b];
                row.direct_share[b] = direct / all;
                row.per_direct[b] = 1.0 / direct;
                row.y[b] = direct.ln() - row.geometry[b]
                    + (f64::from(row.log_color[b]) - all.ln()) / row.direct_share[b];
            }
        }
        values
    }

    /// What the unknowns say of a row, by band.
    fn modelled(&self, row: &Row, values: &DVector<f64>) -> [f64; 3] {
        let sum =
            |entries: &[(usize, f64)]| entries.iter().map(|(p, x)| x * values[*p]).sum::<f64>();
        let (beam, bands) = (sum(&self.columns.of_beam(row)), self.setting.bands);
        std::array::from_fn(|b| {
            if b < bands {
                beam + sum(&self.columns.of_band(&self.setting, &self.back, row, b))
            } else {
                0.0
            }
        })
    }

    /// y of a row less that.
    pub(super) fn beyond_model(&self, row: &Row, values: &DVector<f64>) -> [f64; 3] {
        let said = self.modelled(row, values);
        std::array::from_fn(|b| row.y[b] - said[b])
    }

    /// Second differences of neighbouring nodes of the beam, first differences of those in time,
    /// and a ridge for the one free constant.
    pub fn smoothness(&self) -> DMatrix<f64> {
        let unknowns = self.columns.count();
        let weight = self.setting.config.beam_smoothness;
        let mut matrix = DMatrix::from_diagonal_element(unknowns, unknowns, 1e-6);
        let mut hold = |terms: &[(usize, f64)], weight: f64| {
            for (p, a) in terms {
                for (q, b) in terms {
                    matrix[(*p, *q)] += weight * a * b;
                }
            }
        };
        let n = self.setting.nodes.count;
        for i in 0..n {
            for j in 0..n {
                for (step, inside) in [(1, j + 2 < n), (n, i + 2 < n)] {
                    let node = |k: usize| {
                        if inside { self.columns.beam_node(i * n + j + k * step) } else { None }
                    };
                    if let (Some(a), Some(b), Some(c)) = (node(0), node(1), node(2)) {
                        hold(&[(a, 1.0), (b, -2.0), (c, 1.0)], weight);
                    }
                }
            }
        }
        for unknown in (0..SHAPES).filter_map(|k| self.columns.shape(k)) {
            hold(&[(unknown, 1.0)], SHAPE_HELD);
        }
        if let Some(drift) = self.setting.drift {
            for b in 0..self.setting.bands {
                let node = |k: usize| self.columns.attenuation(b, k);
                (0..drift.joined.len())
                    .for_each(|k| hold(&[(node(k), 1.0), (node(k + 1), -1.0)], TIME_STEPS));
                // Across a gap the water may be another.
                for k in (1..drift.joined.len()).filter(|k| drift.joined[k - 1] && drift.joined[*k])
                {
                    hold(&[(node(k - 1), 1.0), (node(k), -2.0), (node(k + 1), 1.0)], TIME_BENDS);
                }
            }
        }
        matrix
    }

    /// Normal matrix and right-hand side of all tracks, over `smooth`.
    pub fn normal_equations(&self, smooth: &DMatrix<f64>) -> (DMatrix<f64>, DVector<f64>) {
        let mut sums = Normal::new(smooth.clone());
        let of_part = |tracks: &[Range<usize>]| {
            let mut part = Normal::new(DMatrix::zeros(smooth.nrows(), smooth.ncols()));
            tracks.iter().for_each(|track| part.add(self, track.clone()));
            part
        };
        for part in self.in_parts(of_part) {
            sums.matrix += part.matrix;
            sums.right += part.right;
        }
        for i in
            (0..self.setting.bands).filter(|b| self.held[*b]).filter_map(|b| self.columns.glow(b))
        {
            sums.matrix[(i, i)] += sums.matrix[(i, i)] * HOLDING;
        }
        (sums.matrix, sums.right)
    }

    /// y − ρ − model per observation and band, in log c, raised for the freedom that ρ took.
    pub fn misfits(&self, values: &DVector<f64>) -> Vec<[f64; 3]> {
        self.in_parts(|tracks| {
            tracks.iter().flat_map(|track| self.misfits_of(track, values)).collect::<Vec<_>>()
        })
        .concat()
    }

    fn misfits_of(&self, track: &Range<usize>, values: &DVector<f64>) -> Vec<[f64; 3]> {
        let (rows, weights) = (&self.rows[track.clone()], &self.weights[track.clone()]);
        let freedom = freedom(track);
        let mut misfits: Vec<[f64; 3]> =
            rows.iter().map(|row| self.beyond_model(row, values)).collect();
        for b in 0..self.setting.bands {
            let (mut total, mut mean) = (0.0, 0.0);
            for (misfit, weight) in misfits.iter().zip(weights) {
                total += weight[b];
                mean += weight[b] * misfit[b];
            }
            for (misfit, row) in misfits.iter_mut().zip(rows) {
                misfit[b] = (misfit[b] - mean / total.max(1e-12)) * freedom * row.direct_share[b];
            }
        }
        misfits
    }

    /// Work on all tracks, in a few parts, on as many cores; the parts do not depend on the cores,
    /// so neither do sums over them.
    fn in_parts<R: Send>(&self, work: impl Fn(&[Range<usize>]) -> R + Sync) -> Vec<R> {
        let tracks: Vec<Range<usize>> = self.tracks().collect();
        par_map(tracks.chunks(tracks.len().div_ceil(PARTS).max(1)).collect(), work)
    }
}

/// A normal matrix, of which the lower triangle is filled, and its right-hand side, as tracks are
/// added.
pub struct Normal {
    pub matrix: DMatrix<f64>,
    pub right: DVector<f64>,
    /// Σ w x per unknown of the track in hand and band
    sums: Vec<(usize, [f64; 3])>,
    /// unknown → where in `sums`
    slots: Vec<usize>,
}

impl Normal {
    /// Nothing but `matrix`.
    pub fn new(matrix: DMatrix<f64>) -> Self {
        let unknowns = matrix.nrows();
        Self {
            matrix,
            right: DVector::zeros(unknowns),
            sums: Vec::new(),
            slots: vec![usize::MAX; unknowns],
        }
    }

    /// Adds one track with its reflectance eliminated.
    pub fn add(&mut self, problem: &Problem<'_>, track: Range<usize>) {
        let bands = problem.setting.bands;
        let (mut total, mut total_y) = ([0.0; 3], [0.0; 3]);
        for (row, weight) in problem.rows[track.clone()].iter().zip(&problem.weights[track]) {
            let (beam, of_all) =
                (problem.columns.of_beam(row), weight[..bands].iter().sum::<f64>());
            for (k, (p, x)) in beam.iter().enumerate() {
                self.right[*p] += x * (0..bands).map(|b| weight[b] * row.y[b]).sum::<f64>();
                for (j, (q, z)) in beam[..=k].iter().enumerate() {
                    // Two lamps that shine on a point from alike share nodes of the beam: such a
                    // pair counts both ways.
                    let times = if j < k && p == q { 2.0 } else { 1.0 };
                    self.matrix[(*p.max(q), *p.min(q))] += times * of_all * x * z;
                }
                self.sum(*p, |b| if b < bands { weight[b] * x } else { 0.0 });
            }
            for b in 0..bands {
                let (w, own) =
                    (weight[b], problem.columns.of_band(&problem.setting, &problem.back, row, b));
                for (k, (p, x)) in own.iter().enumerate() {
                    self.right[*p] += w * x * row.y[b];
                    for (q, z) in beam.iter().chain(&own[..=k]) {
                        self.matrix[(*p, *q)] += w * x * z;
                    }
                    self.sum(*p, |of| if of == b { w * x } else { 0.0 });
                }
                total[b] += w;
                total_y[b] += w * row.y[b];
            }
        }
        let per_total = total.map(|t| if t > 1e-12 { 1.0 / t } else { 0.0 });
        self.sums.sort_unstable_by_key(|(p, _)| *p);
        let unknowns = self.matrix.nrows();
        for (k, (p, x)) in self.sums.iter().enumerate() {
            let x: [f64; 3] = std::array::from_fn(|b| x[b] * per_total[b]);
            self.right[*p] -= x[0] * total_y[0] + x[1] * total_y[1] + x[2] * total_y[2];
            // Down a column, as the matrix lies in memory.
            let column = &mut self.matrix.as_mut_slice()[p * unknowns..][..unknowns];
            for (q, z) in &self.sums[k..] {
                column[*q] -= x[0] * z[0] + x[1] * z[1] + x[2] * z[2];
            }
            self.slots[*p] = usize::MAX;
        }
        self.sums.clear();
    }

    /// Adds to Σ w x of an unknown.
    fn sum(&mut self, unknown: usize, of_band: impl Fn(usize) -> f64) {
        let slot = &mut self.slots[unknown];
        if *slot == usize::MAX {
            *slot = self.sums.len();
            self.sums.push((unknown, [0.0; 3]));
        }
        self.sums[*slot].1.iter_mut().enumerate().for_each(|(b, sum)| *sum += of_band(b));
    }
}

/// Misfits are small by the freedom that a track's own reflectance takes.
pub fn freedom(track: &Range<usize>) -> f64 {
    (track.len() as f64 / (track.len() as f64 - 1.0)).sqrt()
}

/// New weights of y from misfits of log c, and the overall spread.
fn reweighted(rows: &[Row], misfits: &[[f64; 3]], bands: usize) -> (Vec<[f64; 3]>, f64) {
    let all: Vec<f64> = misfits.iter().flat_map(|m| m[..bands].iter().copied()).collect();
    let residual = stats::scale(&all);
    // (expected log c, misfit), darkest first. Expected, not observed: sorted by its own noise, dim
    // light that happens to be brighter would weigh more, and α come out too small (by 0.0001 per
    // metre in the red of rendered dives).
    let mut scales = vec![[residual; 3]; rows.len()];
    for b in 0..bands {
        let expected = |i: usize| f64::from(rows[i].log_color[b]) - misfits[i][b];
        let mut order: Vec<(f64, usize)> = (0..rows.len()).map(|i| (expected(i), i)).collect();
        order.sort_unstable_by(|x, y| x.0.total_cmp(&y.0).then(x.1.cmp(&y.1)));
        for class in order.chunks(rows.len().div_ceil(NOISE_CLASSES).max(30)) {
            let of_class: Vec<f64> = class.iter().map(|(_, i)| misfits[*i][b]).collect();
            let scale = stats::scale(&of_class).max(0.2 * residual);
            class.iter().for_each(|(_, i)| scales[*i][b] = scale);
        }
    }
    let of_row = |((row, misfit), scale): ((&Row, &[f64; 3]), &[f64; 3])| {
        // A false match is false in all bands: the robust factor is shared.
        let common =
            ((0..bands).map(|b| (misfit[b] / scale[b]).powi(2)).sum::<f64>() / bands as f64).sqrt();
        let trust = stats::cauchy(common, 1.0);
        std::array::from_fn(|b| {
            if b < bands {
                trust * (residual / scale[b] * row.direct_share[b]).powi(2)
            } else {
                0.0
            }
        })
    };
    (rows.iter().zip(misfits).zip(&scales).map(of_row).collect(), residual)
}
