//! What a model leaves of the light of points that several frames show, by place in the image and
//! slant range ([`RegionLight`]): whatever lamps light the seafloor, they move with the camera.
//!
//! The log reflectance ρ of a point is a random effect, eliminated in closed form: the mean of all
//! points holds what overlap does not determine. a, b and n are smooth over the image and small.
//! Each band is a linear problem of its own.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};

use super::methods::empirical::rounded;
use crate::image::Bands;
use crate::model::{ImageGrid, RegionLight};
use crate::parallel::par_map;
use crate::stats;

/// Most regions across, and down.
const COLUMNS: usize = 14;
const ROWS: usize = 10;
/// a, b (1/m) and n of a region.
const PARAMETERS: usize = 3;
/// Standard deviations of their second differences between regions, and of their means.
const SMOOTH: [f64; PARAMETERS] = [0.05, 0.1, 0.2];
const SIZE: [f64; PARAMETERS] = [1.0, 0.5, 0.5];
/// Rounds of the reweighted solve.
pub const ROUNDS: usize = 4;
/// Smallest spreads of views of a point, and of points (log light).
const MIN_SPREAD: f64 = 0.004;
const MIN_SPREAD_OF_POINTS: f64 = 0.05;
/// Independent pieces of seafloor in a frame.
const INDEPENDENT: f64 = 20.0;
/// Fewest points.
const MIN_POINTS: usize = 200;

/// A point in one frame.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// x/z and y/z in the image plane
    pub place: (f64, f64),
    /// ℓ_s (m)
    pub range_m: f64,
    /// log light over that of the model, per band
    pub log_ratio: Bands,
}

/// Residual light and how well it explains views.
#[derive(Clone, Debug)]
pub struct ResidualFit {
    /// the light
    pub light: RegionLight,
    /// robust spread of views about their point that it leaves (log light), largest of the bands
    pub spread: f64,
}

/// One view as a row of the linear problem.
struct Row {
    nodes: [(usize, f64); 16],
    by_parameter: [f64; PARAMETERS],
    log_ratio: Bands,
}

impl Row {
    /// Derivatives by the unknowns, in their order.
    fn entries(&self) -> impl Iterator<Item = (usize, f64)> {
        let Self { nodes, by_parameter, .. } = *self;
        let of_node = move |(node, weight): (usize, f64)| {
            (0..PARAMETERS).map(move |k| (PARAMETERS * node + k, weight * by_parameter[k]))
        };
        nodes.into_iter().filter(|(_, weight)| *weight != 0.0).flat_map(of_node)
    }
}

/// The problem of all bands.
struct Problem {
    rows: Vec<Row>,
    /// rows of each point
    points: Vec<Range<usize>>,
    /// points that stand for one independent piece of seafloor
    together: f64,
    grid: ImageGrid,
}

/// The residual light of points, each with its views in `frames` frames, by up to [`ROUNDS`]
/// rounds; `None` where they are too few.
pub fn fit(
    points: &[Vec<View>],
    frames: usize,
    bands: usize,
    rounds: usize,
) -> Option<ResidualFit> {
    let views = || points.iter().filter(|p| p.len() > 1).flatten();
    let ranges: Vec<f64> = views().map(|v| v.range_m).collect();
    let reference_m = stats::median(&ranges);
    let extent = |of: &dyn Fn(&View) -> f64| {
        let widen = |[from, to]: [f64; 2], v: f64| [from.min(v), to.max(v)];
        views().map(of).fold([f64::INFINITY, f64::NEG_INFINITY], widen).map(rounded)
    };
    let (x, y) = (extent(&|v| v.place.0), extent(&|v| v.place.1));
    let is_enough = points.iter().filter(|p| p.len() > 1).count() >= MIN_POINTS;
    if !is_enough || x[1] <= x[0] || y[1] <= y[0] || reference_m <= 0.0 {
        return None;
    }
    let mut light = RegionLight {
        grid: ImageGrid { x, y, columns: COLUMNS, rows: ROWS },
        reference_m: rounded(reference_m),
        range_m: extent(&|v| v.range_m),
        log_level: Vec::new(),
        slope_per_m: Vec::new(),
        exponent: Vec::new(),
    };
    let problem = Problem::new(points, &light, frames);
    let solved = par_map((0..bands).collect(), |b| problem.solve(b, rounds));
    let solved: Vec<(Vec<f64>, f64)> = solved.into_iter().collect::<Option<_>>()?;
    let parts = [&mut light.log_level, &mut light.slope_per_m, &mut light.exponent];
    for (k, part) in parts.into_iter().enumerate() {
        let of_band = |(values, _): &(Vec<f64>, f64)| {
            values.iter().skip(k).step_by(PARAMETERS).map(|v| rounded(*v)).collect()
        };
        *part = solved.iter().map(of_band).collect();
    }
    let spread = solved.iter().map(|(_, spread)| *spread).fold(0.0, f64::max);
    Some(ResidualFit { light, spread })
}

impl Problem {
    fn new(points: &[Vec<View>], model: &RegionLight, frames: usize) -> Self {
        let row = |view: &View| Row {
            nodes: model.grid.around(view.place.0, view.place.1),
            by_parameter: model.derivatives(view.range_m),
            log_ratio: view.log_ratio,
        };
        let (mut rows, mut ranges) = (Vec::new(), Vec::new());
        for point in points.iter().filter(|p| p.len() > 1) {
            ranges.push(rows.len()..rows.len() + point.len());
            rows.extend(point.iter().map(row));
        }
        let together = (ranges.len() as f64 / (INDEPENDENT * frames as f64)).max(1.0);
        Self { rows, points: ranges, together, grid: model.grid }
    }

    fn unknowns(&self) -> usize {
        PARAMETERS * self.grid.columns * self.grid.rows
    }

    /// The values of a band, and the spread of views that they leave.
    fn solve(&self, band: usize, rounds: usize) -> Option<(Vec<f64>, f64)> {
        let mut off: Vec<f64> = self.rows.iter().map(|row| row.log_ratio[band]).collect();
        let mut values = DVector::zeros(self.unknowns());
        for _ in 0..rounds {
            let (normal, right) = self.system(band, &off);
            values = normal.cholesky()?.solve(&right);
            let predicted = |row: &Row| row.entries().map(|(i, by)| by * values[i]).sum::<f64>();
            off = self.rows.iter().map(|row| row.log_ratio[band] - predicted(row)).collect();
        }
        Some((values.as_slice().to_vec(), self.spreads(&off).0))
    }

    /// Robust spread of what is left of views about their point, and of points.
    fn spreads(&self, off: &[f64]) -> (f64, f64) {
        let (mut within, mut between) = (Vec::new(), Vec::new());
        for point in &self.points {
            let seen = &off[point.clone()];
            let mean = seen.iter().sum::<f64>() / seen.len() as f64;
            within.extend(seen.iter().map(|v| v - mean));
            between.push(mean);
        }
        let middle = stats::median(&between);
        between.iter_mut().for_each(|v| *v -= middle);
        let (within, between) = (stats::robust_std(&within), stats::robust_std(&between));
        (within.max(MIN_SPREAD), between.max(MIN_SPREAD_OF_POINTS))
    }

    /// Normal equations of a band, their lower triangle, weights by what a solution leaves. Of a
    /// point with the diagonal weights W they are W − W 1 1ᵀ W / (Σ w + 1 / σ²), where σ is the
    /// spread of points.
    fn system(&self, band: usize, off: &[f64]) -> (DMatrix<f64>, DVector<f64>) {
        let (spread, spread_of_points) = self.spreads(off);
        let prior = 1.0 / (spread_of_points.powi(2) * self.together);
        let mut normal = DMatrix::zeros(self.unknowns(), self.unknowns());
        let mut right = DVector::zeros(self.unknowns());
        // Σ w x of a point, and the unknowns in it.
        let mut sum = vec![0.0; self.unknowns()];
        let mut touched: Vec<usize> = Vec::new();
        for point in &self.points {
            let middle = stats::median(&off[point.clone()]);
            let (mut total, mut sum_of_light) = (prior, 0.0);
            for i in point.clone() {
                let light = self.rows[i].log_ratio[band];
                let weight = stats::cauchy_weight(off[i] - middle, spread) / spread.powi(2);
                let entries: Vec<(usize, f64)> = self.rows[i].entries().collect();
                add_product(&mut normal, &entries, weight);
                for (a, by_a) in entries {
                    right[a] += weight * by_a * light;
                    sum[a] += weight * by_a;
                    touched.push(a);
                }
                total += weight;
                sum_of_light += weight * light;
            }
            touched.sort_unstable();
            touched.dedup();
            let of_point: Vec<(usize, f64)> =
                touched.drain(..).map(|a| (a, std::mem::take(&mut sum[a]))).collect();
            of_point.iter().for_each(|(a, by_a)| right[*a] -= by_a * sum_of_light / total);
            add_product(&mut normal, &of_point, -1.0 / total);
        }
        self.add_priors(&mut normal);
        (normal, right)
    }

    /// Small second differences between neighbouring regions, and a small mean.
    fn add_priors(&self, normal: &mut DMatrix<f64>) {
        let ImageGrid { columns, rows, .. } = self.grid;
        let regions = columns * rows;
        for k in 0..PARAMETERS {
            let at = |region: usize| PARAMETERS * region + k;
            for region in 0..regions {
                normal[(at(region), at(region))] += SIZE[k].powi(-2) / regions as f64;
                let along = (region % columns + 2 < columns).then_some(1);
                let down = (region / columns + 2 < rows).then_some(columns);
                for step in along.into_iter().chain(down) {
                    let bend = [(region, 1.0), (region + step, -2.0), (region + 2 * step, 1.0)];
                    add_product(normal, &bend.map(|(r, by)| (at(r), by)), SMOOTH[k].powi(-2));
                }
            }
        }
    }
}

/// Adds weight · x xᵀ to the lower triangle, of entries in the order of the unknowns.
fn add_product(normal: &mut DMatrix<f64>, x: &[(usize, f64)], weight: f64) {
    debug_assert!(x.is_sorted_by_key(|(unknown, _)| *unknown));
    let rows = normal.nrows();
    for (k, (b, by_b)) in x.iter().enumerate() {
        let column = &mut normal.as_mut_slice()[b * rows..(b + 1) * rows];
        x[k..].iter().for_each(|(a, by_a)| column[*a] += weight * by_b * by_a);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points of uneven seafloor, each seen from four places and heights, under light that a model
    /// leaves.
    fn points(left: impl Fn(f64, f64, f64) -> f64) -> Vec<Vec<View>> {
        let unit = |k: usize, step: f64| (k as f64 * step).fract();
        let point = |p: usize| {
            let log_reflectance = 0.6 * (unit(p, 0.618_034) - 0.5);
            let view = |k: usize| {
                let place = (unit(7 * p + k, 0.754_878) - 0.5, unit(5 * p + k, 0.569_84) - 0.5);
                let range_m = 1.5 + 1.5 * unit(3 * p + k, 0.381_966);
                let light = log_reflectance + left(place.0, place.1, range_m);
                View { place, range_m, log_ratio: [light, light + 0.1, light - 0.1] }
            };
            (0..4).map(view).collect()
        };
        (0..1200).map(point).collect()
    }

    fn worst(fit: &ResidualFit, left: impl Fn(f64, f64, f64) -> f64) -> f64 {
        let off = |k: usize| {
            let (x, y) = ((k % 9) as f64 * 0.1 - 0.4, (k / 9 % 9) as f64 * 0.1 - 0.4);
            let range_m = 1.6 + (k / 81) as f64 * 0.4;
            fit.light.log_light(x, y, range_m)[0] - left(x, y, range_m)
        };
        let all: Vec<f64> = (0..324).map(off).collect();
        let middle = stats::median(&all);
        all.into_iter().map(|v| (v - middle).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn light_that_is_left_comes_back_and_none_stays_none() {
        let lamp = |x: f64, y: f64, range_m: f64| {
            let beside = x - 0.6 / range_m;
            -2.0 * (beside * beside + y * y) - 0.4 * (range_m - 2.0)
        };
        let fitted = fit(&points(lamp), 40, 3, ROUNDS).expect("enough points");
        assert!(worst(&fitted, lamp) < 0.03 && fitted.spread < 0.01, "{}", worst(&fitted, lamp));
        let none = |_: f64, _: f64, _: f64| 0.0;
        let fitted = fit(&points(none), 40, 3, ROUNDS).expect("enough points");
        assert!(worst(&fitted, none) < 0.01, "{}", worst(&fitted, none));
        assert!(fit(&points(none)[..100], 40, 3, ROUNDS).is_none());
    }
}
