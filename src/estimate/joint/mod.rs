//! Attenuation, beam pattern and the reflectance of every tracked point in one robust solve (Eq.
//! 15).
//!
//! ```text
//! y_o = ρ_t + Σ_n w_n B_n − α_Λ(t) ℓ_o [− p log ℓ_a] [+ δb_Λ S_o / D_o]      y = log c − spreading − log cos γ
//! ```
//!
//! Unknown: α per band (at nodes in time, where it drifts), B on bilinear nodes shared by the bands
//! (second differences held small), optionally the spreading exponent p and, to first order, what
//! the water scatters back (`backscatter`) and the strobe's place (`strobe_search`); and ρ per
//! track and band. The ρ are eliminated in closed form: each track contributes Σ w x xᵀ − (Σ w x)(Σ
//! w x)ᵀ / Σ w. Reweighted (Cauchy), a fixed number of rounds. A band's noise grows as light gets
//! less, so misfits are measured against the spread of equally bright observations; and where light
//! scattered back was taken off, what is left carries the noise of all of it.
//!
//! After Bryson et al. (JFR 2016) and SUCRe (3DV 2024) in idea; ours in form. `columns` says where
//! each unknown stands, `normal` builds and solves the equations, `uncertainty` says how sure the
//! answer is.

mod columns;
mod normal;
pub mod places;
mod uncertainty;

use nalgebra::DVector;

use super::tracks::{Observation, Track};
use crate::config::EstimateConfig;
use crate::geometry::LightPath;
use crate::image::Bands;
use crate::model::{
    Backscatter, BeamGrid, BeamPattern, ScatterIntegral, SpreadingModel, log_geometry,
};
use crate::parallel::par_map;
use crate::stats;
use crate::vehicle::{Lamps, MAX_LAMPS};
use columns::Columns;
use places::{MOST_PLACES, Place};

/// Nodes with less weight of observations are not solved for.
const LEAST_NODE_WEIGHT: f64 = 3.0;
/// Where less than this share of a band's light is direct, it is no measurement any more.
pub const LEAST_DIRECT_SHARE: f64 = 0.05;
/// b stays below this quantile of c / S: hardly a point is darker than the water before it.
const DARKEST: f64 = 0.02;
/// Brightness classes of the noise.
const NOISE_CLASSES: usize = 6;

/// What the solve is told beside the tracks.
#[derive(Clone, Copy)]
pub struct Setting<'s> {
    /// how many frames there are
    pub frames: usize,
    /// how many moments of them have pings of their own
    pub moments: usize,
    /// 1 or 3
    pub bands: usize,
    /// the beam pattern's grid
    pub nodes: BeamGrid,
    /// p_a and p_s
    pub spreading: SpreadingModel,
    /// whether p_a is an unknown
    pub fit_exponent: bool,
    /// whether the strobe's place came from this log too, so that α is less sure by it
    pub free_strobe: bool,
    /// what scatters back to begin with, and S_Λ of an observation, where it is an unknown too
    pub glow: Option<(&'s Backscatter, &'s ScatterOf<'s>)>,
    /// where each frame stands among the nodes of α in time, and how many there are
    pub drift: Option<&'s Drift>,
    /// reweightings
    pub rounds: usize,
    /// the choices
    pub config: &'s EstimateConfig,
}

/// S_Λ of an observation.
pub type ScatterOf<'f> = dyn Fn(&Observation) -> ScatterIntegral + Sync + 'f;

/// Nodes of α in time.
#[derive(Clone, Debug)]
pub struct Drift {
    /// per frame: the node before it, and the share of the way to the next
    pub places: Vec<(usize, f64)>,
    /// how many nodes
    pub nodes: usize,
    /// per pair of neighbouring nodes: whether the log runs on between them
    pub joined: Vec<bool>,
}

/// The answer of the solve.
#[derive(Clone, Debug)]
pub struct JointAnswer {
    /// α [1/m] per band, the mean over the frames
    pub attenuation_per_m: Bands,
    /// clustered by stretches of frames [1/m]
    pub std_per_m: Bands,
    /// the same for red − green and green − blue [1/m]
    pub difference_std_per_m: [f64; 2],
    /// α and its standard deviation at each node in time; one where it does not drift
    pub over_time: Vec<(Bands, Bands)>,
    /// p, where it was fitted, and its standard deviation
    pub exponent: Option<(f64, f64)>,
    /// what scatters back, and the standard deviation of b
    pub backscatter: Option<(Backscatter, Bands)>,
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

/// The light path of an observation for a strobe's mount.
pub type PathFor<'f> = dyn Fn(&Observation, Lamps) -> Option<LightPath> + Sync + 'f;

/// One view of a track, as numbers of the linear problem.
struct Row {
    frame: u32,
    nodes: [(usize, f64); 4 * MAX_LAMPS],
    /// how many of these there are
    nodes_used: usize,
    length_m: f64,
    log_strobe_leg: f64,
    /// spreading and cos γ; of several lamps also what is left of their sum beyond the mean of
    /// their logs, per band
    geometry: [f64; 3],
    /// the ways from several lamps: node weights, geometry and log of the share, ℓ_a [m]; empty
    /// where there is one
    legs: Vec<LegRow>,
    seafloor_to_camera_m: f64,
    /// log c freed of geometry and of what was scattered back, by the solution before
    y: [f64; 3],
    /// log c
    log_color: [f32; 3],
    /// S_Λ
    glow: ScatterIntegral,
    /// D / (D + B): misfits of y are this much larger than those of log c
    direct_share: [f64; 3],
    /// 1 / D: D is the direct light by the solution before. The observed light would carry its own
    /// error into the derivative, and the two together would bias b.
    per_direct: [f64; 3],
    /// which of all observations, in the order of the tracks
    source: usize,
    /// derivatives of the model by places, per band
    by_place: [[f64; MOST_PLACES]; 3],
}

/// One lamp's part of a view.
#[derive(Clone, Copy)]
struct LegRow {
    nodes: [(usize, f64); 4],
    log_geometry: f64,
    length_m: f64,
}

/// One view with its way of light, and which of all observations it is.
type Lit<'t> = (usize, &'t Observation, LightPath);

/// The linear problem of one strobe mount.
pub struct Problem<'s> {
    setting: Setting<'s>,
    rows: Vec<Row>,
    /// end of each track in `rows`
    ends: Vec<usize>,
    columns: Columns,
    weights: Vec<[f64; 3]>,
    /// what scatters back, as far as it is known
    back: Backscatter,
    /// most that b may be
    most_scattered: Bands,
    /// bands whose b stands at a bound
    held: [bool; 3],
}

/// A solution and what is left over.
pub struct Solution {
    values: DVector<f64>,
    /// robust spread of the misfits [log light]
    pub residual: f64,
}

/// A solution in words of the model.
pub struct Said {
    /// α [1/m], the mean over the frames
    pub attenuation_per_m: Bands,
    /// b_Λ and η
    pub backscatter: Backscatter,
    /// BP
    pub beam: BeamPattern,
}

/// Solves for all tracks; `None` where too little is seen.
pub fn solve(
    tracks: &[Track],
    setting: &Setting<'_>,
    mount: Lamps,
    paths: &PathFor<'_>,
) -> Option<JointAnswer> {
    let mut problem = Problem::new(tracks, setting, mount, paths)?;
    let solution = problem.solve(setting.rounds)?;
    if setting.free_strobe {
        // The place stays where it is; that it might be elsewhere makes the answer less sure.
        problem.with_places(tracks, &strobe_places(mount, paths), &solution)?;
    }
    problem.answer(&solution)
}

/// The strobe's place as three unknowns [m], in body space.
pub fn strobe_places<'f>(mount: Lamps, paths: &'f PathFor<'f>) -> [Place<'f>; 3] {
    std::array::from_fn(|axis| {
        let moved = move |by: f64| {
            let mut place = mount.origin().vector();
            place[axis] += by;
            mount.moved_to(place)
        };
        Place { step: 0.01, path: Box::new(move |o, by| paths(o, moved(by))) }
    })
}

impl<'s> Problem<'s> {
    /// Sets the problem up for a strobe's mount; `None` where too little is seen.
    pub fn new<'t>(
        tracks: &'t [Track],
        setting: &Setting<'s>,
        mount: Lamps,
        paths: &PathFor<'_>,
    ) -> Option<Self> {
        let Setting { bands, nodes, .. } = *setting;
        let mut source = 0;
        let begun = tracks.iter().map(|track| {
            source += track.len();
            (source - track.len(), track)
        });
        let begun: Vec<(usize, &Track)> = begun.collect();
        let lit = |first: usize, track: &'t Track| {
            let lit = |(i, o)| {
                Some((
                    first + i,
                    o,
                    paths(o, mount).filter(|p| p.all_angles().all(|a| nodes.holds(a)))?,
                ))
            };
            track.iter().enumerate().filter_map(lit).collect()
        };
        let views: Vec<Vec<Lit<'_>>> = par_map(begun, |(first, track)| lit(first, track));
        let mut seen = vec![0.0; nodes.count * nodes.count];
        views
            .iter()
            .flatten()
            .flat_map(|(_, _, p)| p.all_angles().flat_map(|a| nodes.weights(a)))
            .for_each(|(n, w)| seen[n] += w);
        // Only nodes that are seen are unknowns; views at others are left out.
        let columns = Columns::new(seen.iter().map(|w| *w >= LEAST_NODE_WEIGHT), setting);
        let (mut rows, mut ends) = (Vec::with_capacity(source), Vec::with_capacity(tracks.len()));
        for of_track in views {
            let start = rows.len();
            rows.extend(
                of_track
                    .into_iter()
                    .filter_map(|(source, o, path)| row(setting, &columns, o, &path, source)),
            );
            if rows.len() - start < 2 {
                rows.truncate(start);
            } else {
                ends.push(rows.len());
            }
        }
        let weights = rows.iter().map(|r| r.direct_share.map(|d| d * d)).collect();
        let enough = rows.len() >= 2 * (columns.beam_nodes() + bands).min(100) && ends.len() >= 30;
        let back = setting.glow.map_or(Backscatter::NONE, |(back, _)| *back);
        enough.then_some(Self {
            setting: *setting,
            most_scattered: darkest(&rows, &back),
            rows,
            ends,
            columns,
            weights,
            back,
            held: [false; 3],
        })
    }

    /// What a solution says, without how sure it is.
    pub fn said(&self, solution: &Solution) -> Said {
        let (time, values) = (self.mean_over_time(), &solution.values);
        let mean = |b: usize| {
            time.iter().enumerate().map(|(k, w)| w * values[self.columns.attenuation(b, k)]).sum()
        };
        let of_bands = |f: &dyn Fn(usize) -> f64| {
            std::array::from_fn(|b| if b < self.setting.bands { f(b) } else { 0.0 })
        };
        Said {
            attenuation_per_m: of_bands(&mean),
            backscatter: self.back,
            beam: BeamPattern::from_nodes(self.setting.nodes, &self.beam_by_node(values)),
        }
    }

    fn beam_by_node(&self, values: &DVector<f64>) -> Vec<Option<f64>> {
        (0..self.setting.nodes.count * self.setting.nodes.count)
            .map(|n| values.get(self.columns.beam_node(n)?).copied())
            .collect()
    }

    /// Mean of α over the frames as weights of its nodes in time.
    fn mean_over_time(&self) -> Vec<f64> {
        let Some(drift) = self.setting.drift else { return vec![1.0] };
        let mut weights = vec![0.0; drift.nodes];
        for (node, share) in &drift.places {
            weights[*node] += (1.0 - share) / drift.places.len() as f64;
            if *share > 0.0 {
                weights[node + 1] += share / drift.places.len() as f64;
            }
        }
        weights
    }

    /// The solution as an answer, with standard deviations.
    pub fn answer(&self, solution: &Solution) -> Option<JointAnswer> {
        let (bands, values, columns) = (self.setting.bands, &solution.values, &self.columns);
        let first = columns.attenuation(0, 0);
        let covariance = self.covariance(first)?;
        let time = self.mean_over_time();
        // (combination of unknowns, its value) → value and standard deviation
        let of = |terms: &[(usize, f64)]| {
            let value = terms.iter().map(|(i, k)| k * values[*i]).sum::<f64>();
            let variance = terms
                .iter()
                .flat_map(|(i, k)| terms.iter().map(move |(j, l)| (i, j, k * l)))
                .map(|(i, j, k)| k * covariance[(i - first, j - first)]);
            (value, variance.sum::<f64>().max(0.0).sqrt())
        };
        let mean = |b: usize, sign: f64| {
            time.iter()
                .enumerate()
                .map(|(k, w)| (columns.attenuation(b, k), sign * w))
                .collect::<Vec<_>>()
        };
        let mut answer = JointAnswer {
            attenuation_per_m: [0.0; 3],
            std_per_m: [0.0; 3],
            difference_std_per_m: [0.0; 2],
            over_time: vec![([0.0; 3], [0.0; 3]); time.len()],
            exponent: columns.exponent().map(|i| of(&[(i, 1.0)])),
            backscatter: columns.glow(0).map(|_| (self.back, [0.0; 3])),
            beam: self.beam_by_node(values),
            tracks: self.ends.len(),
            observations: self.rows.len(),
            residual: solution.residual,
            path_spread_m: self.path_spread_m(),
        };
        for b in 0..bands {
            (answer.attenuation_per_m[b], answer.std_per_m[b]) = of(&mean(b, 1.0));
            for (k, node) in answer.over_time.iter_mut().enumerate() {
                (node.0[b], node.1[b]) = of(&[(columns.attenuation(b, k), 1.0)]);
            }
            if let (Some((_, std)), Some(i)) = (&mut answer.backscatter, columns.glow(b)) {
                std[b] = of(&[(i, 1.0)]).1;
            }
        }
        for b in 0..bands.saturating_sub(1) {
            answer.difference_std_per_m[b] = of(&[mean(b, 1.0), mean(b + 1, -1.0)].concat()).1;
        }
        Some(answer)
    }

    fn tracks(&self) -> impl Iterator<Item = std::ops::Range<usize>> {
        std::iter::once(0)
            .chain(self.ends.iter().copied())
            .zip(self.ends.iter().copied())
            .map(|(a, b)| a..b)
    }

    fn path_spread_m(&self) -> f64 {
        let mut sum = 0.0;
        for track in self.tracks() {
            let mean =
                track.clone().map(|i| self.rows[i].length_m).sum::<f64>() / track.len() as f64;
            sum += track.map(|i| (self.rows[i].length_m - mean).powi(2)).sum::<f64>();
        }
        (sum / self.rows.len().max(1) as f64).sqrt()
    }

    /// Log reflectance by one observation's own light, and its share of direct light: what a
    /// solution says of any view.
    pub fn reflectance_by(
        &self,
        solution: &Solution,
        o: &Observation,
        mount: Lamps,
        paths: &PathFor<'_>,
    ) -> Option<(Bands, Bands)> {
        let path =
            paths(o, mount).filter(|p| p.all_angles().all(|a| self.setting.nodes.holds(a)))?;
        let setting =
            Setting { glow: self.setting.glow.map(|(_, glow)| (&self.back, glow)), ..self.setting };
        let mut row = row(&setting, &self.columns, o, &path, 0)?;
        self.add_up(&mut row, &solution.values);
        Some((self.beyond_model(&row, &solution.values), row.direct_share))
    }
}

/// An observation as numbers; `None` where it lies on a node that is not solved for.
fn row(
    setting: &Setting<'_>,
    columns: &Columns,
    o: &Observation,
    path: &LightPath,
    source: usize,
) -> Option<Row> {
    let is_known = |(n, w): &(usize, f64)| columns.beam_node(*n).is_some() || *w <= 1e-9;
    let mut nodes = [(0, 0.0); 4 * MAX_LAMPS];
    let of_leg = |p: &LightPath, share: f64| LegRow {
        nodes: setting.nodes.weights(p.angles),
        log_geometry: share.ln()
            + log_geometry(setting.spreading_held(), setting.config.incidence, p),
        length_m: p.strobe_to_seafloor_m,
    };
    let legs: Vec<LegRow> =
        path.lamp_paths().iter().map(|leg| of_leg(&path.via(leg), leg.share)).collect();
    let first = of_leg(path, 1.0);
    let nodes_used = if legs.is_empty() { 4 } else { 4 * legs.len() };
    let all = legs.iter().chain(legs.is_empty().then_some(&first)).flat_map(|l| l.nodes);
    nodes.iter_mut().zip(all).for_each(|(n, of_leg)| *n = of_leg);
    if !nodes[..nodes_used].iter().all(is_known) {
        return None;
    }
    let geometry = first.log_geometry;
    let log_color = o.sample.log_color;
    let (glow, back) = setting
        .glow
        .map_or((ScatterIntegral::default(), Backscatter::NONE), |(back, glow)| (glow(o), *back));
    let (mut y, mut direct_share, mut per_direct, light) =
        ([0.0; 3], [1.0; 3], [0.0; 3], back.light(&glow));
    for b in 0..setting.bands {
        let all = f64::from(log_color[b]).exp();
        let direct = (all - light[b]).max(LEAST_DIRECT_SHARE * all);
        (y[b], direct_share[b], per_direct[b]) =
            (direct.ln() - geometry, direct / all, 1.0 / direct);
    }
    Some(Row {
        frame: o.frame,
        nodes,
        nodes_used,
        legs,
        seafloor_to_camera_m: path.seafloor_to_camera_m,
        length_m: path.length_m(),
        log_strobe_leg: path.strobe_to_seafloor_m.ln(),
        geometry: [geometry; 3],
        y,
        log_color,
        glow,
        direct_share,
        per_direct,
        source,
        by_place: [[0.0; MOST_PLACES]; 3],
    })
}

impl Setting<'_> {
    /// Spreading as far as it is not an unknown.
    fn spreading_held(&self) -> SpreadingModel {
        if self.fit_exponent {
            SpreadingModel { strobe_leg: 0.0, ..self.spreading }
        } else {
            self.spreading
        }
    }
}

/// The largest b that the darkest observations allow.
fn darkest(rows: &[Row], back: &Backscatter) -> Bands {
    let unit = Backscatter { strength_per_m: [1.0; 3], ..*back };
    std::array::from_fn(|b| {
        let ratios: Vec<f64> = rows
            .iter()
            .map(|r| f64::from(r.log_color[b]).exp() / unit.light(&r.glow)[b].max(1e-12))
            .collect();
        stats::quantile(&ratios, DARKEST)
    })
}
