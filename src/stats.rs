//! Robust statistics, which ignore values that are not finite, and the slope of a line.

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

/// Slope of y over x by least squares, and its standard deviation by what is left, of points
/// (x, y, weight); `None` where x does not vary or there are fewer than three points.
pub fn slope(points: &[(f64, f64, f64)]) -> Option<(f64, f64)> {
    let total: f64 = points.iter().map(|p| p.2).sum();
    let mean_x = points.iter().map(|(x, _, w)| w * x).sum::<f64>() / total;
    let mean_y = points.iter().map(|(_, y, w)| w * y).sum::<f64>() / total;
    let centred = || points.iter().map(|(x, y, w)| (x - mean_x, y - mean_y, w));
    let spread: f64 = centred().map(|(x, _, w)| w * x * x).sum();
    let slope = centred().map(|(x, y, w)| w * x * y).sum::<f64>() / spread;
    let left: f64 = centred().map(|(x, y, w)| w * (y - slope * x).powi(2)).sum();
    let is_known = points.len() > 2 && spread > 0.0;
    is_known.then(|| (slope, (left / (points.len() - 2) as f64 / spread).sqrt()))
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
    fn a_line_has_its_slope_and_its_spread_the_standard_deviation() {
        let points = [(1.0, 2.0, 1.0), (2.0, 4.0, 3.0), (4.0, 8.0, 0.5)];
        let (exact, std) = slope(&points).expect("a slope");
        assert!((exact - 2.0).abs() < 1e-12 && std < 1e-12, "{exact} ± {std}");
        // Residuals of a, -2a, a over x = -1, 0, 1: s² = 6 a², over Σ x² = 2.
        let (bent, std) =
            slope(&[(-1.0, 0.9, 1.0), (0.0, 0.8, 1.0), (1.0, 1.1, 1.0)]).expect("a slope");
        let a = (0.9 + 1.1 - 2.0 * 0.8) / 6.0;
        assert!((bent - 0.1).abs() < 1e-12 && (std - a * 3f64.sqrt()).abs() < 1e-12, "{std}");
        assert_eq!(slope(&[(1.0, 0.1, 1.0), (1.0, 0.2, 1.0), (1.0, 0.3, 1.0)]), None);
        assert_eq!(slope(&points[..2]), None);
    }

    #[test]
    fn quantiles_and_spread() {
        let values = [4.0, f64::NAN, 1.0, 3.0, 2.0];
        assert!(median(&values) == 3.0 && median(&[]).is_nan());
        assert_eq!((quantile(&values, 0.9), lower_quantile(&values, 0.9)), (4.0, 3.0));
        assert!((robust_std(&[1.0, -1.0, 100.0]) - 1.4826).abs() < 1e-12);
    }
}
