//! Robust statistics the estimators share: a spread that strays do not move, and the weight of a
//! misfit.

/// Median of values; NaN for none. Reorders nothing of the caller's.
pub fn median(values: &[f64]) -> f64 {
    quantile(values, 0.5)
}

/// A quantile by nearest rank; NaN for none.
pub fn quantile(values: &[f64], share: f64) -> f64 {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    if sorted.is_empty() {
        return f64::NAN;
    }
    let index = ((sorted.len() - 1) as f64 * share).round() as usize;
    *sorted.select_nth_unstable_by(index, f64::total_cmp).1
}

/// Mean of absolute values; 0 for none.
pub fn mean_size(values: &[f64]) -> f64 {
    values.iter().map(|v| v.abs()).sum::<f64>() / values.len().max(1) as f64
}

/// Standard deviation of the well-behaved part, from absolute misfits: 1.4826 × their median.
pub fn scale(misfits: &[f64]) -> f64 {
    let absolute: Vec<f64> = misfits.iter().map(|e| e.abs()).collect();
    (1.4826 * median(&absolute)).max(1e-9)
}

/// Cauchy's weight, squared so that far strays all but vanish.
pub fn cauchy(misfit: f64, scale: f64) -> f64 {
    let x = misfit / (2.0 * scale);
    (1.0 + x * x).powi(-2)
}
