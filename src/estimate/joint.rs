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
//! A strobe that nobody measured is three more unknowns: see `strobe_search`.
//!
//! After Bryson et al. (JFR 2016) and SUCRe (3DV 2024) in idea; ours in form.

use nalgebra::{DMatrix, DVector, Vector3};

use super::robust;
use super::tracks::{Observation, Track};
use crate::config::EstimateConfig;
use crate::geometry::LightPath;
use crate::image::Bands;
use crate::model::{BeamPattern, Nodes, SpreadingModel, log_geometry};
use crate::spaces::{Body, Strobe, Transform};

/// Nodes with less weight of observations are not solved for.
const LEAST_NODE_WEIGHT: f64 = 3.0;
/// Brightness classes of the noise.
const NOISE_CLASSES: usize = 6;
/// Stretches of frames whose errors are taken to be independent.
const STRETCHES: usize = 12;
/// Step of the numeric derivative by the strobe's place [m].
const STROBE_STEP_M: f64 = 0.01;

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
    /// whether the strobe's place came from this log too, so that α is less sure by it
    pub free_strobe: bool,
    /// reweightings
    pub rounds: usize,
    /// the choices
    pub config: &'s EstimateConfig,
}

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

/// A step of the strobe that the residuals ask for, with its standard deviation [m].
#[derive(Clone, Copy, Debug)]
pub struct StrobeStep {
    /// in body space
    pub step_m: Vector3<f64>,
    /// per axis
    pub std_m: Vector3<f64>,
}

/// The light path of an observation for a strobe's mount.
pub type PathFor<'f> = dyn Fn(&Observation, Transform<Body, Strobe>) -> Option<LightPath> + 'f;

/// One view of a track, as numbers of the linear problem.
struct Row {
    frame: u32,
    nodes: [(usize, f64); 4],
    length_m: f64,
    log_strobe_leg: f64,
    y: [f64; 3],
    /// log c, for the class of noise
    log_color: [f32; 3],
    class: [u8; 3],
    /// which of all observations, in the order of the tracks
    source: usize,
    /// derivative of the model by the strobe's place, per band
    by_strobe: [Vector3<f64>; 3],
}

/// One view with its way of light: which of all observations, frame, path, log c.
type Lit = (usize, u32, LightPath, [f32; 3]);

/// The linear problem of one strobe mount.
pub struct Problem<'s> {
    setting: Setting<'s>,
    rows: Vec<Row>,
    /// end of each track in `rows`
    ends: Vec<usize>,
    /// node → unknown, `usize::MAX` where it is none
    place: Vec<usize>,
    /// unknown nodes; α follow, then the exponent, then the strobe
    beam: usize,
    with_strobe: bool,
    weights: Vec<[f64; 3]>,
}

/// A solution and what is left over.
pub struct Solution {
    values: DVector<f64>,
    normal: DMatrix<f64>,
    /// robust spread of the misfits [log light]
    pub residual: f64,
}

/// Solves for all tracks; `None` where too little is seen.
pub fn solve(tracks: &[Track], setting: &Setting<'_>, mount: Transform<Body, Strobe>, paths: &PathFor<'_>) -> Option<JointAnswer> {
    let mut problem = Problem::new(tracks, setting, mount, paths)?;
    let mut solution = problem.solve(setting.rounds)?;
    if setting.free_strobe {
        solution = problem.with_free_strobe(tracks, mount, paths, &solution)?;
    }
    problem.answer(&solution)
}

impl<'s> Problem<'s> {
    /// Sets the problem up for a strobe's mount; `None` where too little is seen.
    pub fn new(tracks: &[Track], setting: &Setting<'s>, mount: Transform<Body, Strobe>, paths: &PathFor<'_>) -> Option<Self> {
        let Setting { bands, nodes, .. } = *setting;
        let spreading = setting.spreading_held();
        let mut seen = vec![0.0; nodes.count * nodes.count];
        let mut views: Vec<Vec<Lit>> = Vec::with_capacity(tracks.len());
        let mut source = 0;
        for track in tracks {
            let lit =
                |(i, o): (usize, &Observation)| Some((source + i, o.frame, paths(o, mount).filter(|p| nodes.holds(p.angles))?, o.sight.log_color));
            let of_track: Vec<_> = track.iter().enumerate().filter_map(lit).collect();
            source += track.len();
            of_track.iter().flat_map(|(_, _, p, _)| nodes.weights(p.angles)).for_each(|(n, w)| seen[n] += w);
            views.push(of_track);
        }
        // Only nodes that are seen are unknowns; views at others are left out.
        let mut place = vec![usize::MAX; seen.len()];
        let mut beam = 0;
        for (node, _) in seen.iter().enumerate().filter(|(_, w)| **w >= LEAST_NODE_WEIGHT) {
            place[node] = beam;
            beam += 1;
        }
        let (mut rows, mut ends) = (Vec::new(), Vec::new());
        for of_track in views {
            let start = rows.len();
            for (source, frame, path, color) in of_track {
                let at = nodes.weights(path.angles);
                if at.iter().any(|(n, w)| place[*n] == usize::MAX && *w > 1e-9) {
                    continue;
                }
                let geometry = log_geometry(spreading, setting.config.incidence, &path);
                rows.push(Row {
                    frame,
                    nodes: at,
                    length_m: path.length_m(),
                    log_strobe_leg: path.strobe_to_seafloor_m.ln(),
                    y: std::array::from_fn(|b| if b < bands { f64::from(color[b]) - geometry } else { 0.0 }),
                    log_color: color,
                    class: [0; 3],
                    source,
                    by_strobe: [Vector3::zeros(); 3],
                });
            }
            if rows.len() - start < 2 {
                rows.truncate(start);
            } else {
                ends.push(rows.len());
            }
        }
        classify(&mut rows, bands);
        let weights = vec![[1.0; 3]; rows.len()];
        let enough = rows.len() >= 2 * (beam + bands).min(100) && ends.len() >= 30;
        enough.then_some(Self { setting: *setting, rows, ends, place, beam, with_strobe: false, weights })
    }

    fn exponent_at(&self) -> usize {
        self.beam + self.setting.bands
    }

    fn strobe_at(&self) -> usize {
        self.exponent_at() + usize::from(self.setting.fit_exponent)
    }

    fn unknowns(&self) -> usize {
        self.strobe_at() + if self.with_strobe { 3 } else { 0 }
    }

    /// Reweighted least squares; keeps the weights for what follows.
    pub fn solve(&mut self, rounds: usize) -> Option<Solution> {
        let smooth = self.smoothness();
        let mut solution = None;
        for _ in 0..rounds.max(1) {
            let (normal, right) = self.normal_equations(&smooth);
            let values = normal.clone().cholesky()?.solve(&right);
            let misfits = self.misfits(&values);
            let (weights, residual) = reweighted(&self.rows, &misfits, self.setting.bands);
            self.weights = weights;
            solution = Some(Solution { values, normal, residual });
        }
        solution
    }

    /// The step of the strobe that would lower the misfits most, to first order, with everything else free.
    pub fn strobe_step(&mut self, tracks: &[Track], mount: Transform<Body, Strobe>, paths: &PathFor<'_>, solution: &Solution) -> Option<StrobeStep> {
        let free = self.with_free_strobe(tracks, mount, paths, solution)?;
        let at = self.strobe_at();
        let covariance = self.covariance(&free.normal, &free.values, at)?;
        self.with_strobe = false;
        let std_m = Vector3::new(covariance[(0, 0)], covariance[(1, 1)], covariance[(2, 2)]).map(f64::sqrt);
        Some(StrobeStep { step_m: Vector3::new(free.values[at], free.values[at + 1], free.values[at + 2]), std_m })
    }

    /// The same problem with the strobe's place as three more unknowns, to first order.
    fn with_free_strobe(&mut self, tracks: &[Track], mount: Transform<Body, Strobe>, paths: &PathFor<'_>, solution: &Solution) -> Option<Solution> {
        self.differentiate(tracks, mount, paths, solution);
        self.with_strobe = true;
        let (normal, right) = self.normal_equations(&self.smoothness());
        let values = normal.clone().cholesky()?.solve(&right);
        Some(Solution { values, normal, residual: solution.residual })
    }

    /// Derivatives of each row's model by the strobe's place, numerically, with the pattern in hand.
    fn differentiate(&mut self, tracks: &[Track], mount: Transform<Body, Strobe>, paths: &PathFor<'_>, solution: &Solution) {
        let nodes = self.setting.nodes;
        let beam = BeamPattern::from_nodes(nodes, &self.beam_by_node(&solution.values));
        let spreading = self.setting.spreading_held();
        let exponent = if self.setting.fit_exponent { solution.values[self.exponent_at()] } else { 0.0 };
        let common = |p: &LightPath| {
            beam.log_gain(p.angles) + log_geometry(spreading, self.setting.config.incidence, p) - exponent * p.strobe_to_seafloor_m.ln()
        };
        let moved = |axis: usize, by: f64| {
            let mut isometry = mount.isometry();
            isometry.translation.vector[axis] += by;
            Transform::from_isometry(isometry)
        };
        let alpha: [f64; 3] = std::array::from_fn(|b| if b < self.setting.bands { solution.values[self.beam + b] } else { 0.0 });
        let observations: Vec<&Observation> = tracks.iter().flatten().collect();
        for row in &mut self.rows {
            let o = observations[row.source];
            for axis in 0..3 {
                let (Some(ahead), Some(behind)) = (paths(o, moved(axis, STROBE_STEP_M)), paths(o, moved(axis, -STROBE_STEP_M))) else { continue };
                let per_m = 1.0 / (2.0 * STROBE_STEP_M);
                let (by_common, by_length) = ((common(&ahead) - common(&behind)) * per_m, (ahead.length_m() - behind.length_m()) * per_m);
                row.by_strobe.iter_mut().zip(alpha).for_each(|(d, alpha)| d[axis] = by_common - alpha * by_length);
            }
        }
    }

    fn beam_by_node(&self, values: &DVector<f64>) -> Vec<Option<f64>> {
        self.place.iter().map(|i| values.get(*i).copied().filter(|_| *i != usize::MAX)).collect()
    }

    /// The solution as an answer, with standard deviations.
    pub fn answer(&self, solution: &Solution) -> Option<JointAnswer> {
        let (bands, values) = (self.setting.bands, &solution.values);
        let covariance = self.covariance(&solution.normal, values, self.beam)?;
        let std = |i: usize| covariance[(i, i)].max(0.0).sqrt();
        let mut answer = JointAnswer {
            attenuation_per_m: [0.0; 3],
            std_per_m: [0.0; 3],
            difference_std_per_m: [0.0; 2],
            exponent: self.setting.fit_exponent.then(|| (values[self.exponent_at()], std(bands))),
            beam: self.beam_by_node(values),
            tracks: self.ends.len(),
            observations: self.rows.len(),
            residual: solution.residual,
            path_spread_m: self.path_spread_m(),
        };
        for b in 0..bands {
            answer.attenuation_per_m[b] = values[self.beam + b];
            answer.std_per_m[b] = std(b);
        }
        for b in 0..bands.saturating_sub(1) {
            answer.difference_std_per_m[b] = (covariance[(b, b)] + covariance[(b + 1, b + 1)] - 2.0 * covariance[(b, b + 1)]).max(0.0).sqrt();
        }
        Some(answer)
    }

    fn tracks(&self) -> impl Iterator<Item = std::ops::Range<usize>> {
        std::iter::once(0).chain(self.ends.iter().copied()).zip(self.ends.iter().copied()).map(|(a, b)| a..b)
    }

    /// The non-zero entries of a row's design for one band.
    fn design(&self, row: &Row, band: usize) -> ([(usize, f64); 9], usize) {
        let mut entries = [(0, 0.0); 9];
        let mut n = 0;
        let mut put = |entry: (usize, f64)| {
            entries[n] = entry;
            n += 1;
        };
        for (node, weight) in row.nodes {
            if self.place[node] != usize::MAX {
                put((self.place[node], weight));
            }
        }
        put((self.beam + band, -row.length_m));
        if self.setting.fit_exponent {
            put((self.exponent_at(), -row.log_strobe_leg));
        }
        if self.with_strobe {
            (0..3).for_each(|axis| put((self.strobe_at() + axis, row.by_strobe[band][axis])));
        }
        (entries, n)
    }

    /// Second differences of neighbouring nodes, and a ridge for the one free constant.
    fn smoothness(&self) -> DMatrix<f64> {
        let unknowns = self.unknowns();
        let weight = self.setting.config.beam_smoothness;
        let mut matrix = DMatrix::from_diagonal_element(unknowns, unknowns, 1e-6);
        let n = self.setting.nodes.count;
        for i in 0..n {
            for j in 0..n {
                for step in [1, n] {
                    let inside = if step == 1 { j + 2 < n } else { i + 2 < n };
                    if !inside {
                        continue;
                    }
                    let three = [0, step, 2 * step].map(|k| self.place[i * n + j + k]);
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

    fn normal_equations(&self, smooth: &DMatrix<f64>) -> (DMatrix<f64>, DVector<f64>) {
        let (mut matrix, mut right) = (smooth.clone(), DVector::zeros(self.unknowns()));
        let mut sum: Vec<(usize, f64)> = Vec::new();
        for track in self.tracks() {
            for b in 0..self.setting.bands {
                sum.clear();
                let (mut total, mut total_y) = (0.0, 0.0);
                for (row, weight) in self.rows[track.clone()].iter().zip(&self.weights[track.clone()]) {
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
    fn misfits(&self, values: &DVector<f64>) -> Vec<[f64; 3]> {
        let mut misfits = vec![[0.0; 3]; self.rows.len()];
        for track in self.tracks() {
            let freedom = freedom(&track);
            for b in 0..self.setting.bands {
                let (mut total, mut mean) = (0.0, 0.0);
                for i in track.clone() {
                    let (entries, n) = self.design(&self.rows[i], b);
                    let modelled: f64 = entries[..n].iter().map(|(p, x)| x * values[*p]).sum();
                    misfits[i][b] = self.rows[i].y[b] - modelled;
                    total += self.weights[i][b];
                    mean += self.weights[i][b] * misfits[i][b];
                }
                for i in track.clone() {
                    misfits[i][b] = (misfits[i][b] - mean / total.max(1e-12)) * freedom;
                }
            }
        }
        misfits
    }

    /// Covariance of the unknowns from `first` on: A⁻¹ (Σ_s g_s g_sᵀ) A⁻¹ over stretches s of frames.
    fn covariance(&self, normal: &DMatrix<f64>, values: &DVector<f64>, first: usize) -> Option<DMatrix<f64>> {
        let (unknowns, frames) = (self.unknowns(), self.setting.frames);
        let wanted = unknowns - first;
        let mut unit = DMatrix::zeros(unknowns, wanted);
        (0..wanted).for_each(|k| unit[(first + k, k)] = 1.0);
        let inverse_rows = normal.clone().cholesky()?.solve(&unit);
        let misfits = self.misfits(values);
        let stretches = STRETCHES.min(frames).max(2);
        let mut scores = DMatrix::<f64>::zeros(stretches, wanted);
        let mut projected = Vec::new();
        for track in self.tracks() {
            let freedom = freedom(&track);
            for b in 0..self.setting.bands {
                let total: f64 = track.clone().map(|i| self.weights[i][b]).sum();
                for k in 0..wanted {
                    projected.clear();
                    projected.extend(track.clone().map(|i| {
                        let (entries, n) = self.design(&self.rows[i], b);
                        entries[..n].iter().map(|(p, x)| x * inverse_rows[(*p, k)]).sum::<f64>()
                    }));
                    let mean = track.clone().zip(&projected).map(|(i, p)| self.weights[i][b] * p).sum::<f64>() / total.max(1e-12);
                    for (i, p) in track.clone().zip(&projected) {
                        let stretch = (self.rows[i].frame as usize * stretches / frames.max(1)).min(stretches - 1);
                        scores[(stretch, k)] += self.weights[i][b] * misfits[i][b] / freedom * (p - mean);
                    }
                }
            }
        }
        // Few stretches: their own spread is uncertain, by Student's factor (about 1.12 for twelve).
        let n = stretches as f64;
        let correction = n / (n - 1.0) * (1.0 + 1.3 / (n - 1.0)).powi(2);
        Some(scores.transpose() * scores * correction)
    }

    fn path_spread_m(&self) -> f64 {
        let mut sum = 0.0;
        for track in self.tracks() {
            let mean = track.clone().map(|i| self.rows[i].length_m).sum::<f64>() / track.len() as f64;
            sum += track.map(|i| (self.rows[i].length_m - mean).powi(2)).sum::<f64>();
        }
        (sum / self.rows.len().max(1) as f64).sqrt()
    }
}

impl Setting<'_> {
    /// Spreading as far as it is not an unknown.
    fn spreading_held(&self) -> SpreadingModel {
        if self.fit_exponent { SpreadingModel { strobe_leg: 0.0, ..self.spreading } } else { self.spreading }
    }
}

/// Misfits are small by the freedom that a track's own reflectance takes.
fn freedom(track: &std::ops::Range<usize>) -> f64 {
    (track.len() as f64 / (track.len() as f64 - 1.0)).sqrt()
}

/// Sorts the observations of each band into classes of equal brightness.
fn classify(rows: &mut [Row], bands: usize) {
    for b in 0..bands {
        let values: Vec<f64> = rows.iter().map(|r| f64::from(r.log_color[b])).collect();
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
