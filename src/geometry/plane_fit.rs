//! Least-squares plane through DVL returns, with outlier rejection (paper §IV-A).
//!
//! ```text
//! h = a u + b v + c + e t + f t²    heights h along the beams' mean axis, t = ping − frame
//! ```
//!
//! The height of the plane may change and curve over time: without the curvature term α is off by
//! +0.002 per metre where a vehicle moves up and down in 24 s. Without attitude the slopes may
//! change too. Normal equations in centred coordinates: as accurate as SVD on the symmetric
//! four-beam layout, and faster. A return that the others contradict (a multipath echo, a fish) is
//! an outlier and left out.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Vector3};

use super::plane::{SeafloorPlane, Support};
use crate::coordinates::Direction;
use crate::stats::{median, robust_std};

/// An outlier differs from the fit of the others by more than this share of the height, …
const OUTLIER_SHARE: f64 = 0.15;
/// … and by more than this many robust standard deviations.
const OUTLIER_STDS: f64 = 6.0;
/// Maximum outliers, as a share of the returns and in number; if there are more, they are seafloor.
const MAX_OUTLIERS: (f64, usize) = (0.25, 16);
/// The shorter axis of the returns' ellipse is at least this share of the longer one; otherwise the
/// slope across it is not determined.
const MIN_AXIS_RATIO: f64 = 0.15;

/// A return in body space at the frame's time (m).
pub struct Return {
    pub at: Vector3<f64>,
    /// time of the ping minus time of the frame (s)
    pub offset_s: f64,
}

/// Distance at the frame's time from (distance (m), time offset (s)) of pings, and the root mean
/// square residual (m). `None` where pings do not lie on both sides of the frame: there is no
/// extrapolation. Linear in time for two pings or more; quadratic for five or more, as a vehicle in
/// swell would otherwise be off by centimetres.
pub fn distance_at_frame(distances: &[(f64, f64)]) -> Option<(f64, f64)> {
    let is_bracketed = distances.iter().any(|d| d.1 <= 0.0) && distances.iter().any(|d| d.1 >= 0.0);
    let mut times: Vec<f64> = distances.iter().map(|d| d.1).collect();
    times.dedup();
    let powers = if times.len() >= 5 { 3 } else { 2 };
    if !is_bracketed || times.len() < 2 {
        return None;
    }
    let design = DMatrix::from_fn(distances.len(), powers, |i, j| distances[i].1.powi(j as i32));
    let observed = DVector::from_iterator(distances.len(), distances.iter().map(|d| d.0));
    let typical = median(&distances.iter().map(|d| d.0.abs()).collect::<Vec<_>>());
    let fit = LeastSquares::rejecting_outliers(&design, &observed, typical)?;
    Some((fit.solution[0], fit.residual_m))
}

/// Linear least squares over heights.
struct LeastSquares {
    solution: DVector<f64>,
    /// one per height, outliers included (m)
    residuals: DVector<f64>,
    /// root mean square residual (m); NaN without redundancy
    residual_m: f64,
    /// number of heights used
    used: usize,
}

impl LeastSquares {
    /// Solves over all rows except `excluded`.
    fn new(
        design: &DMatrix<f64>,
        heights: &DVector<f64>,
        excluded: &[usize],
    ) -> Option<(Self, Cholesky<f64, Dyn>)> {
        let (mut normal, mut right) = (design.transpose() * design, design.transpose() * heights);
        for i in excluded {
            let row = design.row(*i).transpose();
            normal -= &row * row.transpose();
            right -= row * heights[*i];
        }
        let normal = normal.cholesky()?;
        let solution = normal.solve(&right);
        let residuals = heights - design * &solution;
        let used = heights.len() - excluded.len();
        let squares: f64 =
            residuals.norm_squared() - excluded.iter().map(|i| residuals[*i].powi(2)).sum::<f64>();
        let redundancy = used.saturating_sub(design.ncols());
        let residual_m =
            if redundancy > 0 { (squares.max(0.0) / redundancy as f64).sqrt() } else { f64::NAN };
        Some((Self { solution, residuals, residual_m, used }, normal))
    }

    /// Solves without outliers, removed one by one, largest first. `height_m` is the scale of
    /// [`OUTLIER_SHARE`].
    fn rejecting_outliers(
        design: &DMatrix<f64>,
        heights: &DVector<f64>,
        height_m: f64,
    ) -> Option<Self> {
        let mut excluded: Vec<usize> = Vec::new();
        let mut current = Self::new(design, heights, &[])?;
        let mut accepted = 0;
        // Residual of a height against the fit of all others (leave-one-out).
        let leave_one_out = |(fit, normal): &(Self, Cholesky<f64, Dyn>), i: usize| {
            let row = design.row(i).transpose();
            fit.residuals[i].abs() / (1.0 - row.dot(&normal.solve(&row))).max(1e-6)
        };
        let max = MAX_OUTLIERS.1.min((heights.len() as f64 * MAX_OUTLIERS.0) as usize);
        // With a redundancy below two the others do not determine which one is wrong.
        while excluded.len() < max && current.0.used >= design.ncols() + 2 {
            let mut kept: Vec<(f64, usize)> = (0..heights.len())
                .filter(|i| !excluded.contains(i))
                .map(|i| (leave_one_out(&current, i), i))
                .collect();
            kept.sort_by(|a, b| b.0.total_cmp(&a.0));
            let (worst_m, worst) = kept[0];
            if worst_m < OUTLIER_SHARE * height_m {
                break;
            }
            excluded.push(worst);
            let Some(without) = Self::new(design, heights, &excluded) else { break };
            // One outlier may mask another: all are judged by the fit without any of them.
            let others: Vec<f64> =
                kept[1..].iter().map(|(_, i)| without.0.residuals[*i].abs()).collect();
            let limit_m = (OUTLIER_SHARE * height_m).max(OUTLIER_STDS * robust_std(&others));
            let are_outliers = excluded.iter().all(|i| without.0.residuals[*i].abs() > limit_m);
            // The fit without another height instead must not be as good: of two heights that
            // contradict each other, either may be wrong.
            let fits_as_well = |rival: &(f64, usize)| {
                let instead: Vec<usize> =
                    excluded.iter().copied().filter(|i| *i != worst).chain([rival.1]).collect();
                Self::new(design, heights, &instead).is_some_and(|(fit, _)| {
                    fit.residual_m < 2.0 * without.0.residual_m + 0.01 * height_m
                })
            };
            let is_unique = !kept[1..]
                .iter()
                .take_while(|rival| rival.0 > OUTLIER_SHARE * height_m)
                .any(fits_as_well);
            current = without;
            if are_outliers && is_unique {
                accepted = excluded.len();
            }
        }
        Self::new(design, heights, &excluded[..accepted]).map(|(fit, _)| fit)
    }
}

/// A return relative to the centroid: u and v perpendicular to the beams' mean axis, height along
/// it (m), time offset (s).
type Local = [f64; 4];
/// Derivative of the height with respect to one parameter.
type Column = fn(&Local) -> f64;

/// Parameters that the returns determine; `is_rotated`: attitude has been applied.
fn columns(returns: &[Return], is_rotated: bool) -> &'static [Column] {
    let mut times: Vec<f64> = returns.iter().map(|r| r.offset_s).collect();
    times.dedup();
    let is_bracketed = times.iter().any(|t| *t <= 0.0) && times.iter().any(|t| *t >= 0.0);
    match (times.len(), is_rotated) {
        (1, _) => &[|_| 1.0, |p| p[0], |p| p[1]],
        _ if !is_bracketed => &[|_| 1.0, |p| p[0], |p| p[1]],
        (5.., true) if returns.len() >= 12 => {
            &[|_| 1.0, |p| p[0], |p| p[1], |p| p[3], |p| p[3] * p[3]]
        }
        (2.., true) if returns.len() >= 5 => &[|_| 1.0, |p| p[0], |p| p[1], |p| p[3]],
        (3.., false) if returns.len() >= 10 => {
            &[|_| 1.0, |p| p[0], |p| p[1], |p| p[3], |p| p[0] * p[3], |p| p[1] * p[3]]
        }
        (2.., false) if returns.len() >= 6 => &[|_| 1.0, |p| p[0], |p| p[1], |p| p[3]],
        _ => &[|_| 1.0, |p| p[0], |p| p[1]],
    }
}

/// The plane through the returns; `None` where they do not determine one. `axis` is the beams' mean
/// direction; `is_rotated`: attitude has been applied.
pub fn fit_plane(
    returns: &[Return],
    axis: Vector3<f64>,
    is_rotated: bool,
) -> Option<SeafloorPlane> {
    if returns.len() < 3 {
        return None;
    }
    let u = axis.cross(&if axis.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() }).normalize();
    let v = axis.cross(&u);
    let n = returns.len() as f64;
    let centre = returns.iter().map(|r| r.at).sum::<Vector3<f64>>() / n;
    let local: Vec<Local> = returns
        .iter()
        .map(|r| r.at - centre)
        .zip(returns)
        .map(|(p, r)| [u.dot(&p), v.dot(&p), axis.dot(&p), r.offset_s])
        .collect();
    let (uu, vv, uv) = local.iter().fold((0.0, 0.0, 0.0), |(a, b, c), p| {
        (a + p[0] * p[0] / n, b + p[1] * p[1] / n, c + p[0] * p[1] / n)
    });
    let smaller = ((uu + vv) / 2.0 - (((uu - vv) / 2.0).powi(2) + uv * uv).sqrt()).max(0.0).sqrt();
    let larger = ((uu + vv) / 2.0 + (((uu - vv) / 2.0).powi(2) + uv * uv).sqrt()).sqrt();
    if smaller < MIN_AXIS_RATIO * larger.max(0.1) {
        return None;
    }
    let columns = columns(returns, is_rotated);
    let design = DMatrix::from_fn(local.len(), columns.len(), |i, j| columns[j](&local[i]));
    let heights = DVector::from_iterator(local.len(), local.iter().map(|p| p[2]));
    let along_axis: Vec<f64> = returns.iter().map(|r| axis.dot(&r.at)).collect();
    let fit = LeastSquares::rejecting_outliers(&design, &heights, median(&along_axis))?;
    let (offset, a, b) = (fit.solution[0], fit.solution[1], fit.solution[2]);
    // h = offset + a u + b v  ⇔  (axis − a u − b v)·(x − centre) = offset
    let normal = axis - u * a - v * b;
    let length = normal.norm();
    Some(SeafloorPlane {
        normal: Direction::from_vector(normal)?,
        distance_m: (offset + normal.dot(&centre)) / length,
        support: if local.len() == 3 { Support::Exact } else { Support::LeastSquares },
        returns: fit.used,
        residual_m: fit.residual_m,
        nearest_ping_s: 0.0,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pings of four beams 25° off the axis, over a seafloor 2 m below with a slope of 5°. The
    /// `(ping, beam)` of `doubled` have twice the range.
    fn four_beams(pings: u32, doubled: &[(u32, usize)]) -> Vec<Return> {
        let echo = |ping: u32, beam: usize| {
            let azimuth = std::f64::consts::FRAC_PI_2 * beam as f64 + 0.4;
            let direction = Vector3::new(
                25f64.to_radians().sin() * azimuth.cos(),
                25f64.to_radians().sin() * azimuth.sin(),
                25f64.to_radians().cos(),
            );
            let range_m = 2.0 / (direction.z + 5f64.to_radians().tan() * direction.x);
            let factor = if doubled.contains(&(ping, beam)) { 2.0 } else { 1.0 };
            Return {
                at: direction * range_m * factor,
                offset_s: f64::from(ping) - f64::from(pings) / 2.0 + 0.5,
            }
        };
        (0..pings).flat_map(|ping| (0..4).map(move |beam| echo(ping, beam))).collect()
    }

    #[test]
    fn multipath_echoes_are_rejected() {
        let truth = Vector3::new(5f64.to_radians().tan(), 0.0, 1.0).normalize();
        let tilt_deg = |returns: &[Return]| {
            let plane = fit_plane(returns, Vector3::z(), true).expect("a plane");
            (plane.normal.vector().dot(&truth).min(1.0).acos().to_degrees(), plane.returns)
        };
        for doubled in [&[][..], &[(1, 2)], &[(0, 0)], &[(2, 1), (2, 2)], &[(1, 0), (3, 0)]] {
            let (off_deg, used) = tilt_deg(&four_beams(5, doubled));
            assert!(
                off_deg < 0.01 && used == 20 - doubled.len(),
                "{doubled:?}: off by {off_deg}°, {used} used"
            );
        }
        let three_beams: Vec<Return> = four_beams(2, &[(1, 2)])
            .into_iter()
            .enumerate()
            .filter(|(i, _)| i % 4 != 3)
            .map(|(_, echo)| echo)
            .collect();
        assert_eq!(tilt_deg(&three_beams).1, 6, "an ambiguous outlier is kept");
        let distances: Vec<(f64, f64)> =
            (-4..4).map(|k| (if k == 1 { 4.0 } else { 2.0 }, f64::from(k) * 0.2 + 0.1)).collect();
        let (distance_m, _) = distance_at_frame(&distances).expect("bracketed");
        assert!((distance_m - 2.0).abs() < 1e-9, "{distance_m}");
    }

    /// A vehicle that moves up and down by a metre in twelve seconds, with an altimeter at 8 Hz.
    #[test]
    fn altitude_changes_are_followed() {
        let altitude = |t: f64| 2.4 - (0.52 * t).cos();
        for centre in [0.0, 1.3, 6.0] {
            let pings: Vec<(f64, f64)> = (-8..8)
                .map(|k| 0.06 + f64::from(k) * 0.125)
                .map(|t| (altitude(centre + t), t))
                .collect();
            let (found, _) = distance_at_frame(&pings).expect("bracketed");
            assert!(
                (found - altitude(centre)).abs() < 0.002,
                "{found} at {centre} instead of {}",
                altitude(centre)
            );
        }
        assert!(distance_at_frame(&[(2.0, 0.1), (2.1, 0.2)]).is_none(), "no extrapolation");
    }
}
