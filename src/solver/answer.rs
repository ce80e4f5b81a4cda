//! A solution with standard deviations.

use std::collections::BTreeMap;

use nalgebra::DMatrix;

use super::covariance::covariance;
use super::equation::Equation;
use super::terms::Term;
use super::{Problem, Solution};
use crate::image::Bands;
use crate::model::Backscatter;
use crate::stats;

/// Nodes of the beam pattern's grid along a region of the image, observations that tell its error,
/// and regions that tell how large such errors are.
const NODES_PER_REGION: usize = 4;
const MIN_IN_REGION: usize = 8;
const MIN_REGIONS: usize = 20;

/// The answer of the joint solve.
#[derive(Clone, Debug)]
pub struct JointAnswer {
    /// α (1/m) per band, the mean over the frames
    pub attenuation_per_m: Bands,
    /// its standard deviation (1/m)
    pub std_per_m: Bands,
    /// the same for red − green and green − blue (1/m)
    pub difference_std_per_m: [f64; 2],
    /// α and its standard deviation at each node in time; one node where it does not change
    pub over_time: Vec<(Bands, Bands)>,
    /// p_a, where it was fitted, and its standard deviation
    pub exponent: Option<(f64, f64)>,
    /// backscatter, and the standard deviation of b
    pub backscatter: Option<(Backscatter, Bands)>,
    /// log d_Λ in the unit of `beam`, and its standard deviation
    pub log_daylight: Option<(Bands, Bands)>,
    /// log BP by node, `None` where not solved for
    pub beam: Vec<Option<f64>>,
    /// tracks used
    pub tracks: usize,
    /// observations used
    pub observations: usize,
    /// robust spread of the residuals (log light)
    pub residual: f64,
    /// errors common to a region of the image in a frame, beyond what noise explains (log light)
    pub systematic: f64,
    /// root mean square difference of path length within a track (m)
    pub path_spread_m: f64,
}

/// Values of the unknowns with their covariance from `first` on.
struct Estimated<'s> {
    values: &'s [f64],
    covariance: DMatrix<f64>,
    first: usize,
}

impl Estimated<'_> {
    /// Value and standard deviation of Σ coefficient · unknown.
    fn combination(&self, terms: &[(usize, f64)]) -> (f64, f64) {
        let value = terms.iter().map(|(i, k)| k * self.values[*i]).sum::<f64>();
        let products = terms.iter().flat_map(|(i, k)| {
            terms
                .iter()
                .map(move |(j, l)| k * l * self.covariance[(i - self.first, j - self.first)])
        });
        (value, products.sum::<f64>().max(0.0).sqrt())
    }
}

impl Problem<'_> {
    /// The solution with standard deviations; `also_free` are terms whose uncertainty counts.
    pub fn answer(&self, solution: &Solution, also_free: &[&dyn Term]) -> Option<JointAnswer> {
        let mut list = self.terms.list();
        also_free.iter().for_each(|term| list.add(*term));
        let first = self.terms.first_attenuation();
        let covariance = covariance(&self.system(&list), &self.segments(), first)?;
        let estimated = Estimated { values: solution.values.as_slice(), covariance, first };
        let attenuation = &self.terms.attenuation;
        let weights = attenuation.mean_weights();
        let node = |b: usize, k: usize| first + attenuation.unknown(b, k);
        let mean = |b: usize, sign: f64| {
            let of_node = |(k, w): (usize, &f64)| (node(b, k), sign * w);
            weights.iter().enumerate().map(of_node).collect::<Vec<_>>()
        };
        let exponent = self.terms.exponent_unknown();
        let mut answer = JointAnswer {
            attenuation_per_m: [0.0; 3],
            std_per_m: [0.0; 3],
            difference_std_per_m: [0.0; 2],
            over_time: vec![([0.0; 3], [0.0; 3]); weights.len()],
            exponent: exponent.map(|i| estimated.combination(&[(i, 1.0)])),
            backscatter: self.terms.backscatter.as_ref().map(|term| (term.state, [0.0; 3])),
            log_daylight: self.terms.daylight.as_ref().map(|t| (t.log_strength, [0.0; 3])),
            beam: self.terms.beam.by_node(estimated.values),
            tracks: self.ends.len(),
            observations: self.equations.len(),
            residual: solution.residual,
            systematic: self.systematic(solution),
            path_spread_m: self.path_spread_m(),
        };
        for b in 0..self.setup.bands {
            (answer.attenuation_per_m[b], answer.std_per_m[b]) =
                estimated.combination(&mean(b, 1.0));
            for (k, of_node) in answer.over_time.iter_mut().enumerate() {
                (of_node.0[b], of_node.1[b]) = estimated.combination(&[(node(b, k), 1.0)]);
            }
            if let Some((_, std)) = &mut answer.backscatter {
                let unknown = self.terms.first_backscatter() + b;
                std[b] = estimated.combination(&[(unknown, 1.0)]).1;
            }
            if let Some((_, std)) = &mut answer.log_daylight {
                std[b] = estimated.combination(&[(self.terms.first_daylight() + b, 1.0)]).1;
            }
        }
        for b in 0..self.setup.bands.saturating_sub(1) {
            let difference = [mean(b, 1.0), mean(b + 1, -1.0)].concat();
            answer.difference_std_per_m[b] = estimated.combination(&difference).1;
        }
        Some(answer)
    }

    /// Robust spread of the mean residuals of regions of frames, less what noise gives them.
    fn systematic(&self, solution: &Solution) -> f64 {
        let list = self.terms.list();
        let residuals = self.system(&list).residuals(solution.values.as_slice());
        let count = self.setup.grid.count;
        let region = |e: &Equation| {
            let node = e.path.nodes[0].0;
            (e.frame, node / count / NODES_PER_REGION, node % count / NODES_PER_REGION)
        };
        let mut regions: BTreeMap<_, Vec<f64>> = BTreeMap::new();
        for (equation, residual) in self.equations.iter().zip(&residuals) {
            let mean = residual[..self.setup.bands].iter().sum::<f64>() / self.setup.bands as f64;
            regions.entry(region(equation)).or_default().push(mean);
        }
        let of_region = |values: &Vec<f64>| {
            let middle = stats::median(values);
            let around: Vec<f64> = values.iter().map(|v| v - middle).collect();
            // The median of n values is this much less certain than their mean.
            (middle, 1.25 * stats::robust_std(&around) / (values.len() as f64).sqrt())
        };
        let full = regions.values().filter(|values| values.len() >= MIN_IN_REGION);
        let (middles, noises): (Vec<f64>, Vec<f64>) = full.map(of_region).unzip();
        if middles.len() < MIN_REGIONS {
            return 0.0;
        }
        let by_noise = stats::median(&noises);
        (stats::robust_std(&middles).powi(2) - by_noise.powi(2)).max(0.0).sqrt()
    }

    fn path_spread_m(&self) -> f64 {
        let list = self.terms.list();
        let length_m = |i: usize| self.equations[i].path.length_m;
        let mut sum = 0.0;
        for track in self.system(&list).tracks() {
            let mean = track.clone().map(length_m).sum::<f64>() / track.len() as f64;
            sum += track.map(|i| (length_m(i) - mean).powi(2)).sum::<f64>();
        }
        (sum / self.equations.len().max(1) as f64).sqrt()
    }
}
