//! Attenuation, beam pattern and the reflectance of every tracked point in one robust solve (Eq. 15).
//!
//! ```text
//! y_o = ρ_t + Σ_n w_n B_n − α_Λ ℓ_o [− p log ℓ_a]        y = log c − spreading − log cos γ
//! ```
//!
//! Unknown: α per band, B on bilinear nodes shared by the bands (second differences held small), optionally the
//! spreading exponent p, and ρ per track and band. The ρ are eliminated in closed form: each track
//! contributes Σ w x xᵀ − (Σ w x)(Σ w x)ᵀ / Σ w. Reweighted (Cauchy), a fixed number of rounds. A band's noise
//! grows as light gets less, so misfits are measured against the spread of equally bright observations.
//!
//! What a frame gets wrong (plane, attitude) it gets wrong in all its points: the standard deviations come from
//! residuals summed by stretches of frames (a sandwich estimate), not from counting points as independent.
//! After Bryson et al. (JFR 2016) and SUCRe (3DV 2024) in idea; ours in form.

use nalgebra::{DMatrix, DVector};

use super::tracks::Track;
use super::{SamplePath, robust};
use crate::config::EstimateConfig;
use crate::image::Bands;
use crate::model::{Nodes, SpreadingModel, log_geometry};

/// Nodes with less weight of observations are not solved for.
const LEAST_NODE_WEIGHT: f64 = 3.0;
/// Brightness classes of the noise.
const NOISE_CLASSES: usize = 6;
/// Stretches of frames whose errors are taken to be independent.
const STRETCHES: usize = 12;

/// The answer of the solve.
#[derive(Clone, Debug)]
pub struct JointAnswer {
    /// α [1/m] per band
    pub attenuation_per_m: Bands,
    /// clustered by stretches of frames [1/m]
    pub std_per_m: Bands,
    /// the same for red − green and green − blue [1/m]
    pub difference_std_per_m: [f64; 2],
    /// p, where it was fitted, and its standard deviation
    pub exponent: Option<(f64, f64)>,
    /// log BP by node, `None` where not solved for
    pub beam: Vec<Option<f64>>,
    /// tracks used
    pub tracks: usize,
    /// observations used
    pub observations: usize,
    /// robust spread of what is left over [log light]
    pub residual: f64,
    /// root mean square difference of path length within a track [m]
    pub path_spread_m: f64,
}

/// One view of a track, as numbers of the linear problem.
struct Row {
    frame: u32,
    nodes: [(usize, f64); 4],
    length_m: f64,
    log_strobe_leg: f64,
    y: [f64; 3],
    class: [u8; 3],
}

/// What the solve is told beside the tracks.
#[derive(Clone, Copy)]
pub struct Setting<'s> {
    /// how many frames there are
    pub frames: usize,
    /// 1 or 3
    pub bands: usize,
    /// the beam pattern's grid
    pub nodes: Nodes,
    /// p_a and p_s
    pub spreading: SpreadingModel,
    /// whether p_a is an unknown
    pub fit_exponent: bool,
    /// the choices
    pub config: &'s EstimateConfig,
}

/// Solves for all tracks; `None` where too little is seen.
pub fn solve(tracks: &[Track], setting: &Setting<'_>, paths: &SamplePath<'_>) -> Option<JointAnswer> {
    let Setting { frames, bands, nodes, spreading, fit_exponent, config } = *setting;
    let spreading = if fit_exponent { SpreadingModel { strobe_leg: 0.0, ..spreading } } else { spreading };
    let mut rows: Vec<Row> = Vec::new();
    let mut ends: Vec<usize> = Vec::new();
    for track in tracks {
        let start = rows.len();
        for o in track {
            let Some(path) = paths(o).filter(|p| nodes.holds(p.angles)) else { continue };
            let geometry = log_geometry(spreading, config.incidence, &path);
            rows.push(Row {
                frame: o.frame,
                nodes: nodes.weights(path.angles),
                length_m: path.length_m(),
                log_strobe_leg: path.strobe_to_seafloor_m.ln(),
                y: std::array::from_fn(|b| if b < bands { f64::from(o.sight.log_color[b]) - geometry } else { 0.0 }),
                class: [0; 3],
            });
        }
        if rows.len() - start < 2 {
            rows.truncate(start);
        } else {
            ends.push(rows.len());
        }
    }
    classify(&mut rows, tracks, bands);

    // Only nodes that are seen are unknowns.
    let mut seen = vec![0.0; nodes.count * nodes.count];
    rows.iter().flat_map(|r| r.nodes).for_each(|(n, w)| seen[n] += w);
    let active: Vec<usize> = (0..seen.len()).filter(|n| seen[*n] >= LEAST_NODE_WEIGHT).collect();
    let mut place = vec![usize::MAX; seen.len()];
    active.iter().enumerate().for_each(|(i, n)| place[*n] = i);
    let mut kept_rows = Vec::with_capacity(rows.len());
    let mut kept_ends = Vec::with_capacity(ends.len());
    let mut start = 0;
    let mut rows = rows.into_iter();
    for end in ends {
        let before = kept_rows.len();
        kept_rows.extend(rows.by_ref().take(end - start).filter(|r| r.nodes.iter().all(|(n, w)| place[*n] != usize::MAX || *w < 1e-9)));
        start = end;
        if kept_rows.len() - before < 2 {
            kept_rows.truncate(before);
        } else {
            kept_ends.push(kept_rows.len());
        }
    }
    let (rows, ends) = (kept_rows, kept_ends);
    let unknowns = active.len() + bands + usize::from(fit_exponent);
    if rows.len() < 2 * unknowns.min(100) || ends.len() < 30 {
        return None;
    }
    let problem = Problem { rows: &rows, ends: &ends, place: &place, bands, beam: active.len(), unknowns, fit_exponent };

    let smooth = problem.smoothness(nodes, config.beam_smoothness);
    let mut weights = vec![[1.0; 3]; rows.len()];
    let mut solution = DVector::zeros(unknowns);
    let mut residual = 0.0;
    let mut normal = smooth.clone();
    for _ in 0..config.rounds.max(1) {
        let (matrix, right) = problem.normal_equations(&weights, &smooth);
        normal = matrix;
        solution = normal.clone().cholesky()?.solve(&right);
        let misfits = problem.misfits(&solution, &weights);
        (weights, residual) = reweighted(&rows, &misfits, bands);
    }
    let covariance = problem.covariance(&normal, &solution, &weights, frames)?;
    let at = |b: usize| active.len() + b;
    let mut answer = JointAnswer {
        attenuation_per_m: [0.0; 3],
        std_per_m: [0.0; 3],
        difference_std_per_m: [0.0; 2],
        exponent: fit_exponent.then(|| (solution[unknowns - 1], covariance[(unknowns - 1 - active.len(), unknowns - 1 - active.len())].sqrt())),
        beam: place.iter().map(|i| solution.get(*i).copied().filter(|_| *i != usize::MAX)).collect(),
        tracks: ends.len(),
        observations: rows.len(),
        residual,
        path_spread_m: problem.path_spread_m(),
    };
    for b in 0..bands {
        answer.attenuation_per_m[b] = solution[at(b)];
        answer.std_per_m[b] = covariance[(b, b)].sqrt();
    }
    for b in 0..bands.saturating_sub(1) {
        answer.difference_std_per_m[b] = (covariance[(b, b)] + covariance[(b + 1, b + 1)] - 2.0 * covariance[(b, b + 1)]).max(0.0).sqrt();
    }
    Some(answer)
}

/// Sorts the observations of each band into classes of equal brightness.
fn classify(rows: &mut [Row], tracks: &[Track], bands: usize) {
    if tracks.is_empty() || rows.is_empty() {
        return;
    }
    for b in 0..bands {
        let values: Vec<f64> = rows.iter().map(|r| r.y[b] - 2.0 * r.log_strobe_leg).collect();
        let edges: Vec<f64> = (1..NOISE_CLASSES).map(|k| robust::quantile(&values, k as f64 / NOISE_CLASSES as f64)).collect();
        for (row, value) in rows.iter_mut().zip(&values) {
            row.class[b] = edges.iter().filter(|e| value > e).count() as u8;
        }
    }
}

/// New weights from misfits, and the overall spread.
fn reweighted(rows: &[Row], misfits: &[[f64; 3]], bands: usize) -> (Vec<[f64; 3]>, f64) {
    let all: Vec<f64> = misfits.iter().flat_map(|m| m[..bands].iter().copied()).collect();
    let residual = robust::scale(&all);
    let mut scales = [[residual; NOISE_CLASSES]; 3];
    for (b, of_band) in scales.iter_mut().enumerate().take(bands) {
        for (class, scale) in of_band.iter_mut().enumerate() {
            let of_class: Vec<f64> = rows.iter().zip(misfits).filter(|(r, _)| usize::from(r.class[b]) == class).map(|(_, m)| m[b]).collect();
            if of_class.len() >= 30 {
                *scale = robust::scale(&of_class).max(0.2 * residual);
            }
        }
    }
    let weights = rows
        .iter()
        .zip(misfits)
        .map(|(row, misfit)| {
            let scale = |b: usize| scales[b][usize::from(row.class[b])];
            // A false match is false in all bands: the robust factor is shared.
            let common = ((0..bands).map(|b| (misfit[b] / scale(b)).powi(2)).sum::<f64>() / bands as f64).sqrt();
            let trust = robust::cauchy(common, 1.0);
            std::array::from_fn(|b| if b < bands { trust * (residual / scale(b)).powi(2) } else { 0.0 })
        })
        .collect();
    (weights, residual)
}

struct Problem<'p> {
    rows: &'p [Row],
    ends: &'p [usize],
    place: &'p [usize],
    bands: usize,
    /// unknown nodes; α follow, then the exponent
    beam: usize,
    unknowns: usize,
    fit_exponent: bool,
}

impl Problem<'_> {
    fn tracks(&self) -> impl Iterator<Item = std::ops::Range<usize>> {
        std::iter::once(0).chain(self.ends.iter().copied()).zip(self.ends.iter().copied()).map(|(a, b)| a..b)
    }

    /// The non-zero entries of a row's design for one band.
    fn design(&self, row: &Row, band: usize) -> ([(usize, f64); 6], usize) {
        let mut entries = [(0, 0.0); 6];
        let mut n = 0;
        for (node, weight) in row.nodes {
            if self.place[node] != usize::MAX {
                entries[n] = (self.place[node], weight);
                n += 1;
            }
        }
        entries[n] = (self.beam + band, -row.length_m);
        n += 1;
        if self.fit_exponent {
            entries[n] = (self.unknowns - 1, -row.log_strobe_leg);
            n += 1;
        }
        (entries, n)
    }

    /// Second differences of neighbouring nodes, and a ridge for the one free constant.
    fn smoothness(&self, nodes: Nodes, weight: f64) -> DMatrix<f64> {
        let mut matrix = DMatrix::from_diagonal_element(self.unknowns, self.unknowns, 1e-6);
        let n = nodes.count;
        for i in 0..n {
            for j in 0..n {
                for step in [1, n] {
                    let inside = if step == 1 { j + 2 < n } else { i + 2 < n };
                    let first = i * n + j;
                    if !inside {
                        continue;
                    }
                    let three = [first, first + step, first + 2 * step].map(|k| self.place[k]);
                    if three.contains(&usize::MAX) {
                        continue;
                    }
                    for (p, a) in three.iter().zip([1.0, -2.0, 1.0]) {
                        for (q, b) in three.iter().zip([1.0, -2.0, 1.0]) {
                            matrix[(*p, *q)] += weight * a * b;
                        }
                    }
                }
            }
        }
        matrix
    }

    fn normal_equations(&self, weights: &[[f64; 3]], smooth: &DMatrix<f64>) -> (DMatrix<f64>, DVector<f64>) {
        let (mut matrix, mut right) = (smooth.clone(), DVector::zeros(self.unknowns));
        let mut sum: Vec<(usize, f64)> = Vec::new();
        for track in self.tracks() {
            for b in 0..self.bands {
                sum.clear();
                let (mut total, mut total_y) = (0.0, 0.0);
                for (row, weight) in self.rows[track.clone()].iter().zip(&weights[track.clone()]) {
                    let (w, (entries, n)) = (weight[b], self.design(row, b));
                    for (p, x) in &entries[..n] {
                        right[*p] += w * x * row.y[b];
                        for (q, z) in &entries[..n] {
                            matrix[(*p, *q)] += w * x * z;
                        }
                        match sum.iter_mut().find(|(k, _)| k == p) {
                            Some((_, s)) => *s += w * x,
                            None => sum.push((*p, w * x)),
                        }
                    }
                    total += w;
                    total_y += w * row.y[b];
                }
                if total > 1e-12 {
                    for (p, x) in &sum {
                        right[*p] -= x * total_y / total;
                        for (q, z) in &sum {
                            matrix[(*p, *q)] -= x * z / total;
                        }
                    }
                }
            }
        }
        (matrix, right)
    }

    /// y − ρ − model per observation and band, raised for the freedom that ρ took.
    fn misfits(&self, solution: &DVector<f64>, weights: &[[f64; 3]]) -> Vec<[f64; 3]> {
        let mut misfits = vec![[0.0; 3]; self.rows.len()];
        for track in self.tracks() {
            let freedom = (track.len() as f64 / (track.len() as f64 - 1.0)).sqrt();
            for b in 0..self.bands {
                let (mut total, mut mean) = (0.0, 0.0);
                for i in track.clone() {
                    let (entries, n) = self.design(&self.rows[i], b);
                    let modelled: f64 = entries[..n].iter().map(|(p, x)| x * solution[*p]).sum();
                    misfits[i][b] = self.rows[i].y[b] - modelled;
                    total += weights[i][b];
                    mean += weights[i][b] * misfits[i][b];
                }
                for i in track.clone() {
                    misfits[i][b] = (misfits[i][b] - mean / total.max(1e-12)) * freedom;
                }
            }
        }
        misfits
    }

    /// Covariance of the unknowns behind the beam's: A⁻¹ (Σ_s g_s g_sᵀ) A⁻¹ over stretches s of frames.
    fn covariance(&self, normal: &DMatrix<f64>, solution: &DVector<f64>, weights: &[[f64; 3]], frames: usize) -> Option<DMatrix<f64>> {
        let wanted = self.unknowns - self.beam;
        let mut unit = DMatrix::zeros(self.unknowns, wanted);
        (0..wanted).for_each(|k| unit[(self.beam + k, k)] = 1.0);
        let inverse_rows = normal.clone().cholesky()?.solve(&unit);
        let misfits = self.misfits(solution, weights);
        let stretches = STRETCHES.min(frames).max(2);
        let mut scores = DMatrix::<f64>::zeros(stretches, wanted);
        for track in self.tracks() {
            let freedom = (track.len() as f64 / (track.len() as f64 - 1.0)).sqrt();
            for b in 0..self.bands {
                let total: f64 = track.clone().map(|i| weights[i][b]).sum();
                let project = |i: usize, k: usize| {
                    let (entries, n) = self.design(&self.rows[i], b);
                    entries[..n].iter().map(|(p, x)| x * inverse_rows[(*p, k)]).sum::<f64>()
                };
                for k in 0..wanted {
                    let mean = track.clone().map(|i| weights[i][b] * project(i, k)).sum::<f64>() / total.max(1e-12);
                    for i in track.clone() {
                        let stretch = self.rows[i].frame as usize * stretches / frames.max(1);
                        scores[(stretch.min(stretches - 1), k)] += weights[i][b] * misfits[i][b] / freedom * (project(i, k) - mean);
                    }
                }
            }
        }
        let correction = stretches as f64 / (stretches as f64 - 1.0);
        Some(scores.transpose() * scores * correction)
    }

    fn path_spread_m(&self) -> f64 {
        let mut sum = 0.0;
        for track in self.tracks() {
            let n = track.len() as f64;
            let mean = track.clone().map(|i| self.rows[i].length_m).sum::<f64>() / n;
            sum += track.map(|i| (self.rows[i].length_m - mean).powi(2)).sum::<f64>();
        }
        (sum / self.rows.len().max(1) as f64).sqrt()
    }
}
