//! Robust weights (Cauchy): residuals are measured against the spread of equally bright
//! observations, as a band's noise grows when light gets less.

use super::equation::Equation;
use crate::image::Bands;
use crate::stats;

/// Brightness classes of the noise.
const NOISE_CLASSES: usize = 6;
/// Fewest observations of a class.
const MIN_CLASS: usize = 30;
/// A class has at least this share of the overall spread.
const MIN_CLASS_SPREAD: f64 = 0.2;

/// Weights of y from residuals of log c, and the overall robust spread (log light).
pub fn reweight(equations: &[Equation], residuals: &[Bands], bands: usize) -> (Vec<Bands>, f64) {
    let all: Vec<f64> = residuals.iter().flat_map(|r| r[..bands].iter().copied()).collect();
    let spread = stats::robust_std(&all);
    let spreads = class_spreads(equations, residuals, bands, spread);
    let weights = equations.iter().zip(residuals).zip(&spreads).map(|((equation, r), of_class)| {
        // A false match is false in all bands: the robust factor is shared.
        let common =
            ((0..bands).map(|b| (r[b] / of_class[b]).powi(2)).sum::<f64>() / bands as f64).sqrt();
        let trust = stats::cauchy_weight(common, 1.0);
        std::array::from_fn(|b| {
            let share = equation.reading.direct_share[b];
            if b < bands { trust * (spread / of_class[b] * share).powi(2) } else { 0.0 }
        })
    });
    (weights.collect(), spread)
}

/// Spread of the brightness class of every equation, by band. Classes go by expected light: sorted
/// by its own noise, dim light that happens to be brighter would weigh more, and α come out too
/// small (by 0.0001 per metre in the red of rendered dives).
fn class_spreads(
    equations: &[Equation],
    residuals: &[Bands],
    bands: usize,
    spread: f64,
) -> Vec<Bands> {
    let count = equations.len();
    let mut spreads = vec![[spread; 3]; count];
    for b in 0..bands {
        let expected = |i: usize| f64::from(equations[i].reading.log_color[b]) - residuals[i][b];
        let mut order: Vec<(f64, usize)> = (0..count).map(|i| (expected(i), i)).collect();
        let size = count.div_ceil(NOISE_CLASSES).max(MIN_CLASS);
        // Only what belongs together is wanted, not an order within.
        for start in (size..count).step_by(size) {
            order[start - size..]
                .select_nth_unstable_by(size, |x, y| x.0.total_cmp(&y.0).then(x.1.cmp(&y.1)));
        }
        for class in order.chunks(size) {
            let of_class: Vec<f64> = class.iter().map(|(_, i)| residuals[*i][b]).collect();
            let of_class = stats::robust_std(&of_class).max(MIN_CLASS_SPREAD * spread);
            class.iter().for_each(|(_, i)| spreads[*i][b] = of_class);
        }
    }
    spreads
}
