//! Robust statistics. Values that are not finite are ignored.

/// Ratio of standard deviation to median absolute deviation of a normal distribution.
const STD_PER_MAD: f64 = 1.4826;

/// Median, the upper of the two middle values for an even number; NaN without values.
pub fn median(values: &[f64]) -> f64 {
    quantile(values, 0.5)
}

/// Quantile, its rank rounded to the nearest; NaN without values.
pub fn quantile(values: &[f64], share: f64) -> f64 {
    select(values, |last| (last * share).round())
}

/// Quantile, its rank rounded down; NaN without values.
pub fn lower_quantile(values: &[f64], share: f64) -> f64 {
    select(values, |last| last * share)
}

/// The value of a rank, given the last one.
fn select(values: &[f64], rank: impl Fn(f64) -> f64) -> f64 {
    let mut finite: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    let Some(last) = finite.len().checked_sub(1) else { return f64::NAN };
    *finite.select_nth_unstable_by(rank(last as f64) as usize, f64::total_cmp).1
}

/// Mean of absolute values; 0 without values.
pub fn mean_absolute(values: &[f64]) -> f64 {
    values.iter().map(|v| v.abs()).sum::<f64>() / values.len().max(1) as f64
}

/// Robust standard deviation of residuals about 0: 1.4826 × their median absolute value.
pub fn robust_std(residuals: &[f64]) -> f64 {
    let absolute: Vec<f64> = residuals.iter().map(|e| e.abs()).collect();
    (STD_PER_MAD * median(&absolute)).max(1e-9)
}

/// Squared Cauchy weight of a residual, 0 to 1; the square suppresses large outliers.
pub fn cauchy_weight(residual: f64, scale: f64) -> f64 {
    let x = residual / (2.0 * scale);
    (1.0 + x * x).powi(-2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_and_spread() {
        let values = [4.0, f64::NAN, 1.0, 3.0, 2.0];
        assert!(median(&values) == 3.0 && median(&[]).is_nan());
        assert_eq!((quantile(&values, 0.9), lower_quantile(&values, 0.9)), (4.0, 3.0));
        assert!((robust_std(&[1.0, -1.0, 100.0]) - 1.4826).abs() < 1e-12);
    }
}
